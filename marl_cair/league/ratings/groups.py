"""Groups of agents that share a rating scale, and bounds on the distance between groups.

Maximum-likelihood Bradley-Terry ratings exist only within a set of agents whose graph "has taken
points off" is strongly connected (Ford 1957, "Solution of a ranking problem from binary
comparisons"). Between two such sets all points went one way: no result limits their distance.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.sparse.csgraph import connected_components, shortest_path
from scipy.special import log_expit

ELO_PER_LOGIT = 400.0 / math.log(10.0)
# At a smaller distance than the bound, winning every game would be rarer than this.
SWEEP_PROBABILITY = 0.025
_GRID = 128  # points between which gaps are interpolated
_MAX_GAP_ELO = 20_000.0  # between two agents; beyond what any number of games shows


def find_groups(points: NDArray[np.float64]) -> list[list[int]]:
    """Strongly connected sets of agents, weakest first; points [n, n] of the row off the column."""
    reach = _find_reach(points)
    members: dict[bytes, list[int]] = {}
    for agent, both_ways in enumerate(reach & reach.T):
        members.setdefault(both_ways.tobytes(), []).append(agent)
    # An agent that took points off a group reaches all that the group reaches, and itself.
    return sorted(members.values(), key=lambda group: (int(reach[group[0]].sum()), group))


def split_core(points: NDArray[np.float64]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """The largest strongly connected set, and the agents that took points off it: bool [n] both."""
    num_groups, labels = connected_components(points > 0.0, directed=True, connection="strong")
    if num_groups == 1:
        everyone = np.ones(len(points), np.bool_)
        return everyone, everyone
    core: NDArray[np.bool_] = labels == labels[np.bincount(labels)[labels].argmax()]
    return core, _find_reach(points)[:, core.argmax()]


def require_comparison(names: Sequence[str], points: NDArray[np.float64], reference: int) -> None:
    """Check that a chain of points leads from each agent to the reference, or back.

    Raises:
        ValueError: agents that no such chain compares with the reference; names them.
    """
    reach = _find_reach(points)
    compared = reach[reference] | reach[:, reference]
    if not compared.all():
        apart = [name for name, is_near in zip(names, compared, strict=True) if not is_near]
        raise ValueError(
            f"no games compare {', '.join(apart)} with {names[reference]}: let them play each "
            "other first"
        )


def find_home(groups: Sequence[Sequence[int]]) -> int:
    """The group that has the zero of the scale: the largest, the best among equals."""
    return max(range(len(groups)), key=lambda place: (len(groups[place]), place))


def place_groups(
    groups: Sequence[list[int]],
    home: int,
    fitted: NDArray[np.float64],
    meetings: NDArray[np.float64],
    probability: float = SWEEP_PROBABILITY,
) -> NDArray[np.float64]:
    """Elo [n]: the home group's mean is 0, the others are as far away as `find_gap` says.

    fitted: Elo [n] within each group. meetings: games [n, n] of both.
    """
    elo = fitted.copy()
    for group in groups:
        elo[group] -= elo[group].mean()
    for group, upper, lower, way in _go_outward(groups, home):
        counts = meetings[np.ix_(upper, lower)]
        elo[group] += way * find_gap(elo[upper], elo[lower], counts, probability)
    return elo


def draw_places(
    groups: Sequence[list[int]],
    home: int,
    fitted: NDArray[np.float64],
    meetings: NDArray[np.float64],
    num_samples: int,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Possible means of each agent's group, Elo [samples, n], from the distances that the sweeps
    between groups leave possible: after a few games a group may as well be below the next.
    """
    elo = place_groups(groups, home, fitted, meetings, 0.5)
    moved = np.zeros((num_samples, len(elo)))
    totals = {1.0: np.zeros(num_samples), -1.0: np.zeros(num_samples)}
    for group, upper, lower, way in _go_outward(groups, home):
        counts, chances = meetings[np.ix_(upper, lower)], rng.random(num_samples)
        totals[way] = totals[way] + way * draw_gaps(elo[upper], elo[lower], counts, chances)
        moved[:, group] = totals[way][:, None]
    for group in groups:
        moved[:, group] += elo[group].mean()
    return moved


def _go_outward(
    groups: Sequence[list[int]], home: int
) -> Iterator[tuple[list[int], list[int], list[int], float]]:
    """Each group but `home`, from there up and then down: it, the upper and the lower of it and all
    groups before, and 1 (up) or -1.
    """
    placed = list(groups[home])
    for group in groups[home + 1 :]:
        yield group, group, placed, 1.0
        placed += group
    for group in reversed(groups[:home]):
        yield group, placed, group, -1.0
        placed += group


def find_gap(
    upper: NDArray[np.float64],
    lower: NDArray[np.float64],
    counts: NDArray[np.float64],
    probability: float = SWEEP_PROBABILITY,
) -> float:
    """Elo to add to `upper` [n]: at this distance from `lower` [m] a clean sweep of independent
    games has the given probability. After few games it is negative.

    counts [n, m]: games of each upper agent against each lower one, all won by the upper.
    """
    distances = upper[:, None] - lower

    def surplus(gap: float) -> float:
        logits = (distances + gap) / ELO_PER_LOGIT
        return float((counts * log_expit(logits)).sum()) - math.log(probability)

    widest = _MAX_GAP_ELO + float(np.abs(distances).max())
    return float(brentq(surplus, -widest, widest, xtol=1e-6))


def draw_gaps(
    upper: NDArray[np.float64],
    lower: NDArray[np.float64],
    counts: NDArray[np.float64],
    chances: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The gaps [S] of `find_gap` for probabilities [S], from 0.001 to 0.999 about: drawn evenly,
    they are the distances that a sweep leaves possible, as likely as it makes them.
    """
    least, most = (find_gap(upper, lower, counts, end) for end in (0.001, 0.999))
    grid = np.linspace(least, most, _GRID)
    logits = (upper[:, None] - lower + grid[:, None, None]) / ELO_PER_LOGIT
    chances_of_sweep = (counts * log_expit(logits)).sum(axis=(1, 2))
    return np.asarray(
        np.interp(np.log(np.maximum(chances, 1e-9)), chances_of_sweep, grid), np.float64
    )


def _find_reach(points: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether a chain of points leads from the row's agent to the column's, bool [n, n]."""
    steps = shortest_path((points > 0.0).astype(np.float64), unweighted=True)
    reach: NDArray[np.bool_] = np.isfinite(steps)
    return reach
