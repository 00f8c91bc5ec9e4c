"""Replay buffers: real and generated transitions, and batches with an exact share of each."""

from marl_cair.lookup import import_when_used

MAX_FRACTION = 0.9  # of a batch that may be generated
MOST_STEPS = 10_000  # largest n_steps of a return

_MODULES = {
    "buffer": ("EpisodeReplayBuffer", "ReplayConfig", "make_replay_buffer"),
    "dataset": ("DatasetDescription", "TransitionDataset", "load_dataset"),
    "generated": ("GeneratedReplay", "GeneratedSequences"),
    "mixed": ("MixedReplay",),
    "rollout": ("Rollout",),
    "sampler": ("PrioritizedSampler", "UniformSampler"),
    "storage": ("EpisodeStorage",),
    "transition": ("NO_INDEX", "NO_OPPONENT", "TransitionSpec", "check_transitions"),
}
__getattr__ = import_when_used(
    __name__,
    {name: f"{__name__}.{module}:{name}" for module, names in _MODULES.items() for name in names},
)
