"""Sites: exact ticks and prices, what is refused, what comes back."""

from __future__ import annotations

import dataclasses

import pytest

from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from tests.games.deep_rts.skirmish import RICH, Skirmish, of, start

BLADES_PRODUCT, PLATES_PRODUCT = t.FIRST_UPGRADE + t.BLADES, t.FIRST_UPGRADE + t.PLATES


@pytest.fixture
def slow(monkeypatch) -> str:
    """The original's numbers, with the time that building takes."""
    monkeypatch.setitem(
        t.PRESETS, "slow", dataclasses.replace(t.PRESETS["original"], has_instant_build=False)
    )
    return "slow"


# --- sites ---------------------------------------------------------------------------------------


@pytest.mark.plain_python
@pytest.mark.parametrize(
    ("kind", "ticks"), [(t.TOWN_HALL, 400), (t.BARRACKS, 300), (t.FARM, 150), (t.SMITHY, 300)]
)
def test_a_building_rises_in_exactly_its_ticks_with_its_builder_inside(kind, ticks):
    skirmish, worker = start()
    skirmish.make(worker, kind)
    site = skirmish.units_of(0)[-1]
    full = t.PRESETS["drill"].health[kind]
    for _ in range(ticks - 2):
        skirmish.wait()
        assert skirmish.get(site, s.UNIT_STATE) == s.RISING
        assert skirmish.get(worker, s.UNIT_STATE) == s.INSIDE
        assert skirmish.occupant(8, 8) == site
        assert skirmish.get(site, s.UNIT_HEALTH) == full // 10
    assert of(skirmish, 0, s.NUM_CREATED + kind) == 0
    skirmish.wait()
    assert skirmish.get(site, s.UNIT_STATE) == s.IDLE
    assert skirmish.get(site, s.UNIT_HEALTH) == full
    assert skirmish.get(worker, s.UNIT_PARTNER) == skirmish.get(site, s.UNIT_PARTNER) == s.NO_UNIT
    assert skirmish.occupant(*skirmish.place(worker)) == worker
    row, column = skirmish.place(worker)
    assert max(abs(row - 8), abs(column - 8)) == t.PRESETS["drill"].size_tiles[kind] // 2 + 1
    assert of(skirmish, 0, s.NUM_CREATED + kind) == of(skirmish, 0, s.NUM_OWNED + kind) == 1


@pytest.mark.parametrize(
    ("kind", "ticks"), [(t.TOWN_HALL, 600), (t.BARRACKS, 1_000), (t.FARM, 1_000)]
)
def test_the_original_takes_its_time(slow, kind, ticks):
    skirmish, worker = start(preset=slow)
    skirmish.make(worker, kind)
    site = skirmish.units_of(0)[-1]
    skirmish.wait(ticks - 2)
    assert skirmish.get(site, s.UNIT_STATE) == s.RISING
    skirmish.wait()
    assert skirmish.get(site, s.UNIT_STATE) == s.IDLE


@pytest.mark.parametrize("preset", ["original", "thesis"])
def test_with_instant_building_a_site_stands_after_its_tick(preset):
    skirmish, worker = start(preset=preset)
    skirmish.make(worker, t.FARM)
    assert skirmish.get(skirmish.units_of(0)[-1], s.UNIT_STATE) == s.IDLE
    assert skirmish.get(worker, s.UNIT_STATE) == s.IDLE


@pytest.mark.parametrize("kind", [t.TOWN_HALL, t.BARRACKS, t.FARM, t.SMITHY])
def test_a_site_costs_its_price_at_once(kind):
    skirmish, worker = start()
    preset = t.PRESETS["drill"]
    skirmish.make(worker, kind)
    price = (preset.cost_gold[kind], preset.cost_lumber[kind], preset.cost_stone[kind], 0)
    assert skirmish.store(0) == [5_000 - cost for cost in price]
    assert skirmish.illegal() == [0, 0]


