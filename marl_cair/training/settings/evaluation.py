"""Settings of evaluations while training, and of a run's saved states."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

from marl_cair.training.settings.checks import Count, check_fields, require, require_once


@dataclass(frozen=True)
class EvaluationSettings:
    """Greedy games with the rated reward, while training: against bots, or alone in scenarios of
    one team.
    """

    every_frames: Count = 100_000  # frames between two evaluations
    games: Count = 64  # games against each bot, rounded up to as many in each seat (or team)
    bots: tuple[str, ...] = ("random",)  # opponents; with one team, policies to compare with
    options: dict[str, Any] = field(default_factory=dict)  # changes to the scenario, {map: ...}
    scenarios: dict[str, dict[str, Any]] = field(default_factory=dict)  # held-out ones, {name: ...}
    record: bool = True  # keep replays of the last evaluation's first map in <out>/games

    def __post_init__(self) -> None:
        check_fields(self, "evaluation.")
        require_once("evaluation.bots", self.bots)
        for name in self.scenarios:
            plain = re.fullmatch(r"[\w-]+", name) is not None
            require(plain, "evaluation.scenarios", name, "names of letters, digits, _ and -")
        for place, options in self.changes().items():
            require("reward" not in options, place, options, "without reward: the game's own rates")

    def changes(self) -> dict[str, dict[str, Any]]:
        """Changed fields of the training scenario, by option: first the scenario that selects the
        best agent, then those that are held out.
        """
        heldout = {f"evaluation.scenarios.{name}": self.scenarios[name] for name in self.scenarios}
        return {"evaluation.options": self.options} | heldout


@dataclass(frozen=True)
class CheckpointSettings:
    """Files of a run. `<out>/latest` is the agent at the last evaluation or state."""

    every_frames: Count = 200_000  # frames between two resumable states
    include_replay: bool = True  # else a resumed run begins with an empty replay

    def __post_init__(self) -> None:
        check_fields(self, "checkpoint.")
