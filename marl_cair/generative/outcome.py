"""What a transition pays, whether it ends the episode, and which actions are legal after it.

All three are read from (state, action, next economy), so that the labels of a sampled row fit the
next state that was sampled with it.
"""

from __future__ import annotations

from typing import NamedTuple, cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from marl_cair.generative.economy import NUM_VALUES, ScalarTables
from marl_cair.generative.settings import NO_CELL, GeneratorSpec, NetworkSize

PLANE_UNIT = 64.0  # plane values that the mask head counts as 1
BIN_POWER = 3.0  # bins crowd around 0, where shaping rewards lie, and still reach a win's +-1


class RewardBins(nn.Module):
    """Signed bins over the reward range; a reward is spread over the two bins beside it.

    The centres are scale * sign(t) |t|^3 for even steps of t; the mean of the bins under the
    predicted probabilities is the reward (two-hot, as in MuZero and Dreamer v3).
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

    def read(self, logits: Tensor) -> Tensor:
        """Expected rewards [N] under logits [N, bins]."""
        return logits.softmax(-1) @ self.centres


class Outcome(NamedTuple):
    """Logits that belong to one next state."""

    reward: Tensor  # [N, bins]
    terminal: Tensor  # [N]
    mask: Tensor  # [N, A]


class OutcomeInput(NamedTuple):
    """What the heads read."""

    features: Tensor  # [N, F], pooled board and context
    scalars: Tensor  # uint8 [N, U], next economy
    changes: Tensor  # int64 [N, U]
    board: Tensor  # [N, H, W, F], last layer of the trunk
    planes: Tensor  # uint8 [N, S, H, W], next spatial planes
    action_mask: Tensor  # bool [N, A], of the current state


class OutcomeHeads(nn.Module):
    """OutcomeInput -> Outcome."""

    kinds: Tensor
    named_cells: Tensor
    place: Tensor
    has_cell: Tensor

    def __init__(self, spec: GeneratorSpec, size: NetworkSize, num_features: int) -> None:
        super().__init__()
        uniform, kinds, hidden = spec.num_uniform, spec.num_kinds, size.hidden
        cells = torch.tensor(spec.cells)
        # Only the cells that some action names are looked at.
        named, place = torch.unique(cells.clamp_min(0), return_inverse=True)
        self.register_buffer("kinds", torch.tensor(spec.kinds), persistent=False)
        self.register_buffer("named_cells", named, persistent=False)
        self.register_buffer("place", place, persistent=False)
        self.register_buffer("has_cell", cells != NO_CELL, persistent=False)
        self.values = ScalarTables(uniform, size.table_width)
        self.changes = ScalarTables(uniform, size.table_width)
        self.enter = nn.Linear(num_features + 2 * uniform * (1 + size.table_width), hidden)
        self.middle = nn.Linear(hidden, hidden)
        self.reward = nn.Linear(hidden, size.reward_bins)
        self.terminal = nn.Linear(hidden, 1)
        self.kind = nn.Linear(hidden, kinds)
        self.keep = nn.Parameter(torch.full((kinds,), 2.0))  # the copy gate: now legal, still legal
        self.from_board = nn.Linear(size.channels, kinds) if bool(self.has_cell.any()) else None
        self.from_planes = nn.Linear(spec.num_spatial, kinds) if self.from_board else None

    def forward(self, seen: OutcomeInput) -> Outcome:
        hidden = self._read_economy(seen)
        return Outcome(
            self.reward(hidden), self.terminal(hidden).squeeze(-1), self._judge_mask(seen, hidden)
        )

    def _read_economy(self, seen: OutcomeInput) -> Tensor:
        changes = seen.changes
        signed = torch.where(changes < NUM_VALUES // 2, changes, changes - NUM_VALUES)
        numbers = torch.cat([seen.scalars.float(), 4.0 * signed.float()], -1) / 255.0
        tables = [self.values(seen.scalars.long()), self.changes(changes)]
        hidden = functional.relu(self.enter(torch.cat([seen.features, numbers, *tables], -1)))
        return functional.relu(hidden + self.middle(hidden))

    def _judge_mask(self, seen: OutcomeInput, hidden: Tensor) -> Tensor:
        legal_now = seen.action_mask.to(hidden.dtype) * 2.0 - 1.0
        logits = self.kind(hidden)[:, self.kinds] + self.keep[self.kinds] * legal_now
        if self.from_board is None or self.from_planes is None:
            return cast(Tensor, logits)
        planes = seen.planes.flatten(2)[:, :, self.named_cells].transpose(1, 2).to(hidden.dtype)
        board = seen.board.flatten(1, 2)[:, self.named_cells]
        of_cells = self.from_board(board) + self.from_planes(planes * (1.0 / PLANE_UNIT))
        return cast(Tensor, logits + of_cells[:, self.place, self.kinds] * self.has_cell)
