"""Replay buffers: real and generated transitions, and batches with an exact share of each."""

from marl_cair.lookup import import_when_used

MAX_FRACTION = 0.9  # of a batch that may be generated
MOST_STEPS = 10_000  # largest n_steps of a return

__getattr__ = import_when_used(__name__, {"load_dataset": f"{__name__}.dataset:load_dataset"})
