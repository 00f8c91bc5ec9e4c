"""The quantile loss: its numbers in plain float64, what it learns, and settings it needs."""

from copy import deepcopy

import numpy as np
import pytest
import torch

from marl_cair.policies.q_network import QNetworkConfig, make_q_network
from marl_cair.replay.transition import NO_ACTION, TransitionSpec
from marl_cair.training import losses
from marl_cair.training.learner import Learner
from marl_cair.training.settings.config import TrainConfig
from marl_cair.training.settings.demonstration import DemonstrationSettings
from marl_cair.training.settings.learner import LearnerSettings
from tests.replay.streams import make_transitions

SPEC = TransitionSpec((2, 8, 8), 5)
NUM_QUANTILES = 7
POLICY = QNetworkConfig(hidden_width=8, head="quantile", num_quantiles=NUM_QUANTILES)


def make_batch(num_rows=32):
    rng = np.random.default_rng(1)
    batch = make_transitions(rng, num_rows, SPEC)
    batch["steps_to_next_obs"] = torch.from_numpy(rng.integers(1, 4, (num_rows, 1)))
    batch["next", "terminated"] = torch.from_numpy(rng.random((num_rows, 1)) < 0.3)
    return batch


def huber(error):
    return 0.5 * error**2 if abs(error) <= 1 else abs(error) - 0.5


def find_loss_plainly(rated, chooser, found, row, gamma):
    """Loss and TD error of one row from quantiles [A, K] in float64, one number at a time."""
    legal = [a for a, holds in enumerate(row["next", "action_mask"].tolist()) if holds]
    best = max(legal, key=lambda action: chooser[action].mean())
    discount = gamma ** int(row["steps_to_next_obs"]) * (1 - float(row["next", "terminated"]))
    targets = [float(row["next", "reward"]) + discount * ahead for ahead in rated[best]]
    chosen, total = found[int(row["action"])], 0.0
    for place, quantile in enumerate(chosen, 1):
        tau = (2 * place - 1) / (2 * NUM_QUANTILES)
        for target in targets:
            error = target - quantile
            total += abs(tau - (1.0 if error < 0 else 0.0)) * huber(error) / NUM_QUANTILES**2
    return total, np.mean(targets) - chosen.mean()


