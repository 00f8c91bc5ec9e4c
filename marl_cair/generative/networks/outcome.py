"""Outcome heads: reward, end of the episode and next action mask, and their losses.

On boards all three are computed from (state, actions, next state): the labels of a generated row
fit the next state that was generated with it. Of pictures they are computed from the state and the
actions. Rewards are learned in units of their own size, apart from the next state (FTFL, arXiv
2510.01457).
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from tensordict import TensorDict
from torch import Tensor, nn
from torch.nn import functional

from marl_cair.generative.networks.boards import is_picture
from marl_cair.generative.networks.paths import PathReadout
from marl_cair.generative.settings import GeneratorSpec, NetworkSize
from marl_cair.policies.config import NO_CELL

SUM_UNIT = 0.1  # weight of one cell in a sum: a dozen units are about 1
MEETING_GAIN = 100.0  # few ends with the same meeting outweigh all that merely came with them
ROBUST_UNITS = 4.0  # larger errors of a reward count linearly
REWARD_WEIGHT = 4.0  # against the sums over all cells
# The mask's loss is a mean over actions, those of the cells are sums.
MASK_WEIGHT_EACH, MASK_WEIGHTS = 0.1, (20.0, 70.0)  # for each action; least and most
RARE_BIAS = 5.0  # log odds against an end before training


class OutcomeInput(NamedTuple):
    """Inputs of the outcome heads. `after` and `boards` are read of boards, not of pictures."""

    after: Tensor  # [N, F, H, W], features of the next state's board
    features: Tensor  # [N, E], of both boards, of the actions, of the next scalars and of changes
    boards: tuple[Tensor, Tensor]  # uint8 [N, S, H, W], spatial planes before and after
    action_mask: Tensor  # bool [N, A], of the state


class Outcome(NamedTuple):
    """Rewards and logits for N transitions."""

    reward: Tensor  # [N, 2], in units, if the episode goes on and if it ends
    end: Tensor  # [N]
    mask: Tensor  # [N, A]


class OutcomeHeads(nn.Module):
    """OutcomeInput -> Outcome. num_features: E."""

    pairs: Tensor  # [2, P], of planes that may meet at a cell
    kinds: Tensor
    place: Tensor
    has_cell: Tensor
    reward_units: Tensor  # [2], root mean squares of real rewards: of steps that go on, of ends

    def __init__(self, spec: GeneratorSpec, size: NetworkSize, num_features: int) -> None:
        super().__init__()
        channels, hidden = size.channels, size.hidden
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
        self.register_buffer("reward_units", torch.ones(2))
        least, most = MASK_WEIGHTS
        self.mask_weight = min(max(least, MASK_WEIGHT_EACH * spec.num_actions), most)
        self.paths = PathReadout(spec, size) if size.distances else None
        num_features += self.paths.num_numbers if self.paths else 0
        num_planes = 0 if is_picture(spec) else spec.num_spatial
        pairs = torch.triu_indices(num_planes, num_planes)
        self.register_buffer("pairs", pairs, persistent=False)
        self.enter = nn.Linear(num_features, 2 * hidden)
        self.meet = nn.Linear(pairs.shape[1], 1, bias=False) if pairs.numel() else None
        # Separate layers: the mask's loss is far larger than those of reward and end.
        self.middle = nn.ModuleList(nn.Linear(hidden, hidden) for _ in range(2))
        self.reward, self.end = nn.Linear(hidden, 2), nn.Linear(hidden, 1)
        self.kind = nn.Linear(hidden, spec.num_kinds)
        # The copy gate: legal actions stay legal.
        self.keep = nn.Parameter(torch.full((spec.num_kinds,), 2.0))
        self.of_cells = nn.Conv2d(channels, num_named, 1) if num_named else None
        with torch.no_grad():
            self.end.bias.sub_(RARE_BIAS)
            if self.meet is not None:
                self.meet.weight.zero_()

    def forward(self, seen: OutcomeInput) -> Outcome:
        features = [seen.features]
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
        end = self.end(of_value)
        if self.meet is not None:
            before, after = map(find_meetings, seen.boards)
            end = end + self.meet(MEETING_GAIN * (after - before)[:, *self.pairs])
        return Outcome(self.reward(of_value), end[:, 0], mask)

    def expect_reward(self, outcome: Outcome) -> Tensor:
        """Rewards [N]: those of an end where it is likelier than none."""
        rewards = outcome.reward * self.reward_units
        return torch.where(outcome.end > 0.0, rewards[:, 1], rewards[:, 0])

    def compute_losses(
        self, outcome: Outcome, rows: TensorDict, end_log_odds: float, real: slice = slice(None)
    ) -> dict[str, Tensor]:
        """Losses of rewards, ends and masks of `rows` [N], in nats per row.

        real: the rows whose own next states were read; the others have no loss of masks, as a mask
        is to fit the state that is read.
        end_log_odds: log odds of ends in the batch minus true ones; it keeps P(end) calibrated
        (logit adjustment, Menon et al. 2021).
        """
        rewards, ends = rows["next", "reward"], rows["next", "terminated"]
        which = ends.long()
        missed = outcome.reward.gather(1, which) - rewards / self.reward_units[which]
        loss = functional.huber_loss(missed, torch.zeros_like(missed), delta=ROBUST_UNITS)
        ends = ends[:, 0].float()
        # The mask after an end has no meaning: these rows have no mask loss.
        mask = functional.binary_cross_entropy_with_logits(
            outcome.mask[real], rows["next", "action_mask"][real].float(), reduction="none"
        ).mean(1)
        return {
            "reward": loss * REWARD_WEIGHT,
            "end": functional.binary_cross_entropy_with_logits(outcome.end + end_log_odds, ends),
            "mask": (mask * (1.0 - ends[real])).sum() / max(1, len(mask)) * self.mask_weight,
        }


def find_meetings(board: Tensor) -> Tensor:
    """Which planes of uint8 [N, S, H, W] meet, both above 0 at a cell: 1.0 or 0.0, [N, S, S].

    A player at a goal, a unit at a base: what ends a game is learned from few examples by these
    pairs (docs/experiments/generator.md#meetings).
    """
    filled = (board > 0).flatten(2).float()
    return torch.bmm(filled, filled.transpose(1, 2)).clamp_max(1.0)


def pool(board: Tensor) -> tuple[Tensor, Tensor]:
    """Largest values and sums [N, F] over the cells; a mean would hide one unit among hundreds."""
    # Channels are last in memory: one pass over the cells is several times as fast as over planes.
    cells = board.permute(0, 2, 3, 1).flatten(1, 2)
    return cells.amax(1), cells.sum(1) * SUM_UNIT
