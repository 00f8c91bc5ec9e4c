"""What a finished game gives each team: a point to the winners, a draw shared by who is left."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import NO_WINNER


def share_points(
    winner: NDArray[np.int8], was_out: NDArray[np.bool_], team_of_seat: NDArray[np.int64]
) -> NDArray[np.float64]:
    """The points of each team in N finished games, float64 [N, teams]; each row's sum is 1.

    The winning team has the point. Without a winner it is shared evenly by the teams that were
    still in when the last decision was made: who had gone out before has lost.

    winner: int8 [N], a seat of the winning team or NO_WINNER. was_out: bool [N, P], seats that
    were out before the last decision. team_of_seat: int64 [P], as `GameSpec.team_of_seat`.
    """
    num_teams = int(team_of_seat.max()) + 1
    members = team_of_seat[:, None] == np.arange(num_teams)
    is_left = (~was_out).astype(np.int64) @ members.astype(np.int64) > 0
    points: NDArray[np.float64] = is_left / np.maximum(1, is_left.sum(1, keepdims=True))
    decided = np.flatnonzero(winner != NO_WINNER)
    points[decided] = team_of_seat[winner[decided], None] == np.arange(num_teams)
    return points
