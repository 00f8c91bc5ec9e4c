"""Settings of exploration, and the table of its kinds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from marl_cair.lookup import LazyTable, check_name
from marl_cair.training.settings.checks import Count, NonNegative, Share, check_fields
from marl_cair.training.settings.learner import interpolate

EPSILON_GREEDY, NOISY = "epsilon_greedy", "noisy"
EXPLORATIONS: LazyTable[Any] = LazyTable(
    {
        EPSILON_GREEDY: "marl_cair.training.collecting.exploration:EpsilonGreedy",
        NOISY: "marl_cair.training.collecting.exploration:NoisyLayers",
    },
    group="marl_cair.explorations",
    base="marl_cair.training.collecting.exploration:Exploration",
)


@dataclass(frozen=True)
class ExplorationSettings:
    """How the learner chooses actions while it collects; rated agents are greedy."""

    kind: str = EPSILON_GREEDY  # epsilon_greedy, noisy (with policy.noisy), or module:Class
    epsilon_start: Share = 1.0  # chance of a random action at frame 0 (epsilon_greedy)
    epsilon_end: Share = 0.02  # the same from `anneal_frames` on
    epsilon_power: NonNegative = 0.0  # how much less often the last world explores than the first
    anneal_frames: Count = 60_000  # frames from start to end, linearly

    def __post_init__(self) -> None:
        check_fields(self, "exploration.")
        check_name("exploration.kind", self.kind, EXPLORATIONS)

    def epsilon_at(self, frames: int) -> float:
        """Linear from start to end over `anneal_frames`."""
        return interpolate(self.epsilon_start, self.epsilon_end, frames / self.anneal_frames)
