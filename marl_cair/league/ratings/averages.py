"""Nash averaging and alpha-Rank of a payoff matrix, with intervals.

Point values of both mislead where games are few: they change with the last game. So both are
computed for resampled matrices too (see `payoffs`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from marl_cair.league.ratings.equilibrium import maximum_entropy_nash
from marl_cair.league.ratings.intervals import find_ends
from marl_cair.league.ratings.payoffs import Payoffs

NASH, ALPHA_RANK = "Nash averaging", "alpha-Rank"
NUM_SAMPLES = 200
ALPHA, POPULATION = 100.0, 50  # of alpha-Rank: selection pressure, and agents of a population
# Payoffs float64 [n, n], 1 a win, 0 even, -1 a loss -> a weight for each agent, float64 [n].
Average = Callable[[NDArray[np.float64]], NDArray[np.float64]]


@dataclass(frozen=True)
class Averages:
    """Weights and scores of n agents, by number.

    Attributes:
        weights: float64 [n], in sum 1.
        low, high: float64 [n], 95 % intervals of the weights.
        skills: float64 [n], the share of points against all agents mixed by the weights.
        skill_low, skill_high: float64 [n], 95 % intervals of the skills.
    """

    weights: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    skills: NDArray[np.float64]
    skill_low: NDArray[np.float64]
    skill_high: NDArray[np.float64]

    def reorder(self, order: Sequence[int]) -> Averages:
        """The same with the agents in another order: the first, the second, ..."""
        return Averages(**{name: column[list(order)] for name, column in vars(self).items()})


def average(payoffs: Payoffs, find: Average) -> Averages:
    """Weights by `find`, of the shares as they are and of the first NUM_SAMPLES resampled ones.

    Pairs that never met count as even in the former.
    """
    shares = payoffs.shares
    weights = find(2.0 * shares - 1.0)
    drawn = payoffs.samples[:NUM_SAMPLES]
    found = np.stack([find(2.0 * sample - 1.0) for sample in drawn])
    skills = shares @ weights
    ends = find_ends((drawn @ found[..., None])[..., 0], skills)
    return Averages(weights, *find_ends(found, weights), skills, *ends)


def find_alpha_rank(payoff: NDArray[np.float64]) -> NDArray[np.float64]:
    """alpha-Rank (Omidshafiei et al. 2019, "alpha-Rank: multi-agent evaluation by evolution") by
    OpenSpiel: the stationary distribution of a population that drifts and selects, float64 [n];
    payoff float64 [n, n] of the row. Raises ValueError: OpenSpiel is not installed.
    """
    try:
        from open_spiel.python.egt import alpharank  # an extra
    except ModuleNotFoundError as error:
        raise ValueError(
            "alpha-Rank needs OpenSpiel: pip install 'marl_cair[openspiel]', or leave --alpha-rank "
            "out"
        ) from error
    if len(payoff) == 1:
        return np.ones(1)
    with np.errstate(over="ignore"):  # where a population is all but never left
        _, _, weights, *_ = alpharank.compute(
            [payoff], m=POPULATION, alpha=ALPHA, use_local_selection_model=True
        )
    positive = np.where(weights > 0.0, weights, 0.0)  # rounding leaves some just below
    return np.asarray(positive / positive.sum(), np.float64)


# By title. Nash averaging (Balduzzi et al. 2018, "Re-evaluating evaluation"): weights are the
# equilibrium of highest entropy, so that copies of an agent share its weight and change nothing.
AVERAGES: dict[str, Average] = {NASH: maximum_entropy_nash, ALPHA_RANK: find_alpha_rank}
