"""`PathReadout`: path distances from moving to static planes, for rewards that pay for nearness."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from marl_cair.generative.settings import GeneratorSpec, NetworkSize
from marl_cair.policies.distances import find_costs, make_log_cost, measure_nearness

ATTENTION_SCALE = 12.0  # logit of a cell with a full plane: outweighs a thousand other cells
MOST_STEPS = 4.0  # largest change of a path distance that is distinguished


class PathReadout(nn.Module):
    """Boards now and later, uint8 [N, S, H, W] -> features [N, D].

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
        self.register_buffer("static", torch.tensor(static), persistent=False)
        self.register_buffer("moving", torch.tensor(moving), persistent=False)
        self.usual_cost = 1.0 / (spec.num_rows + spec.num_columns)
        obstacles = [static.index(plane) for plane in size.obstacle_planes]
        self.log_cost = make_log_cost(len(static), obstacles)
        self.num_numbers = 2 * len(static) * len(moving)

    def forward(self, now: Tensor, later: Tensor) -> Tensor:
        static = now[:, self.static].float() / 255.0
        cost = find_costs(static, self.log_cost, self.usual_cost)
        nearness = measure_nearness(static, cost).flatten(2)
        before, after = (
            (nearness @ self._attend(board).transpose(1, 2)).flatten(1) for board in (now, later)
        )
        steps = ((after - before) / self.usual_cost).clamp(-MOST_STEPS, MOST_STEPS)
        return torch.cat([after, steps], -1)

    def _attend(self, board: Tensor) -> Tensor:
        """Softmax [N, moving, H * W] over the cells of each moving plane."""
        return (ATTENTION_SCALE / 255.0 * board[:, self.moving].flatten(2).float()).softmax(-1)
