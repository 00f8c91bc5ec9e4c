"""The network of boards: gradients, likelihoods, static planes and the economy."""

from dataclasses import replace

import pytest
import torch

from marl_cair.generative import GeneratorSpec, NetworkSize
from marl_cair.generative.ensemble import Ensemble
from marl_cair.generative.networks.ccdn import CCDN
from marl_cair.generative.networks.economy import EconomyChain, apply_changes, find_changes
from marl_cair.generative.networks.outcome import RareCorrection, RewardBins
from marl_cair.policies.config import NO_CELL
from tests.generative.conftest import SMALL
from tests.generative.plane_game import NUM_ACTIONS, SPEC, TERRAIN


def no_correction(num):
    return RareCorrection(torch.ones(num), torch.zeros(SMALL.size.reward_bins), 1.0, 0.0)


def make_network(spec: GeneratorSpec = SPEC, size: NetworkSize = SMALL.size):
    with torch.random.fork_rng():
        torch.manual_seed(0)
        return CCDN(spec, size)


def test_gradient_reaches_every_parameter(real_rows):
    network = make_network()
    losses = network.compute_losses(real_rows[:64], no_correction(64), stride=1, offset=0)
    torch.stack(list(losses.values())).sum().backward()
    for name, parameter in network.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.abs().sum() > 0.0, name


@pytest.mark.slow
def test_untrained_network_copies(real_rows):
    network = make_network()
    rows = real_rows[:64]
    following = network.decode(rows["observation"], rows["action"], None)
    assert float((following == rows["observation"]).float().mean()) > 0.95


@pytest.mark.slow
def test_static_planes_are_copied_whatever_the_weights(real_rows):
    network = make_network()
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(torch.randn_like(parameter))
    rows = real_rows[:64]
    following = network.decode(rows["observation"], rows["action"], torch.Generator())
    assert torch.equal(following[:, TERRAIN], rows["observation"][:, TERRAIN])
    assert not torch.equal(following, rows["observation"])


def test_sparse_cell_loss_is_unbiased(real_rows):
    network = make_network()
    rows, correction = real_rows[:64], no_correction(64)
    with torch.no_grad():
        whole = network.compute_losses(rows, correction, stride=1, offset=0)["cells"]
        parts = [
            network.compute_losses(rows, correction, stride=7, offset=offset)["cells"]
            for offset in range(7)
        ]
    torch.testing.assert_close(torch.stack(parts).mean(), whole, rtol=1e-4, atol=1e-4)


def test_likelihood_of_an_opinion_is_that_of_the_loss(real_rows):
    ensemble = Ensemble(SPEC, SMALL)
    rows = real_rows[:40]
    with torch.no_grad():
        losses = ensemble.members[0].compute_losses(rows, no_correction(40), stride=1, offset=0)
    predicted = ensemble.predict(rows)
    torch.testing.assert_close(
        -predicted.log_prob[0].mean(), losses["cells"] + losses["economy"], rtol=1e-4, atol=1e-4
    )


def test_economy_probabilities_sum_to_one():
    chain = EconomyChain(6, 2, 8)
    context, now = torch.randn(1, 6).expand(256, 6), torch.zeros(256, 2, dtype=torch.uint8)
    first = torch.arange(256)
    changes = torch.stack([torch.full((256,), 5), first], -1)
    total = chain.find_log_prob(context, now, changes)[:, 1].exp().sum()
    torch.testing.assert_close(total, torch.tensor(1.0))


def test_economy_changes_round_trip():
    now = torch.tensor([[250, 3]], dtype=torch.uint8)
    later = torch.tensor([[10, 0]], dtype=torch.uint8)
    changes = find_changes(now, later)
    assert changes.tolist() == [[16, 253]]
    assert torch.equal(apply_changes(now, changes), later)


def test_rewards_survive_the_bins_exactly():
    bins = RewardBins((-1.0, 1.0), 63)
    rewards = torch.tensor([-1.0, -0.3, -0.004, 0.0, 0.0101, 0.77, 1.0])
    targets = bins.spread(rewards)
    torch.testing.assert_close(targets.sum(-1), torch.ones(7))
    assert ((targets > 0).sum(-1) <= 2).all()
    torch.testing.assert_close(targets @ bins.centres, rewards, atol=1e-6, rtol=1e-5)
    assert float(bins.centres[31]) == 0.0


@pytest.mark.parametrize("num_uniform", [0, 2])
def test_games_without_cells_or_kinds_or_economy_work(num_uniform):
    spec = GeneratorSpec((3, 4, 4), 5, num_uniform, 0)
    ensemble = Ensemble(spec, replace(SMALL, num_members=1))
    observation = torch.randint(0, 256, (7, 3, 4, 4), dtype=torch.uint8)
    observation[:, 3 - num_uniform :] = 9
    following = ensemble.propose(observation, torch.arange(7) % 5, torch.Generator())
    assert following.shape == observation.shape
    assert following.dtype == torch.uint8


def test_target_cell_reaches_the_prediction(real_rows):
    network = make_network()
    board = real_rows["observation"][:1].expand(2, -1, -1, -1)
    same = network.encode(board, torch.tensor([3, 3])).board
    other = network.encode(board, torch.tensor([3, NUM_ACTIONS - 1])).board
    assert torch.equal(same[0], same[1])
    assert not torch.equal(other[0], other[1])


def test_a_sample_makes_only_differences_that_have_been_seen():
    """A change of -10, learned from full purses, must not fill an empty one by 246."""
    torch.manual_seed(0)
    chain = EconomyChain(context=3, num_uniform=2, hidden=8)
    context = torch.zeros(400, 3)
    now = torch.full((400, 2), 5, dtype=torch.uint8)
    with torch.no_grad():
        chain.leave_bias[:, :, (0 - 10) % 256] = 3.0
    everything = chain.decode(context, now, torch.Generator().manual_seed(0))
    assert (everything == 246).any()  # nothing is ruled out before anything was seen
    before = torch.tensor([[100, 100], [90, 0], [7, 8]], dtype=torch.uint8)
    after = torch.tensor([[90, 100], [90, 255], [9, 8]], dtype=torch.uint8)
    chain.record_differences(before, after)
    for generator in (torch.Generator().manual_seed(0), None):
        changes = chain.decode(context, now, generator)
        assert set(changes[:, 0].tolist()) <= {0, 2}
        assert set(changes[:, 1].tolist()) == {0}
    wraps = chain.decode(context, torch.zeros_like(now), torch.Generator().manual_seed(0))
    assert set(wraps[:, 1].tolist()) <= {0, 255}  # the restart of a clock was seen


def test_no_rows_are_asked_about(real_rows):
    """Before the first rare reward there is nothing to judge."""
    cells = (*range(NUM_ACTIONS - 1), NO_CELL)
    for spec in (SPEC, replace(SPEC, action_cells=cells)):
        for size in (SMALL.size, replace(SMALL.size, distances=True)):
            predicted = Ensemble(spec, replace(SMALL, size=size)).predict(real_rows[:0])
            assert predicted.mask.shape == (SMALL.num_members, 0, NUM_ACTIONS)
