"""Rare transitions: which they are, and the correction of their oversampling in the loss."""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.generative.networks.outcome import RareCorrection, RewardBins
from marl_cair.ranges import MOST, Range, read_array, read_numbers

_AMOUNT = Range(0.0, MOST, float)  # of rows
MIN_VARIANCE = 1e-6  # of rewards: below, an error of 0.001 costs as much as one standard deviation


class Stratum(IntEnum):
    """Kinds of rows, by how they are sampled for training."""

    COMMON = 0
    RARE_REWARD = 1  # and the episode continues
    END = 2


class RareCounts:
    """Running counts of all real rows and of their rewards (by bin), by stratum.

    A reward is rare if it is among the least frequent bins that together hold less than
    `rare_share` of all rows so far: every reward if rewards are sparse, the large ones if they are
    shaped. Ends are a stratum of their own: a long episode has only one.
    """

    def __init__(self, bins: RewardBins, rare_share: float) -> None:
        self.bins = bins
        self.rare_share = rare_share
        num = bins.centres.numel()
        self.all_rewards = torch.zeros(num, dtype=torch.float64)
        self.rewards = torch.zeros(len(Stratum), num, dtype=torch.float64)
        self.num_rows = torch.zeros(len(Stratum), dtype=torch.float64)
        self.sum_reward = 0.0  # these two of rows that do not end
        self.sum_square = 0.0

    def count(self, rows: TensorDict) -> Tensor:
        """Count real rows; returns the stratum of each, int64 [N]."""
        rewards = rows["next", "reward"].squeeze(-1)
        ends = rows["next", "terminated"].squeeze(-1)
        spread = self.bins.spread(rewards).double()
        self.all_rewards += spread.sum(0)
        strata = self.find_strata(rewards, ends)
        self.rewards.index_add_(0, strata, spread)
        self.num_rows += torch.bincount(strata, minlength=len(Stratum))
        going_on = rewards[~ends].double()
        self.sum_reward += float(going_on.sum())
        self.sum_square += float(going_on.square().sum())
        return strata

    def find_strata(self, rewards: Tensor, ends: Tensor) -> Tensor:
        """The stratum of rows with rewards [N] and ends (bool [N]) by the counts so far."""
        strata = self.is_rare_reward(rewards) * Stratum.RARE_REWARD
        return torch.where(ends, int(Stratum.END), strata)

    def is_rare_reward(self, rewards: Tensor) -> Tensor:
        """Whether the bins nearest to the rewards [N] are rare, bool [N]."""
        counts, order = self.all_rewards.sort()
        rare = torch.zeros_like(order, dtype=torch.bool)
        rare[order] = counts.cumsum(0) < self.rare_share * self.all_rewards.sum()
        return rare[self.bins.spread(rewards).argmax(-1)]

    @property
    def rare_reward_odds(self) -> float:
        """Share of rows with a rare reward among those that do not end."""
        going_on = self.num_rows[: Stratum.END]
        return float(going_on[Stratum.RARE_REWARD] / going_on.sum().clamp_min(1.0))

    def correct(self, drawn_from: Tensor, strata: Tensor) -> RareCorrection:
        """The correction for a batch.

        drawn_from: int64 [N], the stratum from which a row was drawn, COMMON if from all rows;
        strata: int64 [N], the stratum of the row.
        """
        shares = torch.bincount(drawn_from, minlength=len(Stratum)).double()
        shares /= shares.sum().clamp_min(1.0)
        evenly = float(shares[Stratum.COMMON])  # share of the rows drawn from all
        extra = shares.clone()
        extra[Stratum.COMMON] = 0.0
        num_rows = self.num_rows.sum().clamp_min(1.0)
        odds = self.num_rows.clamp_min(1.0) / num_rows
        density = (evenly + extra / odds).clamp_min(1e-3)  # in this batch, relative to the truth
        true = self.all_rewards / num_rows
        of_strata = self.rewards / self.num_rows.clamp_min(1.0)[:, None]
        drawn = evenly * true + (extra[:, None] * of_strata).sum(0)
        log_odds = torch.where(true > 0.0, (drawn / true.clamp_min(1e-12)).log(), 0.0)
        true_end = (self.num_rows[Stratum.END] + 0.5) / (num_rows + 1.0)
        ends = torch.stack([evenly * true_end + extra[Stratum.END], true_end])
        ends = ends.clamp(1e-6, 1.0 - 1e-6).logit()
        num_going_on = float(self.num_rows[: Stratum.END].sum().clamp_min(1.0))
        mean = self.sum_reward / num_going_on
        variance = max(self.sum_square / num_going_on - mean**2, MIN_VARIANCE)
        weights = (1.0 / density).float()[strata]
        return RareCorrection(weights, log_odds.float(), variance, float(ends[0] - ends[1]))

    def state_dict(self) -> dict[str, Any]:
        return {
            "all_rewards": self.all_rewards.clone(),
            "rewards": self.rewards.clone(),
            "num_rows": self.num_rows.clone(),
            "sums": [self.sum_reward, self.sum_square],
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from `state_dict`. Raises ValueError for numbers out of range."""
        for name in ("all_rewards", "rewards", "num_rows"):
            own = getattr(self, name).numpy()
            own[:] = read_array(state, name, (own.dtype, own.shape), _AMOUNT)
        sums = read_numbers(state["sums"], "sums", Range(-MOST, MOST, float))
        self.sum_reward, self.sum_square = sums
