"""Board features of the outcome heads: neighbourhoods, path distances, steps of values."""

import dataclasses

import pytest
import torch

from marl_cair.generative.networks.cells import gather_candidates
from marl_cair.generative.networks.readout import (
    SIDES,
    NearReadout,
    NeighbourhoodReadout,
    PathReadout,
    flatten_board,
)
from marl_cair.generative.networks.steps import StepTable
from marl_cair.generative.settings import GeneratorSpec, NetworkSize

ROWS, COLUMNS = 4, 6
WALKER, WALL = range(2)


def read_neighbourhoods(planes):
    """Planes [N, 2, H, W], one feature: walls -> what the planes' attention reads [N, 9, 2]."""
    readout = NeighbourhoodReadout(ROWS, COLUMNS, num_spatial=2, num_features=1)
    with torch.no_grad():
        readout.enter.weight.copy_(torch.tensor([[0.0, 1.0]]))
        readout.enter.bias.zero_()
        return readout(flatten_board(planes)).view(-1, len(SIDES), 2)


def test_a_neighbourhood_is_read_wherever_the_walker_is():
    walls = torch.rand(ROWS, COLUMNS, generator=torch.Generator().manual_seed(0)) < 0.5
    planes = torch.zeros(ROWS * COLUMNS, 2, ROWS, COLUMNS, dtype=torch.uint8)
    planes[:, WALL] = walls * 255
    planes[:, WALKER] = 255 * torch.eye(ROWS * COLUMNS).view(-1, ROWS, COLUMNS).to(torch.uint8)
    seen = read_neighbourhoods(planes)[..., WALKER]
    for cell in range(ROWS * COLUMNS):
        row, column = divmod(cell, COLUMNS)
        for side, (rows, columns) in enumerate(SIDES):
            there = row + rows, column + columns
            inside = 0 <= there[0] < ROWS and 0 <= there[1] < COLUMNS
            expected = float(walls[there]) if inside else 0.0
            assert abs(float(seen[cell, side]) - expected) < 1e-3


def test_attention_is_the_mean_around_all_cells_where_the_plane_is_on():
    planes = torch.zeros(1, 2, ROWS, COLUMNS, dtype=torch.uint8)
    planes[0, WALKER, 1:3, 1] = 255
    planes[0, WALL, 1:4, 2] = 255
    seen = read_neighbourhoods(planes)[0, :, WALKER]
    found = {side: round(float(number), 2) for side, number in zip(SIDES, seen, strict=True)}
    expected = {(-1, 1): 0.5, (0, 1): 1.0, (1, 1): 1.0}
    assert {side: number for side, number in found.items() if number} == expected


def test_near_readout_sees_two_cells_far_and_not_three():
    readout = NearReadout(num_spatial=2, num_factors=1)
    with torch.no_grad():  # the factor: plane 1 is on within two cells
        readout.enter.weight.copy_(torch.tensor([[0.0, 0.0, 0.0, 0.0, 0.0, 1.0]]))
        readout.enter.bias.zero_()
    planes = torch.zeros(2, 2, 1, 8, dtype=torch.uint8)
    planes[:, 0, 0, 0] = 255
    planes[0, 1, 0, 2] = planes[1, 1, 0, 3] = 255
    sums = readout(planes).view(2, 1, 2).expm1()
    torch.testing.assert_close(sums[:, 0], torch.tensor([[1.0, 1.0], [0.0, 1.0]]))


# --- path distances ---------------------------------------------------------------------------

BLOCK, GOAL, MOVER = range(3)
MAZE = ("....", ".G..", "###.", ".W..")  # one gap in the wall
SPEC = GeneratorSpec((3, 4, 4), 5, num_uniform=0, noop_action=4, static_planes=(BLOCK, GOAL))
SIZE = NetworkSize(distances=True, obstacle_planes=(BLOCK,))


def draw(row, column):
    planes = torch.zeros(1, 3, 4, 4, dtype=torch.uint8)
    for line, cells in enumerate(MAZE):
        for place, cell in enumerate(cells):
            planes[0, BLOCK, line, place] = 255 * (cell == "#")
            planes[0, GOAL, line, place] = 255 * (cell == "G")
    planes[0, MOVER, row, column] = 255
    return flatten_board(planes)


