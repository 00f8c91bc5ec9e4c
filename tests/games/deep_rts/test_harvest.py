"""Harvesting by hand and pumping oil: exact ticks, whole trips, conservation."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from tests.games.deep_rts.skirmish import Skirmish

# A hall at (8, 3) has its edge at column 4; the walk from column 5 to column 9 is 4 tiles.
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
MINE = (8, 10)  # the gold tile beside column 9


def put_worker(game: Skirmish, row: int = 8, column: int = 9, player: int = 0) -> int:
    return game.put(player, t.PEASANT, row, column)


def mining(has_hall: bool = True, row: int = 8, **options) -> tuple[Skirmish, int]:
    """A worker at (row, 9) that is sent to MINE, a hall at (8, 3), an empty store."""
    game = Skirmish(FIELD, **options)
    if has_hall:
        game.put(0, t.TOWN_HALL, 8, 3)
    game.fill_store(0, 0, 0)
    worker = put_worker(game, row)
    game.order(worker, s.HARVEST, *MINE)
    return game, worker


# --- time --------------------------------------------------------------------------------------


@pytest.mark.plain_python
@pytest.mark.parametrize(("preset", "ticks"), [("original", 6), ("thesis", 5), ("drill", 5)])
@pytest.mark.parametrize(
    ("row", "resource"),
    [(8, t.GOLD), (10, t.LUMBER), (11, t.STONE)],
    ids=("gold", "lumber", "stone"),
)
def test_each_unit_of_a_resource_takes_exactly_its_ticks(preset, ticks, row, resource):
    game = Skirmish(FIELD, preset=preset)
    full = game.amount(row, 10)
    worker = put_worker(game, row)
    game.order(worker, s.HARVEST, row, 10)
    game.wait()
    assert game.get(worker, s.UNIT_STATE) == s.GATHERING
    for taken in range(1, 11):
        game.wait(ticks - 1)
        assert game.get(worker, s.UNIT_CARRY) == taken - 1
        game.wait()
        assert game.get(worker, s.UNIT_CARRY, s.UNIT_CARRY_KIND) == (taken, resource)
        assert game.amount(row, 10) == full - taken
        assert game.gathered(0)[resource] == taken
    game.wait(100)
    assert game.get(worker, s.UNIT_CARRY) == 10


@pytest.mark.parametrize("preset", ["thesis", "drill"])
def test_trip_takes_the_sum_of_its_parts(preset):
    """1 to set out, 10 x 5 at the tile, 4 tiles of 11 home; the load is in store at once.

    In the thesis the worker idles then.
    """
    game, worker = mining(preset=preset)
    game.wait(1 + 10 * 5 + 4 * 11 - 1)
    assert game.get(worker, s.UNIT_ORDER) == s.RETURN
    assert game.store(0) == [0, 0, 0, 0]
    game.wait()
    assert game.place(worker) == (8, 5)
    assert game.store(0) == [10, 0, 0, 0]
    assert game.get(worker, s.UNIT_CARRY) == 0
    if preset == "thesis":
        game.wait(300)
        assert game.get(worker, s.UNIT_STATE, s.UNIT_ORDER) == (s.IDLE, s.NO_ORDER)
        assert game.place(worker) == (8, 5)


def test_worker_goes_back_for_more_until_its_order_changes():
    """In `drill`: each further trip takes 50 ticks of work and 2 x 44 of walking."""
    game, worker = mining()
    game.wait(95)
    for trip in range(1, 6):
        assert game.store(0)[t.GOLD] == 10 * trip
        assert game.get(worker, s.UNIT_STATE) == s.WALKING
        game.wait(137)
        assert game.store(0)[t.GOLD] == 10 * trip
        game.wait()


def test_worker_without_a_hall_keeps_its_load():
    game, worker = mining(has_hall=False)
    game.wait(200)
    assert game.get(worker, s.UNIT_ORDER, s.UNIT_CARRY) == (s.NO_ORDER, 10)
    assert game.place(worker) == (8, 9)
    game.put(0, t.TOWN_HALL, 8, 3)
    game.select(worker)
    game.play("go_r8_c4")
    game.wait(60)
    assert game.store(0) == [10, 0, 0, 0]
    assert game.illegal() == [0, 0]


def test_load_goes_to_the_nearest_hall():
    game = Skirmish(FIELD)
    game.put(0, t.TOWN_HALL, 2, 8)
    game.put(0, t.TOWN_HALL, 5, 12)
    worker = put_worker(game)
    game.set(worker, s.UNIT_CARRY, 10)
    game.set(worker, s.UNIT_CARRY_KIND, t.GOLD)
    game.order(worker, s.RETURN)
    game.wait(40)
    row, column = game.place(worker)
    assert max(abs(row - 5), abs(column - 12)) == 2


def test_worker_with_a_new_resource_brings_home_the_old_one_first():
    game, worker = mining(row=9)
    game.wait(1 + 3 * 5)
    game.order(worker, s.HARVEST, 10, 10)
    game.wait(400)
    assert game.gathered(0)[t.GOLD] == game.store(0)[t.GOLD] == 3
    assert game.store(0)[t.LUMBER] > 0


# --- used up -----------------------------------------------------------------------------------


def test_used_up_tile_becomes_grass_and_its_worker_takes_the_next_of_its_kind():
    game, worker = mining(has_hall=False)
    game.set_tile(6, 10, t.GOLD_TILE, 500)
    game.set_amount(*MINE, 3)
    game.wait(1 + 3 * 5)
    assert (game.tile(*MINE), game.amount(*MINE)) == (t.GRASS, 0)
    assert game.get(worker, s.UNIT_CARRY) == 3
    game.wait(11 + 7 * 5)
    assert game.get(worker, s.UNIT_CARRY) == 10
    assert game.amount(6, 10) == 500 - 7
    assert game.get(worker, s.UNIT_GOAL) == game.cell(6, 10)


def test_worker_without_a_tile_of_its_kind_left_brings_home_its_load():
    game, _ = mining()
    game.set_tile(0, 15, t.GRASS)
    game.set_amount(*MINE, 4)
    game.wait(150)
    assert game.store(0)[t.GOLD] == 4


def test_several_workers_may_take_the_last_unit_in_one_tick():
    game, first = mining(has_hall=False, preset="thesis")
    game.set_amount(*MINE, 1)
    workers = [first, put_worker(game, 7, 11, player=1), put_worker(game, 9, 10, player=1)]
    for worker in workers[1:]:
        game.order(worker, s.HARVEST, *MINE)
    game.wait(6)
    assert [game.get(worker, s.UNIT_CARRY) for worker in workers] == [1, 1, 1]
    assert (game.tile(*MINE), game.amount(*MINE)) == (t.GRASS, 0)


def test_worker_that_comes_a_tick_too_late_takes_nothing():
    game, first = mining(has_hall=False, preset="thesis")
    game.set_amount(*MINE, 1)
    second = put_worker(game, 9, 10)
    game.wait()
    game.order(second, s.HARVEST, *MINE)
    game.wait(5)
    assert game.tile(*MINE) == t.GRASS
    game.wait()
    assert [game.get(worker, s.UNIT_CARRY) for worker in (first, second)] == [1, 0]


def test_worker_turned_away_from_a_crowded_tile_finds_another():
    """There are eight places around a tile; the ninth worker goes to the next best tile."""
    game = Skirmish(FIELD)
    for row, column in np.ndindex(3, 3):
        if (row, column) != (1, 1):
            game.order(put_worker(game, 7 + row, 9 + column), s.HARVEST, *MINE)
    late = put_worker(game, 8, 6)
    game.order(late, s.HARVEST, *MINE)
    game.wait(45)
    assert game.get(late, s.UNIT_CARRY) == 0
    game.wait(120)
    assert game.get(late, s.UNIT_CARRY) > 0
    assert game.get(late, s.UNIT_GOAL) != game.cell(*MINE)


@pytest.mark.parametrize(("kind", "is_legal"), [(t.PEASANT, True), (t.FOOTMAN, False)])
def test_only_peasants_can_be_sent_to_harvest(kind, is_legal):
    game = Skirmish(FIELD)
    game.select(game.put(0, kind, 8, 8))
    assert game.is_legal(0, "go_r8_c10") == is_legal
    assert not game.is_legal(0, "go_r13_c12")  # oil comes out of wells


# --- oil -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("amount", [300, 3])
def test_well_pumps_one_oil_every_20_ticks_until_it_is_dry(amount):
    game = Skirmish(FIELD)
    game.put(0, t.PEASANT, 5, 5)
    game.put(0, t.OIL_WELL, 13, 12)
    game.set_amount(13, 12, amount)
    game.wait()
    for pumped in range(1, 8):
        game.wait(19)
        assert game.store(0)[t.OIL] == min(amount, pumped - 1)
        game.wait()
        assert game.store(0)[t.OIL] == game.gathered(0)[t.OIL] == min(amount, pumped)
        assert game.amount(13, 12) == max(0, amount - pumped)
    assert game.tile(13, 12) == t.OIL_TILE


# --- the store -----------------------------------------------------------------------------------


def test_store_holds_a_million_of_each():
    game, worker = mining()
    game.fill_store(0, t.MAX_RESOURCE - 4)
    game.wait(95)
    assert game.store(0)[t.GOLD] == t.MAX_RESOURCE
    assert game.get(worker, s.UNIT_CARRY) == 0


def test_yield_above_one_multiplies_the_load(monkeypatch):
    yields = (0, 0, 0, 0, 0, 1, 3, 1, 1)  # 3 of gold
    preset = dataclasses.replace(t.PRESETS["drill"], tile_yield=yields)
    monkeypatch.setitem(t.PRESETS, "fertile", preset)
    game, worker = mining(has_hall=False, preset="fertile")
    game.wait(1 + 4 * 5)
    assert game.get(worker, s.UNIT_CARRY) == 12
    assert game.amount(*MINE) == 500 - 4
    assert game.gathered(0)[t.GOLD] == 12
    game.wait(50)
    assert game.get(worker, s.UNIT_CARRY) == 12


@pytest.mark.parametrize("amount", [300, 12])
def test_gathered_resources_are_those_that_tiles_lost(amount):
    """If several take the last unit, each has one: at most eight can stand around a tile."""
    game = Skirmish(FIELD)
    luck = np.random.default_rng(amount)
    places = [MINE, (10, 10), (11, 10), (0, 15)]
    for place in places:
        game.set_amount(*place, amount)
    start, before = game.store(0), amounts_of(game)
    for player, column in ((0, 7), (1, 14)):
        game.put(player, t.TOWN_HALL, 8, column)
        for row in (6, 7, 8, 9, 10):
            put_worker(game, row, column + 2 if column == 7 else column - 2, player)
    for _ in range(120):
        player = int(luck.integers(2))
        worker = int(luck.choice(game.units_of(player)[1:]))
        game.order(worker, s.HARVEST, *places[luck.integers(4)])
        game.wait(10)
        lost = before - amounts_of(game)
        num_gone = sum(game.tile(*place) == t.GRASS for place in places)
        gathered = np.sum([game.gathered(player) for player in (0, 1)], axis=0)
        assert 0 <= int((gathered - lost).sum()) <= 7 * num_gone
        for player in (0, 1):
            hands = [0] * t.NUM_RESOURCES
            for unit in game.units_of(player):
                kind, load = game.get(unit, s.UNIT_CARRY_KIND), game.get(unit, s.UNIT_CARRY)
                assert kind != t.NO_RESOURCE or load == 0
                hands[kind] += load
            owned = np.add(hands, game.store(player))
            assert (owned <= np.add(start, game.gathered(player))).all()
    assert lost.sum() > 40
    assert (amount == 12) == (num_gone == 4)


def amounts_of(game: Skirmish) -> np.ndarray:
    """Gold, lumber, stone and oil in the ground."""
    tiles, amounts = game.world.board[s.TILE], game.world.board[s.AMOUNT].astype(int)
    kinds = (t.GOLD_TILE, t.LUMBER_TILE, t.STONE_TILE, t.OIL_TILE)
    return np.array([amounts[tiles == kind].sum() for kind in kinds])


def test_load_of_a_dead_worker_is_lost():
    game, worker = mining(has_hall=False)
    game.put(0, t.PEASANT, 5, 5)
    game.wait(1 + 5 * 5)
    game.kill(worker)
    before = game.store(0)
    game.wait()
    assert not game.is_alive(worker)
    assert game.store(0) == before
