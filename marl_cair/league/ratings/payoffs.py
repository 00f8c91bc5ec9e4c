"""Scores of agents against each other, by seat and by map, with block-bootstrap intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.league.ratings.bootstrap import NUM_SAMPLES, resample_shares
from marl_cair.league.ratings.games import (
    Games,
    count_points,
    find_shares,
    sort_games,
    split_pairs,
)
from marl_cair.league.ratings.intervals import find_ends


class Share(NamedTuple):
    """A share of points with its 95 % interval, and the number of its games."""

    share: float
    low: float
    high: float
    games: int


@dataclass(frozen=True)
class Payoffs:
    """Scores of n agents against each other.

    Attributes:
        points: float64 [n, n], how often the row came in above the column; ties count half.
        counts: int64 [n, n], games of both.
        draws: int64 [n, n], games of both in which they came in level.
        repeats: int64 [n, n], games of both that are the same as another and are not counted.
        low, high: float64 [n, n], 95 % interval of the row's share of points; finite everywhere.
        samples: float64 [S, n, n], resampled shares; row and column add up to 1.
    """

    points: NDArray[np.float64]
    counts: NDArray[np.int64]
    draws: NDArray[np.int64]
    repeats: NDArray[np.int64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    samples: NDArray[np.float64]

    @property
    def shares(self) -> NDArray[np.float64]:
        """Float64 [n, n], as `find_shares`."""
        return find_shares(self.points, self.counts)

    def reorder(self, order: Sequence[int]) -> Payoffs:
        """The same with the agents in another order: the first, the second, ..."""
        grid = np.ix_(order, order)
        return Payoffs(**{name: array[(..., *grid)] for name, array in vars(self).items()})

    def pair(self, row: int, column: int) -> Share | None:
        """Score of the row against the column; None without games."""
        games = int(self.counts[row, column])
        if not games:
            return None
        share = float(self.points[row, column]) / games
        return Share(share, float(self.low[row, column]), float(self.high[row, column]), games)


def find_payoffs(num_agents: int, games: Games, seed: int = 0) -> Payoffs:
    """The payoff matrix of games as in `ratings.rate`; the same in whatever order they are."""
    repeated = count_points(num_agents, split_pairs(games.select(games.is_repeat)))[1]
    pairs = split_pairs(sort_games(games.count_once()))
    points, counts = count_points(num_agents, pairs)
    draws = np.zeros_like(counts)
    level = pairs.scores == 0.5
    np.add.at(draws, (pairs.first[level], pairs.second[level]), 1)
    first, second = np.triu_indices(num_agents, 1)
    number = np.zeros((num_agents, num_agents), np.int64)
    number[first, second] = np.arange(len(first))
    cells, rng = number[pairs.first, pairs.second], np.random.default_rng(seed)
    resampled = resample_shares(pairs.scores, pairs.blocks, cells, len(first), rng, NUM_SAMPLES)
    samples = np.full((len(resampled), num_agents, num_agents), 0.5)
    samples[:, first, second] = resampled
    samples[:, second, first] = 1.0 - resampled
    low, high = find_ends(samples, find_shares(points, counts))
    return Payoffs(points, counts, draws + draws.T, repeated, low, high, samples)


def find_team_shares(games: Games) -> dict[tuple[int, int], Share]:
    """Scores of each agent in each team's seats, by (agent, team); repeats are not counted."""
    return _group_shares(
        games, np.broadcast_to(np.arange(games.agents.shape[1]), games.agents.shape)
    )


def find_map_shares(games: Games, maps: Sequence[str]) -> dict[tuple[int, str], Share]:
    """Scores of each agent on each map, by (agent, map); maps: of all N games."""
    names, numbers = np.unique(np.array(maps, np.str_), return_inverse=True)
    played = np.broadcast_to(numbers.ravel()[:, None], games.agents.shape)
    found = _group_shares(games, played)
    return {(agent, str(names[number])): share for (agent, number), share in found.items()}


def _group_shares(games: Games, keys: NDArray[np.int64]) -> dict[tuple[int, int], Share]:
    """Scores by agent and another key [N, T]."""
    counted = games.count_once()
    groups = np.stack((counted.agents, keys[~games.is_repeat]), 2).reshape(-1, 2)
    unique, cells = np.unique(groups, axis=0, return_inverse=True)
    cells, scores = cells.ravel(), counted.points.ravel()
    blocks = np.repeat(counted.blocks, games.agents.shape[1])
    rng = np.random.default_rng(0)
    samples = resample_shares(scores, blocks, cells, len(unique), rng)
    sizes = np.bincount(cells, minlength=len(unique))
    shares = np.bincount(cells, scores, len(unique)) / sizes
    columns = shares, *find_ends(samples, shares), sizes
    return {
        (agent, key): Share(*row)
        for (agent, key), *row in zip(unique.tolist(), *(c.tolist() for c in columns), strict=True)
    }
