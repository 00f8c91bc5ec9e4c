"""Quantile heads and noisy layers: shapes, means, formulas in float64, seeds, refusals."""

import numpy as np
import pytest
import torch

from marl_cair.policies.config import LATER
from marl_cair.policies.heads import NoisyLinear, make_noisy, set_noise
from marl_cair.policies.q_network import QNetworkConfig, make_q_network

SHAPE, NUM_ACTIONS = (3, 10, 15), 6
CELLS = {"cell_values": True, "action_cells": (-1, 0, 1, 2, 3, 4), "action_kinds": (0,) * 6}


def make(seed=0, **settings):
    config = QNetworkConfig(hidden_width=16, **settings)
    return make_q_network(config, SHAPE, NUM_ACTIONS, seed)


def make_planes(*axes):
    generator = torch.Generator().manual_seed(1)
    return torch.randint(0, 256, (*axes, *SHAPE), dtype=torch.uint8, generator=generator)


@pytest.mark.parametrize(
    "changes", [{}, {"action_embedding": 4}, {"body": "capsule"}, {"norm": "layer"}, CELLS], ids=str
)
def test_values_are_the_means_of_the_quantiles(changes):
    network, seen = make(head="quantile", num_quantiles=5, **changes), make_planes(2, 3)
    quantiles = network(seen, quantiles=True)
    assert quantiles.shape == (2, 3, NUM_ACTIONS, 5)
    torch.testing.assert_close(network(seen), quantiles.mean(-1))
    assert network.num_quantiles == 5
    assert make(head="quantile").num_quantiles == 32


@pytest.mark.parametrize("head", ["dueling", "quantile"])
def test_first_values_of_normalised_networks_are_small_with_any_head(head):
    def spread(**settings):
        network = make(head=head, norm="layer", **settings)
        return float(network(make_planes(8)).detach().std(1).mean())

    assert 0.001 < spread() < 0.05
    assert spread(action_embedding=4) == pytest.approx(spread(), rel=0.8)
    places = make_q_network(
        QNetworkConfig(action_shape=SHAPE[1:], norm="layer", hidden_width=16), SHAPE, 4, 0
    )
    assert not places(make_planes(2)).any()


def test_each_quantile_is_dueling():
    head = make(head="quantile", num_quantiles=3).head
    features = torch.randn(4, 16, generator=torch.Generator().manual_seed(0))
    found = head(features)
    for place in range(3):
        weight = head.advantage.weight.view(NUM_ACTIONS, 3, 16)[:, place]
        advantage = features @ weight.T
        value = features @ head.state_value.weight[place]
        wanted = value[:, None] + advantage - advantage.mean(1, keepdim=True)
        torch.testing.assert_close(found[..., place], wanted)


def test_quantiles_of_sequences_are_those_of_their_steps():
    network = make(head="quantile", num_quantiles=4, memory="gru", memory_width=5)
    seen, state = make_planes(3, 2), torch.zeros(2, 5)
    found, states = network.unroll(seen, state, torch.zeros(3, 2, dtype=torch.bool), quantiles=True)
    for step in range(3):
        wanted, state = network(seen[step], state, quantiles=True)
        torch.testing.assert_close(found[step], wanted)
        torch.testing.assert_close(states[step], state)


@pytest.mark.parametrize("shift", [0.0, 1.0])
def test_cells_shift_all_quantiles_of_the_actions_that_point_at_them(shift):
    network, seen = make(head="quantile", num_quantiles=4, **CELLS), make_planes(2)
    before = network(seen, quantiles=True)
    network.cells.values.bias.data.fill_(shift)
    moved = (network(seen, quantiles=True) - before).detach()
    torch.testing.assert_close(moved[:, 1:], torch.full((2, 5, 4), shift))
    assert not moved[:, 0].any()


def test_other_heads_have_no_quantiles():
    with pytest.raises(ValueError, match="head 'dueling' has no quantiles: use policy.head=quan"):
        make()(make_planes(2), quantiles=True)
    with pytest.raises(ValueError, match="num_quantiles is 8, but head 'dueling' has no quantiles"):
        QNetworkConfig(num_quantiles=8)
    with pytest.raises(ValueError, match="num_quantiles is 0, but must be an integer of at least"):
        QNetworkConfig(head="quantile", num_quantiles=0)


def test_later_settings_keep_the_fingerprints_of_older_agents():
    plain = QNetworkConfig()
    assert {name: getattr(plain, name) for name in LATER} == LATER
    assert {"noisy", "num_quantiles"} <= LATER.keys()


# --- noisy layers ----------------------------------------------------------------------------


def test_a_noisy_layer_has_the_numbers_of_its_formula():
    layer = NoisyLinear(torch.nn.Linear(7, 5))
    with torch.no_grad():
        for number, weight in enumerate(layer.parameters()):
            weight.normal_(generator=torch.Generator().manual_seed(number))
    rows = torch.randn(4, 7, generator=torch.Generator().manual_seed(9))
    layer.generator = torch.Generator().manual_seed(3)
    found = layer(rows).detach().numpy()
    again = torch.Generator().manual_seed(3)
    drawn = [torch.randn(shape, generator=again).double().numpy() for shape in ((4, 7), (5,))]
    of_input, of_output = (np.sign(one) * np.sqrt(np.abs(one)) for one in drawn)
    weight, bias, weight_noise, bias_noise = (
        getattr(layer, name).detach().double().numpy()
        for name in ("weight", "bias", "weight_noise", "bias_noise")
    )
    for row, noise, one in zip(rows.double().numpy(), of_input, found, strict=True):
        matrix = weight + weight_noise * np.outer(of_output, noise)
        np.testing.assert_allclose(one, matrix @ row + bias + bias_noise * of_output, rtol=1e-4)
    layer.generator = None
    torch.testing.assert_close(
        layer(rows), torch.nn.functional.linear(rows, layer.weight, layer.bias)
    )


@pytest.mark.parametrize("head", ["dueling", "plain", "quantile"])
def test_noise_is_drawn_for_each_row_from_the_seed_alone_and_can_be_turned_off(head):
    network, plain = make(head=head, noisy=True), make(head=head)
    seen = make_planes(1).expand(3, *SHAPE)
    quiet = network(seen)
    torch.testing.assert_close(quiet, plain(seen))  # the same weights from the same seed
    before = torch.get_rng_state()
    set_noise(network, torch.Generator().manual_seed(5))
    first, second = network(seen), network(seen)
    assert not torch.isclose(first[0], first[1]).any()
    assert not torch.isclose(first, second).any()
    set_noise(network, torch.Generator().manual_seed(5))
    assert torch.equal(network(seen), first)
    assert torch.equal(torch.get_rng_state(), before)
    set_noise(network, None)
    assert torch.equal(network(seen), quiet)


def test_gradients_reach_the_noise_only_where_it_is_on():
    network = make(noisy=True)
    for is_on in (False, True):
        set_noise(network, torch.Generator() if is_on else None)
        network.zero_grad()
        network(make_planes(4)).square().sum().backward()
        for name, weight in network.named_parameters():
            assert (weight.grad is not None) == (is_on or "noise" not in name), name


def test_noisy_layers_need_dense_layers_to_replace():
    with pytest.raises(ValueError, match="noisy is True, but Identity holds no torch.nn.Linear"):
        make_noisy(torch.nn.Identity())
    with pytest.raises(ValueError, match="noisy is True, but body 'thesis_capsule' has capsules"):
        QNetworkConfig(body="thesis_capsule", head="length", noisy=True)
    with pytest.raises(ValueError, match="noisy is 1, it must be True or False"):
        QNetworkConfig(noisy=1)
