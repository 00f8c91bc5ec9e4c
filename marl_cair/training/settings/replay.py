"""Settings of the replay buffers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from marl_cair.lookup import LazyTable, check_name
from marl_cair.training.settings.checks import Allowed, Count, Natural, Share, check_fields, require

TD_ERROR = "td_error"
REPLAY_SAMPLERS: LazyTable[Any] = LazyTable(
    {TD_ERROR: "marl_cair.replay.sampler:PrioritizedSampler"},
    group="marl_cair.replay_samplers",
    base="marl_cair.replay.sampler:Sampler",
)
_SequenceSteps = Annotated[int, Allowed(lambda n: n >= 2, "2 or more")]


@dataclass(frozen=True)
class ReplaySettings:
    """The replay buffers of real and generated transitions."""

    capacity_transitions: int = 200_000  # the newest real transitions are kept
    generated_capacity_transitions: Count = 20_000  # the newest generated ones
    min_transitions: Count = 5_000  # transitions; learning starts with these
    scratch_dir: str | None = None  # observations on disk in this folder; None: in memory
    sampler: str = TD_ERROR  # td_error, by priority_alpha; or module:Class
    priority_alpha: Share = 0.0  # how strongly TD errors decide what is sampled; 0: uniformly
    priority_beta: Share = 0.4  # how far weights correct for that at first; fully at total_frames
    sequence_steps: _SequenceSteps = 16  # learned steps of a sequence, for networks with memory
    burn_in_steps: Natural = 8  # of a sequence before them, which only move its stored state on

    def __post_init__(self) -> None:
        check_fields(self, "replay.")
        check_name("replay.sampler", self.sampler, REPLAY_SAMPLERS)
        is_own = self.sampler == TD_ERROR
        require(is_own or not self.priority_alpha, "replay.priority_alpha", self.priority_alpha,
                f"0 with replay.sampler={self.sampler}")  # fmt: skip
        steps, burn_in = self.sequence_steps, self.burn_in_steps
        allowed = f"below replay.sequence_steps, which is {steps}"
        require(burn_in < steps, "replay.burn_in_steps", burn_in, allowed)
        capacity, least = self.capacity_transitions, self.min_transitions
        require(capacity >= least, "replay.capacity_transitions", capacity, f"{least} or more")
