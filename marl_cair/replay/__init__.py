"""Replay: real transitions stored once, generated ones apart, and exact mixtures of the two."""

from marl_cair.replay.buffer import EpisodeReplayBuffer, ReplayConfig, make_replay_buffer
from marl_cair.replay.generated import GeneratedReplay
from marl_cair.replay.mixed import MixedReplay
from marl_cair.replay.prioritized import PrioritizedSampler
from marl_cair.replay.rollout import Rollout
from marl_cair.replay.sampler import UniformSampler
from marl_cair.replay.storage import EpisodeStorage
from marl_cair.replay.transition import (
    NO_INDEX,
    NO_OPPONENT,
    TransitionSpec,
    check_transitions,
)

__all__ = [
    "NO_INDEX",
    "NO_OPPONENT",
    "EpisodeReplayBuffer",
    "EpisodeStorage",
    "GeneratedReplay",
    "MixedReplay",
    "PrioritizedSampler",
    "ReplayConfig",
    "Rollout",
    "TransitionSpec",
    "UniformSampler",
    "check_transitions",
    "make_replay_buffer",
]
