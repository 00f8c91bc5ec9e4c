"""Under autocast a network's body computes in bfloat16; path distances and heads do not."""

import pytest
import torch

from marl_cair.policies import NETWORKS
from marl_cair.policies.q_network import QNetworkConfig, make_q_network

BOARD, VECTOR, ACTIONS = (3, 12, 12), (10,), 5
MAZE = QNetworkConfig(distances=True, obstacle_planes=(0,))
CELLS = QNetworkConfig(cell_values=True, action_cells=(-1, 0, 7, 20, 143), action_kinds=(0,) * 5)
CONFIGURATIONS = [
    *(
        (QNetworkConfig(body=body), VECTOR if body == "mlp" else BOARD)
        for body in NETWORKS
        if body != "thesis_capsule"
    ),
    (QNetworkConfig(body="thesis_capsule", head="length"), BOARD),
    (MAZE, BOARD),
    (CELLS, BOARD),
]


def see(shape, count=6):
    torch.manual_seed(0)
    return torch.randint(0, 256, (count, *shape), dtype=torch.uint8)


def run(network, observation, is_on=True):
    with torch.autocast("cpu", torch.bfloat16, enabled=is_on):
        return network(observation)


@pytest.mark.parametrize(("config", "shape"), CONFIGURATIONS)
def test_values_are_nearly_the_same(config, shape):
    network = make_q_network(config, shape, ACTIONS, seed=0)
    seen = see(shape) if shape == BOARD else torch.randn(6, *shape)
    dtypes = {"body": [], "head": []}
    network.body.register_forward_hook(lambda _, inputs, out: dtypes["body"].append(out.dtype))
    network.head.register_forward_hook(lambda _, inputs, out: dtypes["head"].append(out.dtype))
    plain, reduced = run(network, seen, is_on=False), run(network, seen)
    assert plain.dtype == reduced.dtype == torch.float32
    assert dtypes == {
        "body": [torch.float32, torch.bfloat16],
        "head": [torch.float32, torch.float32],
    }
    assert not torch.equal(plain, reduced)
    assert (plain - reduced).abs().max() < 0.05 * (1.0 + plain.abs().max())


@pytest.mark.parametrize(("config", "shape"), CONFIGURATIONS)
def test_every_weight_learns_after_a_pass_without_gradients(config, shape):
    """PyTorch keeps casts of weights; before 2.13 those made without gradients stayed so."""
    network = make_q_network(config, shape, ACTIONS, seed=0)
    seen = see(shape) if shape == BOARD else torch.randn(6, *shape)
    with torch.autocast("cpu", torch.bfloat16):
        with torch.no_grad():
            network(seen)
        network(seen).square().sum().backward()
    learned = {name: w.grad is not None and w.grad.any() for name, w in network.named_parameters()}
    run_plain = make_q_network(config, shape, ACTIONS, seed=0)
    run_plain(seen).square().sum().backward()
    expected = {
        name: w.grad is not None and w.grad.any() for name, w in run_plain.named_parameters()
    }
    assert learned == expected
    assert all(w.grad.dtype == torch.float32 for w in network.parameters() if w.grad is not None)


def test_kernels_around_cells_are_reduced_and_their_sums_are_not():
    network, dtypes = make_q_network(CELLS, BOARD, ACTIONS, seed=0), []
    for part in (network.cells.near, network.cells.far, network.cells.values):
        part.register_forward_hook(lambda _, inputs, out: dtypes.append(out.dtype))
    run(network, see(BOARD))
    assert dtypes == [torch.bfloat16, torch.float32, torch.float32]


def test_path_distances_are_exact():
    """bfloat16 cannot represent 257, or distinguish a path of 40 steps from one of 40.1."""
    network = make_q_network(MAZE, BOARD, ACTIONS, seed=0)
    seen, measured = see(BOARD), []
    network.distances.register_forward_hook(lambda _, inputs, out: measured.append(out))
    run(network, seen, is_on=False)
    run(network, seen)
    for plain, reduced in zip(*measured, strict=True):
        assert torch.equal(plain, reduced)
