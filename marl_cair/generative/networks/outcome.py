"""Outcome heads: reward, end of the episode and next action mask, and their losses.

All three are computed from (state, actions, next state): the labels of a generated row fit the next
state that was generated with it. Rewards are learned in units of their own size, apart from the
next state (FTFL, arXiv 2510.01457).
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from tensordict import TensorDict
from torch import Tensor, nn
from torch.nn import functional

from marl_cair.generative.networks.paths import PathReadout
from marl_cair.generative.settings import GeneratorSpec, NetworkSize
from marl_cair.policies.config import NO_CELL

SUM_UNIT = 0.1  # weight of one cell in a sum: a dozen units are about 1
MOST_LOG = 6.0  # rewards up to exp(6) units are distinguished
MASK_WEIGHT = 20.0  # the mask's loss is a mean over actions: scaled to the size of the others
RARE_BIAS = 5.0  # log odds against an end, and against a reward other than 0, before training


class OutcomeInput(NamedTuple):
    """Inputs of the outcome heads."""

    before: Tensor  # [N, F, H, W], features of the state, above 0
    after: Tensor  # [N, F, H, W], of the next state
    context: Tensor  # [N, D]
    scalars: Tensor  # [N, E], features of the next scalars and of their changes
    boards: tuple[Tensor, Tensor]  # uint8 [N, S, H, W], spatial planes before and after
    action_mask: Tensor  # bool [N, A], of the state


class Outcome(NamedTuple):
    """Logits for N transitions."""

    reward: Tensor  # [N, bins]
    end: Tensor  # [N]
    mask: Tensor  # [N, A]


class OutcomeHeads(nn.Module):
    """OutcomeInput -> Outcome. num_scalars: E."""

    kinds: Tensor
    place: Tensor
    has_cell: Tensor
    centres: Tensor  # of the bins, in reward units
    reward_unit: Tensor  # root mean square of real rewards

    def __init__(self, spec: GeneratorSpec, size: NetworkSize, num_scalars: int) -> None:
        super().__init__()
        channels, hidden, bins = size.channels, size.hidden, size.reward_bins
        kinds, cells = torch.tensor(spec.kinds), torch.tensor(spec.cells)
        # Only kinds with an action that names a cell have logits of cells.
        named, place = torch.unique(
            torch.where(cells != NO_CELL, kinds, NO_CELL), return_inverse=True
        )
        num_named = int((named != NO_CELL).sum())
        place = (place - (named.numel() - num_named)).clamp_min(0)
        place = place * (spec.num_rows * spec.num_columns) + cells.clamp_min(0)
        self.register_buffer("kinds", kinds, persistent=False)
        self.register_buffer("place", place, persistent=False)
        self.register_buffer("has_cell", (cells != NO_CELL).float(), persistent=False)
        steps = torch.linspace(-MOST_LOG, MOST_LOG, bins)
        self.register_buffer("centres", steps.sign() * steps.abs().expm1(), persistent=False)
        self.register_buffer("reward_unit", torch.ones(()))
        self.paths = PathReadout(spec, size) if size.distances else None
        num_paths = self.paths.num_numbers if self.paths else 0
        self.enter = nn.Linear(3 * channels + hidden + num_scalars + num_paths, 2 * hidden)
        # Separate layers: the mask's loss is far larger than those of reward and end.
        self.middle = nn.ModuleList(nn.Linear(hidden, hidden) for _ in range(2))
        self.reward, self.end = nn.Linear(hidden, bins), nn.Linear(hidden, 1)
        self.kind = nn.Linear(hidden, spec.num_kinds)
        # The copy gate: legal actions stay legal.
        self.keep = nn.Parameter(torch.full((spec.num_kinds,), 2.0))
        self.of_cells = nn.Conv2d(channels, num_named, 1) if num_named else None
        with torch.no_grad():
            self.reward.weight.mul_(0.1)
            self.reward.bias[bins // 2] += 8.0  # of 63 bins
            self.end.bias.sub_(RARE_BIAS)

    def forward(self, seen: OutcomeInput) -> Outcome:
        largest, total = pool(seen.after)
        before = seen.before.permute(0, 2, 3, 1).flatten(1, 2).sum(1) * SUM_UNIT
        features = [largest, total, total - before, seen.context, seen.scalars]
        if self.paths is not None:
            features.append(self.paths(*seen.boards))
        halves = functional.relu(self.enter(torch.cat(features, 1))).chunk(2, 1)
        layers = zip(self.middle, halves, strict=True)
        of_value, of_mask = (functional.relu(half + layer(half)) for layer, half in layers)
        legal_now = 2.0 * seen.action_mask.float() - 1.0
        mask = self.kind(of_mask)[:, self.kinds] + self.keep[self.kinds] * legal_now
        if self.of_cells is not None:
            of_cells = self.of_cells(seen.after).flatten(1)
            mask = mask + of_cells[:, self.place] * self.has_cell
        return Outcome(self.reward(of_value), self.end(of_value)[:, 0], mask)

    def expect_reward(self, logits: Tensor) -> Tensor:
        """Rewards [N]: the mean of the bins under their probabilities."""
        return logits.softmax(1) @ self.centres * self.reward_unit

    def spread(self, rewards: Tensor) -> Tensor:
        """Two-hot targets [N, bins] of rewards [N] (as in MuZero and Dreamer v3)."""
        scaled, last = rewards / self.reward_unit, len(self.centres) - 1
        right = torch.searchsorted(self.centres, scaled.contiguous()).clamp(1, last)
        low, high = self.centres[right - 1], self.centres[right]
        share = ((scaled - low) / (high - low)).clamp(0.0, 1.0)
        targets = rewards.new_zeros(len(rewards), last + 1)
        targets.scatter_(1, (right - 1)[:, None], (1.0 - share)[:, None])
        return targets.scatter_(1, right[:, None], share[:, None])

    def compute_losses(
        self, outcome: Outcome, rows: TensorDict, end_log_odds: float
    ) -> dict[str, Tensor]:
        """Losses of rewards, ends and masks of `rows` [N], in nats per row.

        end_log_odds: log odds of ends in the batch minus true ones; it keeps P(end) calibrated
        (logit adjustment, Menon et al. 2021).
        """
        rewards, ends = rows["next", "reward"][:, 0], rows["next", "terminated"][:, 0].float()
        # The mask after an end has no meaning: these rows have no mask loss.
        mask = functional.binary_cross_entropy_with_logits(
            outcome.mask, rows["next", "action_mask"].float(), reduction="none"
        ).mean(1)
        return {
            "reward": functional.cross_entropy(outcome.reward, self.spread(rewards)),
            "end": functional.binary_cross_entropy_with_logits(outcome.end + end_log_odds, ends),
            "mask": (mask * (1.0 - ends)).mean() * MASK_WEIGHT,
        }


def pool(board: Tensor) -> tuple[Tensor, Tensor]:
    """Largest values and sums [N, F] over the cells; a mean would hide one unit among hundreds."""
    # Channels are last in memory: one pass over the cells is several times as fast as over planes.
    cells = board.permute(0, 2, 3, 1).flatten(1, 2)
    return cells.amax(1), cells.sum(1) * SUM_UNIT
