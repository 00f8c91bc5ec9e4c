"""Plans of seconds for tests, and how their cells are made without the command line."""

import functools
from pathlib import Path

from marl_cair.cli.experiment import compose
from marl_cair.experiments.cells import make_cells
from marl_cair.experiments.plan import Plan
from marl_cair.training.settings.config_file import build_value

WORDS = [
    *("game=deep_maze", "scenario=7x7-stochastic", "generator=none"),
    *("max_ticks=30", "collector.num_worlds=8", "collector.steps_per_batch=8"),
    *("policy=mlp", "representation=vector", "policy.hidden_width=16", "learner.batch_size=16"),
    *("replay.min_transitions=64", "checkpoint.every_frames=256", "evaluation.bots=[]"),
]
TINY = {
    "about": "Which learner?",
    "words": WORDS,
    "tasks": {"maze": {"rating": {"games": 4}, "agents": ["oracle"], "scale": [-1, "oracle"]}},
    "factors": {"learner": {"dqn": [], "pqn": ["learner.algorithm=pqn"]}},
    "seeds": [0, 1],
    "budget": {"frames": 512},
    "looks": {"frames": 128},
}


def make_plan(**changes):
    """TINY with other options."""
    return build_value(Plan, {**TINY, **changes})


def change_task(**changes):
    """The tasks of TINY with other options of its one task."""
    return {"maze": {**TINY["tasks"]["maze"], **changes}}


@functools.cache  # Hydra takes a second
def compose_once(layers):
    return compose(layers)


def compose_layers(layers):
    return compose_once(tuple(map(tuple, layers)))


def list_cells(plan, folder=Path("out"), scale=1.0):
    return make_cells(plan, compose_layers, scale, folder)
