"""How far the way is from what moves to what stays, as the generator's rewards see it."""

from __future__ import annotations

import dataclasses

import pytest
import torch
from torch import Tensor

from marl_cair.generative.networks.readout import flatten_board
from marl_cair.generative.networks.ways import WayReadout
from marl_cair.generative.settings import GeneratorSpec, NetworkSize

WALL, GOAL, WALKER = range(3)
# A wall with one gap: who stands above the goal must walk around.
MAZE = ("....", ".G..", "###.", ".W..")
SPEC = GeneratorSpec((3, 4, 4), 5, num_uniform=0, noop_action=4, static_planes=(WALL, GOAL))
SIZE = NetworkSize(distances=True, obstacle_planes=(WALL,))


def draw(row: int, column: int) -> Tensor:
    planes = torch.zeros(1, 3, 4, 4, dtype=torch.uint8)
    for line, cells in enumerate(MAZE):
        for place, cell in enumerate(cells):
            planes[0, WALL, line, place] = 255 * (cell == "#")
            planes[0, GOAL, line, place] = 255 * (cell == "G")
    planes[0, WALKER, row, column] = 255
    return flatten_board(planes)


@pytest.mark.parametrize(
    ("before", "after", "steps"),
    [
        ((3, 1), (3, 2), 1.0),  # away by the eye, nearer by the way
        ((3, 1), (3, 0), -1.0),
        ((3, 1), (3, 1), 0.0),
        ((3, 3), (2, 3), 1.0),
        ((1, 3), (1, 1), 2.0),
    ],
)
def test_steps_are_counted_along_the_way(
    before: tuple[int, int], after: tuple[int, int], steps: float
) -> None:
    ways = WayReadout(SPEC, SIZE)
    with torch.no_grad():
        numbers = ways(draw(*before), draw(*after))
    assert numbers.shape == (1, ways.num_numbers)
    nearness, change = numbers.view(2, 2)
    assert float(change[GOAL]) == pytest.approx(steps, abs=0.01)
    if after == (1, 1):
        assert float(nearness[GOAL]) == pytest.approx(0.0, abs=1e-3)


def test_costs_are_learned() -> None:
    ways = WayReadout(SPEC, SIZE)
    ways(draw(3, 1), draw(3, 2)).sum().backward()  # type: ignore[no-untyped-call]
    gradient = ways.log_cost.weight.grad
    assert gradient is not None
    assert float(gradient.abs().sum()) > 0.0


def test_boards_without_ways_are_refused() -> None:
    nothing_static = dataclasses.replace(SPEC, static_planes=())
    with pytest.raises(ValueError, match=r"of 3 spatial planes 0 are: set it to False"):
        WayReadout(nothing_static, NetworkSize(distances=True))
    with pytest.raises(ValueError, match=r"obstacle_planes names plane 2, but static are \[0, 1\]"):
        WayReadout(SPEC, NetworkSize(distances=True, obstacle_planes=(WALKER,)))
