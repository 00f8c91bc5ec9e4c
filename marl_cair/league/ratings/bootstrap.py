"""Block bootstrap of shares of points and of ratings: the games of a map seed are drawn together.

The plain bootstrap is overconfident: if four map seeds agree, all its resamples agree. So each
resample has pseudo-blocks too, won and lost alike, with random weights of half a block each on the
mean: Jeffreys' prior (Firth 1993, "Bias reduction of maximum likelihood estimates"). A share of
points has two, one won and one lost: between blocks that are whole wins and losses its resamples
are the posterior. Ratings have one for each rating, shared among pairs by their information: two
agents have one between them, and each of a hundred has about one against all others together.
The point estimates do not use them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from marl_cair.league.ratings.games import MAX_NUMBERS, Games, split_pairs, split_work
from marl_cair.league.ratings.groups import split_core
from marl_cair.league.ratings.intervals import find_ends
from marl_cair.league.ratings.likelihood import Likelihood, Rankings, indicate, rank_pairs

# Resamples of the shares of many pairs, and of one or a few cells: up to MOST as time allows.
NUM_SAMPLES, MOST_SAMPLES, MOST_WEIGHTS = 500, 4_000, 5_000_000
_JEFFREYS = 0.5  # blocks that each pseudo-block weighs on the mean
_LEAST_SHARE = 1e-9  # of a pseudo-block, below which a pair of agents has none


def resample_shares(
    scores: NDArray[np.float64],
    blocks: NDArray[np.int64],
    cells: NDArray[np.int64],
    num_cells: int,
    rng: np.random.Generator,
    num_samples: int = 0,
) -> NDArray[np.float64]:
    """Mean scores of cells, [S, num_cells], each block with a random weight: exponential, Rubin's
    (1981, "The Bayesian Bootstrap"). Whole numbers, as `Resampler` draws them, leave out all games
    of a cell too often where it has few blocks.

    scores: of N games, 0..1. blocks, cells [N]: the number of the block and of the cell of each.
    num_samples: S; 0: as many as time allows.
    """
    num_blocks = int(blocks.max()) + 1 if len(blocks) else 0
    affordable = max(NUM_SAMPLES, min(MOST_SAMPLES, MOST_WEIGHTS // max(1, num_blocks)))
    num_samples = num_samples or affordable
    shape = num_blocks, num_cells
    counts = indicate(blocks, cells, shape)
    points = csr_array((scores, (blocks, cells)), shape=shape)
    met = np.bincount(counts.tocoo().col, minlength=num_cells)  # blocks of each cell
    size = np.where(met > 0, counts.sum(axis=0) / np.maximum(met, 1), 1.0)  # games of a block
    samples = np.empty((num_samples, num_cells))
    for part in split_work(num_samples, num_blocks, 2 * MAX_NUMBERS):
        drawn = part.stop - part.start
        weights = rng.standard_exponential((drawn, num_blocks))
        won, lost = size * rng.gamma(_JEFFREYS, size=(2, drawn, num_cells))
        samples[part] = (weights @ points + won) / (weights @ counts + won + lost)
    return samples


def block_interval(scores: NDArray[np.float64], blocks: NDArray[np.int64]) -> tuple[float, float]:
    """95 % interval of the mean score of N games, 0..1 each, in blocks of any number [N]."""
    _, numbers = np.unique(blocks, return_inverse=True)
    cells, rng = np.zeros(len(scores), np.int64), np.random.default_rng(0)
    samples = resample_shares(scores, numbers.ravel(), cells, 1, rng)
    low, high = find_ends(samples, scores.mean())
    return float(low[0]), float(high[0])


class Resamples(NamedTuple):
    """S fits of n agents and T teams, in logits, and how often a group fell apart."""

    ratings: NDArray[np.float64]  # [S, n]
    seats: NDArray[np.float64]  # [S, T]
    is_open: NDArray[np.float64]  # [2, n], shares in which the agent left its group's largest part
    # downwards, and upwards


class PseudoBlocks(NamedTuple):
    """M pseudo-blocks, and the distribution of their weights."""

    rankings: Rankings
    shapes: NDArray[np.float64]  # [M] of the gamma distribution of the weight
    games: float  # of a block that was played, in those of a pseudo-block


class Resampler:
    """Draws blocks of `games`, and fits each draw.

    rankings: of the games within each group, that `point` [n + T] fits.
    """

    def __init__(
        self,
        num_agents: int,
        games: Games,
        rankings: Sequence[Rankings],
        point: NDArray[np.float64],
        groups: Sequence[Sequence[int]],
    ) -> None:
        self._pseudo = make_pseudo_blocks(num_agents, games, rankings, point)
        self._joint = Likelihood(num_agents, [*rankings, self._pseudo.rankings])
        self.num_blocks, self._groups = int(games.blocks.max()) + 1, groups
        mean = np.concatenate((np.ones(self.num_blocks), self._pseudo.games * self._pseudo.shapes))
        self._centre = self._joint.fit(mean)
        self._factor = self._joint.factorise(self._centre, mean)
        self._pairs = _pair_blocks(num_agents, games, self.num_blocks)
        self._above = np.ones(self.num_blocks) @ self._pairs
        self._points: list[NDArray[np.float64]] = []
        self._num_open = np.zeros((2, num_agents))
        # The cost of a resample: its blocks, and an exponential for each place of each set, in
        # each of some ten steps of the fit.
        self.work = self.num_blocks + 10 * self._joint.num_places

    def draw(self, num_samples: int, rng: np.random.Generator) -> Resamples:
        """All resamples so far, and `num_samples` more."""
        num_agents, num_blocks, pseudo = self._joint.num_agents, self.num_blocks, self._pseudo
        for part in split_work(num_samples, self._joint.num_blocks):
            size = part.stop - part.start
            drawn = rng.integers(num_blocks, size=(size, num_blocks))
            drawn += num_blocks * np.arange(size)[:, None]
            weights = np.bincount(drawn.ravel(), minlength=drawn.size).reshape(drawn.shape)
            more = pseudo.games * rng.gamma(pseudo.shapes, size=(size, len(pseudo.shapes)))
            both = np.hstack((weights.astype(np.float64), more))
            self._points.append(self._joint.refit(self._centre, both, self._factor))
            self._num_open += _count_open(self._groups, self._above, weights @ self._pairs)
        points = np.concatenate(self._points)
        is_open = self._num_open / len(points)
        return Resamples(points[:, :num_agents], points[:, num_agents:], is_open)


def make_pseudo_blocks(
    num_agents: int, games: Games, rankings: Sequence[Rankings], point: NDArray[np.float64]
) -> PseudoBlocks:
    """Two for each pair, one won in both seatings by either; numbered after the blocks of games.

    A pseudo-block counts for as many games as a block has for each of its ratings: a whole block if
    it is of one line-up. If several line-ups shared its map seed, it is the part that one agent has
    in it.
    """
    model, (num_games, num_teams) = Likelihood(num_agents, rankings), games.agents.shape
    cells = np.unique(np.repeat(games.blocks, num_teams) * num_agents + games.agents.ravel())
    members = np.bincount(cells // num_agents) - 1.0
    share = (num_teams - 1.0) / max(members.mean(), num_teams - 1.0)
    size = float(num_games / len(members) * share)
    leverage = find_leverage(model, point)
    one, two = np.nonzero(leverage > _LEAST_SHARE)
    rows = np.arange(len(one))
    seats = np.stack((rows, rows + 1), 1) % num_teams  # of more than two others in each pair
    blocks = model.num_blocks + np.concatenate((rows, rows, rows + len(rows), rows + len(rows)))
    pseudo_rankings = rank_pairs(
        np.concatenate((one, one, two, two)),
        np.concatenate((two, two, one, one)),
        np.concatenate((seats, seats[:, ::-1]) * 2),
        num_teams,
        blocks,
    )
    return PseudoBlocks(pseudo_rankings, np.tile(_JEFFREYS * leverage[one, two], 2), size / 2.0)


def find_leverage(model: Likelihood, point: NDArray[np.float64]) -> NDArray[np.float64]:
    """The number of ratings that each pair's games amount to, [n, n], 0 but above the diagonal; the
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
    """The number of samples in which each agent left its group's largest part, downwards and
    upwards: [2, n].

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
            counts[:, group] += number * np.stack((~core & ~is_above, ~core & is_above))
    return counts


def _pair_blocks(num_agents: int, games: Games, num_blocks: int) -> csr_array:
    """How often the pair's first came in above its second, or level, [blocks, n * n]."""
    pairs = split_pairs(games)
    first, second = pairs.scores >= 0.5, pairs.scores <= 0.5
    rows = np.concatenate((pairs.blocks[first], pairs.blocks[second]))
    ahead = pairs.first * num_agents + pairs.second, pairs.second * num_agents + pairs.first
    columns = np.concatenate((ahead[0][first], ahead[1][second]))
    return indicate(rows, columns, (num_blocks, num_agents**2))
