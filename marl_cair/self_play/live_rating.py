"""Rates a learner during training by openskill, for a curve in the log.

The rating depends on the order of games. Compare agents by `marl-cair league`, which fits ratings
to all games at once.
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

    All start at openskill's 25 +- 25/3; a snapshot starts with the learner's rating.
    """

    def __init__(self) -> None:
        self._model = PlackettLuce()
        self._ratings: dict[int, tuple[float, float]] = {}

    def note(self, opponent: int, score: float) -> None:
        """Rate one game against `opponent`; score: above 1/2 won, below lost, else drawn."""
        own, other = (self._model.create_rating([*self.read(n)]) for n in (LATEST_ID, opponent))
        won, lost = float(score < 0.5), float(score > 0.5)  # ranks: the lower is ahead
        rated = self._model.rate([[own], [other]], ranks=[won, lost])
        for number, team in zip((LATEST_ID, opponent), rated, strict=True):
            self._ratings[number] = (float(team[0].mu), float(team[0].sigma))

    def freeze(self, number: int) -> None:
        """Start the snapshot `number` with the learner's rating."""
        self._ratings[number] = self.read(LATEST_ID)

    def read(self, number: int) -> tuple[float, float]:
        """Mean and standard deviation of `number`."""
        new = self._model.rating()
        return self._ratings.get(number, (float(new.mu), float(new.sigma)))

    def report(self) -> dict[str, float]:
        """The learner's rating by log name; empty before its first game."""
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
