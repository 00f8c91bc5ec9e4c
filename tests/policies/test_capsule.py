"""The capsule layers against plain formulas, and the counts of the body's weights."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from marl_cair.policies.capsule import stride_first
from marl_cair.policies.capsule_layers import (
    ROUTING_CHUNK_ROWS,
    EntityRouting,
    GridPooling,
    measure_presence,
    overlap_shares,
    squash,
)
from marl_cair.policies.q_network import QNetworkConfig, make_q_network


@pytest.fixture(autouse=True)
def _seeded():
    with torch.random.fork_rng(devices=[]):
        torch.default_generator.manual_seed(0)
        yield


def count_weights(shape: tuple[int, int, int], num_actions: int) -> int:
    config = QNetworkConfig(body="capsule", action_embedding=0)
    network = make_q_network(config, shape, num_actions, seed=0)
    return sum(weight.numel() for weight in network.parameters())


def test_weights_are_counted_as_in_the_table():
    assert count_weights((5, 10, 15), 4) == 254_509
    assert count_weights((3, 25, 25), 4) == 253_933
    assert count_weights((1, 84, 84), 4) == 262_285
    assert count_weights((3, 128, 128), 300) == 304_565


def test_new_networks_for_large_boards_stride_first():
    config, large = QNetworkConfig(body="capsule"), (43, 31, 31)
    fitted = stride_first(config, large)
    assert (fitted.conv_channels, fitted.conv_strides) == ((32, 32), (2, 1))
    old, new = (make_q_network(one, large, 9, seed=0) for one in (config, fitted))
    new.load_state_dict(old.state_dict())  # the same weights
    rows = torch.randint(0, 256, (3, *large), dtype=torch.uint8)
    assert not torch.allclose(old(rows), new(rows))
    for shape in ((28, 10, 15), (1, 84, 84), (7,)):
        assert stride_first(config, shape) is config
    own = QNetworkConfig(body="capsule", conv_channels=(8, 8), conv_strides=(1, 2))
    assert stride_first(own, large) is own
    conv = QNetworkConfig(body="conv")
    assert stride_first(conv, large) is conv


def test_each_action_adds_129_weights_and_a_larger_board_none():
    assert count_weights((5, 10, 15), 300) - count_weights((5, 10, 15), 100) == 129 * 200
    assert count_weights((5, 10, 15), 4) == count_weights((5, 19, 61), 4)
    assert count_weights((1, 64, 64), 4) == count_weights((1, 300, 400), 4)


@given(positions=st.integers(1, 40), cells=st.integers(1, 9))
@settings(max_examples=60, deadline=None)
def test_shares_divide_each_cell_and_each_position_wholly(positions, cells):
    shares = overlap_shares(positions, cells)
    torch.testing.assert_close(shares.sum(1), torch.ones(cells))
    torch.testing.assert_close(shares.sum(0), torch.full((positions,), cells / positions))


def test_one_present_part_in_a_large_cell_is_not_diluted():
    poses, presences = torch.zeros(1, 2, 1, 40, 40), torch.full((1, 1, 40, 40), 1e-4)
    poses[0, :, 0, 7, 9] = torch.tensor([3.0, -2.0])
    presences[0, 0, 7, 9] = 1.0
    pooled, presence = GridPooling(40, 40, 1)(poses, presences)
    assert presence.item() > 0.8
    assert pooled[0, 0, 0, 0] > 2.0


@pytest.mark.parametrize("sides", [(1, 1), (2, 3), (5, 8), (37, 50)])
def test_pooling_gives_the_same_grid_for_every_map_even_a_smaller_one(sides):
    poses = torch.ones(1, 2, 3, *sides)
    pooled, presence = GridPooling(*sides, 5)(poses, torch.full((1, 3, *sides), 0.5))
    torch.testing.assert_close(presence, torch.full((1, 3, 25), 0.5))
    torch.testing.assert_close(pooled, torch.full((1, 2, 3, 25), 0.5))


def test_absent_parts_pool_to_zero_without_dividing_by_it():
    pooled, presence = GridPooling(6, 6, 2)(torch.randn(1, 2, 1, 6, 6), torch.zeros(1, 1, 6, 6))
    assert torch.equal(pooled, torch.zeros(1, 2, 1, 4))
    assert torch.equal(presence, torch.zeros(1, 1, 4))


def route_with_votes(layer: EntityRouting, parts: torch.Tensor, num_passes: int) -> torch.Tensor:
    """The textbook form: build every vote, weight by agreement, sum. Returns [N, K, O]."""
    num_rows, part_size, num_parts = parts.shape
    weight = layer.weight.view(layer.num_entities, part_size, num_parts, -1)
    votes = torch.einsum("ndi,kdio->niko", parts, weight)
    agreement = torch.zeros(num_rows, num_parts, layer.num_entities)
    for _ in range(num_passes):
        weights = layer.num_entities * agreement.softmax(-1)
        entities = torch.einsum("nik,niko->nko", weights, votes)
        agreement = agreement + torch.einsum("niko,nko->nik", votes, squash(entities)).detach()
    return entities


@pytest.mark.parametrize("num_passes", [1, 2, 3])
@pytest.mark.parametrize("num_rows", [3, ROUTING_CHUNK_ROWS + 5])
def test_routing_without_votes_equals_routing_with_votes(num_passes, num_rows):
    layer = EntityRouting(12, 4, 5, 6)
    parts = 4.0 * torch.randn(num_rows, 4, 12)  # large, so that the parts disagree
    ours, textbook = parts.clone().requires_grad_(), parts.clone().requires_grad_()
    entities = layer(ours, num_passes)
    expected = route_with_votes(layer, textbook, num_passes)
    torch.testing.assert_close(entities, expected, rtol=1e-4, atol=1e-5)
    direction = torch.randn_like(expected)
    (entities * direction).sum().backward()
    (expected * direction).sum().backward()
    torch.testing.assert_close(ours.grad, textbook.grad, rtol=1e-4, atol=1e-4)
    weights = layer.find_weights(parts, num_passes)
    torch.testing.assert_close(weights.sum(0), torch.full((num_rows, 12), 5.0))
    assert (weights.std() > 0.1) == (num_passes > 1)


def test_presence_has_a_finite_gradient_where_an_entity_is_absent():
    vectors = torch.zeros(2, 3, 4, requires_grad=True)
    measure_presence(vectors).sum().backward()
    assert torch.equal(vectors.grad, torch.zeros(2, 3, 4))
