"""What stands on a board, counted: a small network at every cell, summed over the cells.

Rewards and legal actions are often sums over things (health of all units, what carriers hold) or
depend on the one thing that is marked (the unit under the cursor), wherever it stands. A pooled
convolution trunk of the current board shows neither; equal weights on both boards make the change
of a sum exact.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

SUM_UNIT = 0.1  # what one cell counts for in a sum, so that a dozen things are about 1
SIDES = tuple((row, column) for row in (-1, 0, 1) for column in (-1, 0, 1))
GAZE = 12.0  # logit of a cell where the plane is full: more than all of a thousand other cells
CHANGE_UNIT = 2.0  # the same in a change: one thing more or less is an event


class BoardFeatures(NamedTuple):
    """K features of one board's cells, and D sums over its cells."""

    cells: Tensor  # [N, H * W, K], 0 or more
    sums: Tensor  # [N, D]


class BoardReadout(nn.Module):
    """Boards float32 [N, H * W, S] of values 0..1 -> BoardFeatures.

    The sums are those of the planes and of their products with the first learned features
    (bilinear pooling, Lin et al. 2015): "health of own archers" is a product of three planes, and
    a network that must find it by sums of planes takes ten times as long.
    """

    def __init__(self, num_spatial: int, num_features: int, num_factors: int) -> None:
        super().__init__()
        self.num_factors = num_factors
        self.num_sums = (num_factors + 1) * num_spatial
        self.enter = nn.Linear(num_spatial, num_features)
        self.leave = nn.Linear(num_features, num_features)

    def forward(self, board: Tensor) -> BoardFeatures:
        first = functional.relu(self.enter(board))
        products = first[..., : self.num_factors].transpose(1, 2) @ board
        sums = torch.cat([products.flatten(1), board.sum(1)], -1)
        return BoardFeatures(functional.relu(self.leave(first)), sums)


class NearReadout(nn.Module):
    """Planes uint8 [N, S, H, W] -> sums [N, D] over the cells of what stands near what.

    As the sums of `BoardReadout`, but the learned features also see the largest values within one
    and two cells: a carrier that will be at its hall in a step is a product of such planes.
    """

    def __init__(self, num_spatial: int, num_factors: int) -> None:
        super().__init__()
        self.num_sums = num_factors * num_spatial
        self.enter = nn.Linear(3 * num_spatial, num_factors)

    def forward(self, planes: Tensor) -> Tensor:
        beside = _spread(planes)
        seen = torch.cat([planes, beside, _spread(beside)], 1).flatten(2).float() * (1.0 / 255.0)
        # Written so, it is several times as fast as a layer that broadcasts over the boards.
        weights = self.enter.weight.expand(len(seen), -1, -1)
        factors = functional.relu(torch.bmm(weights, seen) + self.enter.bias[:, None])
        # One arrival must count beside hundreds of cells of ground.
        sums = factors @ seen[:, : planes.shape[1]].transpose(1, 2)
        return sums.flatten(1).log1p()


class SideReadout(nn.Module):
    """Boards float32 [N, H * W, S] of values 0..1 -> numbers [N, D]: what surrounds what.

    Each plane has an eye, which rests on the cells where the plane is on (softmax attention, at
    first on the plane itself) and sees learned features of these and of the eight cells around
    each: "a wall above the walker" is one such number, wherever the walker stands. Sums over the
    board, as in `BoardReadout`, lose it among hundreds of other walls.
    """

    def __init__(
        self, num_rows: int, num_columns: int, num_spatial: int, num_features: int
    ) -> None:
        super().__init__()
        self.shape = num_rows, num_columns
        self.num_seen = len(SIDES) * num_features * num_spatial
        self.eyes = nn.Linear(num_spatial, num_spatial, bias=False)
        nn.init.eye_(self.eyes.weight)
        self.enter = nn.Linear(num_spatial, num_features)

    def forward(self, board: Tensor) -> Tensor:
        gaze = (GAZE * self.eyes(board)).softmax(1)
        features = self.enter(board).transpose(1, 2).unflatten(-1, self.shape)
        features = functional.pad(features, (1, 1, 1, 1))
        rows, columns = self.shape
        around = [
            features[..., 1 + row : 1 + row + rows, 1 + column : 1 + column + columns]
            for row, column in SIDES
        ]
        seen: Tensor = torch.cat(around, 1).flatten(2) @ gaze
        return seen.flatten(1)


def _spread(planes: Tensor) -> Tensor:
    """The largest value within one cell of each, uint8 (pooling takes no uint8 on every device)."""
    for axis in (2, 3):
        length = planes.shape[axis] - 1
        wider = planes.clone()
        for start, other in ((0, 1), (1, 0)):
            part = wider.narrow(axis, start, length)
            torch.maximum(part, planes.narrow(axis, other, length), out=part)
        planes = wider
    return planes


def compare(now: BoardFeatures, later: BoardFeatures) -> Tensor:
    """Features [N, 2 D] of a transition: what stands there later, and what has changed."""
    return torch.cat([later.sums * SUM_UNIT, (later.sums - now.sums) * CHANGE_UNIT], -1)


def flatten_board(planes: Tensor) -> Tensor:
    """Planes uint8 [N, S, H, W] as a readout takes them: float32 [N, H * W, S], 0..1."""
    return planes.flatten(2).transpose(1, 2).contiguous().float().mul_(1.0 / 255.0)