@pytest.mark.parametrize(
    ("before", "after", "steps"),
    [
        ((3, 1), (3, 2), 1.0),  # further in a straight line, nearer by path
        ((3, 1), (3, 0), -1.0),
        ((3, 1), (3, 1), 0.0),
        ((3, 3), (2, 3), 1.0),
        ((1, 3), (1, 1), 2.0),
    ],
)
def test_steps_are_counted_along_the_path(before, after, steps):
    paths = PathReadout(SPEC, SIZE)
    with torch.no_grad():
        numbers = paths(draw(*before), draw(*after))
    assert numbers.shape == (1, paths.num_numbers)
    nearness, change = numbers.view(2, 2)
    assert float(change[GOAL]) == pytest.approx(steps, abs=0.01)
    if after == (1, 1):
        assert float(nearness[GOAL]) == pytest.approx(0.0, abs=1e-3)


def test_path_costs_are_learned():
    paths = PathReadout(SPEC, SIZE)
    paths(draw(3, 1), draw(3, 2)).sum().backward()
    assert float(paths.log_cost.weight.grad.abs().sum()) > 0.0


def test_boards_without_static_planes_or_with_moving_obstacles_are_refused():
    without = dataclasses.replace(SPEC, static_planes=())
    with pytest.raises(ValueError, match=r"of 3 spatial planes 0 are static: set it to False"):
        PathReadout(without, NetworkSize(distances=True))
    with pytest.raises(ValueError, match=r"plane 2, but only static planes are allowed: \[0, 1\]"):
        PathReadout(SPEC, NetworkSize(distances=True, obstacle_planes=(MOVER,)))


# --- steps of values --------------------------------------------------------------------------

SHIFTS = ((0, 1), (0, -1), (1, 0), (-1, 0))
CLOCK, UNIT = 0, 1
LOSS = 23  # of a unit's value in a move


def step_clock(values):
    """A clock of ten steps to 255, rounded down: it takes steps of 25 and of 26."""
    return (((values + 1) * 10 // 255) + 1) * 255 // 10


def draw_boards(num, random):
    now, later = (torch.zeros(num, 2, 4, 6, dtype=torch.uint8) for _ in range(2))
    clock = torch.randint(0, 10, (num, 4, 6), generator=random) * 255 // 10
    now[:, CLOCK] = clock.to(torch.uint8)
    later[:, CLOCK] = torch.where(clock > 0, step_clock(clock), 0).to(torch.uint8)
    value = torch.randint(30, 250, (num,), generator=random).to(torch.uint8)
    row, column = torch.randint(0, 4, (num,), generator=random), torch.arange(num) % 5
    now[torch.arange(num), UNIT, row, column] = value
    later[torch.arange(num), UNIT, row, column + 1] = value - LOSS
    return now, later


@pytest.fixture(scope="module")
def table():
    counted, random = StepTable(2, num_steps=3), torch.Generator().manual_seed(0)
    for _ in range(20):
        counted.count(*draw_boards(16, random), SHIFTS)
    return counted


def test_a_rounded_clock_is_one_step_with_an_exact_result_for_each_value(table):
    assert abs(int(table.slots[CLOCK, 0])) in (25, 26)
    assert table.slots[CLOCK, 1:3].tolist() == [0, 0]
    values = torch.arange(1, 10) * 255 // 10
    assert torch.equal(table.results[CLOCK, 0][values].long(), step_clock(values))
    assert not table.results[..., 0].any()  # empty stays empty
    assert table.results[UNIT, 0].tolist() == list(range(256))  # no step was seen


def test_values_that_arrive_have_their_own_step(table):
    now, later = draw_boards(8, torch.Generator().manual_seed(1))
    candidates = gather_candidates(now, SHIFTS, table.results, torch.arange(now.numel()))
    assert candidates.shape[0] == 1 + len(SHIFTS) + 3 + 2
    arrived = (later[:, UNIT] > 0).flatten()
    from_left = candidates[1].view(8, 2, -1)[:, UNIT].flatten()
    assert torch.equal(from_left[arrived], later[:, UNIT].flatten()[arrived].float())


def test_a_slot_is_given_away_only_for_a_step_that_is_twice_as_common():
    counted = StepTable(1, num_steps=1)
    now = torch.full((10, 1, 1, 1), 100, dtype=torch.uint8)
    counted.count(now, now + 10, SHIFTS)
    counted.count(torch.cat([now, now[:5]]), torch.cat([now, now[:5]]) + 50, SHIFTS)
    assert counted.slots[0, 0] == 10
    counted.count(now, now + 50, SHIFTS)
    assert counted.slots[0, 0] == 50
