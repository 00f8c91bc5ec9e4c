"""Whether one number per agent is enough: a test of fit of the ratings, by parametric bootstrap.

The deviance compares the share of points of each pair with what ratings and seats say it should be:
0 where all pairs agree, large where agents go in circles. What it is by chance alone is found by
playing all games again on paper, with the same agents in the same seats of the same blocks, as the
ratings say (Plackett-Luce), and fitting anew each time.

Real games vary less than tosses of a coin (draws, maps that favour a seat) or more (maps that
favour an agent). So each deviance is divided by the dispersion of its own data: the variance
between blocks of the same pair, over the variance of independent games.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components
from scipy.special import expit, xlogy
from scipy.stats import chi2, ncx2

from marl_cair.league.ratings.groups import ELO_PER_LOGIT
from marl_cair.league.ratings.intervals import CONFIDENCE
from marl_cair.league.ratings.likelihood import MAX_STEP, PRIOR_ELO, SEAT_PRIOR_ELO
from marl_cair.league.ratings.payoffs import PairGames, split_pairs
from marl_cair.league.ratings.rate import Games, sort_games

NUM_SIMULATIONS = 299
LEVEL = 1.0 - CONFIDENCE
NOTICED_SHARE = 0.1  # the deviation, in shares of points, whose detection `power` tells of
_COIN = 0.25  # variance of one even game: keeps the dispersion of few games near 1
_TOLERANCE, _MAX_CHORD_STEPS, _MAX_NEWTON_STEPS = 1e-5, 30, 200
_MAX_NUMBERS = 4_000_000  # that are drawn at once


@dataclass(frozen=True)
class FitTest:
    """What the test found.

    Attributes:
        deviance: of the games, over their dispersion.
        by_chance: the mean of the same, where one number per agent is the truth.
        p_value: share of the simulations (the games themselves with them) whose deviance is no
            smaller.
        misfit: root mean square, over games, of a pair's share of points less what ratings say.
        misfit_by_chance: its mean where one number per agent is the truth.
        power: about the chance to find p <= 0.05 where every pair is NOTICED_SHARE off.
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
    """Test games as in `ratings.rate`; None where too few pairs met for any circle to show.

    The same games give the same numbers in whatever order they are. Between more than two teams
    ratings are fitted to who came in above whom, pair by pair; the simulations are of whole games.
    """
    games = sort_games(games.count_once())
    pairs = split_pairs(games)
    num_free = _count_free(num_agents, pairs)
    if num_free < 1:
        return None
    model = _PairModel(num_agents, games, pairs)
    point = model.fit((pairs.scores @ model.cell_of_row)[None])[0]
    found = model.judge(pairs.scores[None], point[None], point)
    rng = np.random.default_rng(seed)
    strength = point[games.agents] + point[num_agents:]
    step = max(1, _MAX_NUMBERS // max(1, strength.size))
    parts = []
    for start in range(0, NUM_SIMULATIONS, step):
        size = min(step, NUM_SIMULATIONS - start)
        # Who is first in a race of exponential times is Plackett-Luce's choice.
        times = rng.standard_exponential((size, *strength.shape)) * np.exp(-strength)
        own, other = (times[:, pairs.games, pairs.teams[:, side]] for side in (0, 1))
        scores = (own < other).astype(np.float64)
        points = model.refit(scores @ model.cell_of_row, point)
        parts.append(model.judge(scores, points, point))
    chance = np.concatenate(parts, axis=1)
    deviance, misfit, dispersion = found[:, 0].tolist()
    return FitTest(
        deviance,
        float(chance[0].mean()),
        (1.0 + float((chance[0] >= deviance).sum())) / (1.0 + NUM_SIMULATIONS),
        misfit,
        float(chance[1].mean()),
        model.find_power(point, dispersion, num_free),
        dispersion,
    )


def _count_free(num_agents: int, pairs: PairGames) -> int:
    """Pairs that met, beyond those that ratings can always fit."""
    met = np.unique(np.column_stack((pairs.first, pairs.second)), axis=0)
    graph = csr_array((np.ones(len(met)), (met[:, 0], met[:, 1])), shape=(num_agents, num_agents))
    num_parts, _ = connected_components(graph, directed=False)
    return len(met) - (num_agents - int(num_parts))


class _PairModel:
    """Bradley-Terry with seats on pairs of teams; parameters: n ratings, T seats, in logits."""

    def __init__(self, num_agents: int, games: Games, pairs: PairGames) -> None:
        num_rows, self._size = len(pairs.first), num_agents + games.agents.shape[1]
        rows = np.arange(num_rows)
        keys = np.column_stack((pairs.first, pairs.second, pairs.teams))
        cells, cell = np.unique(keys, axis=0, return_inverse=True)
        self.cell_of_row = _indicate(rows, cell.ravel(), (num_rows, len(cells)))
        self._counts = np.bincount(cell.ravel(), minlength=len(cells)).astype(np.float64)
        ends = np.concatenate(
            (cells[:, 0], cells[:, 1], num_agents + cells[:, 2], num_agents + cells[:, 3])
        )
        turns = np.array((1.0, -1.0, 1.0, -1.0))
        signs = np.repeat(turns, len(cells))
        places = np.tile(np.arange(len(cells)), 4)
        self._design = csr_array((signs, (places, ends)), shape=(len(cells), self._size))
        ends = ends.reshape(4, -1)
        entries = (ends[:, None] * self._size + ends).reshape(16, -1)
        values = np.repeat(np.outer(turns, turns).ravel(), len(cells))
        # Cell -> its part of the curvature, row by row.
        self._squares = csr_array(
            (values, (np.tile(np.arange(len(cells)), 16), entries.ravel())),
            shape=(len(cells), self._size**2),
        )
        met, pair_of_cell = np.unique(cells[:, :2], axis=0, return_inverse=True)
        self._pair_of_cell = _indicate(
            np.arange(len(cells)), pair_of_cell.ravel(), (len(cells), len(met))
        )
        self._games = self._counts @ self._pair_of_cell
        pair = pair_of_cell.ravel()[cell.ravel()]
        # A block of a pair: what varies together.
        parts, part = np.unique(np.column_stack((pair, pairs.blocks)), axis=0, return_inverse=True)
        self._part_of_row = _indicate(rows, part.ravel(), (num_rows, len(parts)))
        self._pair_of_part = _indicate(np.arange(len(parts)), parts[:, 0], (len(parts), len(met)))
        self._num_parts = np.bincount(parts[:, 0], minlength=len(met))
        self._precision = np.full(self._size, (ELO_PER_LOGIT / PRIOR_ELO) ** 2)
        self._precision[num_agents:] = (ELO_PER_LOGIT / SEAT_PRIOR_ELO) ** 2

    def fit(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The parameters [S, n + T] at the largest posteriors, by Newton's method; points
        [S, cells] of the cells' first agents.
        """
        at = np.zeros((len(points), self._size))
        for _ in range(_MAX_NEWTON_STEPS):
            rise = self._climb(at, points)[..., None]
            step = np.linalg.solve(self._curve(at), rise)[..., 0]
            size = np.abs(step).max(1, keepdims=True)
            at += step * np.minimum(1.0, MAX_STEP / np.maximum(size, 1e-300))
            if (size < _TOLERANCE).all():
                break
        return at

    def refit(self, points: NDArray[np.float64], start: NDArray[np.float64]) -> NDArray[np.float64]:
        """As `fit`, from `start` [n + T] with one curvature for all: cheap where it is near."""
        factor = cho_factor(self._curve(start[None])[0])
        at = np.tile(start, (len(points), 1))
        is_left = np.ones(len(points), np.bool_)
        for _ in range(_MAX_CHORD_STEPS):
            left = np.flatnonzero(is_left)
            if not len(left):
                break
            step = cho_solve(factor, self._climb(at[left], points[left]).T).T
            at[left] += step
            size = np.abs(step).max(1)
            is_left[left] = size >= _TOLERANCE
            if not (size <= MAX_STEP).all():
                break
        left = np.flatnonzero(is_left)
        most = max(1, _MAX_NUMBERS // self._size**2)
        for first in range(0, len(left), most):
            part = left[first : first + most]
            at[part] = self.fit(points[part])
        return at

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
        tells = np.square(NOTICED_SHARE * self._games) / np.maximum(variance, _COIN)
        shift = float(tells.sum()) / dispersion * num_free / len(self._games)
        return float(ncx2.sf(chi2.isf(LEVEL, num_free), num_free, shift))

    def _chances(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Of the cells' first agents to come in above the second: [S, cells]."""
        chances: NDArray[np.float64] = expit((self._design @ points.T).T)
        return chances

    def _climb(self, at: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
        surplus = points - self._counts * self._chances(at)
        return np.asarray((self._design.T @ surplus.T).T - self._precision * at, np.float64)

    def _curve(self, at: NDArray[np.float64]) -> NDArray[np.float64]:
        """[S, n + T] -> [S, n + T, n + T]."""
        chances = self._chances(at)
        curves = (self._counts * chances * (1.0 - chances)) @ self._squares
        return np.asarray(
            curves.reshape(-1, self._size, self._size) + np.diag(self._precision), np.float64
        )


def _indicate(
    rows: NDArray[np.int64], columns: NDArray[np.int64], shape: tuple[int, int]
) -> csr_array:
    return csr_array((np.ones(len(rows)), (rows, columns)), shape=shape)
