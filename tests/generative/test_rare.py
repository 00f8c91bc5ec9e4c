"""Rare rows, and the correction of their oversampling."""

import math

import pytest
import torch
from tensordict import TensorDict

from marl_cair.generative.rare import RARE_UNITS, RareCounts


def make_rows(rewards, ends):
    following = {"reward": rewards[:, None], "terminated": ends[:, None]}
    return TensorDict({"next": TensorDict(following, [len(rewards)])}, [len(rewards)])


def test_ends_and_rewards_beyond_four_units_are_rare():
    rewards = torch.tensor([0.1, -0.1] * 50 + [0.1 * RARE_UNITS * 1.5, 1.0])
    ends = torch.zeros(102, dtype=torch.bool)
    ends[-1] = True
    counts = RareCounts()
    rare = counts.count(make_rows(rewards, ends))
    assert rare.nonzero().flatten().tolist() == [100, 101]
    # The end's reward, ten times the others, does not count for the unit.
    assert counts.reward_unit == pytest.approx(((100 * 0.01 + 0.36) / 101) ** 0.5, rel=1e-5)


def test_a_correction_undoes_the_oversampling():
    counts = RareCounts()
    ends = torch.arange(1_000) < 10
    counts.count(make_rows(torch.where(ends, 1.0, 0.001), ends))
    in_batch = torch.arange(100) < 25  # drawn from the rare rows
    correction = counts.correct(in_batch, in_batch, 25)
    assert float(correction.weights.mean()) == pytest.approx(1.0, abs=0.02)
    # Rare rows weigh as much as they are frequent.
    share = float(correction.weights[in_batch].sum() / correction.weights.sum())
    assert share == pytest.approx(0.01, abs=0.002)
    in_truth, seen = 0.0105, 0.25 * 10.5 / 11.0 + 0.75 * 0.0105
    expected = math.log(seen / (1 - seen)) - math.log(in_truth / (1 - in_truth))
    assert correction.end_log_odds == pytest.approx(expected, abs=0.01)


def test_without_oversampling_nothing_is_corrected():
    counts = RareCounts()
    ends = torch.arange(1_000) < 10
    counts.count(make_rows(torch.zeros(1_000), ends))
    correction = counts.correct(ends, ends, 0)
    torch.testing.assert_close(correction.weights, torch.ones(1_000), atol=1e-3, rtol=0.0)
    assert correction.end_log_odds == pytest.approx(0.0, abs=1e-6)


def test_counts_are_saved_and_checked():
    counts = RareCounts()
    counts.count(make_rows(torch.ones(5), torch.ones(5, dtype=torch.bool)))
    other = RareCounts()
    other.load_state_dict(counts.state_dict())
    assert vars(other) == vars(counts)
    with pytest.raises(ValueError, match="counts"):
        other.load_state_dict({"counts": [-1.0, 0.0, 0.0, 0.0]})


def test_no_held_out_rare_rows_are_no_error(trained, real_rows):
    assert len(trained.imagine(real_rows[:0]).reward) == 0


def test_the_correction_knows_that_half_of_the_ends_are_held_out():
    """Odds of ends in a batch, by drawing batches as a generator does."""
    random = torch.Generator().manual_seed(0)
    num, heldout_share, heldout_ends = 40_000, 0.1, 0.5
    kinds = torch.rand(num, generator=random)
    ends = kinds < 0.01
    rewards = torch.where(ends | (kinds > 0.96), 1.0, 0.001)
    counts = RareCounts(heldout_share, heldout_ends)
    rare = counts.count(make_rows(rewards, ends))
    assert rare.sum() > 4 * ends.sum()
    chance = torch.rand(num, generator=random)
    kept = chance >= torch.where(ends, heldout_ends, heldout_share)
    drawn, batch = 0.25, 100
    share = drawn * ends[kept & rare].float().mean() + (1 - drawn) * ends[kept].float().mean()
    truth = ends.float().mean()
    in_batch = torch.arange(batch) < drawn * batch
    correction = counts.correct(in_batch, in_batch, int(drawn * batch))
    expected = share.logit() - truth.logit()
    assert correction.end_log_odds == pytest.approx(float(expected), abs=0.08)
