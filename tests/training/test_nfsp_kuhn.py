"""Kuhn poker of OpenSpiel: the average policy comes near the equilibrium, which no greedy one can.

Exploitability is OpenSpiel's own. The best of all pure strategies, and so any greedy network, is
exploitable by 1/6; see `tests/self_play/test_kuhn.py`.
"""

import dataclasses

import numpy as np
import pytest
import torch

from marl_cair.policies.q_network import QNetworkConfig, make_q_network
from marl_cair.replay.reservoir import Reservoir
from marl_cair.replay.transition import TransitionSpec
from marl_cair.training.collecting.average_policy import AveragePolicy
from marl_cair.training.run import TrainingRun
from marl_cair.training.settings import config as settings_of
from marl_cair.training.settings.config import GameSettings, OpponentSettings, TrainConfig
from marl_cair.training.settings.learner import LearnerSettings, NfspSettings
from marl_cair.training.trainer import Timers, iterate

pyspiel = pytest.importorskip("pyspiel", reason="OpenSpiel is the extra `openspiel`")

from tests.games import kuhn_poker  # noqa: E402  # needs OpenSpiel
from tests.games.kuhn_poker import ENDED, read_tree  # noqa: E402

EPISODES, BATCH = 100_000, 500
EPSILON, RATE = 0.05, 0.02
NEVER = 10**9
NETWORK = QNetworkConfig(body="mlp", head="plain", hidden_width=16)


def exploit(chances):
    """OpenSpiel's exploitability of chances [I, 2] of the actions by what is seen."""
    from open_spiel.python import policy as policies
    from open_spiel.python.algorithms import exploitability

    game = pyspiel.load_game("kuhn_poker")
    tabular = policies.TabularPolicy(game)
    for number, name in enumerate(read_tree().names):
        if name in tabular.state_lookup:
            tabular.action_probability_array[tabular.state_lookup[name]] = chances[number]
    return exploitability.exploitability(game, tabular)


def find_chances(policy):
    with torch.no_grad():
        return policy.network(torch.eye(len(read_tree().names))).softmax(1).double().numpy()


def play(values, chances, answering, rng):
    """Games of both seats: decisions of the Q-table that "answers", and what each led to."""
    tree = read_tree()
    state = rng.integers(tree.num_deals, size=len(answering))
    last = np.full((*answering.shape, 2), -1)  # what each seat saw and did on its last turn
    answers, cells, targets = [], [], []
    while len(live := np.flatnonzero(tree.player[state] != ENDED)):
        player = tree.player[state[live]]
        seen = tree.seen[state[live], player]
        answered = answering[live, player]
        explores = rng.random(len(live)) < EPSILON
        best = np.where(explores, rng.integers(0, 2, len(live)), values[seen].argmax(1))
        actions = np.where(answered, best, rng.random(len(live)) < chances[seen, 1])
        cells.append(last[live, player].copy())
        targets.append(values[seen].max(1))
        last[live, player] = np.stack([seen, actions], 1)
        answers.append(np.stack([seen, actions], 1)[answered])
        state[live] = tree.child[state[live], actions]
    cells += [last[:, 0], last[:, 1]]
    targets += [tree.returns[state, 0], tree.returns[state, 1]]
    cells, targets = np.concatenate(cells), np.concatenate(targets)
    had_turn = cells[:, 0] >= 0
    return np.concatenate(answers), cells[had_turn], targets[had_turn]


def learn(seed, eta):
    """A table of Q-values, with the real reservoir and the real average policy beside it."""
    size = len(read_tree().names)
    rng, seen = np.random.default_rng(seed), torch.eye(size)
    network = make_q_network(NETWORK, (size,), 2, seed=seed)
    rows = Reservoir(TransitionSpec((size,), 2, 0, torch.float32), 200_000, seed)
    settings = NfspSettings(True, eta, batch_size=256, learning_rate=3e-3, capacity_rows=200_000)
    policy, values = AveragePolicy(network, settings, rows), np.zeros((size, 2))
    for _ in range(EPISODES // BATCH):
        answering = rng.random((BATCH, 2)) < eta
        answers, cells, targets = play(values, find_chances(policy), answering, rng)
        numbers = cells[:, 0] * 2 + cells[:, 1]
        counts = np.bincount(numbers, minlength=values.size).reshape(values.shape)
        sums = np.bincount(numbers, targets, values.size).reshape(values.shape)
        share = 1.0 - (1.0 - RATE) ** np.minimum(20, counts)
        values += share * (sums / np.maximum(1, counts) - values)
        legal = torch.ones(len(answers), 2, dtype=torch.bool)
        observed, actions = torch.from_numpy(answers.astype(np.int64)).unbind(1)
        rows.extend(seen[observed], legal, actions)
        policy.learn(2)
    return policy, values


@pytest.mark.slow
def test_the_average_policy_comes_near_the_equilibrium_and_the_greedy_one_cannot():
    policy, values = learn(0, eta=0.2)
    assert exploit(np.eye(2)[values.argmax(1)]) >= 1 / 6 - 1e-9
    assert exploit(find_chances(policy)) <= 0.06


@pytest.mark.slow
def test_a_training_run_comes_near_the_equilibrium(tmp_path, monkeypatch):
    """Networks for both halves, the engine, the collector and the replay as in every run."""
    kuhn_poker.register(monkeypatch)
    frames = 400_000
    config = TrainConfig(
        out=str(tmp_path / "a"),
        total_frames=frames,
        torch_threads=1,
        synthetic_fraction=0.0,
        game=GameSettings("kuhn_poker", "two", "vector", reward="sparse"),
        policy=dataclasses.replace(NETWORK, hidden_width=32),
        opponent=OpponentSettings(
            {"latest": 1.0}, snapshot_every_frames=NEVER, snapshot_margin=None
        ),
        collector=settings_of.CollectorSettings(num_worlds=512, steps_per_batch=4),
        exploration=settings_of.ExplorationSettings(
            epsilon_start=0.05, epsilon_end=0.02, anneal_frames=frames
        ),
        replay=settings_of.ReplaySettings(60_000, 1, min_transitions=2_000),
        # One step, as the average policy plays most games, and the mean of what is paid, not
        # near the median, as of smooth_l1: with either the answers are no best ones.
        learner=LearnerSettings(
            batch_size=512,
            gamma=1.0,
            n_steps=1,
            loss="l2",
            learning_rate=3e-3,
            target_tau=0.05,
        ),
        nfsp=NfspSettings(True, 0.2, capacity_rows=200_000, batch_size=256, learning_rate=3e-3),
        generator=settings_of.GeneratorSettings("none"),
        evaluation=settings_of.EvaluationSettings(every_frames=NEVER, bots=()),
        checkpoint=settings_of.CheckpointSettings(every_frames=NEVER),
    )
    run = TrainingRun(config)
    steps = iterate(run, Timers())
    while run.frames < frames:
        next(steps)
    assert exploit(find_chances(run.average_policy)) <= 0.06
    run.close()
