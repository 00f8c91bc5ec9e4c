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
CHANGE_UNIT = 2.0  # the same in a change: one thing more or less is an event


class BoardFeatures(NamedTuple):
    """K features of one board's cells, and their sums with those of the S planes themselves."""

    cells: Tensor  # [N, H * W, K], 0 or more
    sums: Tensor  # [N, K + S]


class BoardReadout(nn.Module):
    """Boards float32 [N, H * W, S] of values 0..1 -> BoardFeatures."""

    def __init__(self, num_spatial: int, num_features: int) -> None:
        super().__init__()
        self.enter = nn.Linear(num_spatial, num_features)
        self.leave = nn.Linear(num_features, num_features)

    def forward(self, board: Tensor) -> BoardFeatures:
        cells = functional.relu(self.leave(functional.relu(self.enter(board))))
        return BoardFeatures(cells, torch.cat([cells.sum(1), board.sum(1)], -1))


def compare(now: BoardFeatures, later: BoardFeatures) -> Tensor:
    """Features [N, 2 (K + S)] of a transition: what stands there later, and what has changed."""
    return torch.cat([later.sums * SUM_UNIT, (later.sums - now.sums) * CHANGE_UNIT], -1)


def flatten_board(planes: Tensor) -> Tensor:
    """Planes uint8 [N, S, H, W] as a readout takes them: float32 [N, H * W, S], 0..1."""
    return planes.flatten(2).transpose(1, 2).contiguous().float().mul_(1.0 / 255.0)
