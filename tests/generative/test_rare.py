"""Which rewards are rare, and that ends alone do not decide what is said of rewards."""

from __future__ import annotations

import torch
from tensordict import TensorDict

from marl_cair.generative.ensemble import Ensemble
from marl_cair.generative.metrics import examine, measure
from marl_cair.generative.outcome import RewardBins
from marl_cair.generative.rare import RareCounts
from marl_cair.generative.settings import GeneratorConfig
from tests.generative.plane_game import SPEC

SHARE = 0.02


def make_rewards(rewards: torch.Tensor) -> TensorDict:
    following = {
        "reward": rewards[:, None],
        "terminated": torch.zeros(len(rewards), 1, dtype=torch.bool),
    }
    return TensorDict({"next": TensorDict(following, [len(rewards)])}, [len(rewards)])


def test_rewards_spread_over_many_seldom_bins_are_not_all_rare() -> None:
    shaping = torch.linspace(-0.2, 0.2, 2000)
    counts = RareCounts(RewardBins((-1.0, 1.0), 201), SHARE)
    rows = make_rewards(torch.cat([shaping, torch.tensor([1.0, -1.0])]))
    counts.count(rows)
    assert (counts.all_rewards > 0).sum() > 1 / SHARE  # each bin alone holds less than the share
    rare = counts.is_rare_reward(rows["next", "reward"].squeeze(-1))
    assert rare[-2:].all()
    assert 0 < rare.float().mean() < SHARE


def test_the_variance_that_is_corrected_for_is_of_rows_that_go_on() -> None:
    counts = RareCounts(RewardBins((-1.0, 1.0), 63), SHARE)
    rows = make_rewards(torch.tensor([0.1, -0.1] * 50 + [1.0]))
    rows["next", "terminated"][-1] = True
    counts.count(rows)
    nothing = torch.zeros(4, dtype=torch.bool)
    variance = counts.correct(nothing, nothing).reward_variance
    torch.testing.assert_close(torch.tensor(variance), torch.tensor(0.01))


def test_what_ends_pay_does_not_change_the_explained_share(real_rows: TensorDict) -> None:
    ended = real_rows["next", "terminated"].squeeze(-1)
    rows = torch.cat([real_rows[~ended][:100], real_rows[ended][:4]]).clone()
    assert ended.sum() >= 4
    rows["next", "reward"][:100:3] = 0.1
    ensemble = Ensemble(SPEC, GeneratorConfig())
    explained = []
    for pay in (0.0, 1.0):
        rows["next", "reward"][100:] = pay
        held = examine(ensemble, rows, rows[100:], torch.Generator().manual_seed(0))
        explained.append(measure(held, SPEC, 0.8)["reward/explained"])
    assert explained[0] == explained[1]
