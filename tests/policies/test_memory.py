"""Networks with memory: cells, sequences, states of episodes, and agents of them."""

import itertools

import numpy as np
import pytest
import torch

from marl_cair.lookup import UnknownNameError
from marl_cair.policies import MEMORIES
from marl_cair.policies.actor import CHUNK_ROWS, PolicyActor
from marl_cair.policies.q_network import QNetworkConfig, make_q_network
from tests.recurrent_agents import make_actor

SHAPE, NUM_ACTIONS = (3, 10, 15), 6
each_memory = pytest.mark.parametrize("memory", MEMORIES)


def make_network(memory, **changes):
    config = QNetworkConfig(hidden_width=12, memory=memory, memory_width=5, **changes)
    return make_q_network(config, SHAPE, NUM_ACTIONS, seed=1)


def make_planes(*axes):
    return torch.randint(0, 256, (*axes, *SHAPE), dtype=torch.uint8, generator=seeded())


def seeded():
    return torch.Generator().manual_seed(0)


@each_memory
@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"head": "plain"},
        {"body": "capsule"},
        {"distances": True},
        {"cell_values": True, "action_cells": (-1, 0, 1, 2, 3, 4), "action_kinds": (0,) * 6},
    ],
    ids=str,
)
def test_a_sequence_equals_its_steps_one_by_one(memory, changes):
    network, (steps, rows) = make_network(memory, **changes), (4, 3)
    seen, starts = make_planes(steps, rows), torch.zeros(steps, rows, dtype=torch.bool)
    starts[2, 1] = True
    before = torch.randn(rows, network.state_size, generator=seeded())
    values, states = network.unroll(seen, before, starts)
    assert values.shape == (steps, rows, NUM_ACTIONS)
    assert states.shape == (steps, rows, network.state_size)
    state = before
    for step in range(steps):
        state = torch.where(starts[step, :, None], 0.0, state)
        expected, state = network(seen[step], state)
        torch.testing.assert_close(values[step], expected, rtol=1e-5, atol=1e-5)
        torch.testing.assert_close(states[step], state, rtol=1e-5, atol=1e-5)


@each_memory
def test_the_start_of_an_episode_forgets_all_steps_before_even_nan(memory):
    network, seen = make_network(memory), make_planes(3, 2)
    starts = torch.tensor([[False, False], [False, True], [False, False]])
    lost = torch.full((2, network.state_size), float("nan"))
    values, _ = network.unroll(seen, lost, starts)
    assert values[:, 0].isnan().all()
    assert values[0, 1].isnan().all()
    fresh, _ = network.unroll(seen[1:], torch.zeros_like(lost), starts[1:])
    torch.testing.assert_close(values[1:, 1], fresh[:, 1])


@each_memory
def test_gradients_reach_the_first_step_of_a_sequence_but_not_across_a_start(memory):
    network = make_network(memory)
    for restarts in (False, True):
        state = torch.zeros(1, network.state_size, requires_grad=True)
        starts = torch.tensor([[False], [restarts]])
        values, _ = network.unroll(make_planes(2, 1), state, starts)
        (gradient,) = torch.autograd.grad(values[1].sum(), state)
        assert gradient.any().item() is not restarts


def test_the_cells_are_those_of_torch():
    lstm, gru = (MEMORIES[name](4, 3) for name in ("lstm", "gru"))
    seen, state = torch.randn(2, 4), torch.randn(2, 6)
    hidden, cell = lstm.cell(seen, (state[:, :3], state[:, 3:]))
    features, after = lstm(seen, state)
    assert torch.equal(features, hidden)
    assert torch.equal(after, torch.cat([hidden, cell], 1))
    features, after = gru(seen, state[:, :3].contiguous())
    assert torch.equal(features, gru.cell(seen, state[:, :3].contiguous()))
    assert torch.equal(features, after)
    assert (lstm.state_size, gru.state_size) == (6, 3)


@each_memory
def test_a_missing_or_wrong_state_is_refused(memory):
    network = make_network(memory)
    size, seen = network.state_size, make_planes(2)
    needed = rf"but a network of memory '{memory}' needs \[2, {size}\]: pass zeros where"
    for state, given in ((None, "none"), (torch.zeros(2, size + 1), rf"\[2, {size + 1}\]")):
        with pytest.raises(ValueError, match=f"the state is {given}, {needed}"):
            network(seen, state)
    with pytest.raises(ValueError, match=rf"the state is \[2, 0\], {needed}"):
        PolicyActor(network, "a", "planes").compute_values(seen)


def test_a_network_without_memory_has_no_state():
    network = make_q_network(QNetworkConfig(hidden_width=8), SHAPE, NUM_ACTIONS, seed=0)
    assert network.state_size == PolicyActor(network, "a", "planes").state_size == 0
    assert network(make_planes(2)).shape == (2, NUM_ACTIONS)


def test_settings_are_checked_and_older_ones_have_no_memory():
    with pytest.raises(UnknownNameError, match="'lsmt': nearest are 'lstm'"):
        QNetworkConfig(memory="lsmt")
    with pytest.raises(ValueError, match="memory_width is 0, but must be an integer of at least 1"):
        QNetworkConfig(memory="gru", memory_width=0)
    with pytest.raises(ValueError, match="memory_width is 8, but memory is 'none': set it to lstm"):
        QNetworkConfig(memory_width=8)
    config = QNetworkConfig(memory="gru", hidden_width=24)
    assert QNetworkConfig.from_dict(config.to_dict()) == config
    assert make_q_network(config, SHAPE, NUM_ACTIONS, seed=0).state_size == 24
    older = QNetworkConfig().to_dict()
    del older["memory"], older["memory_width"]
    assert QNetworkConfig.from_dict(older) == QNetworkConfig()


# --- agents --------------------------------------------------------------------------------------


def play(actor, seen, masks, rows):
    """Actions [T, len(rows)] of games `rows` of observations [T, N, ...], played together."""
    state = np.zeros((len(rows), actor.state_size), np.float32)
    played = []
    for observation, mask in zip(seen[:, rows], masks[:, rows], strict=True):
        actions, state = actor.act(observation, mask, state)
        assert (state.dtype, state.shape) == (np.float32, (len(rows), actor.state_size))
        played.append(actions)
    return np.stack(played)


@each_memory
def test_an_agent_plays_the_same_in_any_batch_at_any_place_and_remembers(memory):
    actor, num_games = make_actor((7,), 5, memory), CHUNK_ROWS + 3
    luck = np.random.default_rng(0)
    seen = luck.normal(size=(6, num_games, 7)).astype(np.float32)
    masks = luck.random((6, num_games, 5)) < 0.7
    masks[..., 0] = True
    together = play(actor, seen, masks, np.arange(num_games))
    order = luck.permutation(num_games)
    np.testing.assert_array_equal(play(actor, seen, masks, order), together[:, order])
    for first, last in itertools.pairwise((0, 1, 4, 60, num_games)):
        part = play(actor, seen, masks, np.arange(first, last))
        np.testing.assert_array_equal(part, together[:, first:last])
    seen[0] += 9.0  # another past
    assert (play(actor, seen, masks, np.arange(num_games))[1:] != together[1:]).any()


@each_memory
def test_an_agent_changes_no_state_in_place(memory):
    actor = make_actor((7,), 5, memory)
    state = np.ones((2, actor.state_size), np.float32)
    state.flags.writeable = False
    _, after = actor.act(np.ones((2, 7), np.float32), np.ones((2, 5), np.bool_), state)
    assert (state == 1).all()
    assert (after != 1).any()
