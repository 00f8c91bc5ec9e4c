"""Places groups of agents on one scale: the largest has the zero, the others are bounded."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from marl_cair.league.ratings.groups import SWEEP_PROBABILITY, draw_gaps, find_gap


def find_home(groups: Sequence[Sequence[int]]) -> int:
    """The group of the zero of the scale: the largest, the best among equals."""
    return max(range(len(groups)), key=lambda place: (len(groups[place]), place))


def place_groups(
    groups: Sequence[list[int]],
    home: int,
    fitted: NDArray[np.float64],
    meetings: NDArray[np.float64],
    probability: float = SWEEP_PROBABILITY,
) -> NDArray[np.float64]:
    """Elo [agents]: the home group's mean is 0, the others lie as far away as is sure, or as a
    sweep of another probability says.
    """
    elo = fitted.copy()
    for group in groups:
        elo[group] -= elo[group].mean()
    placed = list(groups[home])
    for group in groups[home + 1 :]:
        elo[group] += find_gap(
            elo[group], elo[placed], meetings[np.ix_(group, placed)], probability
        )
        placed += group
    for group in reversed(groups[:home]):
        elo[group] -= find_gap(
            elo[placed], elo[group], meetings[np.ix_(placed, group)], probability
        )
        placed += group
    return elo


def draw_places(
    groups: Sequence[list[int]],
    home: int,
    fitted: NDArray[np.float64],
    meetings: NDArray[np.float64],
    num_samples: int,
    rng: np.random.Generator,
) -> NDArray[np.float64]:
    """Where the mean of each agent's group may lie, Elo [samples, agents]: a group that has won a
    few games only may as well be below the next.
    """
    elo = place_groups(groups, home, fitted, meetings, 0.5)
    moved = np.zeros((num_samples, len(elo)))
    placed = list(groups[home])
    for nearer, further in ((groups[home + 1 :], 1.0), (groups[:home][::-1], -1.0)):
        total = np.zeros(num_samples)
        for group in nearer:
            upper, lower = (group, placed) if further > 0.0 else (placed, group)
            counts, chances = meetings[np.ix_(upper, lower)], rng.random(num_samples)
            total = total + further * draw_gaps(elo[upper], elo[lower], counts, chances)
            moved[:, group] = total[:, None]
            placed += group
    for group in groups:
        moved[:, group] += elo[group].mean()
    return moved
