"""Outcome heads: reward, end of the episode and next action mask, and their losses.

All three are computed from (state, action, next state), boards and economy: the labels of a sampled
row fit the next state that was sampled with it.
"""

from __future__ import annotations

from typing import NamedTuple, cast

import torch
from tensordict import TensorDict
from torch import Tensor, nn
from torch.nn import functional

from marl_cair.generative.networks import readout
from marl_cair.generative.networks.economy import NUM_VALUES, ScalarTables
from marl_cair.generative.settings import GeneratorSpec, NetworkSize
from marl_cair.policies.config import NO_CELL

PLANE_GAIN = 4.0  # of the mask head's planes: a quarter of the full value counts as 1
FINE_REACH = 2.0  # standard deviations: bound of the correction of the bins' mean
BIN_POWER = 3.0  # bins are dense around 0, for shaping rewards, and still reach a win's +-1
MAX_REWARD_LOSS = 4.0  # of the reward's mean, in variances of real rewards
MASK_WEIGHT = 20.0  # the mask's loss is a mean over actions: scaled to the size of the others


class RewardBins(nn.Module):
    """Signed bins over the reward range; a reward is spread over the two nearest bins.

    The centres are scale * sign(t) |t|^3 for even steps of t; the reward is the mean of the bins
    under the predicted probabilities (two-hot, as in MuZero and Dreamer v3).
    """

    centres: Tensor

    def __init__(self, reward_range: tuple[float, float], num_bins: int) -> None:
        super().__init__()
        scale = max(abs(reward_range[0]), abs(reward_range[1]))
        steps = torch.linspace(-1.0, 1.0, num_bins, dtype=torch.float64)
        centres = scale * steps.sign() * steps.abs() ** BIN_POWER
        self.register_buffer("centres", centres.float(), persistent=False)

    def spread(self, rewards: Tensor) -> Tensor:
        """Two-hot targets [N, bins] of rewards [N]."""
        last = self.centres.numel() - 1
        right = torch.searchsorted(self.centres, rewards).clamp(1, last)
        low, high = self.centres[right - 1], self.centres[right]
        share = ((rewards - low) / (high - low)).clamp(0.0, 1.0)
        targets = rewards.new_zeros(rewards.shape[0], last + 1)
        targets.scatter_(1, (right - 1)[:, None], (1.0 - share)[:, None])
        return targets.scatter_(1, right[:, None], share[:, None])


class RareCorrection(NamedTuple):
    """Corrects for the oversampling of rare rows: predictions stay calibrated."""

    row_weights: Tensor  # [N], true density over batch density, for the next-state heads
    reward_log_odds: Tensor  # [bins], log(share in batch / true share), added to logits in training
    reward_variance: float  # of real rewards of rows that do not end the episode
    terminal_log_odds: float  # log odds of ends in the batch - true log odds


class Outcome(NamedTuple):
    """Logits for one next state."""

    reward: Tensor  # [N, bins]
    terminal: Tensor  # [N]
    mask: Tensor  # [N, A]
    fine: Tensor  # [N], added to the mean of the reward's bins, in reward units

    def expected_reward(self, bins: RewardBins) -> Tensor:
        """Rewards [N]."""
        return self.reward.softmax(-1) @ bins.centres + self.fine

    def predict(self, bins: RewardBins) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """Rewards, P(reward of 0), P(end), each [N], and mask logits [N, A]."""
        zero_bin = bins.centres.abs().argmin()
        is_zero = self.reward.softmax(-1)[:, zero_bin]
        return self.expected_reward(bins), is_zero, self.terminal.sigmoid(), self.mask

    def compute_losses(
        self, bins: RewardBins, rows: TensorDict, correction: RareCorrection
    ) -> dict[str, Tensor]:
        """Losses of rewards, ends and masks of `rows` [N], in nats per row."""
        rewards = rows["next", "reward"].squeeze(-1)
        terminated = rows["next", "terminated"].squeeze(-1).float()
        # A terminal reward is a hundred times a step's reward: it is learned by the bins alone.
        square = (self.expected_reward(bins) - rewards).square()
        square = (square * correction.row_weights * (1.0 - terminated)).mean()
        # While rewards hardly vary their variance is tiny: this loss would dominate all others.
        scale = (square.detach() / MAX_REWARD_LOSS).clamp_min(correction.reward_variance)
        # The mask after an end has no meaning: these rows have no mask loss.
        mask_nll = functional.binary_cross_entropy_with_logits(
            self.mask, rows["next", "action_mask"].float(), reduction="none"
        ).mean(-1)
        return {
            "reward": functional.cross_entropy(
                self.reward + correction.reward_log_odds, bins.spread(rewards)
            ),
            # Shaped rewards are far smaller than a win: cross entropy hardly depends on their mean.
            "reward_mean": square / scale,
            "terminal": functional.binary_cross_entropy_with_logits(
                self.terminal + correction.terminal_log_odds, terminated
            ),
            "mask": (mask_nll * (1.0 - terminated)).mean() * MASK_WEIGHT,
        }


