"""Ratings from stored results: Bradley-Terry by choix on the Elo scale, intervals by bootstrap."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import choix
import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.stats import binomtest

ELO_PER_LOGIT = 400.0 / math.log(10.0)
CONFIDENCE = 0.95
NUM_BOOTSTRAPS = 500
# A weak pull of all ratings towards each other: keeps an undefeated agent's rating finite.
REGULARISATION = 0.05
ANCHOR = "random"  # rated 0 where it takes part

# One row for each game: first agent, second agent, block, score of the first.
Games = NDArray[np.float64]


@dataclass(frozen=True)
class Rating:
    """One agent's place. `elo` with its interval; `is_bound`: it lost no game (or won none), so the
    number shows only that it is at least (at most) so strong.
    """

    name: str
    elo: float
    low: float
    high: float
    games: int
    score: float
    is_bound: bool


def rate(names: Sequence[str], games: Games, seed: int = 0) -> list[Rating]:
    """Ratings of all agents, best first.

    games: [N, 4] rows of (first, second, block, score of the first), agents by index in `names`.
    The bootstrap draws whole blocks (a seed, both seats) within each pair, never single games.

    Raises:
        ValueError: agents that no chain of games connects cannot be compared; names them.
    """
    _require_connection(names, games)
    elo = _fit(len(names), games)
    samples = _bootstrap(len(names), games, seed)
    anchor = names.index(ANCHOR) if ANCHOR in names else None
    elo, samples = _anchor(elo, anchor), _anchor(samples, anchor)
    tail = 100.0 * (1.0 - CONFIDENCE) / 2.0
    low, high = np.percentile(samples, (tail, 100.0 - tail), axis=0)
    ratings = []
    for index, name in enumerate(names):
        points = _points_of(index, games)
        ratings.append(
            Rating(
                name,
                float(elo[index]),
                float(min(low[index], elo[index])),
                float(max(high[index], elo[index])),
                len(points),
                float(points.mean()) if len(points) else math.nan,
                bool(len(points)) and (points.min() == 1.0 or points.max() == 0.0),
            )
        )
    return sorted(ratings, key=lambda rating: -rating.elo)


def score_matrix(num_agents: int, games: Games) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Points and numbers of games of each agent (row) against each other (column)."""
    points = np.zeros((num_agents, num_agents))
    counts = np.zeros((num_agents, num_agents), np.int64)
    first, second = games[:, 0].astype(int), games[:, 1].astype(int)
    np.add.at(points, (first, second), games[:, 3])
    np.add.at(points, (second, first), 1.0 - games[:, 3])
    np.add.at(counts, (first, second), 1)
    np.add.at(counts, (second, first), 1)
    return points, counts


def win_rate_interval(wins: int, draws: int, games: int) -> tuple[float, float]:
    """Wilson's 95 % interval of the share of points (draws count half, rounded to whole games).

    Raises:
        ValueError: no games, or more wins and draws than games.
    """
    if games < 1 or wins < 0 or draws < 0 or wins + draws > games:
        raise ValueError(f"{wins} wins and {draws} draws of {games} games cannot be")
    points = round(wins + draws / 2)
    interval = binomtest(points, games).proportion_ci(CONFIDENCE, method="wilson")
    return float(interval.low), float(interval.high)


def _fit(num_agents: int, games: Games) -> NDArray[np.float64]:
    """Elo, centred on 0, of the regularised maximum likelihood."""
    points, _ = score_matrix(num_agents, games)
    logits = choix.ilsr_pairwise_dense(points, alpha=REGULARISATION, max_iter=1_000, tol=1e-6)
    return ELO_PER_LOGIT * np.asarray(logits, np.float64)


def _bootstrap(num_agents: int, games: Games, seed: int) -> NDArray[np.float64]:
    """Elo [NUM_BOOTSTRAPS, agents] of resampled blocks."""
    rng = np.random.default_rng(seed)
    order = np.lexsort((games[:, 2], games[:, 1], games[:, 0]))
    games = games[order]
    _, starts, sizes = np.unique(games[:, :3], axis=0, return_index=True, return_counts=True)
    pairs = games[starts, :2]
    _, pair_of_block = np.unique(pairs, axis=0, return_inverse=True)
    pair_of_block = pair_of_block.ravel()
    members = [np.flatnonzero(pair_of_block == pair) for pair in range(pair_of_block.max() + 1)]
    samples = np.empty((NUM_BOOTSTRAPS, num_agents))
    for index in range(NUM_BOOTSTRAPS):
        drawn = np.concatenate([rng.choice(blocks, len(blocks)) for blocks in members])
        rows = [np.arange(starts[block], starts[block] + sizes[block]) for block in drawn]
        samples[index] = _fit(num_agents, games[np.concatenate(rows)])
    return samples


def _anchor(elo: NDArray[np.float64], anchor: int | None) -> NDArray[np.float64]:
    zero = elo.mean(-1, keepdims=True) if anchor is None else elo[..., anchor : anchor + 1]
    return elo - zero


def _points_of(index: int, games: Games) -> NDArray[np.float64]:
    """The agent's score in each of its games."""
    as_first = games[games[:, 0] == index, 3]
    as_second = 1.0 - games[games[:, 1] == index, 3]
    return np.concatenate([as_first, as_second])


def _require_connection(names: Sequence[str], games: Games) -> None:
    _, counts = score_matrix(len(names), games)
    num_parts, part = connected_components(counts > 0, directed=False)
    if num_parts > 1:
        apart = [name for name, where in zip(names, part, strict=True) if where != part[0]]
        raise ValueError(
            f"no games connect {', '.join(apart)} with {names[0]}: let them play each other first"
        )
