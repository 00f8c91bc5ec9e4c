"""Path distances over the board with learned costs, from every cell to each plane.

Paths through a maze are longer than the kernels of convolutions reach. This layer follows paths of
any length with one weight for each plane, like Value Propagation (Nardelli et al. 2019), but sums
costs: a step makes the same difference near and far.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import torch
from torch import Tensor, nn

CHUNK_NUMBERS = 1 << 16  # numbers of a chunk of maps: it stays in a core's cache
STEPS_PER_CHECK = 8  # relaxation steps between two checks for convergence
NUM_SIDES = 4
FARTHEST = 4.0  # largest distance
# Scales of weights for usual learning rates. At 32, a wall of a 25x25 maze cost only 22 steps after
# 1,000 updates, and paths led through it.
LOG_COST_SCALE, READ_SCALE = 8.0, 10.0
OBSTACLE_LOG_COST = 6.0  # initially: 400 steps of other cells
LOWEST_COST, HIGHEST_COST = 1e-3, 20.0  # lower costs are lost in rounding: paths could be circles


class DistanceMaps(nn.Module):
    """Planes float32 [N, C, H, W] -> planes and nearness [N, 2 C, H, W], and features [N, F].

    nearness_m(x) = max(FARTHEST * (plane_m(x) - 1), max over the four neighbours y of
    nearness_m(y) - cost(x)): minus the cost of the cheapest path from x to a cell where plane m is
    on. The features are read at the cells of each plane (softmax attention, initially on the plane
    itself): planes, nearness, and the difference of each neighbour's nearness.

    The cost of a cell is a learned function of its planes. Exploration completes few paths to learn
    it from: `obstacle_planes` sets planes that block from the start.
    """

    def __init__(
        self, shape: tuple[int, int, int], num_features: int, obstacle_planes: Sequence[int]
    ) -> None:
        super().__init__()
        num_planes, num_rows, num_columns = shape
        if wrong := [plane for plane in obstacle_planes if not 0 <= plane < num_planes]:
            raise ValueError(
                f"obstacle_planes holds plane {wrong[0]}, but the observation has the planes "
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
        neighbours = compare_neighbours(nearness, cost)
        seen = torch.cat([planes, nearness, neighbours.flatten(1, 2)], dim=1)
        weights = (READ_SCALE * self.eyes(planes)).flatten(2).softmax(-1)
        attended = weights @ seen.flatten(2).transpose(1, 2)
        features: Tensor = self.read_out(attended.flatten(1))
        return seen[:, : 2 * planes.shape[1]], features


def make_log_cost(num_planes: int, obstacle_planes: Sequence[int]) -> nn.Conv2d:
    """The weights of `find_costs`: 0, except for obstacles."""
    log_cost = nn.Conv2d(num_planes, 1, 1)
    with torch.no_grad():
        for weight in log_cost.parameters():
            weight.zero_()
        log_cost.weight[:, list(obstacle_planes)] = OBSTACLE_LOG_COST / LOG_COST_SCALE
    return log_cost


def find_costs(planes: Tensor, log_cost: nn.Conv2d, usual_cost: float) -> Tensor:
    """Planes [N, C, H, W] -> cost of a step from each cell, [N, 1, H, W]."""
    factor: Tensor = torch.exp(LOG_COST_SCALE * log_cost(planes))
    return (usual_cost * factor).clamp(LOWEST_COST, HIGHEST_COST)


def measure_nearness(planes: Tensor, cost: Tensor) -> Tensor:
    """Planes in 0..1 [N, C, H, W], cost [N, 1, H, W] -> nearness [N, C, H, W]."""
    source = FARTHEST * (planes - 1.0)
    if torch.compiler.is_exporting():
        return propagate_in_graph(source, cost)
    # Constant planes have no better cell to go to.
    differs = (planes != planes[:, :, :1, :1]).any(0).flatten(1).any(1).nonzero().squeeze(1)
    if len(differs) == 0:
        return source
    costs = cost.expand(-1, len(differs), -1, -1)
    found: Tensor = _Propagation.apply(source[:, differs], costs)  # type: ignore[no-untyped-call]
    return source.index_copy(1, differs, found)


@torch.no_grad()
def compare_neighbours(nearness: Tensor, cost: Tensor) -> Tensor:
    """By how many steps each neighbour is nearer, in -1..1: [N, 4, C, H, W] (below, above, right,
    left). Without gradients: the shortest path does not show which change of a cost would turn it.
    """
    framed = nn.functional.pad(nearness, (1, 1, 1, 1), value=-torch.inf).permute(2, 3, 0, 1)
    around = torch.stack([side.permute(2, 3, 0, 1) for side in _shift_to_neighbours(framed)], dim=1)
    return ((around - nearness.unsqueeze(1)) / cost.unsqueeze(1)).clamp(-1.0, 1.0)


class _Propagation(torch.autograd.Function):
    """Source and cost [N, M, H, W] -> values at their fixed point, with gradients along the best
    paths: no step is stored, so memory does not grow with their length.
    """

    @staticmethod
    def forward(ctx: Any, source: Tensor, cost: Tensor) -> Tensor:
        values = propagate(source, cost)
        ctx.save_for_backward(source, cost, values)
        return values

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor]:
        source, cost, values = ctx.saved_tensors
        next_cells = find_next_cells(source, cost, values)
        through = sum_along_paths(gradients[0].flatten(2), next_cells).view_as(values)
        is_source = (next_cells == source[0, 0].numel()).view_as(values)
        return torch.where(is_source, through, 0.0), torch.where(is_source, 0.0, -through)


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
        reached = _relax(ahead, price)
        values[rows] = reached.permute(2, 0, 1).reshape(-1, num_maps, height, width)
    return values


def propagate_in_graph(source: Tensor, cost: Tensor) -> Tensor:
    """The numbers of `propagate` as one loop of a graph that `torch.export` writes."""
    from torch._higher_order_ops import while_loop

    def has_changed(values: Tensor, changed: Tensor) -> Tensor:
        return changed.clone()

    def step(values: Tensor, changed: Tensor) -> tuple[Tensor, Tensor]:
        framed = nn.functional.pad(values, (1, 1, 1, 1), value=-torch.inf)
        best = torch.maximum(
            torch.maximum(framed[..., 2:, 1:-1], framed[..., :-2, 1:-1]),
            torch.maximum(framed[..., 1:-1, 2:], framed[..., 1:-1, :-2]),
        )
        reached = torch.maximum(values, best - cost)
        return reached, (reached != values).any()

    first = (source.contiguous(), source.new_ones((), dtype=torch.bool))
    values: Tensor = while_loop(has_changed, step, first)[0]  # type: ignore[no-untyped-call]
    return values


def _relax(source: Tensor, cost: Tensor) -> Tensor:
    """The Bellman-Ford algorithm on a grid [H, W, rows]."""
    height, width, num_rows = source.shape
    framed = source.new_full((height + 2, width + 2, num_rows), -torch.inf)
    values = framed[1:-1, 1:-1]
    values.copy_(source)
    best, other = torch.empty_like(source), torch.empty_like(source)
    below, above, right, left = _shift_to_neighbours(framed)
    for _ in range(0, height * width, STEPS_PER_CHECK):
        before = values.clone()
        for _ in range(STEPS_PER_CHECK):
            torch.maximum(below, above, out=best)
            torch.maximum(right, left, out=other)
            torch.maximum(best, other, out=best)
            best -= cost
            torch.maximum(values, best, out=values)
        if torch.equal(values, before):
            break
    return values


def _shift_to_neighbours(framed: Tensor) -> Iterator[Tensor]:
    """The neighbours below, above, right and left of the cells of [H + 2, W + 2, ...]."""
    yield framed[2:, 1:-1]
    yield framed[:-2, 1:-1]
    yield framed[1:-1, 2:]
    yield framed[1:-1, :-2]


def find_next_cells(source: Tensor, cost: Tensor, values: Tensor) -> Tensor:
    """Neighbour from which each cell has its value, H * W for its own: int64 [N, M, H * W]."""
    height, width = values.shape[2:]
    framed = values.new_full((height + 2, width + 2, values[:, :, 0, 0].numel()), -torch.inf)
    framed[1:-1, 1:-1] = values.flatten(0, 1).permute(1, 2, 0)
    around = torch.stack(list(_shift_to_neighbours(framed)))
    best, which = around.max(0)
    cells = torch.arange(height * width, device=values.device).view(height, width, 1)
    steps = torch.tensor([width, -width, 1, -1], device=values.device)
    own = source.flatten(0, 1).permute(1, 2, 0)
    price = cost.flatten(0, 1).permute(1, 2, 0)
    next_cells = torch.where(best - price > own, cells + steps[which], height * width)
    return next_cells.flatten(0, 1).T.reshape(*values.shape[:2], -1)


def sum_along_paths(gradient: Tensor, next_cells: Tensor) -> Tensor:
    """For each cell the sum of the gradients [N, M, cells] of itself and of all cells whose path
    leads through it. Doubling: after k rounds paths of up to 2 ** k cells are summed.
    """
    end = gradient.shape[-1]
    total = torch.cat([gradient, gradient.new_zeros(*gradient.shape[:2], 1)], dim=-1)
    ends = torch.full_like(next_cells[..., :1], end)
    jump = torch.cat([next_cells, ends], dim=-1)
    for _ in range(end.bit_length()):
        total = total + torch.zeros_like(total).scatter_add_(-1, jump, total)
        total[..., end] = 0.0
        jump = jump.gather(-1, jump)
    return total[..., :end]
