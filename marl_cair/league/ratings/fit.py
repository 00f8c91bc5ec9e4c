"""Goodness of fit of the ratings by parametric bootstrap: is one number per agent enough?

The deviance compares the share of points of each pair with what ratings and seats say it should be:
0 where all pairs agree, large where agents beat each other in cycles. Its distribution by chance is
found by simulating all games from the ratings (Plackett-Luce), with the same agents in the same
seats of the same blocks, and fitting each simulation.

Real games vary less than tosses of a coin (draws, maps that favour a seat) or more (maps that
favour an agent). So each deviance is divided by the dispersion of its own data: the variance
between blocks of the same pair, over the variance of independent games.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.special import expit, xlogy
from scipy.stats import chi2, ncx2

from marl_cair.league.ratings.games import (
    MAX_NUMBERS,
    Games,
    PairGames,
    sort_games,
    split_pairs,
    split_work,
)
from marl_cair.league.ratings.intervals import LEVEL
from marl_cair.league.ratings.likelihood import Likelihood, indicate, rank_pairs

NUM_SIMULATIONS = 299
NOTICED_SHARE = 0.1  # the deviation, in shares of points, for which `power` is computed
_COIN = 0.25  # variance of one even game: keeps the dispersion of few games near 1
_TOLERANCE = 1e-5  # logits, of fits to simulations
# Relative difference below which two deviances are equal. Where all games went as the ratings say,
# most simulations repeat the data, and only the tolerance of the fits decides which is larger.
_TIE = 1e-3


@dataclass(frozen=True)
class FitTest:
    """The result of the test.

    Attributes:
        deviance: of the games, over their dispersion.
        by_chance: its mean over the simulations, in which one number per agent is the truth.
        p_value: share of the simulations, and the games themselves, with no smaller deviance.
        misfit: root mean square, over games, of a pair's share of points less the expected one.
        misfit_by_chance: its mean over the simulations.
        power: the approximate chance of p <= 0.05 where every pair is NOTICED_SHARE off.
        dispersion: variance between blocks over that of independent games.
    """

    deviance: float
    by_chance: float
    p_value: float
    misfit: float
    misfit_by_chance: float
    power: float
    dispersion: float


def check_fit(num_agents: int, games: Games, seed: int = 0) -> FitTest | None:
    """Test games as in `ratings.rate`; None where too few pairs met to show a cycle.

    The same games give the same numbers in whatever order they are. Between more than two teams
    ratings are fitted to the order of each pair; the simulations are of whole games.
    """
    games = sort_games(games.count_once())
    pairs = split_pairs(games)
    num_free = _count_free(num_agents, pairs)
    if num_free < 1:
        return None
    model = _PairModel(num_agents, games, pairs)
    point = model.fit(pairs.scores @ model.cell_of_row)
    found = model.judge(pairs.scores[None], point[None], point)
    rng = np.random.default_rng(seed)
    scale = np.exp(-point[games.agents] - point[num_agents:]).astype(np.float32)
    parts = []
    for part in split_work(NUM_SIMULATIONS, scale.size, 2 * MAX_NUMBERS):
        # The first in a race of exponential times is Plackett-Luce's choice.
        shape = part.stop - part.start, *scale.shape
        times = rng.standard_exponential(shape, np.float32) * scale
        own, other = (times[:, pairs.games, pairs.teams[:, side]] for side in (0, 1))
        scores = (own < other).astype(np.float64)
        points = model.refit(scores @ model.cell_of_row, point)
        parts.append(model.judge(scores, points, point))
    chance = np.concatenate(parts, axis=1)
    deviance, misfit, dispersion = found[:, 0].tolist()
    return FitTest(
        deviance,
        float(chance[0].mean()),
        (1.0 + float((chance[0] >= (1.0 - _TIE) * deviance).sum())) / (1.0 + NUM_SIMULATIONS),
        misfit,
        float(chance[1].mean()),
        model.find_power(point, dispersion, num_free),
        dispersion,
    )


def _count_free(num_agents: int, pairs: PairGames) -> int:
    """Pairs that met, beyond those that ratings can always fit."""
    met, _ = _group(pairs.first, pairs.second)
    graph = indicate(met[:, 0], met[:, 1], (num_agents, num_agents))
    num_parts, _ = connected_components(graph, directed=False)
    return len(met) - (num_agents - int(num_parts))


def _group(*keys: NDArray[np.int64]) -> tuple[NDArray[np.int64], csr_array]:
    """The different rows of keys [N, ...], sorted, and which of them each row is, [N, rows]."""
    rows = np.column_stack(keys)
    codes = np.ravel_multi_index(tuple(rows.T), tuple(rows.max(0, initial=0) + 1))
    _, first, place = np.unique(codes, return_index=True, return_inverse=True)
    return rows[first], indicate(np.arange(place.size), place, (place.size, first.size))


class _PairModel:
    """The likelihood of pairs of teams. A cell is all games of a pair in the same two seats."""

    def __init__(self, num_agents: int, games: Games, pairs: PairGames) -> None:
        self._cells, self.cell_of_row = _group(pairs.first, pairs.second, pairs.teams)
        self._counts = np.asarray(self.cell_of_row.sum(0), np.float64)
        # Two games of each cell, each a block: won by its first agent, then by its second.
        one, two, *_ = self._cells.T
        seats, num_cells = self._cells[:, 2:].copy(), len(self._cells)
        ranked = rank_pairs(
            np.concatenate((one, two)),
            np.concatenate((two, one)),
            np.concatenate((seats, seats[:, ::-1])),
            games.agents.shape[1],
            np.arange(2 * num_cells),
        )
        self._likelihood = Likelihood(num_agents, [ranked])
        self._cells[:, 2:] += num_agents  # the places of seats among the parameters
        _, self._pair_of_cell = _group(one, two)
        self._games = self._counts @ self._pair_of_cell
        # The games of a pair in a block: what varies together.
        parts, self._part_of_row = _group(pairs.first, pairs.second, pairs.blocks)
        _, self._pair_of_part = _group(parts[:, :2])
        self._num_parts = self._pair_of_part.sum(0)

    def fit(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The parameters [n + T] of the largest posterior; points [cells] of their first agents."""
        return self._likelihood.fit(np.concatenate((points, self._counts - points)))

    def refit(self, points: NDArray[np.float64], start: NDArray[np.float64]) -> NDArray[np.float64]:
        """As `fit` for points [S, cells], beginning at `start`: [S, n + T]."""
        halves = np.tile(self._counts / 2.0, 2)  # the curvature depends on the counts only
        factor = self._likelihood.factorise(start, halves)
        weights = np.hstack((points, self._counts - points))
        return self._likelihood.refit(start, weights, factor, _TOLERANCE)

    def judge(
        self,
        scores: NDArray[np.float64],
        points: NDArray[np.float64],
        centre: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Deviance over dispersion, misfit and dispersion [3, S] of scores [S, rows].

        points: the fit [S, n + T] to each; centre: the fit that the dispersion is measured at.
        """
        won = scores @ self.cell_of_row @ self._pair_of_cell
        expected = (self._chances(points) * self._counts) @ self._pair_of_cell
        lost, left = self._games - won, self._games - expected
        each = xlogy(won, won / expected) + xlogy(lost, lost / left)
        misfit = np.sqrt((np.square(won - expected) / self._games).sum(1) / self._games.sum())
        dispersion = self._disperse(scores, centre)
        return np.stack((2.0 * each.sum(1) / dispersion, misfit, dispersion))

    def _disperse(
        self, scores: NDArray[np.float64], centre: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        chances = self.cell_of_row @ self._chances(centre[None])[0]
        sums = (scores - chances) @ self._part_of_row
        squares, totals = np.square(sums) @ self._pair_of_part, sums @ self._pair_of_part
        counts = self._num_parts
        found = (squares - np.square(totals) / counts).sum(1)
        variance = (chances * (1.0 - chances)) @ self._part_of_row @ self._pair_of_part
        expected = float((variance * (counts - 1) / counts).sum())
        return np.asarray((found + _COIN) / (expected + _COIN), np.float64)

    def find_power(self, point: NDArray[np.float64], dispersion: float, num_free: int) -> float:
        """The chance of a noncentral chi-squared, the limit for many games, to be found large."""
        chances = self._chances(point[None])[0]
        variance = (self._counts * chances * (1.0 - chances)) @ self._pair_of_cell
        information = np.square(NOTICED_SHARE * self._games) / np.maximum(variance, _COIN)
        shift = float(information.sum()) / dispersion * num_free / len(self._games)
        return float(ncx2.sf(chi2.isf(LEVEL, num_free), num_free, shift))

    def _chances(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Chances that the cells' first agents come in above the second: [S, cells]."""
        first, second, seat, other_seat = points.T[self._cells.T]
        return np.asarray(expit(first - second + seat - other_seat).T, np.float64)
