"""Values of actions that point at a cell: alike everywhere, by place, and learned in a network."""

import json

import pytest
import torch

from marl_cair.policies.cell_values import CellValues
from marl_cair.policies.q_network import QNetworkConfig, make_q_network

ROWS, COLUMNS = 8, 9
CELLS = ROWS * COLUMNS
# Two without a cell, a kind with all cells, and one with some, unordered.
ACTION_CELLS = (-1, *range(CELLS), 9, 3, 30, -1)
ACTION_KINDS = (0, *[1] * CELLS, 4, 4, 4, 2)
NUM_ACTIONS = len(ACTION_CELLS)


def make_config(body="conv", **changes):
    config = QNetworkConfig(body=body, hidden_width=16, cell_values=True, **changes)
    return config.with_actions(ACTION_CELLS, ACTION_KINDS)


def make_planes(num_rows, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return torch.randint(
        0, 256, (num_rows, 3, ROWS, COLUMNS), dtype=torch.uint8, generator=generator
    )


def make_cells():
    """With random weights."""
    cells = CellValues((3, ROWS, COLUMNS), 4, ACTION_CELLS, ACTION_KINDS)
    generator = torch.Generator().manual_seed(1)
    with torch.no_grad():
        for weight in cells.parameters():
            weight.normal_(generator=generator)
    return cells


@pytest.mark.parametrize("body", ["conv", "capsule"])
@pytest.mark.parametrize("head", ["plain", "dueling"])
def test_a_new_network_has_the_values_of_one_without_cell_values(body, head):
    planes = make_planes(5)
    config = QNetworkConfig(body=body, head=head, hidden_width=16)
    plain = make_q_network(config, (3, ROWS, COLUMNS), NUM_ACTIONS, seed=3)
    network = make_q_network(make_config(body, head=head), (3, ROWS, COLUMNS), NUM_ACTIONS, seed=3)
    assert torch.equal(network(planes), plain(planes))
    with torch.no_grad():
        network.cells.values.bias.fill_(1.0)
    changed = network(planes) - plain(planes)
    assert changed[:, [0, -1]].abs().max() == 0
    assert changed[:, 1:-1].sub(1).abs().max() < 1e-5


def test_values_shift_with_the_board():
    cells, features = make_cells(), torch.ones(1, 4)
    planes = torch.zeros(2, 3, ROWS, COLUMNS)
    planes[0, 1, 2, 2] = planes[1, 1, 3, 4] = 1.0
    values = cells(planes, features.expand(2, -1), torch.zeros(2, NUM_ACTIONS))
    board = values[:, 1 : 1 + CELLS].view(2, ROWS, COLUMNS)
    around = board[0, 1:4, 1:4], board[1, 2:5, 3:6]
    torch.testing.assert_close(*around)
    assert around[0].std() > 0.1


def test_actions_of_a_kind_differ_by_their_cell_and_kinds_by_their_weights():
    cells = make_cells()
    planes, features = make_planes(3) / 255, torch.ones(3, 4)
    values = cells(planes, features, torch.zeros(3, NUM_ACTIONS))
    by_cell = values[:, 1 : 1 + CELLS]
    with torch.no_grad():
        cells.values.weight[1] = cells.values.weight[0]
        cells.values.bias[1] = cells.values.bias[0]
    again = cells(planes, features, torch.zeros(3, NUM_ACTIONS))
    assert not torch.equal(values[:, -4:-1], by_cell[:, [9, 3, 30]])
    assert torch.equal(again[:, -4:-1], by_cell[:, [9, 3, 30]])


def test_the_rest_of_the_board_counts_too():
    cells, planes = make_cells(), torch.zeros(2, 3, ROWS, COLUMNS)
    features = torch.stack([torch.zeros(4), torch.ones(4)])
    values = cells(planes, features, torch.zeros(2, NUM_ACTIONS))
    assert (values[0] - values[1])[1:-1].abs().min() > 0


@pytest.mark.parametrize("body", ["conv", "capsule"])
def test_every_weight_gets_a_gradient_once_values_are_not_0(body):
    network = make_q_network(make_config(body), (3, ROWS, COLUMNS), NUM_ACTIONS, seed=0)
    with torch.no_grad():
        network.cells.values.weight.normal_()
    network(make_planes(8)).square().sum().backward()
    assert all(weight.grad.abs().max() > 0 for weight in network.cells.parameters())


def find_missed(network, updates=60):
    """Share of new boards on which another cell than the marked one is chosen, once learned."""
    generator = torch.Generator().manual_seed(0)
    optimiser = torch.optim.Adam(network.parameters(), 2e-3)

    def draw(count):
        marked = torch.randint(0, CELLS, (count,), generator=generator)
        planes = torch.randint(0, 2, (count, 3, CELLS), generator=generator)
        planes[:, 1:] = 0  # noise in the first alone
        planes[torch.arange(count), 1, marked] = 1
        return (255 * planes).to(torch.uint8).view(-1, 3, ROWS, COLUMNS), marked

    for _ in range(updates):
        planes, marked = draw(32)
        loss = torch.nn.functional.cross_entropy(network(planes)[:, 1 : 1 + CELLS], marked)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
    planes, marked = draw(400)
    return (network(planes)[:, 1 : 1 + CELLS].argmax(1) != marked).float().mean().item()


@pytest.mark.slow
def test_a_rule_for_one_cell_is_learned_for_all():
    shape = 3, ROWS, COLUMNS
    dense = make_q_network(QNetworkConfig(hidden_width=16), shape, NUM_ACTIONS, seed=0)
    assert find_missed(make_q_network(make_config(), shape, NUM_ACTIONS, seed=0)) < 0.02
    assert find_missed(dense) > 0.3


def test_the_configuration_survives_a_checkpoint():
    config = make_config()
    assert QNetworkConfig.from_dict(json.loads(json.dumps(config.to_dict()))) == config
    assert config.with_actions((0,), (0,)) == config  # of the agent that it was
    own = QNetworkConfig(cell_values=True, action_kinds=(7, 7)).with_actions((0, -1), (1, 2))
    assert (own.action_cells, own.action_kinds) == ((0, -1), (7, 7))
    plain = QNetworkConfig()
    assert plain.with_actions(ACTION_CELLS, ACTION_KINDS) is plain


@pytest.mark.parametrize(
    ("shape", "cells", "message"),
    [
        (
            (6,),
            (0, -1),
            r"reads boards \[C, H, W\], but the observation has shape \(6,\): take representation",
        ),
        ((3, 8, 8), (-1, -1), "none of the actions points at a cell: set cell_values to False"),
        ((3, 8, 8), (64, -1), r"points at cell 64, but the observation has the cells 0\.\.63"),
        ((3, 8, 8), (0,), "for 2 actions, but action_cells has 1 entries and action_kinds 1: give"),
    ],
)
def test_observations_and_actions_without_cells_are_refused(shape, cells, message):
    body = "mlp" if len(shape) == 1 else "conv"
    config = QNetworkConfig(body=body, cell_values=True).with_actions(cells, (0,) * len(cells))
    with pytest.raises(ValueError, match=message):
        make_q_network(config, shape, 2, seed=0)
