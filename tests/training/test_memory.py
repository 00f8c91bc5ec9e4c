"""Memory of an update is counted before it is needed, with the votes of dynamic routing."""

import dataclasses

import pytest
import torch

from marl_cair import memory
from marl_cair.games import GAMES
from marl_cair.memory import NotEnoughMemoryError
from marl_cair.policies.q_network import QNetwork, QNetworkConfig
from marl_cair.replay.transition import TransitionSpec
from marl_cair.training.memory import count_update_bytes, require_memory_of_learning
from marl_cair.training.settings.config import GeneratorSettings, TrainConfig
from marl_cair.training.settings.learner import LearnerSettings

THESIS = QNetworkConfig(body="thesis_capsule", head="length")
BOARD = (5, 10, 15)
CELLS = {"cell_values": True, "action_cells": (0, -1, 2), "action_kinds": (0, 1, 0)}
CONFIGS = [
    THESIS,
    *(QNetworkConfig(body=body) for body in ("conv", "capsule", "residual", "thesis_conv")),
    *(QNetworkConfig(memory=memory) for memory in ("lstm", "gru")),
    *(QNetworkConfig(**extra) for extra in ({"norm": "layer"}, {"distances": True}, CELLS)),
]


def count_weights(config, shape, num_actions):
    with torch.device("meta"):
        network = QNetwork(config, shape, num_actions)
    return sum(weight.nbytes for weight in network.parameters())


@pytest.mark.parametrize("num_actions", [2, 16, 300])
def test_votes_of_dynamic_routing_are_counted(num_actions):
    num_rows, num_capsules = 64, 36 * 32
    votes = num_rows * num_capsules * num_actions * 16 * 4
    counted = count_update_bytes(THESIS, (1, 28, 28), num_actions, num_rows)
    weights = count_weights(THESIS, (1, 28, 28), num_actions)
    assert counted > 5 * weights + votes
    without = count_update_bytes(THESIS, (1, 28, 28), num_actions, 1)
    assert votes < counted - without
    if num_actions == 300:  # the votes, their gradient, and what is made of them on the way
        assert counted - without < 4 * votes


@pytest.mark.parametrize("config", CONFIGS, ids=lambda config: f"{config.body} {config.memory}")
def test_every_network_is_counted(config):
    weights = count_weights(config, BOARD, 3)
    random = torch.get_rng_state()
    few, many = (count_update_bytes(config, BOARD, 3, rows) for rows in (1, 512))
    assert torch.equal(torch.get_rng_state(), random)
    assert few >= 6 * weights
    assert many > few + 511 * 5 * 10 * 15 * 4  # planes before the first layer, at the least


def test_activations_and_their_gradients_are_counted():
    config = QNetworkConfig(body="mlp", head="plain", hidden_width=8)
    one, two = (count_update_bytes(config, (4,), 2, rows) for rows in (10_000, 20_000))
    numbers = (two - one) / 10_000 / 4
    # The features of both layers live until the gradients; each has a gradient, and a layer's sum
    # lives until its ReLU is done.
    assert 2 * 8 <= numbers <= 2 * (4 * 8 + 2)


def test_buffers_that_a_run_does_not_use_need_no_memory(monkeypatch):
    game = GAMES["deep_line_wars"]
    spec = game.make_spec(game.scenario("10x15"))
    seen = spec.representations["planes"]
    rows = TransitionSpec(seen.shape, spec.num_actions, seen.num_uniform, torch.uint8)
    asked = {}
    monkeypatch.setattr(
        "marl_cair.training.memory.require_memory",
        lambda name, size: asked.update({name.split(" = ")[0]: size}),
    )
    learner = LearnerSettings(algorithm="pqn")
    config = TrainConfig(learner=learner, generator=GeneratorSettings(name="none"))
    require_memory_of_learning(config, QNetworkConfig(), seen, rows)
    buffers = ("nfsp.capacity_rows", "replay.capacity_transitions")
    assert [asked[name] for name in buffers] == [0, 0]
    require_memory_of_learning(TrainConfig(), QNetworkConfig(), seen, rows)
    assert [asked[name] > 0 for name in buffers] == [False, True]


def test_a_batch_of_votes_that_does_not_fit_is_refused(monkeypatch):
    game = GAMES["deep_line_wars"]
    spec = game.make_spec(game.scenario("10x15"))
    seen = spec.representations["planes"]
    rows = TransitionSpec(seen.shape, spec.num_actions, seen.num_uniform, torch.uint8)
    config = TrainConfig()
    small = dataclasses.replace(config.replay, capacity_transitions=5_000)
    config = dataclasses.replace(config, replay=small)
    shape, size = seen.shape, config.learner.batch_size
    needed = count_update_bytes(THESIS, shape, spec.num_actions, size)
    assert needed > 6 * count_weights(THESIS, shape, spec.num_actions)
    monkeypatch.setattr(memory, "total_memory", lambda: needed)
    require_memory_of_learning(config, THESIS, seen, rows)
    monkeypatch.setattr(memory, "total_memory", lambda: needed - 1)
    message = (
        rf"the network \(policy.*\) of [\d,]+ bytes, in updates of learner.batch_size = {size}"
    )
    with pytest.raises(NotEnoughMemoryError, match=message):
        require_memory_of_learning(config, THESIS, seen, rows)
