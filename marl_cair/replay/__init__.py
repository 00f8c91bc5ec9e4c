"""Replay: real transitions stored once, generated ones apart, and exact mixtures of the two."""

from typing import Any

from marl_cair.lookup import LazyTable

MAX_FRACTION = 0.9  # of a batch that may be generated
MOST_STEPS = 10_000  # between an observation and the next of a row: the most that n_steps may be

_MODULES = {
    "buffer": ("EpisodeReplayBuffer", "ReplayConfig", "make_replay_buffer"),
    "generated": ("GeneratedReplay",),
    "mixed": ("MixedReplay",),
    "prioritized": ("PrioritizedSampler",),
    "rollout": ("Rollout",),
    "sampler": ("UniformSampler",),
    "storage": ("EpisodeStorage",),
    "transition": ("NO_INDEX", "NO_OPPONENT", "TransitionSpec", "check_transitions"),
}
_PLACES: LazyTable[Any] = LazyTable(
    {name: f"{__name__}.{module}:{name}" for module, names in _MODULES.items() for name in names}
)


def __getattr__(name: str) -> Any:
    if name in _PLACES:
        return _PLACES[name]  # torch is loaded only from here on
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
