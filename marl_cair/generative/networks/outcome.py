"""What a transition pays, whether it ends the episode, and which actions are legal after it.

All three are read from (state, action, next state), boards and economy, so that the labels of a
sampled row fit the next state that was sampled with it.
"""

from __future__ import annotations

from typing import NamedTuple, cast

import torch
from torch import Tensor, nn
from torch.nn import functional

from marl_cair.generative.networks.economy import NUM_VALUES, ScalarTables
from marl_cair.generative.networks.readout import BoardReadout, SideReadout, compare, flatten_board
from marl_cair.generative.networks.ways import WayReadout
from marl_cair.generative.settings import GeneratorSpec, NetworkSize
from marl_cair.policies.config import NO_CELL

PLANE_GAIN = 4.0  # of the mask head's planes: a quarter of the full value counts as 1
FINE_REACH = 2.0  # standard deviations that the correction of the bins' mean stays within
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
    fine: Tensor  # [N], added to the mean of the reward's bins, in reward units


def read_reward(outcome: Outcome, bins: RewardBins) -> Tensor:
    """Expected rewards [N]."""
    return bins.read(outcome.reward) + outcome.fine


def read_outcome(outcome: Outcome, bins: RewardBins) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Of `Opinions` the last four: rewards, P(reward of 0) and P(end), [N] each, mask [N, A]."""
    zero_bin = bins.centres.abs().argmin()
    return (
        read_reward(outcome, bins),
        outcome.reward.softmax(-1)[:, zero_bin],
        outcome.terminal.sigmoid(),
        outcome.mask,
    )


def judge_kinds(scores: Tensor, keep: Tensor, kinds: Tensor, action_mask: Tensor) -> Tensor:
    """Mask logits [N, A] from those of kinds of action, and from which actions are legal now.

    scores: [N, K]; keep: [K], for what is legal now, against what is not; kinds: int64 [A], of each
    action; action_mask: bool [N, A].
    """
    legal_now = action_mask.to(scores.dtype) * 2.0 - 1.0
    return scores[:, kinds] + keep[kinds] * legal_now


class OutcomeInput(NamedTuple):
    """What the heads read."""

    features: Tensor  # [N, F], pooled board and context
    scalars: Tensor  # uint8 [N, U], next economy
    changes: Tensor  # int64 [N, U]
    board: Tensor  # [N, H, W, F], last layer of the trunk
    things: Tensor  # float32 [N, H * W, S], spatial planes now, 0..1
    planes: Tensor  # uint8 [N, S, H, W], next spatial planes
    action_mask: Tensor  # bool [N, A], of the current state


class OutcomeHeads(nn.Module):
    """OutcomeInput -> Outcome."""

    kinds: Tensor
    place: Tensor
    has_cell: Tensor
    reward_std: Tensor

    def __init__(self, spec: GeneratorSpec, size: NetworkSize, num_features: int) -> None:
        super().__init__()
        uniform, kinds, hidden = spec.num_uniform, spec.num_kinds, size.hidden
        of_actions, cells = torch.tensor(spec.kinds), torch.tensor(spec.cells)
        has_cell = cells != NO_CELL
        # Only the kinds of which some action names a cell look at cells.
        named, place = torch.unique(torch.where(has_cell, of_actions, -1), return_inverse=True)
        num_named = int((named >= 0).sum())
        place = (cells * num_named + place - (named.numel() - num_named)).clamp_min(0)
        self.register_buffer("kinds", of_actions, persistent=False)
        self.register_buffer("place", place * has_cell, persistent=False)
        self.register_buffer("has_cell", has_cell, persistent=False)
        self.readout = BoardReadout(spec.num_spatial, size.readout, size.factors)
        self.values = ScalarTables(uniform, size.table_width)
        self.changes = ScalarTables(uniform, size.table_width)
        # The mask's loss is far larger than the others: in layers of their own these learn faster.
        self.ways = WayReadout(spec, size) if size.distances else None
        num_boards = 2 * self.readout.num_sums + (self.ways.num_numbers if self.ways else 0)
        num_seen = num_features + num_boards + 2 * uniform * (1 + size.table_width)
        self.enter = nn.Linear(num_seen, 2 * hidden)
        self.sides = SideReadout(
            spec.num_rows, spec.num_columns, spec.num_spatial, size.side_features
        )
        self.enter_sides = nn.Linear(self.sides.num_seen, 2 * hidden, bias=False)
        self.middle = nn.ModuleList(nn.Linear(hidden, hidden) for _ in range(2))
        self.reward = nn.Linear(hidden, size.reward_bins)
        self.terminal = nn.Linear(hidden, 1)
        # Bins are coarse for rewards of a thousandth of a win, which are sums over what changed.
        self.fine = nn.Linear(hidden + num_boards, 1)
        nn.init.zeros_(self.fine.weight)
        nn.init.zeros_(self.fine.bias)
        self.register_buffer("reward_std", torch.ones(()))  # of the rewards learned from
        self.kind = nn.Linear(hidden, kinds)
        self.keep = nn.Parameter(torch.full((kinds,), 2.0))  # the copy gate: now legal, still legal
        self.from_board = nn.Linear(size.channels, num_named) if num_named else None
        self.from_planes = nn.Linear(spec.num_spatial, num_named) if num_named else None
        # What a cell allows depends on what stands there and on who would act (the unit under the
        # cursor): the product of both.
        self.query = nn.Linear(hidden, num_named * size.readout) if num_named else None

    def forward(self, seen: OutcomeInput) -> Outcome:
        things = flatten_board(seen.planes)
        later = self.readout(things)
        boards = compare(self.readout(seen.things), later)
        if self.ways is not None:
            boards = torch.cat([boards, self.ways(seen.things, things)], -1)
        of_value, of_mask = self._read(seen, boards, self.sides(things))
        fine = self.fine(torch.cat([of_value, boards], -1)).squeeze(-1)
        return Outcome(
            self.reward(of_value),
            self.terminal(of_value).squeeze(-1),
            self._judge_mask(seen, of_mask, things, later.cells),
            FINE_REACH * self.reward_std * torch.tanh(fine),
        )

    def _read(self, seen: OutcomeInput, boards: Tensor, sides: Tensor) -> list[Tensor]:
        """Hidden layers [N, hidden]: of reward and end, and of the mask."""
        changes = seen.changes
        signed = torch.where(changes < NUM_VALUES // 2, changes, changes - NUM_VALUES)
        numbers = torch.cat([seen.scalars.float(), 4.0 * signed.float()], -1) / 255.0
        tables = [self.values(seen.scalars.long()), self.changes(changes)]
        entered = self.enter(torch.cat([seen.features, boards, numbers, *tables], -1))
        halves = functional.relu(entered + self.enter_sides(sides)).chunk(2, -1)
        layers = zip(self.middle, halves, strict=True)
        return [functional.relu(half + layer(half)) for layer, half in layers]

    def _judge_mask(
        self, seen: OutcomeInput, hidden: Tensor, things: Tensor, features: Tensor
    ) -> Tensor:
        logits = judge_kinds(self.kind(hidden), self.keep, self.kinds, seen.action_mask)
        if self.from_board is None or self.from_planes is None or self.query is None:
            return logits
        of_cells = self.from_board(seen.board.flatten(1, 2)) + self.from_planes(things) * PLANE_GAIN
        query = self.query(hidden).unflatten(-1, (-1, features.shape[-1]))
        of_cells = (of_cells + features @ query.transpose(1, 2)).flatten(1)
        return cast(Tensor, logits + of_cells[:, self.place] * self.has_cell)
