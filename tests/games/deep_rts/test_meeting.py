"""Walkers that meet: changing places, standing off, crowds and columns without overlap."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from tests.games.deep_rts.skirmish import Skirmish, ticks_until

CORRIDOR = """
...............G
.1..........2...
................
################
................
################
................
................
................
................
................
................
................
................
................
................
"""


def assert_no_overlap(skirmish: Skirmish) -> None:
    places = [skirmish.place(unit) for player in (0, 1) for unit in skirmish.units_of(player)]
    assert len(set(places)) == len(places)
    for player in (0, 1):
        for unit in skirmish.units_of(player):
            assert skirmish.occupant(*skirmish.place(unit)) == unit


@pytest.mark.parametrize(("gap", "delay"), [(1, 0), *product(range(2, 6), (0, 3, 10))])
def test_own_units_that_meet_in_a_corridor_change_places(gap, delay):
    skirmish = Skirmish(CORRIDOR)
    left = skirmish.put(0, t.PEASANT, 4, 4)
    right = skirmish.put(0, t.PEASANT, 4, 4 + gap)
    skirmish.order(left, s.MOVE, 4, 12)
    skirmish.wait(delay)
    skirmish.order(right, s.MOVE, 4, 1)
    for _ in range(300):
        skirmish.wait()
        assert_no_overlap(skirmish)
    assert skirmish.place(left) == (4, 12)
    assert skirmish.place(right) == (4, 1)


def test_enemies_do_not_pass_each_other_in_a_corridor():
    skirmish = Skirmish(CORRIDOR, preset="thesis")
    left = skirmish.put(0, t.PEASANT, 4, 4)
    right = skirmish.put(1, t.PEASANT, 4, 8)
    skirmish.order(left, s.MOVE, 4, 12)
    skirmish.order(right, s.MOVE, 4, 1)
    for _ in range(300):
        skirmish.wait()
        assert_no_overlap(skirmish)
        assert skirmish.place(left)[1] < skirmish.place(right)[1]


def test_a_lot_decides_between_equals_that_are_not_mirror_images():
    skirmish = Skirmish(CORRIDOR, preset="thesis")
    left = skirmish.put(0, t.PEASANT, 4, 7)
    skirmish.put(1, t.PEASANT, 4, 12)
    right = skirmish.put(1, t.PEASANT, 4, 9)
    skirmish.order(left, s.MOVE, 4, 8)
    skirmish.order(right, s.MOVE, 4, 8)
    skirmish.wait(12)
    assert skirmish.occupant(4, 8) in (left, right)


def test_mirror_images_stand_off_before_one_cell():
    skirmish = Skirmish(CORRIDOR, preset="thesis")
    left = skirmish.put(0, t.PEASANT, 4, 7)
    right = skirmish.put(1, t.PEASANT, 4, 9)
    skirmish.order(left, s.MOVE, 4, 8)
    skirmish.order(right, s.MOVE, 4, 8)
    for _ in range(200):
        skirmish.wait()
        assert skirmish.occupant(4, 8) == s.NO_UNIT
        assert skirmish.get(left, s.UNIT_ORDER) == skirmish.get(right, s.UNIT_ORDER)


@pytest.mark.parametrize("stronger", [0, 1])
def test_of_two_that_want_a_cell_the_healthier_gets_it(stronger):
    skirmish = Skirmish(CORRIDOR, preset="thesis")
    units = [skirmish.put(player, t.FOOTMAN, 4, 7 + 2 * player) for player in (0, 1)]
    skirmish.set(units[1 - stronger], s.UNIT_HEALTH, 59)
    for unit in units:
        skirmish.order(unit, s.MOVE, 4, 8)
    skirmish.wait(12)
    assert skirmish.occupant(4, 8) == units[stronger]


@pytest.mark.parametrize("straight", [0, 1])
def test_of_two_that_want_a_cell_the_one_that_comes_straight_gets_it(straight):
    skirmish = Skirmish(preset="thesis")
    places = [(8, 7), (7, 9)]
    units = [skirmish.put(player, t.FOOTMAN, *places[player ^ straight]) for player in (0, 1)]
    skirmish.set(units[straight], s.UNIT_HEALTH, 1)
    for unit in units:
        skirmish.order(unit, s.MOVE, 8, 8)
    skirmish.wait(12)
    assert skirmish.occupant(8, 8) == units[straight]


def test_the_older_of_two_own_equals_gets_the_cell():
    for first in ((4, 7), (4, 9)):
        skirmish = Skirmish(CORRIDOR)
        older = skirmish.put(0, t.FOOTMAN, *first)
        younger = skirmish.put(0, t.FOOTMAN, 4, 16 - first[1])
        for unit in (younger, older):
            skirmish.order(unit, s.MOVE, 4, 8)
        skirmish.wait(12)
        assert skirmish.occupant(4, 8) == older


@pytest.mark.parametrize("owners", [1, 2])
def test_a_crowd_that_is_sent_to_one_cell_does_not_overlap(owners):
    skirmish = Skirmish(preset="thesis")
    luck = np.random.default_rng(5)
    cells = luck.permutation(14 * 14)[:20]
    for index, cell in enumerate(cells.tolist()):
        kind = t.CAVALRY if index % 3 else t.FOOTMAN
        skirmish.put(index % owners, kind, 1 + cell // 14, 1 + cell % 14)
    for player in range(owners):
        for unit in skirmish.units_of(player):
            skirmish.order(unit, s.MOVE, 8, 8)
    for _ in range(600):
        skirmish.wait()
        assert_no_overlap(skirmish)
    assert skirmish.occupant(8, 8) != s.NO_UNIT
    for player in range(owners):
        for unit in skirmish.units_of(player):
            row, column = skirmish.place(unit)
            assert max(abs(row - 8), abs(column - 8)) <= 4
            assert skirmish.get(unit, s.UNIT_ORDER) == s.NO_ORDER


def test_a_column_in_a_corridor_walks_on_as_one():
    """Those behind do not take the one before them for an obstacle."""
    skirmish = Skirmish(CORRIDOR)
    column = [skirmish.put(0, t.FOOTMAN, 4, 5 - index) for index in range(4)]
    for index, unit in enumerate(column):
        skirmish.order(unit, s.ADVANCE, 4, 14 - index)
    for index, unit in enumerate(column):
        assert ticks_until(skirmish, unit, (4, 14 - index)) <= 1 + 9 * 11 + 40
    assert skirmish.get(column[0], s.UNIT_CELL) == skirmish.cell(4, 14)
