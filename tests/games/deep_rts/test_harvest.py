"""Harvesting by hand and pumping oil: exact ticks, whole trips, nothing made of nothing."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from tests.games.deep_rts.skirmish import Skirmish

# A hall at (8, 3) has its edge at column 4; one walks 4 tiles from column 5 to column 9.
FIELD = """
...............G
.1..............
................
................
................
................
................
................
..........G.....
................
..........T.....
..........S.....
................
............OO..
..2.............
................
"""


def put_worker(skirmish: Skirmish, row: int = 8, column: int = 9, player: int = 0) -> int:
    return skirmish.put(player, t.PEASANT, row, column)


# --- time --------------------------------------------------------------------------------------


@pytest.mark.plain_python
@pytest.mark.parametrize(("preset", "ticks"), [("original", 6), ("thesis", 5), ("drill", 5)])
@pytest.mark.parametrize(
    ("row", "resource"),
    [(8, t.GOLD), (10, t.LUMBER), (11, t.STONE)],
    ids=("gold", "lumber", "stone"),
)
def test_each_unit_of_a_resource_takes_exactly_its_ticks(preset, ticks, row, resource):
    skirmish = Skirmish(FIELD, preset=preset)
    full = skirmish.amount(row, 10)
    worker = put_worker(skirmish, row)
    skirmish.order(worker, s.HARVEST, row, 10)
    skirmish.wait()
    assert skirmish.get(worker, s.UNIT_STATE) == s.GATHERING
    for taken in range(1, 11):
        skirmish.wait(ticks - 1)
        assert skirmish.get(worker, s.UNIT_CARRY) == taken - 1
        skirmish.wait()
        assert skirmish.get(worker, s.UNIT_CARRY) == taken
        assert skirmish.get(worker, s.UNIT_CARRY_KIND) == resource
        assert skirmish.amount(row, 10) == full - taken
        assert skirmish.gathered(0)[resource] == taken
    skirmish.wait(100)
    assert skirmish.get(worker, s.UNIT_CARRY) == 10


@pytest.mark.parametrize("preset", ["thesis", "drill"])
def test_a_trip_takes_the_sum_of_its_parts(preset):
    """1 to set out, 10 x 5 at the tile, 4 tiles of 11 home; the load is in store at once."""
    skirmish = Skirmish(FIELD, preset=preset)
    skirmish.put(0, t.TOWN_HALL, 8, 3)
    skirmish.fill_store(0, 0, 0)
    worker = put_worker(skirmish)
    skirmish.order(worker, s.HARVEST, 8, 10)
    skirmish.wait(1 + 10 * 5 + 4 * 11 - 1)
    assert skirmish.get(worker, s.UNIT_ORDER) == s.RETURN
    assert skirmish.store(0) == [0, 0, 0, 0]
    skirmish.wait()
    assert skirmish.place(worker) == (8, 5)
    assert skirmish.store(0) == [10, 0, 0, 0]
    assert skirmish.get(worker, s.UNIT_CARRY) == 0


def test_a_worker_goes_back_for_more_until_told_otherwise():
    """In `drill`: each further trip takes 50 ticks of work and 2 x 44 of walking."""
    skirmish = Skirmish(FIELD)
    skirmish.put(0, t.TOWN_HALL, 8, 3)
    skirmish.fill_store(0, 0, 0)
    worker = put_worker(skirmish)
    skirmish.order(worker, s.HARVEST, 8, 10)
    skirmish.wait(95)
    for trip in range(1, 6):
        assert skirmish.store(0)[t.GOLD] == 10 * trip
        assert skirmish.get(worker, s.UNIT_STATE) == s.WALKING
        skirmish.wait(137)
        assert skirmish.store(0)[t.GOLD] == 10 * trip
        skirmish.wait()


def test_in_the_thesis_a_worker_idles_after_its_trip():
    skirmish = Skirmish(FIELD, preset="thesis")
    skirmish.put(0, t.TOWN_HALL, 8, 3)
    skirmish.fill_store(0, 0, 0)
    worker = put_worker(skirmish)
    skirmish.order(worker, s.HARVEST, 8, 10)
    skirmish.wait(400)
    assert skirmish.store(0)[t.GOLD] == 10
    assert skirmish.get(worker, s.UNIT_ORDER) == s.NO_ORDER
    assert skirmish.get(worker, s.UNIT_STATE) == s.IDLE
    assert skirmish.place(worker) == (8, 5)


def test_without_a_hall_a_worker_keeps_its_load():
    skirmish = Skirmish(FIELD)
    skirmish.fill_store(0, 0, 0)
    worker = put_worker(skirmish)
    skirmish.order(worker, s.HARVEST, 8, 10)
    skirmish.wait(200)
    assert skirmish.get(worker, s.UNIT_ORDER) == s.NO_ORDER
    assert skirmish.get(worker, s.UNIT_CARRY) == 10
    assert skirmish.place(worker) == (8, 9)
    skirmish.put(0, t.TOWN_HALL, 8, 3)
    skirmish.select(worker)
    skirmish.play("go_r8_c4")
    skirmish.wait(60)
    assert skirmish.store(0) == [10, 0, 0, 0]
    assert skirmish.illegal() == [0, 0]


def test_a_load_goes_to_the_nearest_finished_hall():
    skirmish = Skirmish(FIELD)
    skirmish.put(0, t.TOWN_HALL, 2, 8)
    near = skirmish.put(0, t.TOWN_HALL, 5, 12)
    worker = put_worker(skirmish)
    skirmish.set(worker, s.UNIT_CARRY, 10)
    skirmish.set(worker, s.UNIT_CARRY_KIND, t.GOLD)
    skirmish.order(worker, s.RETURN)
    skirmish.wait(40)
    row, column = skirmish.place(worker)
    hall_row, hall_column = skirmish.place(near)
    assert max(abs(row - hall_row), abs(column - hall_column)) == 2


def test_a_worker_that_changes_its_resource_brings_home_first_what_it_has():
    skirmish = Skirmish(FIELD)
    skirmish.put(0, t.TOWN_HALL, 8, 3)
    skirmish.fill_store(0, 0, 0)
    worker = put_worker(skirmish, 9)
    skirmish.order(worker, s.HARVEST, 8, 10)
    skirmish.wait(1 + 3 * 5)
    skirmish.order(worker, s.HARVEST, 10, 10)
    skirmish.wait(400)
    assert skirmish.gathered(0)[:2] == [3, skirmish.gathered(0)[t.LUMBER]]
    assert skirmish.store(0)[t.GOLD] == 3
    assert skirmish.store(0)[t.LUMBER] > 0


# --- used up -----------------------------------------------------------------------------------


def test_a_used_up_tile_becomes_grass_and_its_worker_takes_the_next_of_its_kind():
    skirmish = Skirmish(FIELD)
    skirmish.world.board[s.TILE, skirmish.cell(6, 10)] = t.GOLD_TILE
    skirmish.set_amount(6, 10, 500)
    skirmish.set_amount(8, 10, 3)
    worker = put_worker(skirmish)
    skirmish.order(worker, s.HARVEST, 8, 10)
    skirmish.wait(1 + 3 * 5)
    assert skirmish.tile(8, 10) == t.GRASS
    assert skirmish.amount(8, 10) == 0
    assert skirmish.get(worker, s.UNIT_CARRY) == 3
    skirmish.wait(11 + 7 * 5)
    assert skirmish.get(worker, s.UNIT_CARRY) == 10
    assert skirmish.amount(6, 10) == 500 - 7
    assert skirmish.get(worker, s.UNIT_GOAL) == skirmish.cell(6, 10)


def test_a_worker_without_any_tile_of_its_kind_left_brings_home_what_it_has():
    skirmish = Skirmish(FIELD)
    skirmish.put(0, t.TOWN_HALL, 8, 3)
    skirmish.fill_store(0, 0, 0)
    skirmish.world.board[s.TILE, skirmish.cell(0, 15)] = t.GRASS
    skirmish.set_amount(0, 15, 0)
    skirmish.set_amount(8, 10, 4)
    worker = put_worker(skirmish)
    skirmish.order(worker, s.HARVEST, 8, 10)
    skirmish.wait(150)
    assert skirmish.store(0)[t.GOLD] == 4


def test_several_workers_may_take_the_last_unit_in_one_tick():
    skirmish = Skirmish(FIELD, preset="thesis")
    skirmish.set_amount(8, 10, 1)
    workers = [
        put_worker(skirmish, *place, player=player)
        for place, player in (((7, 9), 0), ((7, 11), 1), ((9, 10), 1))
    ]
    for worker in workers:
        skirmish.order(worker, s.HARVEST, 8, 10)
    skirmish.wait(6)
    assert [skirmish.get(worker, s.UNIT_CARRY) for worker in workers] == [1, 1, 1]
    assert skirmish.tile(8, 10) == t.GRASS
    assert skirmish.amount(8, 10) == 0


def test_a_worker_that_comes_a_tick_too_late_takes_nothing():
    skirmish = Skirmish(FIELD, preset="thesis")
    skirmish.set_amount(8, 10, 1)
    first, second = put_worker(skirmish), put_worker(skirmish, 9, 10)
    skirmish.order(first, s.HARVEST, 8, 10)
    skirmish.wait()
    skirmish.order(second, s.HARVEST, 8, 10)
    skirmish.wait(5)
    assert skirmish.tile(8, 10) == t.GRASS
    skirmish.wait()
    assert skirmish.get(first, s.UNIT_CARRY) == 1
    assert skirmish.get(second, s.UNIT_CARRY) == 0


def test_a_worker_turned_away_from_a_full_tile_finds_another():
    """Eight places around a tile; the ninth worker goes to the tile that is next best."""
    skirmish = Skirmish(FIELD)
    for row in (7, 8, 9):
        for column in (9, 10, 11):
            if (row, column) != (8, 10):
                skirmish.order(put_worker(skirmish, row, column), s.HARVEST, 8, 10)
    late = put_worker(skirmish, 8, 6)
    skirmish.order(late, s.HARVEST, 8, 10)
    skirmish.wait(45)
    assert skirmish.get(late, s.UNIT_CARRY) == 0
    skirmish.wait(120)
    assert skirmish.get(late, s.UNIT_CARRY) > 0
    assert skirmish.get(late, s.UNIT_GOAL) != skirmish.cell(8, 10)


def test_only_peasants_can_be_sent_to_harvest():
    skirmish = Skirmish(FIELD)
    for kind, is_legal in ((t.PEASANT, True), (t.FOOTMAN, False)):
        skirmish.select(skirmish.put(0, kind, 8, 8))
        assert skirmish.is_legal(0, "go_r8_c10") == is_legal
        assert not skirmish.is_legal(0, "go_r13_c12")  # oil comes out of wells
        skirmish.wait()
        skirmish.order(skirmish.units_of(0)[-1], 1, 5, 5)
        skirmish.wait(60)


# --- oil -----------------------------------------------------------------------------------------


def test_a_well_pumps_one_oil_every_20_ticks():
    skirmish = Skirmish(FIELD)
    skirmish.put(0, t.PEASANT, 5, 5)
    skirmish.put(0, t.OIL_WELL, 13, 12)
    skirmish.wait()
    for taken in range(1, 8):
        skirmish.wait(19)
        assert skirmish.store(0)[t.OIL] == taken - 1
        skirmish.wait()
        assert skirmish.store(0)[t.OIL] == skirmish.gathered(0)[t.OIL] == taken
        assert skirmish.amount(13, 12) == 300 - taken


def test_a_well_runs_dry():
    skirmish = Skirmish(FIELD)
    skirmish.put(0, t.PEASANT, 5, 5)
    skirmish.put(0, t.OIL_WELL, 13, 12)
    skirmish.set_amount(13, 12, 3)
    skirmish.wait(200)
    assert skirmish.store(0)[t.OIL] == 3
    assert skirmish.amount(13, 12) == 0
    assert skirmish.tile(13, 12) == t.OIL_TILE


# --- the store -----------------------------------------------------------------------------------


def test_a_store_holds_a_million_of_each():
    skirmish = Skirmish(FIELD)
    skirmish.put(0, t.TOWN_HALL, 8, 3)
    skirmish.fill_store(0, t.MAX_RESOURCE - 4)
    worker = put_worker(skirmish)
    skirmish.order(worker, s.HARVEST, 8, 10)
    skirmish.wait(95)
    assert skirmish.store(0)[t.GOLD] == t.MAX_RESOURCE
    assert skirmish.get(worker, s.UNIT_CARRY) == 0


def test_a_yield_above_one_multiplies_what_is_taken(monkeypatch):
    yields = [0] * 9
    yields[t.GOLD_TILE] = 3
    yields[t.LUMBER_TILE] = yields[t.STONE_TILE] = yields[t.OIL_TILE] = 1
    preset = dataclasses.replace(t.PRESETS["drill"], tile_yield=tuple(yields))
    monkeypatch.setitem(t.PRESETS, "fertile", preset)
    skirmish = Skirmish(FIELD, preset="fertile")
    worker = put_worker(skirmish)
    skirmish.order(worker, s.HARVEST, 8, 10)
    skirmish.wait(1 + 4 * 5)
    assert skirmish.get(worker, s.UNIT_CARRY) == 12
    assert skirmish.amount(8, 10) == 500 - 4
    assert skirmish.gathered(0)[t.GOLD] == 12
    skirmish.wait(50)
    assert skirmish.get(worker, s.UNIT_CARRY) == 12


@pytest.mark.parametrize("amount", [300, 12])
def test_what_is_gathered_is_what_the_tiles_have_lost(amount):
    """Where several take the last unit, each of them has one: at most eight can stand around."""
    skirmish = Skirmish(FIELD)
    luck = np.random.default_rng(amount)
    places = [(8, 10), (10, 10), (11, 10), (0, 15)]
    for place in places:
        skirmish.set_amount(*place, amount)
    start, before = skirmish.store(0), amounts_of(skirmish)
    for player, column in ((0, 7), (1, 14)):
        skirmish.put(player, t.TOWN_HALL, 8, column)
        for row in (6, 7, 8, 9, 10):
            put_worker(skirmish, row, column + 2 if column == 7 else column - 2, player)
    for _ in range(120):
        player = int(luck.integers(2))
        worker = int(luck.choice(skirmish.units_of(player)[1:]))
        place = places[luck.integers(4)]
        skirmish.order(worker, s.HARVEST, *place)
        skirmish.wait(10)
        lost = before - amounts_of(skirmish)
        gathered = np.sum([skirmish.gathered(player) for player in (0, 1)], axis=0)
        num_gone = sum(skirmish.tile(*place) == t.GRASS for place in places)
        surplus = int((gathered - lost).sum())
        assert 0 <= surplus <= 7 * num_gone
        for player in (0, 1):
            assert_nothing_is_lost(skirmish, player, start)
    assert lost.sum() > 40
    assert (amount == 12) == (num_gone == 4)


def amounts_of(skirmish: Skirmish) -> np.ndarray:
    tiles, amounts = skirmish.world.board[0], skirmish.world.board[1].astype(int)
    kinds = (t.GOLD_TILE, t.LUMBER_TILE, t.STONE_TILE, t.OIL_TILE)
    return np.array([amounts[tiles == kind].sum() for kind in kinds])


def assert_nothing_is_lost(skirmish: Skirmish, player: int, start: list[int]) -> None:
    """In hands and in store there is at most what was there at the start and was gathered."""
    hands = [0] * t.NUM_RESOURCES
    for unit in skirmish.units_of(player):
        kind = skirmish.get(unit, s.UNIT_CARRY_KIND)
        assert (kind != t.NO_RESOURCE) or skirmish.get(unit, s.UNIT_CARRY) == 0
        hands[kind] += skirmish.get(unit, s.UNIT_CARRY)
    for resource in range(t.NUM_RESOURCES):
        has = hands[resource] + skirmish.store(player)[resource]
        assert has <= start[resource] + skirmish.gathered(player)[resource]


def test_a_worker_that_dies_takes_its_load_with_it():
    skirmish = Skirmish(FIELD)
    skirmish.put(0, t.PEASANT, 5, 5)
    worker = put_worker(skirmish)
    skirmish.order(worker, s.HARVEST, 8, 10)
    skirmish.wait(1 + 5 * 5)
    skirmish.set(worker, s.UNIT_HEALTH, 0)
    skirmish.world.clock[8] += 1  # NUM_FALLEN
    before = skirmish.store(0)
    skirmish.wait()
    assert not skirmish.is_alive(worker)
    assert skirmish.store(0) == before
