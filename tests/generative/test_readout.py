"""What the heads of the outcome are told of a board."""

from __future__ import annotations

import torch

from marl_cair.generative.networks.readout import SIDES, SideReadout, flatten_board

ROWS, COLUMNS = 4, 6
WALKER, WALL = range(2)


def read_sides(planes: torch.Tensor) -> torch.Tensor:
    """Planes [N, 2, H, W], the one feature is walls -> what the eyes see [N, 9 sides, 2 eyes]."""
    readout = SideReadout(ROWS, COLUMNS, num_spatial=2, num_features=1)
    with torch.no_grad():
        readout.enter.weight.copy_(torch.tensor([[0.0, 1.0]]))
        readout.enter.bias.zero_()
        return readout(flatten_board(planes)).view(-1, len(SIDES), 2)


def test_sides_tell_what_stands_around_a_walker_wherever_it_is() -> None:
    walls = torch.rand(ROWS, COLUMNS, generator=torch.Generator().manual_seed(0)) < 0.5
    planes = torch.zeros(ROWS * COLUMNS, 2, ROWS, COLUMNS, dtype=torch.uint8)
    planes[:, WALL] = walls * 255
    planes[:, WALKER] = 255 * torch.eye(ROWS * COLUMNS).view(-1, ROWS, COLUMNS).to(torch.uint8)
    seen = read_sides(planes)[..., WALKER]
    for cell in range(ROWS * COLUMNS):
        row, column = divmod(cell, COLUMNS)
        for side, (rows, columns) in enumerate(SIDES):
            there = row + rows, column + columns
            inside = 0 <= there[0] < ROWS and 0 <= there[1] < COLUMNS
            expected = float(walls[there]) if inside else 0.0
            assert abs(float(seen[cell, side]) - expected) < 1e-3


def test_an_eye_sees_the_mean_around_all_cells_where_its_plane_is_on() -> None:
    planes = torch.zeros(1, 2, ROWS, COLUMNS, dtype=torch.uint8)
    planes[0, WALKER, 1:3, 1] = 255
    planes[0, WALL, 1:4, 2] = 255
    seen = read_sides(planes)[0, :, WALKER]
    found = {side: round(float(number), 2) for side, number in zip(SIDES, seen, strict=True)}
    assert {side: number for side, number in found.items() if number} == {
        (-1, 1): 0.5,
        (0, 1): 1.0,
        (1, 1): 1.0,
    }
