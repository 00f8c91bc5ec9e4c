"""Rare transitions: which they are, a store of them, and the correction of their oversampling."""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.ranges import MOST, Range, read_numbers

RARE_UNITS = 4.0  # rewards beyond so many units are rare: at most 1 of 16 (Chebyshev)
MIN_UNIT = 1e-3  # of rewards: smaller differences are not learned
_AMOUNT = Range(0.0, MOST, float)
_COUNTS = ("num_rows", "num_rare", "num_ends", "sum_square", "ends_square")


class Correction(NamedTuple):
    """Corrects for the oversampling of rare rows: predictions stay calibrated."""

    weights: Tensor  # [N], true density over batch density
    end_log_odds: float  # log odds of ends in the batch minus true log odds


class RareCounts:
    """Running counts of real rows: all, rare ones, ends; and the size of rewards.

    heldout_share, heldout_ends: shares of rows and of ends that are not trained on.
    A row is rare if it ends the episode, or its reward is more than four units: the unit is the
    root mean square of the rewards of all other rows so far.
    """

    def __init__(self, heldout_share: float = 0.0, heldout_ends: float = 0.0) -> None:
        self._kept, self._kept_ends = 1.0 - heldout_share, 1.0 - heldout_ends
        self.num_rows = self.num_rare = self.num_ends = self.sum_square = self.ends_square = 0.0

    @property
    def reward_unit(self) -> float:
        """The root mean square of rewards in rows that do not end."""
        going_on = max(1.0, self.num_rows - self.num_ends)
        return float(max(MIN_UNIT, (self.sum_square / going_on) ** 0.5))

    @property
    def end_unit(self) -> float:
        """The root mean square of rewards in rows that end the episode."""
        return float(max(self.reward_unit, (self.ends_square / max(1.0, self.num_ends)) ** 0.5))

    def count(self, rows: TensorDict) -> Tensor:
        """Count real rows; returns which of them are rare, bool [N]."""
        rewards, ends = rows["next", "reward"][:, 0], rows["next", "terminated"][:, 0]
        self.num_rows += len(rows)
        self.num_ends += float(ends.sum())
        self.sum_square += float(rewards[~ends].double().square().sum())
        self.ends_square += float(rewards[ends].double().square().sum())
        rare = self.find_rare(rewards, ends)
        self.num_rare += float(rare.sum())
        return rare

    def find_rare(self, rewards: Tensor, ends: Tensor | bool = False) -> Tensor:
        """Which rows are rare by the counts so far, bool [N]."""
        return ends | (rewards.abs() > RARE_UNITS * self.reward_unit)

    def correct(self, rare: Tensor, ends: Tensor, num_drawn: int) -> Correction:
        """The correction for a batch of which `num_drawn` rows were drawn from the rare ones.

        rare, ends: bool [N], of the batch.
        """
        num_rows, drawn = max(1.0, self.num_rows), num_drawn / max(1, len(rare))
        kept_ends = self._kept_ends * self.num_ends
        kept_rare = kept_ends + self._kept * (self.num_rare - self.num_ends)
        kept_rows = max(1.0, kept_rare + self._kept * (num_rows - self.num_rare))
        true = min(max(self.num_rare / num_rows, 1e-6), 1.0 - 1e-6)
        in_batch = drawn + (1.0 - drawn) * min(max(kept_rare / kept_rows, 1e-6), 1.0 - 1e-6)
        weights = torch.where(rare, true / in_batch, (1.0 - true) / (1.0 - in_batch + 1e-9))
        true_end = (self.num_ends + 0.5) / (num_rows + 1.0)
        drawn_end = (kept_ends + 0.5) / (kept_rare + 1.0)
        kept_end = (kept_ends + 0.5) / (kept_rows + 1.0)
        odds = torch.tensor([drawn * drawn_end + (1.0 - drawn) * kept_end, true_end])
        odds = odds.clamp(1e-6, 1.0 - 1e-6).logit()
        return Correction(weights, float(odds[0] - odds[1]))

    def state_dict(self) -> dict[str, Any]:
        return {"counts": [getattr(self, name) for name in _COUNTS]}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from `state_dict`. Raises ValueError for numbers out of range."""
        counts = read_numbers(state["counts"], "counts", _AMOUNT)
        for name, count in zip(_COUNTS, counts, strict=True):
            setattr(self, name, count)
