"""Board features for rewards, ends and masks: sums over cells, neighbourhoods, path distances.

Rewards and legal actions are often sums over units (health, carried resources) or depend on one
marked unit (under the cursor), wherever it is. A pooled convolution trunk of the current board
shows neither; equal weights on both boards make the change of a sum exact.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional

from marl_cair.generative.settings import GeneratorSpec, NetworkSize
from marl_cair.policies.distances import find_costs, make_log_cost, measure_nearness

SUM_UNIT = 0.1  # weight of one cell in a sum: a dozen units are about 1
CHANGE_UNIT = 2.0  # the same in a change: one unit more or less is an event
SIDES = tuple((row, column) for row in (-1, 0, 1) for column in (-1, 0, 1))
ATTENTION_SCALE = 12.0  # logit of a cell with a full plane: outweighs a thousand other cells
MOST_STEPS = 4.0  # largest change of a path distance that is distinguished


class BoardFeatures(NamedTuple):
    """K features of one board's cells, and D sums over its cells."""

    cells: Tensor  # [N, H * W, K], 0 or more
    sums: Tensor  # [N, D]


class BoardReadout(nn.Module):
    """Boards float32 [N, H * W, S] of values 0..1 -> BoardFeatures.

    The sums are those of the planes and of their products with the first learned features
    (bilinear pooling, Lin et al. 2015): "health of own archers" is a product of three planes, which
    a network without products takes ten times as long to learn.
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
    """Planes uint8 [N, S, H, W] -> sums [N, D] over cells of products of neighbouring planes.

    Like the sums of `BoardReadout`, but the learned features also see the largest values within one
    and two cells: a carrier that reaches its hall in the next step is such a product.
    """

    def __init__(self, num_spatial: int, num_factors: int) -> None:
        super().__init__()
        self.num_sums = num_factors * num_spatial
        self.enter = nn.Linear(3 * num_spatial, num_factors)

    def forward(self, planes: Tensor) -> Tensor:
        beside = _spread(planes)
        seen = torch.cat([planes, beside, _spread(beside)], 1).flatten(2).float() * (1.0 / 255.0)
        # bmm is several times as fast as a linear layer that broadcasts over the boards.
        weights = self.enter.weight.expand(len(seen), -1, -1)
        factors = functional.relu(torch.bmm(weights, seen) + self.enter.bias[:, None])
        # log1p: one arrival must be visible beside hundreds of cells of terrain.
        sums = factors @ seen[:, : planes.shape[1]].transpose(1, 2)
        return sums.flatten(1).log1p()


class NeighbourhoodReadout(nn.Module):
    """Boards float32 [N, H * W, S] of values 0..1 -> features [N, D] around each plane's cells.

    Each plane has a softmax attention (initially on the cells where the plane is on). It reads
    learned features of these cells and of their eight neighbours: "a wall above the walker" is one
    such feature, wherever the walker is. Sums over the board lose it among hundreds of other walls.
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
        attention = (ATTENTION_SCALE * self.eyes(board)).softmax(1)
        features = self.enter(board).transpose(1, 2).unflatten(-1, self.shape)
        features = functional.pad(features, (1, 1, 1, 1))
        rows, columns = self.shape
        around = [
            features[..., 1 + row : 1 + row + rows, 1 + column : 1 + column + columns]
            for row, column in SIDES
        ]
        seen: Tensor = torch.cat(around, 1).flatten(2) @ attention
        return seen.flatten(1)


class PathReadout(nn.Module):
    """Boards now and later, float32 [N, H * W, S] of values 0..1 -> features [N, D].

    For rewards that pay for every step towards a goal: for each pair of a moving and a static plane
    the later nearness by path (`policies.distances`), and its change in steps. Path costs depend on
    static planes alone: distances are computed once for both boards.
    Raises ValueError if the spec has no static or no moving planes, or `obstacle_planes` has a
    plane that is not static.
    """

    static: Tensor
    moving: Tensor

    def __init__(self, spec: GeneratorSpec, size: NetworkSize) -> None:
        super().__init__()
        static, moving = sorted(set(spec.static_planes)), spec.moving_planes
        if not static or not moving:
            raise ValueError(
                "distances is True, but paths lead from moving to static planes, and of "
                f"{spec.num_spatial} spatial planes {len(static)} are static: set it to False"
            )
        if wrong := [plane for plane in size.obstacle_planes if plane not in static]:
            raise ValueError(
                f"obstacle_planes holds plane {wrong[0]}, but only static planes are allowed: "
                f"{static}"
            )
        self.board = spec.num_rows, spec.num_columns
        self.register_buffer("static", torch.tensor(static), persistent=False)
        self.register_buffer("moving", torch.tensor(moving), persistent=False)
        self.usual_cost = 1.0 / (spec.num_rows + spec.num_columns)
        obstacles = [static.index(plane) for plane in size.obstacle_planes]
        self.log_cost = make_log_cost(len(static), obstacles)
        self.num_numbers = 2 * len(static) * len(moving)

    def forward(self, now: Tensor, later: Tensor) -> Tensor:
        planes = now[..., self.static].transpose(1, 2)
        planes = planes.reshape(*planes.shape[:2], *self.board)
        cost = find_costs(planes, self.log_cost, self.usual_cost)
        nearness = measure_nearness(planes, cost).flatten(2)
        before, after = (
            (nearness @ (ATTENTION_SCALE * board[..., self.moving]).softmax(1)).flatten(1)
            for board in (now, later)
        )
        steps = ((after - before) / self.usual_cost).clamp(-MOST_STEPS, MOST_STEPS)
        return torch.cat([after, steps], -1)


def _spread(planes: Tensor) -> Tensor:
    """Largest value within one cell, uint8 (max pooling does not take uint8 on every device)."""
    for axis in (2, 3):
        length = planes.shape[axis] - 1
        wider = planes.clone()
        for start, other in ((0, 1), (1, 0)):
            part = wider.narrow(axis, start, length)
            torch.maximum(part, planes.narrow(axis, other, length), out=part)
        planes = wider
    return planes


def compare(now: BoardFeatures, later: BoardFeatures) -> Tensor:
    """Features [N, 2 D] of a transition: the later sums, and their changes."""
    return torch.cat([later.sums * SUM_UNIT, (later.sums - now.sums) * CHANGE_UNIT], -1)


def flatten_board(planes: Tensor) -> Tensor:
    """Planes uint8 [N, S, H, W] -> float32 [N, H * W, S] of values 0..1."""
    return planes.flatten(2).transpose(1, 2).contiguous().float().mul_(1.0 / 255.0)
