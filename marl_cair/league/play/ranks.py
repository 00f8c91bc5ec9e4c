"""The finishing order of a game's teams."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import NO_WINNER

STILL_IN = int(np.iinfo(np.int64).max)  # in `rank_teams`: a seat that has not gone out


def rank_teams(
    winner: NDArray[np.int8], out_since: NDArray[np.int64], team_of_seat: NDArray[np.int64]
) -> NDArray[np.float64]:
    """The rank of each team in N finished games, float64 [N, teams]: 1 is the best.

    The winning team comes first, then who was in when the last decision was made, then who was out,
    the latest first (a team is out with its last seat). Equal teams share the mean of their ranks.

    winner: int8 [N], a seat of the winning team or NO_WINNER. out_since: int64 [N, P], the first
    decision before which a seat was out, or STILL_IN. team_of_seat: int64 [P].
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
