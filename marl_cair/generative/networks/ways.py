"""How much nearer what moves has come to what stays, by the way and not by the eye."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from marl_cair.generative.networks.readout import GAZE
from marl_cair.generative.settings import GeneratorSpec, NetworkSize
from marl_cair.policies.distances import find_costs, make_log_cost, measure_nearness

MOST_STEPS = 4.0  # of change that are told apart: things move by a cell or a few


class WayReadout(nn.Module):
    """Boards now and later, float32 [N, H * W, S] of values 0..1 -> numbers [N, D].

    The network's own `policies.distances`, for rewards that pay for every step towards a goal: for
    each pair of a plane that moves and one that is static, the nearness of the one to the other
    later, and its change in steps. Ways depend on static planes alone, so that they are measured
    once for both boards.

    Raises:
        ValueError: the spec has no static planes, or none that move; `obstacle_planes` names a
            plane that is not static.
    """

    static: Tensor
    moving: Tensor

    def __init__(self, spec: GeneratorSpec, size: NetworkSize) -> None:
        super().__init__()
        static, moving = sorted(set(spec.static_planes)), spec.moving_planes
        if not static or not moving:
            raise ValueError(
                "distances is True, but ways lead from planes that move to planes that are static, "
                f"and of {spec.num_spatial} spatial planes {len(static)} are: set it to False"
            )
        if wrong := [plane for plane in size.obstacle_planes if plane not in static]:
            raise ValueError(
                f"obstacle_planes names plane {wrong[0]}, but static are {static}: name some of "
                "these"
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
            (nearness @ (GAZE * board[..., self.moving]).softmax(1)).flatten(1)
            for board in (now, later)
        )
        steps = ((after - before) / self.usual_cost).clamp(-MOST_STEPS, MOST_STEPS)
        return torch.cat([after, steps], -1)
