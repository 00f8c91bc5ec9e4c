"""Steps of values are found by counting, and their results are candidates of the cells."""

from __future__ import annotations

import torch
from torch import Tensor

from marl_cair.generative.networks.cells import gather_candidates
from marl_cair.generative.networks.readout import NearReadout
from marl_cair.generative.networks.steps import StepTable

SHIFTS = ((0, 1), (0, -1), (1, 0), (-1, 0))
CLOCK, WALKER = 0, 1
LEFT = 23  # what a walker's value loses on the way


def step_clock(values: Tensor) -> Tensor:
    """A clock of ten steps to 255, rounded down: it takes steps of 25 and of 26."""
    return (((values + 1) * 10 // 255) + 1) * 255 // 10


def draw_boards(num: int, random: torch.Generator) -> tuple[Tensor, Tensor]:
    now, later = (torch.zeros(num, 2, 4, 6, dtype=torch.uint8) for _ in range(2))
    clock = torch.randint(0, 10, (num, 4, 6), generator=random) * 255 // 10
    now[:, CLOCK] = clock.to(torch.uint8)
    later[:, CLOCK] = torch.where(clock > 0, step_clock(clock), 0).to(torch.uint8)
    value = torch.randint(30, 250, (num,), generator=random).to(torch.uint8)
    row, column = torch.randint(0, 4, (num,), generator=random), torch.arange(num) % 5
    now[torch.arange(num), WALKER, row, column] = value
    later[torch.arange(num), WALKER, row, column + 1] = value - LEFT
    return now, later


def count(num_batches: int) -> StepTable:
    table, random = StepTable(2, num_steps=3), torch.Generator().manual_seed(0)
    for _ in range(num_batches):
        table.count(*draw_boards(16, random), SHIFTS)
    return table


def test_rounded_clock_is_one_step_with_an_exact_result_for_each_value() -> None:
    table = count(20)
    assert abs(int(table.slots[CLOCK, 0])) in (25, 26)
    assert table.slots[CLOCK, 1:3].tolist() == [0, 0]
    values = torch.arange(1, 10) * 255 // 10
    assert torch.equal(table.results[CLOCK, 0][values].long(), step_clock(values))


def test_empty_stays_empty_and_unseen_steps_change_nothing() -> None:
    table = count(20)
    assert not table.results[..., 0].any()
    assert table.results[WALKER, 0].tolist() == list(range(256))


def test_what_walks_in_has_its_own_step() -> None:
    now, later = draw_boards(8, torch.Generator().manual_seed(1))
    candidates = gather_candidates(now, SHIFTS, count(20).results, torch.arange(now.numel()))
    assert candidates.shape[0] == 1 + len(SHIFTS) + 3 + 2
    arrived = (later[:, WALKER] > 0).flatten()
    from_left = candidates[1].view(8, 2, -1)[:, WALKER].flatten()
    assert torch.equal(from_left[arrived], later[:, WALKER].flatten()[arrived].float())


def test_slots_change_hands_only_for_a_step_that_is_twice_as_common() -> None:
    table = StepTable(1, num_steps=1)
    now = torch.full((10, 1, 1, 1), 100, dtype=torch.uint8)
    table.count(now, now + 10, SHIFTS)
    table.count(torch.cat([now, now[:5]]), torch.cat([now, now[:5]]) + 50, SHIFTS)
    assert table.slots[0, 0] == 10
    table.count(now, now + 50, SHIFTS)
    assert table.slots[0, 0] == 50


def test_near_readout_sees_two_cells_far_and_not_three() -> None:
    readout = NearReadout(num_spatial=2, num_factors=1)
    with torch.no_grad():  # the factor: something of plane 1 within two cells
        readout.enter.weight.copy_(torch.tensor([[0.0, 0.0, 0.0, 0.0, 0.0, 1.0]]))
        readout.enter.bias.zero_()
    planes = torch.zeros(2, 2, 1, 8, dtype=torch.uint8)
    planes[:, 0, 0, 0] = 255
    planes[0, 1, 0, 2] = planes[1, 1, 0, 3] = 255
    sums = readout(planes).view(2, 1, 2).expm1()
    torch.testing.assert_close(sums[:, 0], torch.tensor([[1.0, 1.0], [0.0, 1.0]]))
