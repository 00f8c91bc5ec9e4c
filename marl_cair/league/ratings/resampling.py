"""Block bootstrap of ratings, with pseudo-blocks so that few blocks have wide intervals.

The plain bootstrap is overconfident: if four map seeds agree, all its resamples agree. So each
resample has pseudo-blocks too, won and lost alike, one for each rating that is estimated: Jeffreys'
prior of the whole model (Firth 1993, "Bias reduction of maximum likelihood estimates"), with random
weights as in `payoffs`. They go to pairs by their information about the ratings: two agents have
one between them, and each of a hundred has about one against all others together.
The point estimates do not use them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from marl_cair.league.ratings.groups import split_core
from marl_cair.league.ratings.likelihood import MAX_NUMBERS, Likelihood, Rankings

_JEFFREYS = 0.5  # of a pair's pseudo-blocks one half is won and one is lost
_LEAST_SHARE = 1e-9  # of a pseudo-block, below which a pair has none


class Resamples(NamedTuple):
    """S fits of n agents and T teams, in logits, and how often a group has fallen apart.

    open_high, open_low: float64 [n], in how many the agent had left its group's largest part
    upwards, and downwards.
    """

    ratings: NDArray[np.float64]  # [S, n]
    seats: NDArray[np.float64]  # [S, T]
    open_high: NDArray[np.float64]
    open_low: NDArray[np.float64]

    def join(self, more: Resamples) -> Resamples:
        """These and more."""
        return Resamples(
            np.concatenate((self.ratings, more.ratings)),
            np.concatenate((self.seats, more.seats)),
            self.open_high + more.open_high,
            self.open_low + more.open_low,
        )


class PseudoBlocks(NamedTuple):
    """M pseudo-blocks, and how to draw what each weighs."""

    rankings: Rankings
    shapes: NDArray[np.float64]  # [M] of the gamma distribution of the weight
    games: float  # of a block that was played, in those of a pseudo-block

    def draw(self, num_samples: int, rng: np.random.Generator) -> NDArray[np.float64]:
        """Weights [num_samples, M]."""
        return self.games * rng.gamma(self.shapes, size=(num_samples, len(self.shapes)))


class Resampler:
    """Draws blocks of `games`, and fits each draw.

    rankings: of the games within each group, that `point` [n + T] fits.
    """

    def __init__(
        self,
        num_agents: int,
        games: Rankings,
        rankings: Sequence[Rankings],
        point: NDArray[np.float64],
        groups: Sequence[Sequence[int]],
    ) -> None:
        size = find_pseudo_size(num_agents, games)
        self._pseudo = make_pseudo_blocks(Likelihood(num_agents, rankings), point, size)
        self._joint = Likelihood(num_agents, [*rankings, self._pseudo.rankings])
        self.num_blocks, self._groups = games.num_blocks, groups
        mean = np.concatenate((np.ones(self.num_blocks), self._pseudo.games * self._pseudo.shapes))
        self._centre = self._joint.fit(mean)
        self._factor = self._joint.factorise(self._centre, mean)
        self._pairs = _pair_blocks(num_agents, games)
        self._above = np.ones(self.num_blocks) @ self._pairs
        # What a resample costs: its blocks, and an exponential for each place of each set, in
        # each of some ten steps of the fit.
        self.work = self.num_blocks + 10 * self._joint.num_places

    def draw(self, num_samples: int, rng: np.random.Generator) -> Resamples:
        """Fits to `num_samples` resamples."""
        num_agents, num_blocks = self._joint.num_agents, self.num_blocks
        points = np.empty((num_samples, self._joint.num_parameters))
        is_open = np.zeros((2, num_agents))
        step = max(1, MAX_NUMBERS // self._joint.num_blocks)
        for first in range(0, num_samples, step):
            part = slice(first, min(first + step, num_samples))
            size = part.stop - first
            drawn = rng.integers(num_blocks, size=(size, num_blocks))
            drawn += num_blocks * np.arange(size)[:, None]
            weights = np.bincount(drawn.ravel(), minlength=drawn.size).reshape(drawn.shape)
            both = np.hstack((weights.astype(np.float64), self._pseudo.draw(size, rng)))
            points[part] = self._joint.refit(self._centre, both, self._factor)
            is_open += _count_open(self._groups, self._above, weights @ self._pairs)
        return Resamples(points[:, :num_agents], points[:, num_agents:], *is_open)


def make_pseudo_blocks(
    model: Likelihood, point: NDArray[np.float64], num_games: float
) -> PseudoBlocks:
    """Two for each pair, one won in both seatings by either; numbered after the model's blocks.

    num_games: for how many a pseudo-block is to count.
    """
    leverage = find_leverage(model, point)
    one, two = np.nonzero(leverage > _LEAST_SHARE)
    num_pairs, num_teams = len(one), model.num_parameters - model.num_agents
    rows = np.arange(num_pairs)
    seats = np.stack((rows, rows + 1), 1) % num_teams  # of more than two others in each pair
    agents = np.zeros((2, 2, num_pairs, num_teams), np.int64)
    ranks = np.zeros((2, 2, num_pairs, num_teams))  # 0: who takes no part
    for number, (winner, loser) in enumerate(((one, two), (two, one))):
        for turn, (own, other) in enumerate((seats.T, seats.T[::-1])):
            agents[number, turn, rows, own], agents[number, turn, rows, other] = winner, loser
            ranks[number, turn, rows, own], ranks[number, turn, rows, other] = 1.0, 2.0
    blocks = np.stack((rows, rows, rows + num_pairs, rows + num_pairs)) + model.num_blocks
    rankings = Rankings(agents.reshape(-1, num_teams), ranks.reshape(-1, num_teams), blocks.ravel())
    shapes = np.tile(_JEFFREYS * leverage[one, two], 2)
    return PseudoBlocks(rankings, shapes, num_games / 2.0)


def find_pseudo_size(num_agents: int, games: Rankings) -> float:
    """For how many games a pseudo-block counts: as many as a block has for each of its ratings.

    A block of one line-up counts whole. Of a map seed that several line-ups shared, a pseudo-block
    is the part that one agent has in it, as its T - 1 opponents in a line-up of its own.
    """
    cells = np.unique(np.repeat(games.blocks, games.num_teams) * num_agents + games.agents.ravel())
    members = np.bincount(cells // num_agents) - 1.0
    share = (games.num_teams - 1.0) / max(members.mean(), games.num_teams - 1.0)
    return float(len(games.agents) / games.num_blocks * share)


def find_leverage(model: Likelihood, point: NDArray[np.float64]) -> NDArray[np.float64]:
    """How many of the ratings each pair's games amount to, [n, n], 0 but above the diagonal; the
    sum is about n less the number of groups.
    """
    num_agents = model.num_agents
    curvature = model.find_curvature(point)
    covariance = np.linalg.inv(curvature)[:num_agents, :num_agents]
    spread = covariance.diagonal()
    gaps = spread[:, None] + spread - 2.0 * covariance
    leverage = np.triu(-curvature[:num_agents, :num_agents] * gaps, 1)
    return np.asarray(np.maximum(leverage, 0.0), np.float64)


def _count_open(
    groups: Sequence[Sequence[int]], above: NDArray[np.float64], samples: NDArray[np.float64]
) -> NDArray[np.float64]:
    """In how many samples each agent has left its group's largest part, upwards and downwards:
    [2, n].

    above [n * n]: how often the row's agent was not below the column's; samples [S, n * n]: in each
    resample.
    """
    num_agents = sum(map(len, groups))
    counts = np.zeros((2, num_agents))
    # Where every arrow between two agents is still there, no group has fallen apart.
    has_lost = (samples <= 0.0)[:, above > 0.0].any(axis=1)
    arrows, times = np.unique(np.packbits(samples[has_lost] > 0.0, 1), axis=0, return_counts=True)
    for packed, number in zip(arrows, times.tolist(), strict=True):
        cells = np.unpackbits(packed, count=num_agents**2).astype(np.float64)
        pairs = cells.reshape(num_agents, num_agents)
        parts = connected_components(pairs, directed=True, connection="strong")[0]
        if parts == len(groups):
            continue
        for group in groups:
            core, is_above = split_core(pairs[np.ix_(group, group)])
            counts[0, group] += number * (~core & is_above)
            counts[1, group] += number * (~core & ~is_above)
    return counts


def _pair_blocks(num_agents: int, games: Rankings) -> csr_array:
    """Whether the pair's first came in above its second, or level, [blocks, n * n]."""
    rows, columns = [], []
    for one in range(games.num_teams):
        for two in range(games.num_teams):
            own, other = games.agents[:, one], games.agents[:, two]
            took = np.flatnonzero((own != other) & (games.ranks[:, one] <= games.ranks[:, two]))
            rows.append(games.blocks[took])
            columns.append(own[took] * num_agents + other[took])
    row, column = np.concatenate(rows), np.concatenate(columns)
    shape = games.num_blocks, num_agents**2
    return csr_array((np.ones(len(row)), (row, column)), shape=shape)