class Heads(nn.Module):
    """Heads of an outcome network: `add_heads` makes their weights."""

    kinds: Tensor
    reward_std: Tensor

    def add_heads(self, spec: GeneratorSpec, size: NetworkSize, hidden: int, num_fine: int) -> None:
        """hidden: features of the heads; num_fine: those of the reward's correction."""
        self.register_buffer("kinds", torch.tensor(spec.kinds), persistent=False)
        self.reward = nn.Linear(hidden, size.reward_bins)
        self.terminal = nn.Linear(hidden, 1)
        # Bins are coarse for rewards of a thousandth of a win, which are sums of changes.
        self.fine = nn.Linear(num_fine, 1)
        nn.init.zeros_(self.fine.weight)
        nn.init.zeros_(self.fine.bias)
        self.register_buffer("reward_std", torch.ones(()))  # of the rewards in training
        self.kind = nn.Linear(hidden, spec.num_kinds)
        # The copy gate: legal actions stay legal.
        self.keep = nn.Parameter(torch.full((spec.num_kinds,), 2.0))

    def compute_outcome(self, of_value: Tensor, of_fine: Tensor, mask: Tensor) -> Outcome:
        """Features [N, hidden] of reward and end, [N, num_fine], and mask logits -> Outcome."""
        fine = FINE_REACH * self.reward_std * torch.tanh(self.fine(of_fine).squeeze(-1))
        return Outcome(self.reward(of_value), self.terminal(of_value).squeeze(-1), mask, fine)

    def compute_mask(self, hidden: Tensor, action_mask: Tensor) -> Tensor:
        """Mask logits [N, A] from features [N, hidden] and the present mask, bool [N, A]."""
        scores = self.kind(hidden)
        legal_now = action_mask.to(scores.dtype) * 2.0 - 1.0
        logits: Tensor = scores[:, self.kinds] + self.keep[self.kinds] * legal_now
        return logits


class OutcomeInput(NamedTuple):
    """Inputs of the outcome heads."""

    features: Tensor  # [N, F], pooled board and context
    scalars: Tensor  # uint8 [N, U], next economy
    changes: Tensor  # int64 [N, U]
    board: Tensor  # [N, H, W, F], last layer of the trunk
    spatial: Tensor  # float32 [N, H * W, S], spatial planes now, 0..1
    planes: Tensor  # uint8 [N, S, H, W], next spatial planes
    action_mask: Tensor  # bool [N, A], of the current state


