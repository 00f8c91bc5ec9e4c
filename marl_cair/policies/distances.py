"""Distances over the board, by learned costs: how far every cell is from what each plane shows.

A stack of convolutions sees as far as its kernels reach; the way through a maze is longer, and
turns at every wall. This layer follows ways of any length with one weight for each plane, as Value
Propagation does (Nardelli et al. 2019); costs are summed here, so that a step makes the same
difference near and far.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import torch
from torch import Tensor, nn

CHUNK_NUMBERS = 1 << 16  # of maps and their steps at a time: they stay in a core's cache
STEPS_PER_LOOK = 8  # between two looks whether anything still changes
NUM_SIDES = 4
FARTHEST = 4.0  # distances are cut here
# Weights are multiplied by these, so that a usual learning rate moves them in time. Costs are given
# less: at 32, a wall of a 25x25 maze came to cost 22 steps in 1,000 updates, and ways led through.
LOG_COST_SCALE, READ_SCALE = 8.0, 10.0
OBSTACLE_LOG_COST = 6.0  # at first, beside that of other cells: 400 of their steps
LOWEST_COST, HIGHEST_COST = 1e-3, 20.0  # less would be lost in rounding: ways could lead in circles


class DistanceMaps(nn.Module):
    """Planes float32 [N, C, H, W] -> planes and nearness [N, 2 C, H, W], and features [N, F].

    nearness_m(x) = max(FARTHEST * (plane_m(x) - 1), max over the four neighbours y of
    nearness_m(y) - cost(x)): minus the cost of the cheapest way from x to a cell where plane m is
    on. The features are what is seen at the cells of each plane (softmax attention, at first on the
    plane itself): planes, nearness, and which neighbour leads to each plane.

    The cost of a cell is read from its planes, by weights that are learned. Who learns by trial
    comes to the end of few ways, from which they could be: `obstacle_planes` tells what blocks.
    """

    def __init__(
        self, shape: tuple[int, int, int], num_features: int, obstacle_planes: Sequence[int]
    ) -> None:
        super().__init__()
        num_planes, num_rows, num_columns = shape
        if wrong := [plane for plane in obstacle_planes if not 0 <= plane < num_planes]:
            raise ValueError(
                f"obstacle_planes names plane {wrong[0]}, but the observation has the planes "
                f"0..{num_planes - 1}"
            )
        self.usual_cost = 1.0 / (num_rows + num_columns)
        self.log_cost = make_log_cost(num_planes, obstacle_planes)
        self.eyes = nn.Conv2d(num_planes, num_planes, 1)
        num_seen = num_planes * num_planes * (2 + NUM_SIDES)
        self.read_out = nn.Sequential(nn.Linear(num_seen, num_features), nn.ReLU())
        with torch.no_grad():
            for weight in self.eyes.parameters():
                weight.zero_()
            self.eyes.weight[:, :, 0, 0] = torch.eye(num_planes)

    def forward(self, planes: Tensor) -> tuple[Tensor, Tensor]:
        cost = find_costs(planes, self.log_cost, self.usual_cost)
        nearness = measure_nearness(planes, cost)
        ahead = find_ways(nearness, cost)
        seen = torch.cat([planes, nearness, ahead.flatten(1, 2)], dim=1)
        weights = (READ_SCALE * self.eyes(planes)).flatten(2).softmax(-1)
        looked_at = weights @ seen.flatten(2).transpose(1, 2)
        features: Tensor = self.read_out(looked_at.flatten(1))
        return seen[:, : 2 * planes.shape[1]], features


def make_log_cost(num_planes: int, obstacle_planes: Sequence[int]) -> nn.Conv2d:
    """The weights by which `find_costs` reads a cell: 0, but for planes that block."""
    log_cost = nn.Conv2d(num_planes, 1, 1)
    with torch.no_grad():
        for weight in log_cost.parameters():
            weight.zero_()
        log_cost.weight[:, list(obstacle_planes)] = OBSTACLE_LOG_COST / LOG_COST_SCALE
    return log_cost


def find_costs(planes: Tensor, log_cost: nn.Conv2d, usual_cost: float) -> Tensor:
    """Planes [N, C, H, W] -> what it costs to walk from each cell, [N, 1, H, W]."""
    factor: Tensor = torch.exp(LOG_COST_SCALE * log_cost(planes))
    return (usual_cost * factor).clamp(LOWEST_COST, HIGHEST_COST)


def measure_nearness(planes: Tensor, cost: Tensor) -> Tensor:
    """Planes in 0..1 [N, C, H, W], cost [N, 1, H, W] -> nearness [N, C, H, W]."""
    source = FARTHEST * (planes - 1.0)
    # From where a plane is the same all over, no way leads to anything better.
    differs = (planes != planes[:, :, :1, :1]).any(0).flatten(1).any(1).nonzero().squeeze(1)
    if len(differs) == 0:
        return source
    costs = cost.expand(-1, len(differs), -1, -1)
    found: Tensor = _Propagation.apply(source[:, differs], costs)  # type: ignore[no-untyped-call]
    return source.index_copy(1, differs, found)


@torch.no_grad()
def find_ways(nearness: Tensor, cost: Tensor) -> Tensor:
    """By how many steps each neighbour is nearer, in -1..1: [N, 4, C, H, W] (below, above, right,
    left). Costs are learned from the nearness alone: which way is shortest says nothing of how much
    a cost must change to turn it.
    """
    framed = nn.functional.pad(nearness, (1, 1, 1, 1), value=-torch.inf).permute(2, 3, 0, 1)
    around = torch.stack([side.permute(2, 3, 0, 1) for side in _look_around(framed)], dim=1)
    return ((around - nearness.unsqueeze(1)) / cost.unsqueeze(1)).clamp(-1.0, 1.0)


class _Propagation(torch.autograd.Function):
    """Source and cost [N, M, H, W] -> values at their fixed point, and gradients along the best
    ways: no step is kept, so memory does not grow with their length.
    """

    @staticmethod
    def forward(ctx: Any, source: Tensor, cost: Tensor) -> Tensor:
        values = propagate(source, cost)
        ctx.save_for_backward(source, cost, values)
        return values

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor]:
        source, cost, values = ctx.saved_tensors
        leads_to = find_next_cells(source, cost, values)
        through = sum_over_ways(gradients[0].flatten(2), leads_to).view_as(values)
        is_source = (leads_to == source[0, 0].numel()).view_as(values)
        nothing = torch.zeros_like(through)
        return torch.where(is_source, through, nothing), torch.where(is_source, nothing, -through)


def propagate(source: Tensor, cost: Tensor) -> Tensor:
    """Source and cost (above 0) [N, M, H, W] -> values [N, M, H, W], exact."""
    num_rows, num_maps, height, width = source.shape
    size = max(1, CHUNK_NUMBERS // max(1, num_maps * height * width))
    values = torch.empty_like(source)
    for first in range(0, num_rows, size):
        rows = slice(first, first + size)
        # [H, W, rows]: a neighbour's values are then one block of memory.
        ahead = source[rows].flatten(0, 1).permute(1, 2, 0).contiguous()
        price = cost[rows].flatten(0, 1).permute(1, 2, 0).contiguous()
        reached = _relax_to_the_end(ahead, price)
        values[rows] = reached.permute(2, 0, 1).reshape(-1, num_maps, height, width)
    return values


def _relax_to_the_end(source: Tensor, cost: Tensor) -> Tensor:
    """Bellman and Ford's algorithm on a grid [H, W, rows]."""
    height, width, num_rows = source.shape
    framed = source.new_full((height + 2, width + 2, num_rows), -torch.inf)
    values = framed[1:-1, 1:-1]
    values.copy_(source)
    best, other = torch.empty_like(source), torch.empty_like(source)
    below, above, right, left = _look_around(framed)
    for _ in range(0, height * width, STEPS_PER_LOOK):
        before = values.clone()
        for _ in range(STEPS_PER_LOOK):
            torch.maximum(below, above, out=best)
            torch.maximum(right, left, out=other)
            torch.maximum(best, other, out=best)
            best -= cost
            torch.maximum(values, best, out=values)
        if torch.equal(values, before):
            break
    return values


