"""Rare rewards, the correction of their oversampling, and metrics of rewards."""

import pytest
import torch
from tensordict import TensorDict

from marl_cair.generative.ensemble import Ensemble
from marl_cair.generative.metrics import Certainty, compute_metrics, predict_heldout
from marl_cair.generative.networks.outcome import RewardBins
from marl_cair.generative.rare import RareCounts
from marl_cair.generative.settings import GeneratorConfig
from tests.generative.plane_game import SPEC

SHARE = 0.02


def make_rewards(rewards):
    following = {
        "reward": rewards[:, None],
        "terminated": torch.zeros(len(rewards), 1, dtype=torch.bool),
    }
    return TensorDict({"next": TensorDict(following, [len(rewards)])}, [len(rewards)])


def test_rewards_spread_over_many_seldom_bins_are_not_all_rare():
    shaping = torch.linspace(-0.2, 0.2, 2000)
    counts = RareCounts(RewardBins((-1.0, 1.0), 201), SHARE)
    rows = make_rewards(torch.cat([shaping, torch.tensor([1.0, -1.0])]))
    counts.count(rows)
    assert (counts.all_rewards > 0).sum() > 1 / SHARE  # each bin alone holds less than the share
    rare = counts.is_rare_reward(rows["next", "reward"].squeeze(-1))
    assert rare[-2:].all()
    assert 0 < rare.float().mean() < SHARE


def test_the_reward_variance_is_of_rows_that_do_not_end():
    counts = RareCounts(RewardBins((-1.0, 1.0), 63), SHARE)
    rows = make_rewards(torch.tensor([0.1, -0.1] * 50 + [1.0]))
    rows["next", "terminated"][-1] = True
    counts.count(rows)
    nothing = torch.zeros(4, dtype=torch.int64)
    variance = counts.correct(nothing, nothing).reward_variance
    torch.testing.assert_close(torch.tensor(variance), torch.tensor(0.01))


def test_corrected_weights_of_an_oversampled_batch_are_those_of_all_rows():
    counts = RareCounts(RewardBins((-1.0, 1.0), 3), 0.06)
    rows = make_rewards(torch.tensor([0.0] * 950 + [1.0] * 40 + [-1.0] * 10))
    rows["next", "terminated"][-10:] = True
    strata = counts.count(rows)
    assert torch.bincount(strata).tolist() == [950, 40, 10]
    half = torch.cat([torch.arange(0, 950, 2), torch.arange(950, 1000, 2)])  # as an even draw
    boosted = torch.cat([torch.arange(950, 990), torch.arange(950, 960), torch.arange(990, 1000)])
    drawn = torch.cat([half, boosted])
    drawn_from = torch.cat([torch.zeros(500), torch.full((50,), 1), torch.full((10,), 2)]).long()
    correction = counts.correct(drawn_from, strata[drawn])

    weighed = torch.zeros(3).index_add_(0, strata[drawn], correction.row_weights) / len(drawn)
    torch.testing.assert_close(weighed, torch.tensor([0.95, 0.04, 0.01]))
    rewards = rows["next", "reward"][drawn].squeeze(-1)
    share = counts.bins.spread(rewards).mean(0)
    torch.testing.assert_close(
        correction.reward_log_odds.exp() * torch.tensor([0.01, 0.95, 0.04]), share
    )
    ends = torch.tensor([15 / 560, 0.01]).logit()
    assert correction.terminal_log_odds == pytest.approx(float(ends[0] - ends[1]), abs=0.05)


def measure_rewards(rows, rare_rows, counted):
    """Metrics of an untrained ensemble."""
    counts = RareCounts(RewardBins(SPEC.reward_range, 63), SHARE)
    counts.count(counted)
    ensemble = Ensemble(SPEC, GeneratorConfig())
    held = predict_heldout(ensemble, rows, rare_rows, torch.Generator().manual_seed(0))
    return compute_metrics(held, SPEC, counts, Certainty(0.8, 0.2))


def test_rewards_of_ends_do_not_change_the_explained_share(real_rows):
    ended = real_rows["next", "terminated"].squeeze(-1)
    rows = torch.cat([real_rows[~ended][:100], real_rows[ended][:4]]).clone()
    assert ended.sum() >= 4
    rows["next", "reward"][:100:3] = 0.1
    explained = []
    for pay in (0.0, 1.0):
        rows["next", "reward"][100:] = pay
        explained.append(measure_rewards(rows, rows[100:], rows)["reward/explained"])
    assert explained[0] == explained[1]


def test_rare_rewards_count_by_their_share_of_all_rows(real_rows):
    """The variance is that of all rows, whether two or none of the sampled rows have them."""
    going_on = real_rows[~real_rows["next", "terminated"].squeeze(-1)][:300].clone()
    going_on["next", "reward"].zero_()
    going_on["next", "reward"][:3] = 0.5
    rare = going_on[:3]
    stds = [
        measure_rewards(rows, rare, going_on)["reward/std"] for rows in (going_on, going_on[3:])
    ]
    expected = float(going_on["next", "reward"].double().std(correction=0))
    assert stds == [pytest.approx(expected), pytest.approx(expected)]