class OutcomeHeads(Heads):
    """OutcomeInput -> Outcome."""

    place: Tensor
    has_cell: Tensor

    def __init__(self, spec: GeneratorSpec, size: NetworkSize, num_features: int) -> None:
        super().__init__()
        uniform, hidden = spec.num_uniform, size.hidden
        of_actions, cells = torch.tensor(spec.kinds), torch.tensor(spec.cells)
        has_cell = cells != NO_CELL
        # Only kinds with an action that names a cell have logits of cells.
        named, place = torch.unique(torch.where(has_cell, of_actions, -1), return_inverse=True)
        num_named = int((named >= 0).sum())
        place = (cells * num_named + place - (named.numel() - num_named)).clamp_min(0)
        self.register_buffer("place", place * has_cell, persistent=False)
        self.register_buffer("has_cell", has_cell, persistent=False)
        self.readout = readout.BoardReadout(spec.num_spatial, size.readout, size.factors)
        self.values = ScalarTables(uniform, size.table_width)
        self.changes = ScalarTables(uniform, size.table_width)
        self.ways = readout.PathReadout(spec, size) if size.distances else None
        num_boards = 2 * self.readout.num_sums + (self.ways.num_numbers if self.ways else 0)
        num_seen = num_features + num_boards + 2 * uniform * (1 + size.table_width)
        self.enter = nn.Linear(num_seen, 2 * hidden)
        self.sides = readout.NeighbourhoodReadout(
            spec.num_rows, spec.num_columns, spec.num_spatial, size.side_features
        )
        self.enter_sides = nn.Linear(self.sides.num_seen, 2 * hidden, bias=False)
        # Separate layers: the mask's loss is far larger than those of reward and end.
        self.middle = nn.ModuleList(nn.Linear(hidden, hidden) for _ in range(2))
        self.add_heads(spec, size, hidden, hidden + num_boards)
        self.from_board = nn.Linear(size.channels, num_named) if num_named else None
        self.from_planes = nn.Linear(spec.num_spatial, num_named) if num_named else None
        # Whether an action on a cell is legal depends on the cell and on the acting unit (under the
        # cursor): the product of both.
        self.query = nn.Linear(hidden, num_named * size.readout) if num_named else None

    def forward(self, seen: OutcomeInput) -> Outcome:
        spatial = readout.flatten_board(seen.planes)
        later = self.readout(spatial)
        boards = readout.compare(self.readout(seen.spatial), later)
        if self.ways is not None:
            boards = torch.cat([boards, self.ways(seen.spatial, spatial)], -1)
        of_value, of_mask = self._compute_hidden(seen, boards, self.sides(spatial))
        mask = self._compute_cell_mask(seen, of_mask, spatial, later.cells)
        return self.compute_outcome(of_value, torch.cat([of_value, boards], -1), mask)

    def _compute_hidden(self, seen: OutcomeInput, boards: Tensor, sides: Tensor) -> list[Tensor]:
        """Hidden layers [N, hidden]: one for reward and end, one for the mask."""
        changes = seen.changes
        signed = torch.where(changes < NUM_VALUES // 2, changes, changes - NUM_VALUES)
        numbers = torch.cat([seen.scalars.float(), 4.0 * signed.float()], -1) / 255.0
        tables = [self.values(seen.scalars.long()), self.changes(changes)]
        entered = self.enter(torch.cat([seen.features, boards, numbers, *tables], -1))
        halves = functional.relu(entered + self.enter_sides(sides)).chunk(2, -1)
        layers = zip(self.middle, halves, strict=True)
        return [functional.relu(half + layer(half)) for layer, half in layers]

    def _compute_cell_mask(
        self, seen: OutcomeInput, hidden: Tensor, spatial: Tensor, features: Tensor
    ) -> Tensor:
        logits = self.compute_mask(hidden, seen.action_mask)
        if self.from_board is None or self.from_planes is None or self.query is None:
            return logits
        of_planes = self.from_planes(spatial) * PLANE_GAIN
        of_cells = self.from_board(seen.board.flatten(1, 2)) + of_planes
        query = self.query(hidden).unflatten(-1, (-1, features.shape[-1]))
        of_cells = (of_cells + features @ query.transpose(1, 2)).flatten(1)
        return cast(Tensor, logits + of_cells[:, self.place] * self.has_cell)
