"""Scores by seat and by map, with intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.league.ratings.intervals import block_interval
from marl_cair.league.ratings.rate import Games


class Share(NamedTuple):
    """A share of points with its 95 % interval; `games` is how many it is of."""

    share: float
    low: float
    high: float
    games: int


def find_team_shares(num_agents: int, games: Games) -> dict[tuple[int, int], Share]:
    """What each agent scores in each team's seats, by (agent, team); repeats are not counted."""
    games = games.count_once()
    teams = np.broadcast_to(np.arange(games.agents.shape[1]), games.agents.shape)
    return _group(games, (games.agents, teams))


def find_map_shares(games: Games, maps: Sequence[str]) -> dict[tuple[int, str], Share]:
    """What each agent scores on each map, by (agent, map); maps: of all N games."""
    names, numbers = np.unique(np.array(maps, np.str_), return_inverse=True)
    counted = games.count_once()
    played = np.broadcast_to(numbers[~games.is_repeat, None], counted.agents.shape)
    found = _group(counted, (counted.agents, played))
    return {(agent, str(names[number])): share for (agent, number), share in found.items()}


def _group(
    games: Games, keys: tuple[NDArray[np.int64], NDArray[np.int64]]
) -> dict[tuple[int, int], Share]:
    """Shares by both keys [N, T]; their intervals are from the spread between blocks."""
    if not games.agents.size:
        return {}
    own, other = (key.ravel() for key in keys)
    blocks = np.repeat(games.blocks, games.agents.shape[1])
    points = games.points.ravel()
    order = np.lexsort((blocks, other, own))
    own, other, blocks, points = own[order], other[order], blocks[order], points[order]
    is_new_group = (np.diff(own, prepend=-1) != 0) | (np.diff(other, prepend=-1) != 0)
    is_new_block = is_new_group | (np.diff(blocks, prepend=-1) != 0)
    starts = np.flatnonzero(is_new_block)
    sizes = np.diff(starts, append=len(points))
    means = np.add.reduceat(points, starts) / sizes
    firsts = np.flatnonzero(is_new_group[starts])  # the first block of each group
    found = {}
    for first, last in zip(firsts, [*firsts[1:].tolist(), len(starts)], strict=True):
        num_games = int(sizes[first:last].sum())
        at = starts[first]
        share = float(points[at : at + num_games].mean())
        low, high = block_interval(means[first:last], num_games / (last - first))
        key = int(own[at]), int(other[at])
        found[key] = Share(share, min(low, share), max(high, share), num_games)
    return found
