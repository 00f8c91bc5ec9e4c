"""Each capsule layer against plain loops in float64; the thesis's networks, and `residual`."""

import math
import re

import pytest
import torch
from torch import nn
from torch.nn import functional

from marl_cair.policies import capsule_layers
from marl_cair.policies.capsule_layers import (
    DenseCapsules,
    EntityRouting,
    GridPooling,
    PartCapsules,
    PrimaryCapsules,
    measure_presence,
    squash,
    sum_routed,
)
from marl_cair.policies.q_network import QNetwork, QNetworkConfig, make_q_network
from marl_cair.policies.residual import ResidualBlock
from marl_cair.policies.thesis import LengthHead, choose_kernel

THESIS = QNetworkConfig(body="thesis_capsule", head="length")
THESIS_CONV, RESIDUAL = QNetworkConfig(body="thesis_conv"), QNetworkConfig(body="residual")
NORMED = QNetworkConfig(body="residual", norm="layer")
NEW = [THESIS, THESIS_CONV, RESIDUAL, NORMED]
BOARD = (3, 10, 12)


@pytest.fixture(autouse=True)
def _seeded():
    with torch.random.fork_rng(devices=[]):
        torch.default_generator.manual_seed(0)
        yield


def draw(*shape, needs_gradient=False):
    return torch.randn(*shape, dtype=torch.float64, requires_grad=needs_gradient)


def check_gradients(layer, *inputs):
    """Of inputs and weights, by finite differences."""
    names, weights = zip(*layer.double().named_parameters(), strict=True)

    def run(*given):
        seen, values = given[: len(inputs)], given[len(inputs) :]
        return torch.func.functional_call(layer, dict(zip(names, values, strict=True)), seen)

    given = [*inputs, *(weight.detach().requires_grad_() for weight in weights)]
    assert torch.autograd.gradcheck(run, given)


# --- references --------------------------------------------------------------------------------


def squash_plainly(vector):
    squared = sum(float(value) ** 2 for value in vector)
    return [float(value) * math.sqrt(squared) / (1.0 + squared) for value in vector]


