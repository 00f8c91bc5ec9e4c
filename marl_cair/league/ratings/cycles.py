"""Finds significant non-transitive cycles of three agents.

A pair is uneven if the scores of its blocks would rarely be as one-sided by chance, each block
being equally likely to go the other way (an exact test by sign flips; Fisher 1935, "The Design of
Experiments"). All pairs are tested together by Holm's procedure (1979, "A simple sequentially
rejective multiple test procedure"): with 95 % no pair is wrongly called uneven, and so no cycle
is reported wrongly, however many there could be.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom

from marl_cair.league.ratings.games import Games, count_points, find_shares, split_pairs
from marl_cair.league.ratings.intervals import LEVEL


class Cycle(NamedTuple):
    """Agents by number: the first beats the second, that beats the third, that beats the first."""

    agents: tuple[int, int, int]  # the smallest number is the first
    share: float  # of the points that the winner of the closest of the three pairs has


def find_cycles(num_agents: int, games: Games) -> tuple[Cycle, ...]:
    """All significant cycles of three, the clearest first; games as in `ratings.rate`."""
    beats, shares = find_uneven_pairs(num_agents, games)
    cycles = []
    for first in range(num_agents):
        later = np.arange(num_agents) > first
        for second in np.flatnonzero(beats[first] & later).tolist():
            for third in np.flatnonzero(beats[second] & beats[:, first] & later).tolist():
                sides = shares[first, second], shares[second, third], shares[third, first]
                cycles.append(Cycle((first, second, third), float(min(sides))))
    return tuple(sorted(cycles, key=lambda cycle: (-cycle.share, cycle.agents)))


def find_uneven_pairs(
    num_agents: int, games: Games
) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
    """Whether the row is significantly better than the column, and its score: [n, n] both."""
    pairs = split_pairs(games.count_once())
    beats = np.zeros((num_agents, num_agents), np.bool_)
    surplus = np.round(2.0 * pairs.scores).astype(np.int64) - 1  # twice the points above even
    # The sum of each block of each pair, then the sums of each pair.
    num_blocks, pair = int(pairs.blocks.max(initial=0)) + 1, num_agents * pairs.first + pairs.second
    keys, part = np.unique(num_blocks * pair + pairs.blocks, return_inverse=True)
    sums = np.zeros(len(keys), np.int64)
    np.add.at(sums, part, surplus)
    met, starts = np.unique(keys // num_blocks, return_index=True)
    found = [
        (find_chance(blocks), *divmod(number, num_agents), blocks.sum() > 0)
        for number, blocks in zip(met.tolist(), np.split(sums, starts)[1:], strict=True)
    ]
    for rank, (chance, one, two, is_ahead) in enumerate(sorted(found)):
        if chance > LEVEL / (len(found) - rank):
            break
        beats[(one, two) if is_ahead else (two, one)] = True
    return beats, find_shares(*count_points(num_agents, pairs))


def find_chance(sums: NDArray[np.int64]) -> float:
    """How often signs by coin tosses make the sum of integers [K] as far from 0 as it is, or more.

    Exact: equal sizes together are a binomial, and different sizes are convolved.
    """
    numbers = np.bincount(np.abs(sums))  # of each size
    return _find_chance(tuple(numbers[1:].tolist()), abs(int(sums.sum())))


@functools.lru_cache(maxsize=4_096)  # thousands of pairs have as many games, and much the same sums
def _find_chance(numbers: tuple[int, ...], distance: int) -> float:
    """numbers: how many sums have the sizes 1, 2, ...; distance: of their sum from 0."""
    chances = np.ones(1)  # of sums from -span to span, by steps of 1
    for size, number in enumerate(numbers, 1):
        if number:
            own = np.zeros(2 * size * number + 1)
            own[:: 2 * size] = binom.pmf(np.arange(number + 1), number, 0.5)
            chances = np.convolve(chances, own)
    span = len(chances) // 2
    far = np.abs(np.arange(-span, span + 1)) >= distance
    return min(1.0, float(chances[far].sum()))
