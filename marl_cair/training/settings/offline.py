"""Settings of learning from a recorded data set."""

from __future__ import annotations

from dataclasses import dataclass

from marl_cair.training.settings.checks import Natural, check_fields


@dataclass(frozen=True)
class OfflineSettings:
    """Learning from a data set of `marl-cair dataset collect`, without playing.

    Its transitions to train on fill replay, and only evaluations play games. Steps are a clock
    then: there is an update for each `learner.frames_per_update` of them. With
    `synthetic_fraction=1` the learner sees no real transition, only those of a generator that was
    trained on the data set.
    """

    dataset: str | None = None  # folder of a data set; None: the run plays
    generator_updates: Natural = 2_000  # of the generator, before the first update of the learner

    def __post_init__(self) -> None:
        check_fields(self, "offline.")