def convolve_plainly(planes, layer):
    """One image [C, H, W] by the convolution `layer`, as lists [out][row][column]."""
    filters, biases = layer.weight.detach(), layer.bias.detach()
    kernel, stride, padding = layer.kernel_size[0], layer.stride[0], layer.padding[0]
    padded = functional.pad(planes, (padding,) * 4)
    rows, columns = ((side - kernel) // stride + 1 for side in padded.shape[1:])
    return [
        [
            [
                float(bias)
                + sum(
                    float(weight[c, i, j] * padded[c, y * stride + i, x * stride + j])
                    for c in range(len(planes))
                    for i in range(kernel)
                    for j in range(kernel)
                )
                for x in range(columns)
            ]
            for y in range(rows)
        ]
        for weight, bias in zip(filters, biases, strict=True)
    ]


def soften(values):
    raised = [math.exp(value) for value in values]
    return [value / sum(raised) for value in raised]


def route_plainly(votes, num_passes, total=1.0):
    """Procedure 1 of Sabour et al. 2017 for votes [I, K, O] of one row: weights and sums, lists.

    The weights of a part sum to `total`.
    """
    num_inputs, num_outputs, size = votes.shape
    agreement = [[0.0] * num_outputs for _ in range(num_inputs)]
    for step in range(num_passes):
        weights = [[total * value for value in soften(row)] for row in agreement]
        sums = [
            [
                sum(weights[i][k] * float(votes[i, k, o]) for i in range(num_inputs))
                for o in range(size)
            ]
            for k in range(num_outputs)
        ]
        if step < num_passes - 1:
            for k in range(num_outputs):
                output = squash_plainly(sums[k])
                for i in range(num_inputs):
                    agreement[i][k] += sum(float(votes[i, k, o]) * output[o] for o in range(size))
    return weights, sums


# --- the layers --------------------------------------------------------------------------------


def test_squash_and_presence():
    vectors = draw(5, 4)
    expected = torch.tensor([squash_plainly(vector) for vector in vectors], dtype=torch.float64)
    torch.testing.assert_close(squash(vectors), expected)
    torch.testing.assert_close(measure_presence(vectors), expected.norm(dim=-1))
    for function in (squash, measure_presence):
        assert torch.autograd.gradcheck(function, draw(3, 4, needs_gradient=True))
    zero = torch.zeros(2, 4, requires_grad=True)
    squash(zero).sum().backward()
    assert zero.grad.abs().max() < 1e-6  # not NaN


def test_primary_capsules():
    layer = PrimaryCapsules(2, num_types=3, pose_size=4, kernel=3, stride=2).double()
    planes = draw(2, 2, 7, 9)
    poses = layer(planes).detach()
    assert poses.shape == (2, 3 * 3 * 4, 4)
    for row, image in enumerate(planes):
        out = convolve_plainly(image, layer.convolution)
        for kind in range(3):
            for y in range(3):
                for x in range(4):
                    pose = [out[kind * 4 + number][y][x] for number in range(4)]
                    got = poses[row, (kind * 3 + y) * 4 + x]
                    assert got.tolist() == pytest.approx(squash_plainly(pose))
    check_gradients(layer, draw(1, 2, 5, 5, needs_gradient=True))


@pytest.mark.parametrize("votes_at_once", [1, 70, 1 << 20])  # parts of 1, 4 and all 5 inputs
@pytest.mark.parametrize("num_passes", [1, 2, 3])
def test_dense_capsules(num_passes, votes_at_once, monkeypatch):
    monkeypatch.setattr(capsule_layers, "ROUTING_VOTES", votes_at_once)
    layer = DenseCapsules(5, 3, 4, 2, num_passes).double()
    nn.init.normal_(layer.weight)  # large votes: the passes differ
    capsules = draw(2, 5, 3)
    outputs, votes = layer(capsules), layer.vote(capsules)
    assert outputs.shape == (2, 4, 2)
    weight = layer.weight.detach().view(5, 3, 4, 2)
    for row in range(2):
        plain = torch.zeros(5, 4, 2, dtype=torch.float64)
        for i in range(5):
            for k in range(4):
                for o in range(2):
                    plain[i, k, o] = sum(capsules[row, i, d] * weight[i, d, k, o] for d in range(3))
        torch.testing.assert_close(votes[:, row], plain)
        weights, sums = route_plainly(plain, num_passes)
        got = layer.find_weights(votes)[:, row]
        torch.testing.assert_close(got, torch.tensor(weights, dtype=torch.float64))
        expected = [squash_plainly(vector) for vector in sums]
        torch.testing.assert_close(outputs[row], torch.tensor(expected, dtype=torch.float64))


def test_gradients_of_dense_capsules_take_the_routing_as_given():
    check_gradients(DenseCapsules(4, 3, 3, 2, passes=1), draw(2, 4, 3, needs_gradient=True))
    layer = DenseCapsules(4, 3, 3, 2, passes=3).double()
    nn.init.normal_(layer.weight)
    capsules = draw(2, 4, 3)
    weights = layer.find_weights(layer.vote(capsules))
    assert not weights.requires_grad
    assert weights.std() > 0.01
    layer(capsules).sum().backward()
    got, layer.weight.grad = layer.weight.grad, None
    squash(sum_routed(layer.vote(capsules), weights)).sum().backward()
    torch.testing.assert_close(got, layer.weight.grad)
    assert torch.autograd.gradcheck(
        lambda seen: squash(sum_routed(layer.vote(seen), weights)), capsules.requires_grad_()
    )


def test_part_capsules():
    layer = PartCapsules(2, num_types=2, pose_size=3).double()
    planes = draw(1, 2, 5, 4)
    poses, presences = layer(planes)
    assert poses.shape == (1, 3, 2, 3, 2)
    assert presences.shape == (1, 2, 3, 2)
    out = torch.tensor(convolve_plainly(planes[0], layer.convolution), dtype=torch.float64)
    for kind in range(2):  # the presences of all types come first, then each number of the poses
        expected = [1.0 / (1.0 + math.exp(-float(v))) for v in out[kind].flatten()]
        assert presences[0, kind].flatten().tolist() == pytest.approx(expected)
        for number in range(3):
            torch.testing.assert_close(poses[0, number, kind], out[2 + 2 * number + kind])
    check_gradients(layer, draw(1, 2, 4, 4, needs_gradient=True))


def test_grid_pooling():
    layer = GridPooling(4, 3, grid_side=2).double()
    poses, presences = draw(1, 2, 1, 4, 3), torch.rand(1, 1, 4, 3, dtype=torch.float64)
    pooled, shown = layer(poses, presences)
    for row in range(2):
        for column in range(2):
            total = squares = 0.0
            sums = [0.0, 0.0]
            for y in range(4):
                for x in range(3):
                    tall = max(0.0, min((y + 1) / 4, (row + 1) / 2) - max(y / 4, row / 2))
                    wide = max(0.0, min((x + 1) / 3, (column + 1) / 2) - max(x / 3, column / 2))
                    seen = tall * wide * float(presences[0, 0, y, x])
                    total += seen
                    squares += seen * float(presences[0, 0, y, x])
                    sums = [s + seen * float(poses[0, d, 0, y, x]) for d, s in enumerate(sums)]
            cell = row * 2 + column
            assert float(shown[0, 0, cell]) == pytest.approx(squares / total)
            expected = [squares / total * value / total for value in sums]
            assert pooled[0, :, 0, cell].tolist() == pytest.approx(expected)
    given = poses.requires_grad_(), presences.requires_grad_()
    assert torch.autograd.gradcheck(layer, given)


@pytest.mark.parametrize("num_passes", [1, 2, 3])
def test_entity_routing(num_passes):
    layer = EntityRouting(num_parts=5, part_size=3, num_entities=4, entity_size=2).double()
    nn.init.normal_(layer.weight)
    parts = draw(2, 3, 5)
    entities = layer(parts, num_passes)
    weight = layer.weight.detach().view(4, 3, 5, 2)
    for row in range(2):
        votes = torch.zeros(5, 4, 2, dtype=torch.float64)
        for i in range(5):
            for k in range(4):
                for o in range(2):
                    votes[i, k, o] = sum(parts[row, d, i] * weight[k, d, i, o] for d in range(3))
        expected = torch.tensor(route_plainly(votes, num_passes, 4.0)[1], dtype=torch.float64)
        torch.testing.assert_close(entities[row], expected)
    check_gradients(_OnePass(layer), draw(2, 3, 5, needs_gradient=True))


class _OnePass(nn.Module):
    def __init__(self, layer):
        super().__init__()
        self.layer = layer

    def forward(self, parts):
        return self.layer(parts, 1)


def test_lengths_are_values():
    head = LengthHead(6 * 8, 3)
    features = torch.randn(4, 6 * 8)
    torch.testing.assert_close(
        head(features), head.capsules(features.view(4, 6, 8)).square().sum(-1).sqrt()
    )


# --- the networks ------------------------------------------------------------------------------


def count(module):
    return sum(weight.numel() for weight in module.parameters())


@pytest.mark.parametrize(
    ("side", "dense", "total"), [(28, 2_359_296, 7_688_960), (84, 75_759_616, 81_089_280)]
)
def test_the_weights_of_the_thesis(side, dense, total):
    with torch.device("meta"):
        network = QNetwork(THESIS, (1, side, side), 16)
    assert count(network.body.convolution) == 20_992
    assert count(network.body.primary) == 5_308_672
    assert count(network.head) == dense
    assert count(network) == total


def test_the_weights_of_the_released_convolutions():
    with torch.device("meta"):
        network = QNetwork(THESIS_CONV, (1, 84, 84), 16)
    assert network.body.dense[0].weight.numel() == 84 * 84 * 32 * 512  # 115.6 M


def test_kernels_follow_the_smaller_side():
    assert [choose_kernel(side) for side in (8, 10, 12, 13, 16, 17, 20, 21, 84)] == [
        *(3, 3, 3, 5, 5, 7, 7, 9, 9)
    ]
    for side in range(9, 90):
        kernel = choose_kernel(side)
        assert (side - 2 * kernel + 1) // 2 + 1 >= 3
    assert make_q_network(THESIS, (5, 10, 15), 4, seed=0).body.num_features == 576 * 8


@pytest.mark.parametrize("shape", [(1, 84, 84), (3, 64, 96), (5, 21, 8)])
def test_the_maps_of_residual_are_bounded(shape):
    with torch.device("meta"):
        network = QNetwork(RESIDUAL, shape, 4)
    assert network.body.dense[0].in_features <= 32 * 121
    if shape == (1, 84, 84):  # of IMPALA: 15 convolutions, 11 x 11 cells
        assert network.body.dense[0].in_features == 32 * 121
        assert sum(isinstance(part, nn.Conv2d) for part in network.modules()) == 15


def test_a_residual_block_adds_to_its_input():
    block = ResidualBlock(4, "none")
    planes = torch.randn(2, 4, 5, 5)
    first, second = block.layers[1], block.layers[3]
    torch.testing.assert_close(block(planes), planes + second(first(planes.relu()).relu()))
    for layer in (first, second):
        nn.init.zeros_(layer.weight)
        nn.init.zeros_(layer.bias)
    assert torch.equal(block(planes), planes)


@pytest.mark.parametrize("config", NEW, ids=lambda config: f"{config.body} {config.norm}")
@pytest.mark.parametrize("shape", [BOARD, (2, 8, 8)])
def test_the_error_falls_and_every_weight_learns(config, shape):
    network = make_q_network(config, shape, 4, seed=0)
    before = [weight.clone() for weight in network.parameters()]
    seen = torch.randint(0, 256, (8, *shape), dtype=torch.uint8)
    actions, rewards = torch.randint(0, 4, (8, 1)), torch.rand(8, 1)
    optimizer = torch.optim.Adam(network.parameters(), lr=1e-3)
    errors = []
    for _ in range(30):
        loss = (network(seen).gather(1, actions) - rewards).square().mean()
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        errors.append(loss.item())
    assert errors[-1] < 0.5 * errors[0]
    changed = [not torch.equal(*pair) for pair in zip(before, network.parameters(), strict=True)]
    assert all(changed)
    if config is THESIS:
        assert 0.0 <= network(seen).min() <= network(seen).max() < 1.0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"head": "dueling"}, "use head='length' with this body, and only with it"),
        ({"body": "conv"}, "body is 'conv' and head 'length'"),
        ({"hidden_width": 64}, "hidden_width is 64, but body 'thesis_capsule'"),
        ({"norm": "layer"}, "norm is 'layer', but body 'thesis_capsule'"),
        ({"memory": "lstm"}, "memory is 'lstm', but body 'thesis_capsule'"),
        ({"distances": True}, "distances is True, but body 'thesis_capsule'"),
        ({"cell_values": True}, "cell_values is True, but body 'thesis_capsule'"),
        ({"action_embedding": 8}, "head 'length' has none"),
        ({"conv_channels": (8,), "conv_strides": (1,)}, "but body is 'thesis_capsule'"),
    ],
)
def test_what_the_thesis_capsules_cannot_do(settings, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        QNetworkConfig(**{"body": "thesis_capsule", "head": "length", **settings})


@pytest.mark.parametrize("config", NEW[:3], ids=lambda config: config.body)
@pytest.mark.parametrize("shape", [(7,), (3, 7, 12)])
def test_bodies_need_planes(config, shape):
    with pytest.raises(ValueError, match=f"body '{config.body}' needs planes"):
        QNetwork(config, shape, 4)
