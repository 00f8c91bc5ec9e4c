"""Points and finishing order of the teams of a finished game."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import NO_WINNER

STILL_IN = int(np.iinfo(np.int64).max)  # in `rank_teams`: a seat that is not eliminated


def rank_teams(
    winner: NDArray[np.int8], out_since: NDArray[np.int64], team_of_seat: NDArray[np.int64]
) -> NDArray[np.float64]:
    """The rank of each team in N finished games, float64 [N, teams]: 1 is the best.

    The winning team comes first, then the teams that were in before the last step, then the
    others, the latest to go out first (with its last seat). Equal teams share the mean rank.

    winner: int8 [N], a seat of the winning team or NO_WINNER. out_since: int64 [N, P], the first
    step before which a seat was out, or STILL_IN. team_of_seat: int64 [P].
    """
    num_teams = int(team_of_seat.max()) + 1
    lasted = np.stack(
        [out_since[:, team_of_seat == team].max(1) for team in range(num_teams)], axis=1
    )
    is_winner = np.zeros(lasted.shape, np.bool_)
    decided = np.flatnonzero(winner != NO_WINNER)
    is_winner[decided] = team_of_seat[winner[decided], None] == np.arange(num_teams)
    is_above = (is_winner[:, :, None] & ~is_winner[:, None]) | (
        (is_winner[:, :, None] == is_winner[:, None]) & (lasted[:, :, None] > lasted[:, None])
    )
    ranks: NDArray[np.float64] = (1.0 + num_teams + is_above.sum(1) - is_above.sum(2)) / 2.0
    return ranks


def share_points(
    winner: NDArray[np.int8], was_out: NDArray[np.bool_], team_of_seat: NDArray[np.int64]
) -> NDArray[np.float64]:
    """The points of each team in N finished games, float64 [N, teams]; each row's sum is 1.

    The winning team has the point. Without a winner it is shared evenly by the teams that were in
    before the last step; teams that had gone out have lost.

    winner: int8 [N], a seat of the winning team or NO_WINNER. was_out: bool [N, P], seats that
    were out before the last step. team_of_seat: int64 [P], as `GameSpec.team_of_seat`.
    """
    num_teams = int(team_of_seat.max()) + 1
    members = team_of_seat[:, None] == np.arange(num_teams)
    is_left = (~was_out).astype(np.int64) @ members.astype(np.int64) > 0
    points: NDArray[np.float64] = is_left / np.maximum(1, is_left.sum(1, keepdims=True))
    decided = np.flatnonzero(winner != NO_WINNER)
    points[decided] = team_of_seat[winner[decided], None] == np.arange(num_teams)
    return points
