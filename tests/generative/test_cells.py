"""The distribution of one cell, compared with sums over all values and with counts of samples."""

import pytest
import torch

from marl_cair.generative.networks.board_cells import BoardCells
from marl_cair.generative.networks.cells import (
    CellDistribution,
    build_distribution,
    count_outputs,
    find_log_prob,
    find_mass,
    find_mode,
    gather_candidates,
    sample_deviations,
    sample_without_mode,
)

SHIFTS = ((0, 1), (0, -1), (1, 0), (-1, 0))
NO_STEPS = torch.arange(256, dtype=torch.uint8).repeat(2, 1, 1)  # of two planes


def make_cells(num, seed):
    generator = torch.Generator().manual_seed(seed)
    planes = torch.randint(0, 3, (num, 1, 3, 3), generator=generator).to(torch.uint8) * 64
    candidates = gather_candidates(planes, SHIFTS, NO_STEPS[:1], torch.arange(num) * 9 + 4)
    outputs = torch.randn(count_outputs(len(SHIFTS), 0), num, generator=generator)
    return build_distribution(outputs, candidates)


def find_all_masses(cells):
    """Masses [256, M] of all values."""
    num = cells.mean.shape[0]
    return torch.stack([find_mass(cells, torch.full((num,), float(v))) for v in range(256)])


def test_masses_of_all_values_sum_to_one():
    masses = find_all_masses(make_cells(40, seed=0))
    torch.testing.assert_close(masses.sum(0), torch.ones(40))
    assert masses.min() >= 0.0


def test_log_prob_of_an_impossible_value_is_finite():
    cells = CellDistribution(
        torch.tensor([[1.0]]), torch.zeros(1), torch.tensor([[64.0]]), torch.zeros(1), torch.ones(1)
    )
    log_prob = find_log_prob(cells, torch.tensor([200.0]))
    torch.testing.assert_close(log_prob, torch.tensor([1e-4 / 256]).log())


def test_mode_is_the_value_of_largest_mass_where_it_is_likely():
    cells = make_cells(200, seed=1)
    masses = find_all_masses(cells)
    own = cells.candidates[0]
    values, mass = find_mode(own, find_mass(cells, own), cells.select)
    best = masses.max(0)
    sure = best.values > 0.5
    assert sure.sum() > 20
    assert torch.equal(values[sure].long(), best.indices[sure])
    torch.testing.assert_close(mass[sure], best.values[sure])


def test_candidates_are_own_shifted_empty_and_full():
    planes = torch.arange(1, 13, dtype=torch.uint8).view(1, 1, 3, 4)
    # Row 1, column 2 holds 7: from the left 6, right 8, above 3, below 11.
    candidates = gather_candidates(planes, SHIFTS, NO_STEPS[:1], torch.tensor([6]))
    assert candidates[:, 0].tolist() == [7, 6, 8, 3, 11, 0, 255]


def test_candidates_beyond_the_board_are_empty():
    planes = torch.full((1, 1, 2, 2), 9, dtype=torch.uint8)
    assert gather_candidates(planes, SHIFTS, NO_STEPS[:1], torch.tensor([0]))[:, 0].tolist() == [
        9, 0, 9, 0, 9, 0, 255,
    ]  # fmt: skip


def test_candidates_are_the_values_around_and_after_the_steps_of_a_plane():
    planes = torch.arange(1, 41, dtype=torch.uint8).view(1, 2, 4, 5)
    results = torch.arange(256, dtype=torch.uint8).repeat(2, 2, 1)
    results[1, 0] = results[1, 0] + 100  # the second plane's step
    results[1, 1, 1:] = 7  # what comes to a cell of the second plane
    found = gather_candidates(planes, ((0, 2), (-1, 1)), results, torch.tensor([7, 27, 35]))
    # Row 1, column 2: from two to the left, and from the next row, one to the left.
    assert found.T.tolist() == [
        [8, 6, 12, 8, 0, 255],
        [28, 7, 7, 128, 0, 255],
        [36, 0, 0, 136, 0, 255],  # beyond the board
    ]


