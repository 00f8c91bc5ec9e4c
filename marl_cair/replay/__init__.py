"""Replay: real transitions stored once, generated ones apart, and exact mixtures of the two."""

from marl_cair.lookup import import_when_used

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
__getattr__ = import_when_used(
    __name__,
    {name: f"{__name__}.{module}:{name}" for module, names in _MODULES.items() for name in names},
)