@pytest.mark.parametrize("double", [True, False])
@pytest.mark.parametrize("is_weighted", [True, False])
def test_the_loss_has_the_numbers_of_its_formula(double, is_weighted):
    network, target = (make_q_network(POLICY, (2, 8, 8), 5, seed) for seed in (0, 1))
    batch, weights = make_batch(), np.ones(32)
    if is_weighted:
        batch["priority_weight"] = torch.linspace(0.1, 1.0, len(batch))
        weights = batch["priority_weight"].double().numpy()
    settings = LearnerSettings(algorithm="quantile", gamma=0.9, double=double)
    result = losses.QuantileLoss(settings)(network, target, batch)
    with torch.no_grad():
        ahead, online, found = (
            one(batch[key], quantiles=True).double().numpy()
            for one, key in (
                (target, ("next", "observation")),
                (network, ("next", "observation")),
                (network, "observation"),
            )
        )
    chooser = online if double else ahead
    plain = [
        find_loss_plainly(ahead[n], chooser[n], found[n], batch[n], 0.9) for n in range(len(batch))
    ]
    wanted, errors = np.array(plain).T
    assert result.loss.item() == pytest.approx((wanted * weights).sum() / weights.sum(), rel=1e-5)
    np.testing.assert_allclose(result.td_error.numpy(), errors, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(result.values, network(batch["observation"]))


@pytest.mark.slow
def test_the_quantiles_of_a_known_distribution_are_found():
    torch.manual_seed(0)
    quantiles = torch.zeros(1, 4, requires_grad=True)
    outcomes = torch.tensor([0.0, 0.0, 0.0, 0.0, 0.0, 5.0, 5.0, 5.0, 5.0, 20.0])
    optimizer = torch.optim.SGD([quantiles], lr=1.0)
    for _ in range(8_000):
        drawn = outcomes[torch.randint(len(outcomes), (64, 1))]
        optimizer.zero_grad()
        losses.measure_quantiles(quantiles.expand(64, 4), drawn.expand(64, 4)).mean().backward()
        optimizer.step()
    # At 1/8, 3/8, 5/8 and 7/8 of 0 (half), 5 (four tenths) and 20 (a tenth); the Huber loss pulls
    # by less than 1 towards the other outcomes.
    found = quantiles.detach()[0]
    assert (found - torch.tensor([0.0, 0.0, 5.0, 5.0])).abs().max() < 1.0
    assert found.tolist() == sorted(found.tolist())


@pytest.mark.slow
@pytest.mark.parametrize("demonstration", [None, DemonstrationSettings(bots=("counter",))])
def test_a_learner_with_quantiles_learns_the_returns_of_its_batch(demonstration):
    settings = LearnerSettings(algorithm="quantile", learning_rate=3e-3, gamma=0.9)
    network = make_q_network(POLICY, (2, 8, 8), 5, seed=0)
    learner, batch = Learner(network, settings, demonstration), make_batch()
    batch["is_generated"] = (torch.arange(len(batch)) % 5 == 0).unsqueeze(1)
    batch["expert_action"] = torch.where(torch.arange(len(batch)) < 8, batch["action"], NO_ACTION)
    values = [learner.update(batch.clone()) for _ in range(80)]
    assert float(values[-1]["loss/all"]) < 0.3 * float(values[0]["loss/all"])
    assert float(values[-1]["td_error/real"]) < 0.5 * float(values[0]["td_error/real"])
    assert values[-1]["batch/generated_share"] == pytest.approx(7 / 32)


def test_state_of_noise_continues():
    def make():
        policy = QNetworkConfig(hidden_width=8, noisy=True)
        return Learner(make_q_network(policy, (2, 8, 8), 5, seed=0), LearnerSettings(), seed=4)

    whole, batch = make(), make_batch()
    batch["is_generated"] = torch.zeros(len(batch), 1, dtype=torch.bool)
    whole.update(batch.clone())
    parts = make()
    parts.load_state_dict(deepcopy(whole.state_dict()))
    seen = batch["observation"]
    assert torch.equal(whole.average(seen), whole.average(seen))
    for name in ("network", "target"):
        first, second = (getattr(whole, name)(seen) for _ in range(2))
        assert not torch.equal(first, second)
        assert torch.equal(getattr(parts, name)(seen), first)
        assert torch.equal(getattr(parts, name)(seen), second)


@pytest.mark.parametrize(
    ("policy", "learner", "message"),
    [
        ({"head": "quantile"}, {}, r"set both to 'quantile', or neither"),
        ({"head": "quantile"}, {"algorithm": "pqn"}, r"head is 'quantile' and .* 'pqn'"),
        ({}, {"algorithm": "quantile"}, r"head is 'dueling' and learner.algorithm 'quantile'"),
        (
            {"head": "quantile"},
            {"algorithm": "quantile", "loss": "l2"},
            r"learner\.loss is 'l2', it must be smooth_l1 with learner\.algorithm=quantile",
        ),
    ],
)
def test_settings_that_do_not_fit_are_refused(policy, learner, message):
    with pytest.raises(ValueError, match=message):
        TrainConfig(policy=QNetworkConfig(**policy), learner=LearnerSettings(**learner))


def test_a_network_of_another_head_is_refused():
    network = make_q_network(QNetworkConfig(hidden_width=8), (2, 8, 8), 5, seed=0)
    loss = losses.QuantileLoss(LearnerSettings(algorithm="quantile"))
    with pytest.raises(ValueError, match="head 'dueling' has no quantiles"):
        loss(network, network, make_batch())
