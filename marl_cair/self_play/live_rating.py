"""Rates a learner during training by openskill. It depends on the order of games.

For the curve alone: the same games in another order give other numbers. What compares agents is
`marl-cair league`, whose ratings are fitted to all games at once.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from openskill.models import PlackettLuce

from marl_cair.ranges import NUMBER, WEIGHT, check_number
from marl_cair.self_play.samplers import LATEST_ID
from marl_cair.self_play.win_rates import OPPONENT


class LiveRating:
    """Mean and uncertainty of the learner and of its opponents, by number (Weng and Lin 2011).

    All begin at openskill's 25 +- 25/3; a snapshot begins with what the learner had then.
    """

    def __init__(self) -> None:
        self._model = PlackettLuce()
        self._ratings: dict[int, tuple[float, float]] = {}

    def note(self, opponent: int, score: float) -> None:
        """One game against `opponent`: above 1/2 won, below lost, else drawn."""
        own, other = (self._model.create_rating([*self.read(n)]) for n in (LATEST_ID, opponent))
        won, lost = float(score < 0.5), float(score > 0.5)  # ranks: the lower is ahead
        rated = self._model.rate([[own], [other]], ranks=[won, lost])
        for number, team in zip((LATEST_ID, opponent), rated, strict=True):
            self._ratings[number] = (float(team[0].mu), float(team[0].sigma))

    def freeze(self, number: int) -> None:
        """A snapshot of the learner has come under `number`."""
        self._ratings[number] = self.read(LATEST_ID)

    def read(self, number: int) -> tuple[float, float]:
        """Mean and standard deviation of one."""
        new = self._model.rating()
        return self._ratings.get(number, (float(new.mu), float(new.sigma)))

    def report(self) -> dict[str, float]:
        """The learner's, by log name; nothing before its first game."""
        if LATEST_ID not in self._ratings:
            return {}
        mean, deviation = self._ratings[LATEST_ID]
        return {"order_dependent_rating": mean, "order_dependent_rating/deviation": deviation}

    def state_dict(self) -> dict[str, Any]:
        """All ratings as plain data."""
        return {"ratings": dict(self._ratings)}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from `state_dict`."""
        self._ratings = {
            check_number(number, "the number of an opponent", OPPONENT): (
                check_number(mean, "mean", NUMBER),
                check_number(deviation, "deviation", WEIGHT),
            )
            for number, (mean, deviation) in state["ratings"].items()
        }
