"""Ratings from stored results: Bradley-Terry by choix on the Elo scale, intervals by bootstrap."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import choix
import numpy as np
from numpy.typing import NDArray

from marl_cair.league.groups import (
    ELO_PER_LOGIT,
    find_gap,
    find_groups,
    require_comparison,
    split_core,
)
from marl_cair.league.intervals import CONFIDENCE, win_rate_interval

__all__ = ["ANCHOR", "ELO_PER_LOGIT", "Games", "Rating", "rate", "score_matrix"]
__all__ += ["win_rate_interval"]

NUM_BOOTSTRAPS = 500
ANCHOR = "random"  # rated 0 where it takes part

# One row for each game: first agent, second agent, block, score of the first.
Games = NDArray[np.float64]


@dataclass(frozen=True)
class Rating:
    """One agent's place.

    Attributes:
        name: of the agent.
        elo: maximum-likelihood rating; where `bound` is set, the bound.
        low, high: 95 % interval against the mean of the agent's group; infinite where results
            leave that end open, both equal to `elo` in a group of one.
        games, score: number of games, and share of points in them.
        bound: "lower" where the agent's group lost no point to the group of the zero of the scale,
            neither itself nor through others: its ratings may all be larger by one unknown number.
            "upper" where it never took one: they may all be smaller. "" in the group of the zero.
        group: of agents that took points off each other, directly or through others; 0 is the best.
    """

    name: str
    elo: float
    low: float
    high: float
    games: int
    score: float
    bound: Literal["", "lower", "upper"]
    group: int

    @property
    def is_bound(self) -> bool:
        """Whether `elo` is a bound and no estimate."""
        return self.bound != ""


def rate(names: Sequence[str], games: Games, seed: int = 0) -> list[Rating]:
    """Ratings of all agents, best first.

    games: [N, 4] rows of (first, second, block, score of the first), agents by index in `names`.
    `random` is 0 where it takes part, else the mean of the largest group. The bootstrap draws whole
    blocks (a map seed, both seats) within each pair, never single games.

    Raises:
        ValueError: agents that no chain of games compares with the others; names them.
    """
    points, counts = score_matrix(len(names), games)
    groups = find_groups(points)
    home = _find_home(names, groups)
    require_comparison(names, points, groups[home][0])
    elo = _place_groups(groups, home, points, counts)
    if ANCHOR in names:
        elo -= elo[names.index(ANCHOR)]
    low, high = elo.copy(), elo.copy()
    rng = np.random.default_rng(seed)
    for group in groups:
        if len(group) > 1:
            low[group], high[group] = _bootstrap(group, games, elo[group], rng)
    ratings = []
    for place, group in enumerate(groups):
        for index in group:
            num = int(counts[index].sum())
            ratings.append(
                Rating(
                    names[index],
                    float(elo[index]),
                    float(low[index]),
                    float(high[index]),
                    num,
                    float(points[index].sum() / num) if num else math.nan,
                    "lower" if place > home else "upper" if place < home else "",
                    len(groups) - 1 - place,
                )
            )
    return sorted(ratings, key=lambda rating: (rating.group, -rating.elo, rating.name))


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


def _find_home(names: Sequence[str], groups: Sequence[Sequence[int]]) -> int:
    """The group of the zero of the scale: the anchor's, else the largest, the best among equals."""
    if ANCHOR in names:
        anchor = names.index(ANCHOR)
        return next(place for place, group in enumerate(groups) if anchor in group)
    return max(range(len(groups)), key=lambda place: (len(groups[place]), place))


def _place_groups(
    groups: Sequence[list[int]],
    home: int,
    points: NDArray[np.float64],
    counts: NDArray[np.int64],
) -> NDArray[np.float64]:
    """Elo [agents]: the home group's mean is 0, the others lie as far away as is sure."""
    elo = np.zeros(len(points))
    for group in groups:
        elo[group] = _fit(points[np.ix_(group, group)])
    placed = list(groups[home])
    for group in groups[home + 1 :]:
        elo[group] += find_gap(elo[group], elo[placed], counts[np.ix_(group, placed)])
        placed += group
    for group in reversed(groups[:home]):
        elo[group] -= find_gap(elo[placed], elo[group], counts[np.ix_(placed, group)])
        placed += group
    return elo


def _fit(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Elo [n], centred on 0, of the largest likelihood within one group; points [n, n]."""
    if len(points) == 1:
        return np.zeros(1)
    logits = choix.ilsr_pairwise_dense(points, max_iter=1_000, tol=1e-6)
    return ELO_PER_LOGIT * np.asarray(logits, np.float64)


def _bootstrap(
    group: Sequence[int], games: Games, elo: NDArray[np.float64], rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Ends [n], [n] of the percentile intervals of a group's ratings `elo` [n].

    In a sample where the group falls apart, who left its largest part is above or below all limits.
    """
    samples = np.empty((NUM_BOOTSTRAPS, len(group)))
    pairs = _group_blocks(group, games)
    for sample in samples:
        points = np.zeros((len(group), len(group)))
        for first, second, blocks in pairs:
            won, played = blocks[rng.integers(len(blocks), size=len(blocks))].sum(0)
            points[first, second] += won
            points[second, first] += played - won
        core, is_above = split_core(points)
        fitted = _fit(points[np.ix_(core, core)])
        sample[core] = fitted + (elo[core] - fitted).mean()
        sample[~core] = np.where(is_above[~core], np.inf, -np.inf)
    tail = 100.0 * (1.0 - CONFIDENCE) / 2.0
    # No interpolation: between a number and infinity there is nothing.
    low, high = np.percentile(samples, (tail, 100.0 - tail), axis=0, method="inverted_cdf")
    return np.minimum(low, elo), np.maximum(high, elo)


def _group_blocks(group: Sequence[int], games: Games) -> list[tuple[int, int, NDArray[np.float64]]]:
    """Each pair within a group, by place in it: points of the first and games by block, [K, 2]."""
    places = {agent: place for place, agent in enumerate(group)}
    inside = games[np.isin(games[:, :2], group).all(1)]
    keys, block_of_game = np.unique(inside[:, :3], axis=0, return_inverse=True)
    blocks = np.zeros((len(keys), 2))
    np.add.at(blocks[:, 0], block_of_game.ravel(), inside[:, 3])
    np.add.at(blocks[:, 1], block_of_game.ravel(), 1.0)
    pairs, pair_of_block = np.unique(keys[:, :2], axis=0, return_inverse=True)
    return [
        (places[int(first)], places[int(second)], blocks[pair_of_block.ravel() == number])
        for number, (first, second) in enumerate(pairs)
    ]
