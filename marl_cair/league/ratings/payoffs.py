"""The payoff matrix: scores of all pairs of agents, with counts and intervals.

Intervals and resampled matrices are from the Bayesian bootstrap (Rubin 1981, "The Bayesian
Bootstrap") over blocks: each block, the games of a map seed, has a random weight. Two pseudo-blocks
in each pair, one won and one lost, weigh half a block each on the mean: between blocks that are
whole wins and losses this is the posterior of Jeffreys' prior. So a clean sweep has an interval
too, and a pair that never met has nearly all of 0..1.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from marl_cair.league.ratings.rate import TAIL, Games, sort_games

NUM_SAMPLES = 500
_JEFFREYS = 0.5  # blocks that each pseudo-block weighs on the mean
_MAX_NUMBERS = 4_000_000  # weights that are drawn at once


@dataclass(frozen=True)
class PairGames:
    """One row for each two teams of each game, of different agents; N rows.

    Attributes:
        first, second: int64 [N] agents, first < second.
        teams: int64 [N, 2] that the two have played.
        games, blocks: int64 [N].
        scores: float64 [N] of the first: 1 it came in above the second, 0 below, 0.5 level.
    """

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    teams: NDArray[np.int64]
    games: NDArray[np.int64]
    blocks: NDArray[np.int64]
    scores: NDArray[np.float64]


@dataclass(frozen=True)
class Payoffs:
    """What n agents score against each other.

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

    def reorder(self, order: NDArray[np.int64]) -> Payoffs:
        """The same with the agents in another order: int64 [n], who comes first, second, ..."""
        grid = np.ix_(order, order)
        return Payoffs(
            self.points[grid],
            self.counts[grid],
            self.draws[grid],
            self.repeats[grid],
            self.low[grid],
            self.high[grid],
            self.samples[:, order][:, :, order],
        )


def find_payoffs(num_agents: int, games: Games, seed: int = 0) -> Payoffs:
    """The payoff matrix of games as in `ratings.rate`; the same in whatever order they are."""
    repeated = count_points(num_agents, split_pairs(games.select(games.is_repeat)))[1]
    pairs = split_pairs(sort_games(games.count_once()))
    points, counts = count_points(num_agents, pairs)
    draws = np.zeros_like(counts)
    level = pairs.scores == 0.5
    np.add.at(draws, (pairs.first[level], pairs.second[level]), 1)
    samples = _resample(num_agents, pairs, np.random.default_rng(seed))
    shares = find_shares(points, counts)
    low, high = np.quantile(samples, (TAIL, 1.0 - TAIL), axis=0)
    low, high = np.minimum(low, shares), np.maximum(high, shares)
    return Payoffs(points, counts, draws + draws.T, repeated, low, high, samples)


def split_pairs(games: Games) -> PairGames:
    """All pairs of teams of all games, repeats too, in the order of the games."""
    parts = []
    numbers = np.arange(len(games.agents))
    for one, two in combinations(range(games.agents.shape[1]), 2):
        own, other = games.agents[:, one], games.agents[:, two]
        score = (1.0 + np.sign(games.ranks[:, two] - games.ranks[:, one])) / 2.0
        is_turned = own > other
        teams = np.where(is_turned[:, None], (two, one), (one, two))
        first, second = np.minimum(own, other), np.maximum(own, other)
        scores = np.where(is_turned, 1.0 - score, score)
        kept = own != other
        columns: Any = first, second, teams, numbers, games.blocks, scores
        parts.append([column[kept] for column in columns])
    whole: Any = [np.concatenate(column) for column in zip(*parts, strict=True)]
    order = np.argsort(whole[3], kind="stable")
    return PairGames(*(column[order] for column in whole))


def count_points(
    num_agents: int, pairs: PairGames
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points and games of each pair, [n, n] both."""
    points = np.zeros((num_agents, num_agents))
    counts = np.zeros((num_agents, num_agents), np.int64)
    np.add.at(points, (pairs.first, pairs.second), pairs.scores)
    np.add.at(points, (pairs.second, pairs.first), 1.0 - pairs.scores)
    np.add.at(counts, (pairs.first, pairs.second), 1)
    np.add.at(counts, (pairs.second, pairs.first), 1)
    return points, counts


def find_shares(points: NDArray[np.float64], counts: NDArray[np.int64]) -> NDArray[np.float64]:
    """Float64 [n, n] points / counts; 0.5 where nothing was played."""
    return np.where(counts > 0, points / np.maximum(counts, 1), 0.5)


def _resample(num_agents: int, pairs: PairGames, rng: np.random.Generator) -> NDArray[np.float64]:
    """Shares of points [S, n, n] with a random weight for each block: exponential, as normalised
    ones are Rubin's.
    """
    first, second = np.triu_indices(num_agents, 1)
    number = np.zeros((num_agents, num_agents), np.int64)
    number[first, second] = np.arange(len(first))
    columns = number[pairs.first, pairs.second]
    num_blocks = int(pairs.blocks.max()) + 1 if len(pairs.blocks) else 0
    shape = num_blocks, len(first)
    points = csr_array((pairs.scores, (pairs.blocks, columns)), shape=shape)
    counts = csr_array((np.ones(len(columns)), (pairs.blocks, columns)), shape=shape)
    met = np.diff(counts.tocsc().indptr)  # blocks in which the pair has met
    size = counts.sum(axis=0) / np.maximum(met, 1)  # games of one of its blocks
    size = np.where(met > 0, size, 1.0)
    shares = np.empty((NUM_SAMPLES, len(first)))
    step = max(1, _MAX_NUMBERS // max(1, num_blocks))
    for start in range(0, NUM_SAMPLES, step):
        part = slice(start, min(start + step, NUM_SAMPLES))
        weights = rng.standard_exponential((part.stop - start, num_blocks))
        won, lost = size * rng.gamma(_JEFFREYS, size=(2, part.stop - start, len(first)))
        shares[part] = (weights @ points + won) / (weights @ counts + won + lost)
    samples = np.full((NUM_SAMPLES, num_agents, num_agents), 0.5)
    samples[:, first, second] = shares
    samples[:, second, first] = 1.0 - shares
    return samples