def _look_around(framed: Tensor) -> Iterator[Tensor]:
    """The neighbours below, above, right and left of the cells of [H + 2, W + 2, ...]."""
    yield framed[2:, 1:-1]
    yield framed[:-2, 1:-1]
    yield framed[1:-1, 2:]
    yield framed[1:-1, :-2]


def find_next_cells(source: Tensor, cost: Tensor, values: Tensor) -> Tensor:
    """The neighbour that each cell has its value from, or H * W where it has its own: int64
    [N, M, H * W].
    """
    height, width = values.shape[2:]
    framed = values.new_full((height + 2, width + 2, values[:, :, 0, 0].numel()), -torch.inf)
    framed[1:-1, 1:-1] = values.flatten(0, 1).permute(1, 2, 0)
    around = torch.stack(list(_look_around(framed)))
    best, which = around.max(0)
    cells = torch.arange(height * width, device=values.device).view(height, width, 1)
    steps = torch.tensor([width, -width, 1, -1], device=values.device)
    own = source.flatten(0, 1).permute(1, 2, 0)
    price = cost.flatten(0, 1).permute(1, 2, 0)
    leads_to = torch.where(best - price > own, cells + steps[which], height * width)
    return leads_to.flatten(0, 1).T.reshape(*values.shape[:2], -1)


def sum_over_ways(gradient: Tensor, leads_to: Tensor) -> Tensor:
    """For each cell the sum of the gradients [N, M, cells] of itself and of all whose way leads
    through it. Doubling: after k rounds ways of up to 2 ** k cells are summed.
    """
    end = gradient.shape[-1]
    total = torch.cat([gradient, gradient.new_zeros(*gradient.shape[:2], 1)], dim=-1)
    ends = torch.full_like(leads_to[..., :1], end)
    jump = torch.cat([leads_to, ends], dim=-1)
    for _ in range(end.bit_length()):
        total = total + torch.zeros_like(total).scatter_add_(-1, jump, total)
        total[..., end] = 0.0
        jump = jump.gather(-1, jump)
    return total[..., :end]
