"""Sites: exact ticks and prices, refusals, refunds."""

from __future__ import annotations

import dataclasses

import pytest

from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from tests.games.deep_rts.skirmish import RICH, Skirmish, of, start

HOUSES = pytest.mark.parametrize("kind", [t.TOWN_HALL, t.BARRACKS, t.FARM, t.SMITHY])
OWNERS = pytest.mark.parametrize("seat", [0, 1])


@pytest.fixture(autouse=True)
def _slow(monkeypatch):
    """The preset `slow`: the original's numbers, with the time that building takes."""
    slow = dataclasses.replace(t.PRESETS["original"], has_instant_build=False)
    monkeypatch.setitem(t.PRESETS, "slow", slow)


def build(kind: int, **options) -> tuple[Skirmish, int, int]:
    """A site at (8, 8): the game, its builder, the site."""
    game, worker = start(**options)
    game.make(worker, kind)
    return game, worker, game.units_of(0)[-1]


@pytest.mark.plain_python
@pytest.mark.parametrize(
    ("preset", "kind", "ticks"),
    [
        ("drill", t.TOWN_HALL, 400),
        ("drill", t.BARRACKS, 300),
        ("drill", t.FARM, 150),
        ("drill", t.SMITHY, 300),
        ("slow", t.TOWN_HALL, 600),
        ("slow", t.BARRACKS, 1_000),
        ("slow", t.FARM, 1_000),
    ],
)
def test_building_rises_in_exactly_its_ticks_with_its_builder_inside(preset, kind, ticks):
    game, worker, site = build(kind, preset=preset)
    full = t.PRESETS[preset].health[kind]
    for _ in range(ticks - 2):
        game.wait()
        assert game.get(site, s.UNIT_STATE) == s.RISING
        assert game.get(worker, s.UNIT_STATE) == s.INSIDE
        assert game.occupant(8, 8) == site
        assert game.get(site, s.UNIT_HEALTH) == full // 10
    assert of(game, 0, s.NUM_CREATED + kind) == 0
    game.wait()
    assert game.get(site, s.UNIT_STATE, s.UNIT_HEALTH) == (s.IDLE, full)
    assert game.get(worker, s.UNIT_PARTNER) == game.get(site, s.UNIT_PARTNER) == s.NO_UNIT
    row, column = game.place(worker)
    assert game.occupant(row, column) == worker
    assert max(abs(row - 8), abs(column - 8)) == t.PRESETS[preset].size_tiles[kind] // 2 + 1
    assert of(game, 0, s.NUM_CREATED + kind) == of(game, 0, s.NUM_OWNED + kind) == 1


@pytest.mark.parametrize("preset", ["original", "thesis"])
def test_site_stands_after_one_tick_with_instant_building(preset):
    game, worker, site = build(t.FARM, preset=preset)
    assert game.get(site, s.UNIT_STATE) == game.get(worker, s.UNIT_STATE) == s.IDLE


