"""Walkers that meet: swapping cells, ties, crowds and columns without overlap."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from tests.games.deep_rts.skirmish import CALM, MEADOW, Skirmish, ticks_until

CORRIDOR = "\n".join(
    [
        "...............G",
        ".1..........2...",
        "." * 16,
        "#" * 16,
        "." * 16,
        "#" * 16,
        *["." * 16] * 10,
    ]
)


def wait_without_overlap(game: Skirmish, num_ticks: int):
    """Yields after each tick, in which no two units have stood on one cell."""
    for _ in range(num_ticks):
        game.wait()
        units = [unit for player in (0, 1) for unit in game.units_of(player)]
        assert len({game.place(unit) for unit in units}) == len(units)
        assert all(game.occupant(*game.place(unit)) == unit for unit in units)
        yield


def meet(*units: tuple[int, tuple[int, int], int], text=CORRIDOR, goal=(4, 8)):
    """Send footmen (player, place, health) to one cell; returns them and the cell's occupant."""
    game = Skirmish(text, **CALM)
    game.put(1, t.PEASANT, 4, 12)  # so that serial numbers of players can differ
    slots = [game.put(player, t.FOOTMAN, *place) for player, place, _ in units]
    for slot, (*_, health) in zip(slots, units, strict=True):
        game.set(slot, s.UNIT_HEALTH, health)
        game.order(slot, s.MOVE, *goal)
    game.wait(12)
    return slots, game.occupant(*goal)


@pytest.mark.parametrize(("gap", "delay"), [(1, 0), *product(range(2, 6), (0, 3, 10))])
def test_own_units_that_meet_in_a_corridor_swap_cells(gap, delay):
    game = Skirmish(CORRIDOR)
    left, right = game.put(0, t.PEASANT, 4, 4), game.put(0, t.PEASANT, 4, 4 + gap)
    game.order(left, s.MOVE, 4, 12)
    game.wait(delay)
    game.order(right, s.MOVE, 4, 1)
    for _ in wait_without_overlap(game, 300):
        pass
    assert game.place(left) == (4, 12)
    assert game.place(right) == (4, 1)


def test_enemies_do_not_pass_each_other_in_a_corridor():
    game = Skirmish(CORRIDOR, **CALM)
    left, right = game.put(0, t.PEASANT, 4, 4), game.put(1, t.PEASANT, 4, 8)
    game.order(left, s.MOVE, 4, 12)
    game.order(right, s.MOVE, 4, 1)
    for _ in wait_without_overlap(game, 300):
        assert game.place(left)[1] < game.place(right)[1]


def test_mirror_images_do_not_enter_one_cell():
    game = Skirmish(CORRIDOR, **CALM)
    left, right = game.put(0, t.PEASANT, 4, 7), game.put(1, t.PEASANT, 4, 9)
    game.order(left, s.MOVE, 4, 8)
    game.order(right, s.MOVE, 4, 8)
    for _ in range(200):
        game.wait()
        assert game.occupant(4, 8) == s.NO_UNIT
        assert game.get(left, s.UNIT_ORDER) == game.get(right, s.UNIT_ORDER)


def test_draw_decides_between_equals_that_are_not_mirror_images():
    slots, winner = meet((0, (4, 7), 60), (1, (4, 9), 60))
    assert winner in slots


@pytest.mark.parametrize("stronger", [0, 1])
def test_healthier_unit_gets_the_cell(stronger):
    units = [(p, (4, 7 + 2 * p), 60 if p == stronger else 59) for p in (0, 1)]
    slots, winner = meet(*units)
    assert winner == slots[stronger]


@pytest.mark.parametrize("straight", [0, 1])
def test_unit_that_comes_straight_gets_the_cell(straight):
    units = [(p, (8, 7) if p == straight else (7, 9), 1 if p == straight else 60) for p in (0, 1)]
    slots, winner = meet(*units, text=MEADOW, goal=(8, 8))
    assert winner == slots[straight]


@pytest.mark.parametrize("first", [7, 9])
def test_older_of_two_own_equals_gets_the_cell(first):
    slots, winner = meet((0, (4, first), 60), (0, (4, 16 - first), 60))
    assert winner == slots[0]


@pytest.mark.parametrize("owners", [1, 2])
def test_crowd_that_is_sent_to_one_cell_does_not_overlap(owners):
    game = Skirmish(**CALM)
    luck = np.random.default_rng(5)
    for index, cell in enumerate(luck.permutation(14 * 14)[:20].tolist()):
        kind = t.CAVALRY if index % 3 else t.FOOTMAN
        game.put(index % owners, kind, 1 + cell // 14, 1 + cell % 14)
    units = [unit for player in range(owners) for unit in game.units_of(player)]
    for unit in units:
        game.order(unit, s.MOVE, 8, 8)
    for _ in wait_without_overlap(game, 600):
        pass
    assert game.occupant(8, 8) != s.NO_UNIT
    for unit in units:
        row, column = game.place(unit)
        assert max(abs(row - 8), abs(column - 8)) <= 4
        assert game.get(unit, s.UNIT_ORDER) == s.NO_ORDER


def test_column_in_a_corridor_walks_as_one():
    """A unit does not take the walker before it for an obstacle."""
    game = Skirmish(CORRIDOR)
    column = [game.put(0, t.FOOTMAN, 4, 5 - index) for index in range(4)]
    for index, unit in enumerate(column):
        game.order(unit, s.ADVANCE, 4, 14 - index)
    for index, unit in enumerate(column):
        assert ticks_until(game, unit, (4, 14 - index)) <= 1 + 9 * 11 + 40
    assert game.get(column[0], s.UNIT_CELL) == game.cell(4, 14)
