"""The Plackett-Luce likelihood of finishing orders (of two teams Bradley-Terry), and its maximum.

A game of T teams is a sequence of choices: the best of all, the best of the rest, ... (Luce 1959;
Plackett 1975, "The analysis of permutations"). The chance to be chosen from a set is in proportion
to exp(rating of the agent + advantage of the team's seat). With two teams this is Bradley-Terry.
Teams that finish together count as the mean of the log-likelihoods of all their orders: a draw of
two is half a win of each. With seat advantages there is no simple iteration as for Bradley-Terry:
Newton's method finds the maximum. The tests compare it with choix's.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.sparse import csr_array

from marl_cair.league.ratings.games import split_work
from marl_cair.league.ratings.groups import ELO_PER_LOGIT

PRIOR_ELO = 2_000.0  # standard deviation of ratings about the mean of their group
SEAT_PRIOR_ELO = 400.0  # of seat advantages about 0
MAX_STEP = 2.0  # logits: Newton's steps are cut to this
NEWTON_TOLERANCE, CHORD_TOLERANCE = 1e-8, 1e-3  # logits
MAX_NEWTON_STEPS, MAX_CHORD_STEPS = 200, 15


@dataclass(frozen=True)
class Rankings:
    """N games of T teams.

    Attributes:
        agents: int64 [N, T], the agent that played each team, by place in the list of agents.
        ranks: float64 [N, T], 1 is the best, equal teams share the mean; 0: leave the team out.
        blocks: int64 [N], the block of each game, 0..K-1: blocks are resampled as wholes.
    """

    agents: NDArray[np.int64]
    ranks: NDArray[np.float64]
    blocks: NDArray[np.int64]

    @property
    def num_blocks(self) -> int:
        """K."""
        return int(self.blocks.max()) + 1 if len(self.blocks) else 0

    @property
    def num_teams(self) -> int:
        """T."""
        return int(self.agents.shape[1])


def rank_pairs(
    winners: NDArray[np.int64],
    losers: NDArray[np.int64],
    seats: NDArray[np.int64],
    num_teams: int,
    blocks: NDArray[np.int64],
) -> Rankings:
    """Games of two agents in the seats [N, 2] of the winner and the loser; others take no part."""
    rows, shape = np.arange(len(winners))[:, None], (len(winners), num_teams)
    agents, ranks = np.zeros(shape, np.int64), np.zeros(shape)
    agents[rows, seats] = np.column_stack((winners, losers))
    ranks[rows, seats] = 1.0, 2.0
    return Rankings(agents, ranks, blocks)


def split_ranking(
    ranks: Sequence[float],
) -> tuple[list[float], list[tuple[tuple[int, ...], float]]]:
    """How often each of T teams is chosen, and the sets chosen from: (teams, weight of the set).

    The log-likelihood is sum(times chosen * strength) - sum(weight * log(sum(exp(strengths of the
    set)))). Sets of one are left out, together with their choice.
    """
    chosen = [0.0] * len(ranks)
    sets = []
    for rank in sorted({rank for rank in ranks if rank > 0.0}):
        tied = [team for team, other in enumerate(ranks) if other == rank]
        below = tuple(team for team, other in enumerate(ranks) if other > rank)
        for team in tied:
            chosen[team] += 1.0 if below else 1.0 - 1.0 / len(tied)
        for size in range(1 if below else 2, len(tied) + 1):
            weight = 1.0 / math.comb(len(tied), size)
            sets += [(part + below, weight) for part in itertools.combinations(tied, size)]
    return chosen, sets


class Likelihood:
    """The log-likelihood of rankings with a normal prior, as a function of block weights.

    Parameters, in logits: ratings of n agents, then advantages of T teams. The prior makes both
    finite and, as only differences count in the games, centres them on 0: ratings in every set of
    agents that the rankings connect.
    """

    def __init__(self, num_agents: int, rankings: Sequence[Rankings]) -> None:
        """Rankings, one or more, that number their blocks alike."""
        num_teams, num_blocks = rankings[0].num_teams, max(r.num_blocks for r in rankings)
        self.num_agents, self.num_parameters = num_agents, num_agents + num_teams
        self.num_blocks = num_blocks
        parts = zip(*(part for some in rankings for part in self._split(some)), strict=True)
        chosen, listed = ([np.concatenate(c) for c in zip(*p, strict=True)] for p in parts)
        amounts, *places = chosen
        self._chosen = csr_array((amounts, tuple(places)), shape=(num_blocks, self.num_parameters))
        weights, blocks, sets = listed
        # Equal sets of equal agents are one: their weights add up.
        unique, numbers = np.unique(sets, axis=0, return_inverse=True)
        self._weights = csr_array(
            (weights, (blocks, numbers.ravel())), shape=(num_blocks, len(unique))
        )
        self._is_member = unique >= 0
        self._agents = np.maximum(unique, 0)
        # Rating and advantage of each place of each set: two ones in a row; and their products.
        size, rows = self.num_parameters, np.arange(unique.size)
        seats = np.broadcast_to(num_agents + np.arange(num_teams), unique.shape)
        pairs = np.stack((self._agents, seats), 2).reshape(-1, 2)
        products = size * pairs[:, :, None] + pairs[:, None, :]
        self._design = indicate(np.repeat(rows, 2), pairs.ravel(), (len(rows), size))
        self._products = indicate(np.repeat(rows, 4), products.ravel(), (len(rows), size**2))
        self._precision = np.full(size, (ELO_PER_LOGIT / PRIOR_ELO) ** 2)
        self._precision[num_agents:] = (ELO_PER_LOGIT / SEAT_PRIOR_ELO) ** 2

    @property
    def num_places(self) -> int:
        """Places of all sets together, T in each."""
        return int(self._is_member.size)

    def _split(self, rankings: Rankings) -> Iterator[tuple[Any, Any]]:
        """(times chosen, block, parameter) and (weight, block, set [., T]) of each kind of game."""
        patterns, kinds = np.unique(rankings.ranks, axis=0, return_inverse=True)
        for kind, pattern in enumerate(patterns.tolist()):
            here = np.flatnonzero(kinds.ravel() == kind)
            agents, blocks = rankings.agents[here], rankings.blocks[here]
            chosen, sets = split_ranking(pattern)
            teams = np.flatnonzero(chosen)
            seats = np.broadcast_to(self.num_agents + teams, (len(here), len(teams)))
            columns = np.concatenate((agents[:, teams], seats), 1).ravel()
            amounts = np.tile(np.array(chosen)[teams], 2 * len(here))
            members = np.full((len(sets), len(here), rankings.num_teams), -1, np.int64)
            for number, (some, _) in enumerate(sets):
                members[number][:, list(some)] = agents[:, list(some)]
            weights = np.repeat([weight for _, weight in sets], len(here))
            rows = members.reshape(-1, rankings.num_teams)
            yield (
                (amounts, np.repeat(blocks, 2 * len(teams)), columns),
                (weights, np.tile(blocks, len(sets)), rows),
            )

    def fit(self, block_weights: NDArray[np.float64]) -> NDArray[np.float64]:
        """The parameters [n + T] of the largest posterior; block_weights float64 [K]."""
        chosen, weights = block_weights @ self._chosen, block_weights @ self._weights
        found = self._fit_by_newton(chosen[None], weights[None], NEWTON_TOLERANCE)
        return np.asarray(found[0], np.float64)

    def refit(
        self,
        start: NDArray[np.float64],
        block_weights: NDArray[np.float64],
        factor: Any,
        tolerance: float = CHORD_TOLERANCE,
    ) -> NDArray[np.float64]:
        """As `fit` for S weightings [S, K] at once, to `tolerance` in logits: [S, n + T].

        From `start`, with the `factor` of `factorise` there: one curvature for all steps is cheap
        where the maximum is near, which it is for resampled blocks; where it is not, `fit` takes
        over.
        """
        points = np.tile(start, (len(block_weights), 1))
        for part in split_work(len(points), self._is_member.size):
            points[part] = self._refit_part(points[part], block_weights[part], factor, tolerance)
        return points

    def _refit_part(
        self,
        points: NDArray[np.float64],
        block_weights: NDArray[np.float64],
        factor: Any,
        tolerance: float,
    ) -> NDArray[np.float64]:
        chosen, weights = block_weights @ self._chosen, block_weights @ self._weights
        is_far = np.zeros(len(points), np.bool_)
        left = np.arange(len(points))
        for _ in range(MAX_CHORD_STEPS):
            shares = self._share(points[left])
            rise = self._find_gradient(points[left], chosen[left], weights[left], shares)
            step = cho_solve(factor, rise.T).T
            points[left] += step
            size = np.abs(step).max(1)
            is_far[left] = ~(size <= MAX_STEP)
            left = left[(size >= tolerance) & (size <= MAX_STEP)]
            if not len(left):
                break
        left = np.union1d(left, np.flatnonzero(is_far))
        for part in split_work(len(left), len(self._agents) * self.num_parameters):
            far = left[part]
            points[far] = self._fit_by_newton(chosen[far], weights[far], tolerance)
        return points

    def _fit_by_newton(
        self, chosen: NDArray[np.float64], weights: NDArray[np.float64], tolerance: float
    ) -> NDArray[np.float64]:
        """Newton's method for S weightings: chosen [S, n + T], weights [S, sets] -> [S, n + T]."""
        points = np.zeros(chosen.shape)
        left = np.arange(len(points))
        for _ in range(MAX_NEWTON_STEPS):
            shares = self._share(points[left])
            rise = self._find_gradient(points[left], chosen[left], weights[left], shares)
            curves = self._find_curvature(weights[left], shares)
            steps = np.linalg.solve(curves, rise[..., None])[..., 0]
            size = np.abs(steps).max(1)
            points[left] += steps * np.minimum(1.0, MAX_STEP / np.maximum(size, 1e-300))[:, None]
            left = left[size >= tolerance]
            if not len(left):
                break
        return points

    def find_curvature(
        self, point: NDArray[np.float64], block_weights: NDArray[np.float64] | None = None
    ) -> NDArray[np.float64]:
        """The observed information with the prior's, [n + T, n + T]; None: every block once."""
        blocks = np.ones(self.num_blocks) if block_weights is None else block_weights
        return self._find_curvature(blocks @ self._weights, self._share(point))

    def factorise(
        self, point: NDArray[np.float64], block_weights: NDArray[np.float64] | None = None
    ) -> Any:
        """The curvature at `point`, as `refit` takes it."""
        return cho_factor(self.find_curvature(point, block_weights))

    def _share(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """The chance of each place of each set to be chosen from it: [..., P] -> [..., sets, T]."""
        strength = (self._design @ points.T).T.reshape(*points.shape[:-1], *self._is_member.shape)
        strength = np.where(self._is_member, strength, -np.inf)
        odds = np.exp(strength - strength.max(-1, keepdims=True))
        return np.asarray(odds / odds.sum(-1, keepdims=True), np.float64)

    def _find_gradient(
        self,
        points: NDArray[np.float64],
        chosen: NDArray[np.float64],
        weights: NDArray[np.float64],
        shares: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """The gradient: points [..., P], chosen [..., P], weights [..., sets] -> [..., P]."""
        mass = (weights[..., None] * shares).reshape(*points.shape[:-1], -1)
        expected = (self._design.T @ mass.T).T
        return np.asarray(chosen - expected - self._precision * points, np.float64)

    def _find_curvature(
        self, weights: NDArray[np.float64], shares: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Minus the second derivatives: weights [..., sets] -> [..., n + T, n + T]."""
        num_sets, size = len(self._agents), self.num_parameters
        mass = (weights[..., None] * shares).reshape(*weights.shape[:-1], -1)
        own = (self._products.T @ mass.T).T.reshape(*weights.shape[:-1], size, size)
        means = np.zeros((*weights.shape, size))
        means[..., self.num_agents :] = shares
        for team in range(shares.shape[-1]):
            means[..., np.arange(num_sets), self._agents[:, team]] += shares[..., team]
        both = np.swapaxes(means, -1, -2) @ (weights[..., None] * means)
        return np.asarray(own - both + np.diag(self._precision), np.float64)


def indicate(
    rows: NDArray[np.int64], columns: NDArray[np.int64], shape: tuple[int, int]
) -> csr_array:
    """A sparse matrix with ones at the given places, added up where one is given again."""
    return csr_array((np.ones(len(rows)), (rows, columns)), shape=shape)