@HOUSES
def test_site_costs_its_price_and_cancelling_returns_three_quarters(kind):
    game, worker, site = build(kind)
    preset = t.PRESETS["drill"]
    price = (preset.cost_gold[kind], preset.cost_lumber[kind], preset.cost_stone[kind], 0)
    assert game.store(0) == [5_000 - cost for cost in price]
    assert game.illegal() == [0, 0]
    game.wait(20)
    game.select(site)
    game.play("cancel")
    assert game.store(0) == [5_000 - cost + cost * 3 // 4 for cost in price]
    assert not game.is_alive(site)
    assert game.place(worker) == (8, 8)
    assert game.occupant(8, 8) == worker
    assert game.occupant(8, 9) == s.NO_UNIT
    assert of(game, 0, s.NUM_CREATED + kind) == 0
    game.order(worker, s.MOVE, 8, 9)
    game.wait(12)
    assert game.place(worker) == (8, 9)


def test_site_cancelled_in_its_last_tick_is_gone():
    game, worker, site = build(t.FARM)
    game.wait(148)
    game.select(site)
    game.play("cancel")
    assert not game.is_alive(site)
    assert game.occupant(8, 8) == worker
    assert of(game, 0, s.FOOD_MADE) == of(game, 0, s.NUM_CREATED + t.FARM) == 0


def test_destroyed_site_frees_its_builder_and_returns_nothing():
    game, worker, site = build(t.BARRACKS)
    before = game.store(0)
    soldier = game.put(1, t.FOOTMAN, 8, 10)
    game.set(site, s.UNIT_HEALTH, 1)
    game.attack(soldier, site)
    game.wait(2)
    assert not game.is_alive(site)
    assert game.place(worker) == (8, 8)
    assert game.store(0) == before
    assert of(game, 0, s.NUM_OWNED + t.BARRACKS) == 0


def test_damage_to_a_site_stays_when_it_is_finished():
    game, _, site = build(t.FARM)
    game.set(site, s.UNIT_HEALTH, 13)
    game.wait(150)
    assert game.get(site, s.UNIT_HEALTH) == 200 - 7


@pytest.mark.parametrize(
    ("kind", "tile"),
    [
        (t.BARRACKS, t.WALL),
        (t.BARRACKS, t.LAVA),
        (t.BARRACKS, t.WATER),
        (t.BARRACKS, t.GOLD_TILE),
        (t.FARM, t.LAVA),
    ],
)
def test_site_needs_flat_ground(kind, tile):
    game, worker = start()
    place, name = (8, 8) if kind == t.FARM else (7, 9), f"make_{t.UNIT_NAMES[kind]}"
    game.set_tile(*place, tile)
    assert game.is_legal(0, name) is False
    game.select(worker)
    assert game.is_legal(0, name) is False
    game.set_tile(*place, t.DESERT)
    assert game.is_legal(0, name) is True


def test_site_needs_free_ground_within_the_map():
    game, worker = start()
    other, at_edge = game.put(0, t.PEASANT, 9, 9), game.put(0, t.PEASANT, 0, 5)
    for unit in (worker, other, at_edge):
        game.select(unit)
        assert not game.is_legal(0, "make_barracks")
        assert game.is_legal(0, "make_farm")


def test_well_stands_on_oil_beside_its_builder_who_steps_out():
    game, worker = start()
    game.select(worker)
    assert not game.is_legal(0, "make_oil_well")
    game.set_tile(8, 9, t.OIL_TILE, 300)
    game.make(worker, t.OIL_WELL)
    well = game.occupant(8, 9)
    assert game.occupant(8, 8) == s.NO_UNIT
    game.wait(149)
    assert game.get(well, s.UNIT_STATE) != s.RISING
    assert game.occupant(*game.place(worker)) == worker
    game.wait(20 * 5 + 1)
    assert game.store(0)[t.OIL] == 5_000 + 5


def test_builder_of_a_cancelled_well_walks_out_of_the_pool():
    game, worker = start()
    game.set_tile(8, 9, t.OIL_TILE, 300)
    game.make(worker, t.OIL_WELL)
    game.select(game.occupant(8, 9))
    game.play("cancel")
    game.wait()
    assert game.occupant(8, 9) == worker
    game.select(worker)
    game.play("go_r8_c12")
    game.wait(60)
    assert game.place(worker) == (8, 12)
    assert game.occupant(8, 9) == s.NO_UNIT


@OWNERS
def test_site_that_two_players_want_in_one_step_is_refused_to_both(seat):
    game = Skirmish()
    places = [(8, 8), (8, 10)]
    workers = [game.put(p, t.PEASANT, *places[p ^ seat]) for p in (0, 1)]
    for player, worker in enumerate(workers):
        game.fill_store(player, *RICH)
        game.select(worker)
    game.play("make_barracks", "make_barracks")
    assert [game.store(player) for player in (0, 1)] == [list(RICH)] * 2
    assert [len(game.units_of(player)) for player in (0, 1)] == [1, 1]
    assert game.illegal() == [0, 0]
    for worker in workers:
        game.select(worker)
    game.play(*("noop", "make_barracks") if seat else ("make_barracks", "noop"))
    assert game.get(workers[seat], s.UNIT_STATE) == s.INSIDE


@OWNERS
@pytest.mark.parametrize("rallies", [False, True])
def test_order_to_ground_that_becomes_a_site_in_the_same_step_means_the_ground(seat, rallies):
    """In any order of seats: orders are about the board that all of them saw."""
    game = Skirmish()
    builder = game.put(seat, t.PEASANT, 8, 8)
    other = game.put(1 - seat, t.TOWN_HALL if rallies else t.PEASANT, 12, 4)
    for player, unit in ((seat, builder), (1 - seat, other)):
        game.put(player, t.PEASANT, 2, 2 + player)
        game.fill_store(player, *RICH)
        game.select(unit)
    go = game.go(1 - seat, 8, 9)
    assert game.is_legal(1 - seat, go)
    game.play(*(["make_barracks", go] if seat == 0 else [go, "make_barracks"]))
    assert game.get(builder, s.UNIT_STATE) == s.INSIDE
    assert game.illegal() == [0, 0]
    assert game.get(other, s.UNIT_RALLY if rallies else s.UNIT_GOAL) == game.cell(8, 9)
    assert game.get(other, s.UNIT_ORDER) == (s.NO_ORDER if rallies else s.MOVE)
