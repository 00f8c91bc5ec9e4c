"""Which transitions are rare, how often they are drawn, and how that is undone in the loss."""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.generative.loss import RareCorrection
from marl_cair.generative.outcome import RewardBins

MIN_VARIANCE = 1e-6  # of rewards: below, an error of 0.001 costs as much as one standard deviation


class RareCounts:
    """Running counts of rewards (by bin) and ends, of all real training rows and the rare ones.

    A row is rare if it ends the episode or if its reward is among the seldom ones that together
    make up less than `rare_share` of all rows so far. So where rewards are sparse every reward is
    rare, and where they are shaped (nearly every row pays something) the large ones are; shaping
    rewards spread over many bins, each of which is seldom, must not crowd out the ends.
    """

    def __init__(self, bins: RewardBins, rare_share: float) -> None:
        self.bins = bins
        self.rare_share = rare_share
        num = bins.centres.numel()
        self.all_rewards = torch.zeros(num, dtype=torch.float64)
        self.rare_rewards = torch.zeros(num, dtype=torch.float64)
        self.sum_reward = 0.0  # these two of rows that go on
        self.sum_square = 0.0
        self.all_ends = 0.0
        self.rare_ends = 0.0
        self.num_rows = 0.0
        self.num_rare = 0.0

    def count(self, rows: TensorDict) -> Tensor:
        """Count real rows; returns which of them are rare, bool [N]."""
        rewards = rows["next", "reward"].squeeze(-1)
        ends = rows["next", "terminated"].squeeze(-1)
        spread = self.bins.spread(rewards).double()
        self.all_rewards += spread.sum(0)
        self.num_rows += rewards.numel()
        going_on = rewards[~ends].double()
        self.sum_reward += float(going_on.sum())
        self.sum_square += float(going_on.square().sum())
        self.all_ends += float(ends.sum())
        rare: Tensor = ends | self.is_rare_reward(rewards)
        self.rare_rewards += spread[rare].sum(0)
        self.num_rare += float(rare.sum())
        self.rare_ends += float(ends.sum())
        return rare

    def is_rare_reward(self, rewards: Tensor) -> Tensor:
        """Whether the bins nearest to the rewards [N] are among the seldom ones, bool [N]."""
        counts, order = self.all_rewards.sort()
        rare = torch.zeros_like(order, dtype=torch.bool)
        rare[order] = counts.cumsum(0) < self.rare_share * self.num_rows
        return rare[self.bins.spread(rewards).argmax(-1)]

    @property
    def rare_reward_odds(self) -> float:
        """Share of rows with a rare reward among those after which the episode goes on."""
        rare = self.num_rare - self.rare_ends
        return rare / max(self.num_rows - self.all_ends, 1.0)

    def correct(self, is_from_rare: Tensor, is_rare: Tensor) -> RareCorrection:
        """The correction for a batch.

        is_from_rare: bool [N], drawn from the rare ring; is_rare: bool [N], rare rows of either
        origin.
        """
        share = float(is_from_rare.float().mean())
        rare_odds = max(self.num_rare, 1.0) / max(self.num_rows, 1.0)
        # Density of a rare (of any other) row in this batch, relative to the truth.
        boosted = (1.0 - share) + share / rare_odds
        weights = torch.where(is_rare, 1.0 / boosted, 1.0 / max(1.0 - share, 1e-3))
        true = self.all_rewards / max(self.num_rows, 1.0)
        drawn = (1.0 - share) * true + share * self.rare_rewards / max(self.num_rare, 1.0)
        log_odds = torch.where(true > 0.0, (drawn / true.clamp_min(1e-12)).log(), 0.0)
        true_end = (self.all_ends + 0.5) / (self.num_rows + 1.0)
        rare_end = (self.rare_ends + 0.5) / (self.num_rare + 1.0)
        drawn_end = (1.0 - share) * true_end + share * rare_end
        num_going_on = max(self.num_rows - self.all_ends, 1.0)
        mean = self.sum_reward / num_going_on
        variance = max(self.sum_square / num_going_on - mean**2, MIN_VARIANCE)
        terminal = torch.tensor([drawn_end, true_end]).clamp(1e-6, 1.0 - 1e-6).logit()
        shift = float(terminal[0] - terminal[1])
        return RareCorrection(weights, log_odds.float(), variance, shift)

    def state_dict(self) -> dict[str, Any]:
        return {
            "all_rewards": self.all_rewards.clone(),
            "rare_rewards": self.rare_rewards.clone(),
            "numbers": [
                self.sum_reward,
                self.sum_square,
                self.all_ends,
                self.rare_ends,
                self.num_rows,
                self.num_rare,
            ],
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        self.all_rewards = state["all_rewards"].clone()
        self.rare_rewards = state["rare_rewards"].clone()
        (
            self.sum_reward,
            self.sum_square,
            self.all_ends,
            self.rare_ends,
            self.num_rows,
            self.num_rare,
        ) = state["numbers"]
