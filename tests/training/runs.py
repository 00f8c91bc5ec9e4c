"""Training runs of seconds, what they have collected, and what makes two of them equal."""

import dataclasses
import hashlib

import numpy as np
import torch

from marl_cair.games import GAMES
from marl_cair.generative.settings import GeneratorConfig, NetworkSize
from marl_cair.policies.q_network import QNetworkConfig, make_q_network
from marl_cair.replay.transition import TransitionSpec
from marl_cair.training.collecting.metrics import Timers
from marl_cair.training.learner import Learner
from marl_cair.training.settings.config import (
    CheckpointSettings,
    CollectorSettings,
    EvaluationSettings,
    ExplorationSettings,
    GameSettings,
    GeneratorSettings,
    OpponentSettings,
    ReplaySettings,
    TrainConfig,
)
from marl_cair.training.settings.learner import LearnerSettings
from marl_cair.training.trainer import iterate
from tests.replay.streams import make_transitions

GAME = GAMES["deep_line_wars"]
NEVER = 10**9
SMALL_GENERATOR = GeneratorConfig(
    num_members=2, size=NetworkSize(channels=8, hidden=16, readout=8, factors=4, near_factors=4)
)


def tiny(folder, frames=2_560, **changes):
    config = TrainConfig(
        out=str(folder),
        total_frames=frames,
        torch_threads=1,
        policy=QNetworkConfig(hidden_width=32),
        game=GameSettings(scenario="11x11", options={"max_ticks": 300}),
        opponent=OpponentSettings(
            {"latest": 0.3, "uniform": 0.2, "pfsp": 0.2, "counter": 0.3},
            warmup_frames=256,
            snapshot_every_frames=512,
            pool_capacity=2,
        ),
        collector=CollectorSettings(num_worlds=16, steps_per_batch=8),
        replay=ReplaySettings(3_000, 300, min_transitions=300),
        learner=LearnerSettings(batch_size=20, frames_per_update=64),
        generator=GeneratorSettings(
            model=SMALL_GENERATOR,
            batch_size=16,
            frames_per_update=128,
            evaluate_every_frames=1_024,
        ),
        evaluation=EvaluationSettings(every_frames=NEVER, bots=()),
        checkpoint=CheckpointSettings(every_frames=NEVER),
    )
    return dataclasses.replace(config, **changes)


def small(folder, scenario, mixture=None, frames=768, **changes):
    """A run on the test game, which a test makes known by `last_standing.register`."""
    config = TrainConfig(
        out=str(folder),
        total_frames=frames,
        torch_threads=1,
        policy=QNetworkConfig(hidden_width=8),
        game=GameSettings("last_standing", scenario, reward="sparse"),
        opponent=OpponentSettings(
            mixture or {"latest": 0.3, "random": 0.4, "uniform": 0.3}, snapshot_every_frames=256
        ),
        collector=CollectorSettings(num_worlds=8, steps_per_batch=16),
        exploration=ExplorationSettings(anneal_frames=NEVER),
        replay=ReplaySettings(3_000, 300, min_transitions=64),
        learner=LearnerSettings(batch_size=16, n_steps=4),
        generator=GeneratorSettings(name="none"),
        synthetic_fraction=0.0,
        evaluation=EvaluationSettings(every_frames=512, games=5, bots=("idle", "random")),
        checkpoint=CheckpointSettings(every_frames=NEVER),
    )
    return dataclasses.replace(config, **changes)


def digest(folder):
    """Of all weights (target and average too), optimiser moments and the replay's files."""
    state = torch.load(folder / "resume" / "state.pt", weights_only=True)
    found = hashlib.sha256()
    for _, value in sorted(state["learner"]["loss"].items()):
        found.update(value.numpy().tobytes())
    for _, value in sorted(state["learner"]["average"].items()):
        found.update(value.numpy().tobytes())
    for moments in state["learner"]["optimizer"]["state"].values():
        found.update(moments["exp_avg"].numpy().tobytes())
    for path in sorted((folder / "resume" / "replay").rglob("*.npy")):
        found.update(path.read_bytes())
    return found.hexdigest()


def fill_replays(run):
    """Collect what learning starts with, and put some of it among the generated rows; returns the
    steps with which the run goes on.
    """
    steps = iterate(run, Timers())
    while run.replay.real.num_sampleable < 300:
        next(steps)
    made = run.replay.real.sample_steps(100)
    made["is_generated"][:] = True
    made["index"][:] = -1
    run.replay.generated.extend(made)
    return steps


def by_game(data):
    """Each whole game: what was collected of it, time first."""
    ended = data["next", "done"].squeeze(-1)
    for world in range(len(data)):
        start = 0
        for end in ended[world].nonzero().flatten().tolist():
            yield data[world, start : end + 1]
            start = end + 1


def make_learner(**settings):
    network = make_q_network(QNetworkConfig(hidden_width=8), (2, 8, 8), 3, seed=0)
    return Learner(network, LearnerSettings(batch_size=4, learning_rate=0.05, **settings))


def make_batch():
    rows = make_transitions(np.random.default_rng(0), 4, TransitionSpec((2, 8, 8), 3))
    rows["steps_to_next_obs"] = torch.ones(4, 1, dtype=torch.int64)
    rows["is_generated"] = torch.zeros(4, 1, dtype=torch.bool)
    return rows