@pytest.mark.parametrize("kind", [t.TOWN_HALL, t.BARRACKS, t.FARM, t.SMITHY])
def test_a_site_that_is_given_up_pays_back_three_quarters_and_frees_its_builder(kind):
    skirmish, worker = start()
    preset = t.PRESETS["drill"]
    skirmish.make(worker, kind)
    site = skirmish.units_of(0)[-1]
    skirmish.wait(20)
    skirmish.select(site)
    skirmish.play("cancel")
    price = (preset.cost_gold[kind], preset.cost_lumber[kind], preset.cost_stone[kind], 0)
    assert skirmish.store(0) == [5_000 - cost + cost * 3 // 4 for cost in price]
    assert not skirmish.is_alive(site)
    assert skirmish.place(worker) == (8, 8)
    assert skirmish.occupant(8, 8) == worker
    assert skirmish.occupant(8, 9) == s.NO_UNIT
    assert of(skirmish, 0, s.NUM_CREATED + kind) == 0
    skirmish.order(worker, s.MOVE, 8, 9)
    skirmish.wait(12)
    assert skirmish.place(worker) == (8, 9)


def test_a_site_that_is_given_up_as_it_is_finished_is_gone():
    skirmish, worker = start()
    skirmish.make(worker, t.FARM)
    site = skirmish.units_of(0)[-1]
    skirmish.wait(148)
    skirmish.select(site)
    skirmish.play("cancel")
    assert not skirmish.is_alive(site)
    assert skirmish.occupant(8, 8) == worker
    assert of(skirmish, 0, s.FOOD_MADE) == of(skirmish, 0, s.NUM_CREATED + t.FARM) == 0


def test_a_site_that_is_destroyed_frees_its_builder_and_pays_nothing():
    skirmish, worker = start()
    skirmish.make(worker, t.BARRACKS)
    site, before = skirmish.units_of(0)[-1], skirmish.store(0)
    soldier = skirmish.put(1, t.FOOTMAN, 8, 10)
    skirmish.set(site, s.UNIT_HEALTH, 1)
    skirmish.attack(soldier, site)
    skirmish.wait(2)
    assert not skirmish.is_alive(site)
    assert skirmish.place(worker) == (8, 8)
    assert skirmish.store(0) == before
    assert of(skirmish, 0, s.NUM_OWNED + t.BARRACKS) == 0


def test_what_a_site_has_lost_it_lacks_when_it_stands():
    skirmish, worker = start()
    skirmish.make(worker, t.FARM)
    site = skirmish.units_of(0)[-1]
    skirmish.set(site, s.UNIT_HEALTH, 13)
    skirmish.wait(150)
    assert skirmish.get(site, s.UNIT_HEALTH) == 200 - 7


@pytest.mark.parametrize(
    ("kind", "tile"),
    [(t.BARRACKS, "#"), (t.BARRACKS, "^"), (t.BARRACKS, "~"), (t.BARRACKS, "G"), (t.FARM, "^")],
)
def test_a_site_needs_flat_ground(kind, tile):
    skirmish, worker = start()
    place = (8, 8) if kind == t.FARM else (7, 9)
    skirmish.world.board[s.TILE, skirmish.cell(*place)] = ".,^#~TGSO".index(tile)
    assert skirmish.is_legal(0, f"make_{t.UNIT_NAMES[kind]}") is False
    skirmish.select(worker)
    assert skirmish.is_legal(0, f"make_{t.UNIT_NAMES[kind]}") is False
    skirmish.world.board[s.TILE, skirmish.cell(*place)] = 1
    assert skirmish.is_legal(0, f"make_{t.UNIT_NAMES[kind]}") is True


def test_a_site_needs_ground_without_others_and_within_the_map():
    skirmish, worker = start()
    skirmish.select(worker)
    other = skirmish.put(0, t.PEASANT, 9, 9)
    assert not skirmish.is_legal(0, "make_barracks")
    assert skirmish.is_legal(0, "make_farm")
    skirmish.select(other)
    skirmish.put(0, t.PEASANT, 0, 5)
    skirmish.select(skirmish.units_of(0)[-1])
    assert not skirmish.is_legal(0, "make_barracks")
    assert skirmish.is_legal(0, "make_farm")


def test_a_well_stands_on_oil_beside_its_builder_who_steps_out_again():
    skirmish, worker = start()
    skirmish.select(worker)
    assert not skirmish.is_legal(0, "make_oil_well")
    oil = skirmish.cell(8, 9)
    skirmish.world.board[s.TILE, oil] = t.OIL_TILE
    skirmish.world.board[s.AMOUNT, oil] = 300
    skirmish.make(worker, t.OIL_WELL)
    well = skirmish.occupant(8, 9)
    assert skirmish.occupant(8, 8) == s.NO_UNIT
    skirmish.wait(149)
    assert skirmish.get(well, s.UNIT_STATE) != s.RISING
    assert skirmish.occupant(*skirmish.place(worker)) == worker
    skirmish.wait(20 * 5 + 1)
    assert skirmish.store(0)[3] == 5_000 + 5


def test_the_builder_of_a_well_that_is_given_up_walks_out_of_the_pool():
    skirmish, worker = start()
    oil = skirmish.cell(8, 9)
    skirmish.world.board[s.TILE, oil] = t.OIL_TILE
    skirmish.world.board[s.AMOUNT, oil] = 300
    skirmish.make(worker, t.OIL_WELL)
    skirmish.select(skirmish.occupant(8, 9))
    skirmish.play("cancel")
    skirmish.wait()
    assert skirmish.occupant(8, 9) == worker
    skirmish.select(worker)
    skirmish.play("go_r8_c12")
    skirmish.wait(60)
    assert skirmish.place(worker) == (8, 12)
    assert skirmish.occupant(8, 9) == s.NO_UNIT


@pytest.mark.parametrize("seat", [0, 1])
def test_a_site_that_two_players_want_in_one_decision_is_refused_to_both(seat):
    skirmish = Skirmish()
    places = [(8, 8), (8, 10)]
    workers = [skirmish.put(p, t.PEASANT, *places[p ^ seat]) for p in (0, 1)]
    for player, worker in enumerate(workers):
        skirmish.fill_store(player, *RICH)
        skirmish.select(worker)
    skirmish.play("make_barracks", "make_barracks")
    assert [skirmish.store(player) for player in (0, 1)] == [list(RICH)] * 2
    assert [len(skirmish.units_of(player)) for player in (0, 1)] == [1, 1]
    assert skirmish.illegal() == [0, 0]
    for worker in workers:
        skirmish.select(worker)
    skirmish.play(*("noop", "make_barracks") if seat else ("make_barracks", "noop"))
    assert skirmish.get(workers[seat], s.UNIT_STATE) == s.INSIDE


@pytest.mark.parametrize("seat", [0, 1])
def test_an_order_at_ground_that_becomes_a_site_in_the_same_decision_means_the_ground(seat):
    """Whoever sits first: the orders of all seats are about what all of them saw."""
    skirmish = Skirmish()
    builder = skirmish.put(seat, t.PEASANT, 8, 8)
    walker = skirmish.put(1 - seat, t.PEASANT, 8, 12)
    for player in (0, 1):
        skirmish.fill_store(player, *RICH)
    skirmish.select(builder)
    skirmish.select(walker)
    go = skirmish.go(1 - seat, 8, 9)
    actions = ["make_barracks", go] if seat == 0 else [go, "make_barracks"]
    skirmish.play(*actions)
    assert skirmish.get(builder, s.UNIT_STATE) == s.INSIDE
    assert skirmish.get(walker, s.UNIT_ORDER) == s.MOVE
    assert skirmish.get(walker, s.UNIT_GOAL) == skirmish.cell(8, 9)
    assert skirmish.illegal() == [0, 0]


@pytest.mark.parametrize("seat", [0, 1])
def test_a_rally_point_on_ground_that_becomes_a_site_in_the_same_decision_is_legal(seat):
    skirmish = Skirmish()
    builder = skirmish.put(seat, t.PEASANT, 8, 8)
    skirmish.put(1 - seat, t.PEASANT, 2, 2)
    hall = skirmish.put(1 - seat, t.TOWN_HALL, 12, 4)
    skirmish.fill_store(seat, *RICH)
    skirmish.select(builder)
    skirmish.select(hall)
    go = skirmish.go(1 - seat, 8, 9)
    assert skirmish.is_legal(1 - seat, go)
    skirmish.play(*(["make_barracks", go] if seat == 0 else [go, "make_barracks"]))
    assert skirmish.illegal() == [0, 0]