@pytest.mark.parametrize(
    ("shape", "shifts"),
    [((3, 4, 6, 5), SHIFTS), ((1, 2, 4, 7), ((0, 2), (-1, 1), (-2, 0))), ((2, 1, 1, 3), ())],
)
def test_fast_masses_equal_those_of_the_distributions(shape, shifts):
    generator = torch.Generator().manual_seed(len(shifts))
    num, num_planes, rows, columns = shape

    def draw(*size):
        return torch.randn(*size, generator=generator)

    planes = torch.randint(0, 256, shape, generator=generator) * (draw(*shape) > 1.0)
    planes = planes.to(torch.uint8)
    results = torch.randint(0, 256, (num_planes, 3, 256), generator=generator).to(torch.uint8)
    results[..., 0] = 0
    num_outputs = num_planes * count_outputs(len(shifts), 2)
    cells = BoardCells(
        3.0 * draw(num_outputs, num * rows * columns),
        draw(num, num_outputs),
        planes,
        shifts,
        results,
    )
    everywhere = cells.select(torch.arange(planes.numel()))
    changed = torch.randint(0, 256, shape, generator=generator).to(torch.uint8)
    ends = torch.where(draw(*shape) > 0.0, 255, 0).to(torch.uint8)
    for values in (planes, planes.roll(1, -1), changed, ends):
        masses, is_empty = cells.find_masses(values)
        wanted = find_mass(everywhere, values.flatten().float())
        torch.testing.assert_close(masses.flatten(), wanted, atol=3e-6, rtol=1e-4)
    assert torch.equal(is_empty.flatten(), everywhere.candidates[:-1].amax(0) == 0.0)
    assert is_empty.any()
    assert not is_empty.all()


def test_fast_masses_are_finite_for_extreme_outputs():
    planes = torch.tensor([[[[0, 200]]]], dtype=torch.uint8)
    outputs = torch.zeros(count_outputs(0, 0), 2)
    outputs[:4] = torch.tensor([-1e4, -1e4, -1e4, 1e4])[:, None]  # a new value, of the logistic
    outputs[-1] = torch.tensor([1e4, -1e4])  # as wide, and as narrow, as it can be
    cells = BoardCells(outputs, torch.zeros(1, 6), planes, (), torch.zeros(1, 1, 256).byte())
    found = cells.find_masses(planes)[0].flatten()
    wanted = find_mass(cells.select(torch.arange(2)), planes.flatten().float())
    torch.testing.assert_close(found, wanted, atol=1e-6, rtol=0.0)


def test_samples_follow_the_masses_without_the_mode():
    one = make_cells(1, seed=4)
    num = 40_000
    cells = one.select(torch.zeros(num, dtype=torch.int64))
    own = one.candidates[0]
    mode = find_mode(own, find_mass(one, own), one.select)[0]
    drawn = sample_without_mode(cells, mode.expand(num), torch.Generator().manual_seed(0))
    counts = torch.bincount(drawn.long(), minlength=256) / num
    masses = find_all_masses(one)[:, 0].clone()
    masses[int(mode)] = 0.0
    # Four standard errors of a share at most 1/2 of 40,000 draws are 0.01.
    torch.testing.assert_close(counts, masses / masses.sum(), atol=0.01, rtol=0.0)
    assert counts[int(mode)] == 0.0


def test_one_appearance_in_ten_rows_is_one_in_every_sample():
    odds = torch.full((1000, 1, 10), 0.1)
    offsets = torch.rand(1000, 1, generator=torch.Generator().manual_seed(0)) * 0.98 + 0.01
    chosen = sample_deviations(odds, torch.ones_like(odds, dtype=torch.bool), offsets)
    assert chosen.sum(-1).unique().tolist() == [1]
    # Each of the ten rows: 100 +- four standard errors.
    assert ((chosen.sum((0, 1)) - 100).abs() < 38).all()


def test_deviations_keep_each_cells_own_odds():
    odds = torch.tensor([0.05, 0.5, 0.9, 0.0, 1.0]).expand(20_000, 1, 5)
    appears = torch.tensor([True, False, True, False, False]).expand_as(odds)
    offsets = torch.rand(20_000, 1, generator=torch.Generator().manual_seed(0))
    frequency = sample_deviations(odds, appears, offsets).float().mean((0, 1))
    torch.testing.assert_close(frequency, odds[0, 0], atol=0.015, rtol=0.0)


def test_planes_of_one_event_agree_on_the_place():
    odds = torch.zeros(500, 2, 12)
    odds[:, :, :10] = 0.1
    odds[:, 0, 11] = 0.7  # a wound elsewhere in one of the planes must not shift the place
    appears = torch.ones_like(odds, dtype=torch.bool)
    appears[:, :, 10:] = False
    offsets = torch.rand(500, 1, generator=torch.Generator().manual_seed(0)).expand(500, 2)
    chosen = sample_deviations(odds, appears, offsets)
    assert torch.equal(chosen[:, 0, :10], chosen[:, 1, :10])
