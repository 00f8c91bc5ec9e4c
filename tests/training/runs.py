"""Training runs of seconds, what they have collected, and what makes two of them equal."""

import dataclasses
import functools
import hashlib

import numpy as np
import torch

from marl_cair.games import GAMES
from marl_cair.generative.settings import GeneratorConfig, NetworkSize
from marl_cair.policies.q_network import QNetworkConfig, make_q_network
from marl_cair.replay.transition import TransitionSpec
from marl_cair.training import trainer
from marl_cair.training.collecting.metrics import Timers
from marl_cair.training.learner import Learner
from marl_cair.training.run import TrainingRun
from marl_cair.training.settings import config as settings
from marl_cair.training.settings.config import GameSettings, TrainConfig
from marl_cair.training.settings.learner import LearnerSettings
from tests.replay.streams import make_transitions

train = functools.partial(trainer.train, show_progress=False)
GAME = GAMES["deep_line_wars"]
NEVER = 10**9
SMALL_GENERATOR = GeneratorConfig(size=NetworkSize(channels=8, depth=2, hidden=16))


def tiny(folder, frames=1_280, **changes):
    """A run on a small board of Deep Line Wars, with a generator."""
    config = TrainConfig(
        out=str(folder),
        total_frames=frames,
        torch_threads=1,
        policy=QNetworkConfig(hidden_width=32),
        game=GameSettings(scenario="11x11", options={"max_ticks": 300}),
        opponent=settings.OpponentSettings(
            {"latest": 0.3, "uniform": 0.2, "pfsp": 0.2, "counter": 0.3},
            warmup_frames=256,
            snapshot_every_frames=384,
            pool_capacity=2,
        ),
        collector=settings.CollectorSettings(num_worlds=16, steps_per_batch=8),
        replay=settings.ReplaySettings(3_000, 300, min_transitions=300),
        learner=LearnerSettings(batch_size=20, frames_per_update=64),
        generator=settings.GeneratorSettings(
            model=SMALL_GENERATOR,
            batch_size=16,
            frames_per_update=128,
            evaluate_every_frames=512,
        ),
        evaluation=settings.EvaluationSettings(every_frames=NEVER, bots=()),
        checkpoint=settings.CheckpointSettings(every_frames=NEVER),
    )
    return dataclasses.replace(config, **changes)


def small(folder, scenario, mixture=None, frames=512, **changes):
    """A run on the test game, which the fixture `test_game` registers."""
    config = TrainConfig(
        out=str(folder),
        total_frames=frames,
        torch_threads=1,
        policy=QNetworkConfig(hidden_width=8),
        game=GameSettings("last_standing", scenario, reward="sparse"),
        opponent=settings.OpponentSettings(
            mixture or {"latest": 0.3, "random": 0.4, "uniform": 0.3}, snapshot_every_frames=128
        ),
        collector=settings.CollectorSettings(
            num_worlds=8,
            steps_per_batch=16,
            stagger_steps=0,  # whole games can be counted by hand
        ),
        exploration=settings.ExplorationSettings(anneal_frames=NEVER),
        replay=settings.ReplaySettings(3_000, 300, min_transitions=64),
        learner=LearnerSettings(batch_size=16, n_steps=4),
        generator=settings.GeneratorSettings(name="none"),
        synthetic_fraction=0.0,
        evaluation=settings.EvaluationSettings(every_frames=256, games=5, bots=("idle", "random")),
        checkpoint=settings.CheckpointSettings(every_frames=NEVER),
    )
    return dataclasses.replace(config, **changes)


def digest(folder):
    """Of all weights (target and average too), optimiser moments and the replay's files."""
    state = torch.load(folder / "resume" / "state.pt", weights_only=True)["learner"]
    found = hashlib.sha256()
    for network in ("network", "target", "average"):
        for _, value in sorted(state.get(network, {}).items()):
            found.update(value.numpy().tobytes())
    for moments in state["optimizer"]["state"].values():
        found.update(moments["exp_avg"].numpy().tobytes())
    for path in sorted((folder / "resume" / "replay").rglob("*.npy")):
        found.update(path.read_bytes())
    return found.hexdigest()


def train_whole_and_in_parts(folder, make, until):
    """Runs of `make(folder)`, at once and stopped after `until` steps; their bits are equal."""
    whole, parts = folder / "whole", folder / "parts"
    train(make(whole))
    assert train(make(parts), until_frames=until).frames == until
    train(make(parts), resume=True)
    assert digest(whole) == digest(parts)
    return whole, parts


def fill_replays(run):
    """Collect enough to learn from, and copy some of it to the generated rows; returns the steps
    that continue the run.
    """
    steps = trainer.iterate(run, Timers())
    while run.replay.real.num_sampleable < 300:
        next(steps)
    made = run.replay.real.sample_steps(100)
    made["is_generated"][:] = True
    made["index"][:] = -1
    run.replay.generated.extend(made)
    return steps


def make_agent(config):
    """The folder of an agent that has learned nothing."""
    run = TrainingRun(config)
    run.save_agent()
    run.close()
    return str(run.folder / "latest")


def collect(run, num_batches=6):
    """Data [B, T] of some batches; the statistics include its last step."""
    batches = iter(run.collector)
    data = torch.cat([next(batches) for _ in range(num_batches)], 1)
    run.router(data[:, -1]["next"])  # which records the step before
    run.close()
    return data


def was_out(game):
    """Seats [T, P] that were out before the step."""
    return game["player", "done"].squeeze(-1)


def count_by_hand(data, teams):
    """Points of the learner's team in each game, and the plain returns of its seats."""
    points, returns = [], []
    for game in by_game(data):
        owned = game["player", "learned"][0].numpy()
        rewards = game["next", "player", "reward"].squeeze(-1).numpy()
        returns += rewards[:, owned].sum(0).tolist()
        winners, left = set(teams[rewards[-1] >= 1.0]), set(teams[~was_out(game)[-1].numpy()])
        sharing = winners or left
        points.append(float(teams[owned][0] in sharing) / (1 if winners else len(left)))
    return points, returns


def by_game(data):
    """The collected data of each whole game, time first."""
    ended = data["next", "done"].squeeze(-1)
    for world in range(len(data)):
        start = 0
        for end in ended[world].nonzero().flatten().tolist():
            yield data[world, start : end + 1]
            start = end + 1


def make_learner(demonstration=None, learning_rate=0.05, **changes):
    network = make_q_network(QNetworkConfig(hidden_width=8), (2, 8, 8), 3, seed=0)
    chosen = LearnerSettings(batch_size=4, learning_rate=learning_rate, **changes)
    return Learner(network, chosen, demonstration)


def make_batch():
    rows = make_transitions(np.random.default_rng(0), 4, TransitionSpec((2, 8, 8), 3))
    rows["steps_to_next_obs"] = torch.ones(4, 1, dtype=torch.int64)
    rows["is_generated"] = torch.zeros(4, 1, dtype=torch.bool)
    return rows
