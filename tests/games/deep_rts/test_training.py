"""Training, food, limits, upgrades and the cursor: exact ticks and prices."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from tests.games.deep_rts.skirmish import Skirmish, feed, of, start

BLADES_PRODUCT, PLATES_PRODUCT = t.FIRST_UPGRADE + t.BLADES, t.FIRST_UPGRADE + t.PLATES


def own(kind: int, row: int = 4, column: int = 4, **options) -> tuple[Skirmish, int]:
    """A rich and fed player 0 with a peasant and a building."""
    game, _ = start(**options)
    feed(game, 0)
    return game, game.put(0, kind, row, column)


# --- training ------------------------------------------------------------------------------------


@pytest.mark.plain_python
@pytest.mark.parametrize(
    ("building", "kind", "ticks"),
    [
        (t.TOWN_HALL, t.PEASANT, 120),
        (t.BARRACKS, t.FOOTMAN, 150),
        (t.BARRACKS, t.ARCHER, 150),
        (t.BARRACKS, t.CAVALRY, 200),
    ],
)
def test_training_takes_exactly_its_ticks_and_its_price(building, kind, ticks):
    game, house = own(building)
    game.make(house, kind)
    preset = t.PRESETS["drill"]
    price = (preset.cost_gold[kind], preset.cost_lumber[kind], 0, preset.cost_oil[kind])
    assert game.store(0) == [5_000 - cost for cost in price]
    assert of(game, 0, s.FOOD_USED) == preset.food_consumed[kind]
    game.wait(ticks - 2)
    assert of(game, 0, s.NUM_OWNED + kind) == (kind == t.PEASANT)
    assert game.get(house, s.UNIT_STATE) == s.TRAINING
    game.wait()
    assert of(game, 0, s.NUM_CREATED + kind) == 1
    row, column = game.place(game.units_of(0)[-1])
    assert max(abs(row - 4), abs(column - 4)) == 2
    assert of(game, 0, s.FOOD_USED) == preset.food_consumed[kind]


def test_queue_holds_five_products_which_are_made_one_after_another():
    game, house = own(t.BARRACKS)
    kinds = [t.FOOTMAN, t.ARCHER, t.FOOTMAN, t.ARCHER, t.FOOTMAN]
    for kind in kinds:
        game.make(house, kind)
    assert game.queue(house) == kinds
    game.select(house)
    assert not game.is_legal(0, "make_footman")
    game.make(house, t.FOOTMAN)
    assert game.queue(house) == kinds
    assert game.illegal() == [1, 0]
    game.wait(149 - 5)
    for done in range(1, 6):
        assert game.queue(house) == kinds[done:]
        game.wait(149)
        assert game.queue(house) == kinds[done:]
        game.wait()
    assert of(game, 0, s.NUM_CREATED + t.FOOTMAN) == 3
    assert of(game, 0, s.NUM_CREATED + t.ARCHER) == 2


def test_cancelling_returns_the_whole_price_of_the_last_in_the_queue():
    game, house = own(t.BARRACKS)
    game.make(house, t.FOOTMAN)
    game.make(house, t.CAVALRY)
    assert of(game, 0, s.FOOD_USED) == 3
    for queue, gold, oil, food in (([t.FOOTMAN], 4_920, 5_000, 1), ([], 5_000, 5_000, 0)):
        game.select(house)
        game.play("cancel")
        assert game.queue(house) == queue
        assert game.store(0) == [gold, 5_000, 5_000, oil]
        assert of(game, 0, s.FOOD_USED) == food
    game.wait(300)
    assert game.get(house, s.UNIT_STATE) == s.IDLE
    assert of(game, 0, s.NUM_CREATED + t.FOOTMAN) == 0
    game.select(house)
    assert not game.is_legal(0, "cancel")


def test_cancelling_the_second_does_not_delay_the_first():
    game, house = own(t.BARRACKS)
    game.make(house, t.FOOTMAN)
    game.make(house, t.FOOTMAN)
    game.wait(50)
    game.select(house)
    game.play("cancel")
    game.wait(149 - 52)
    assert of(game, 0, s.NUM_CREATED + t.FOOTMAN) == 1


@pytest.mark.parametrize("goal", [(10, 10), (0, 15)])
def test_new_unit_goes_to_the_rally_point(goal):
    """To open ground, or to the gold in the corner, where a worker harvests."""
    game, hall = own(t.TOWN_HALL)
    game.select(hall)
    game.play(f"go_r{goal[0]}_c{goal[1]}")
    game.make(hall, t.PEASANT)
    game.wait(119 + 150)
    unit = game.units_of(0)[-1]
    if goal == (10, 10):
        assert game.place(unit) == goal
        assert game.get(unit, s.UNIT_ORDER) == s.NO_ORDER
    else:
        assert sum(game.gathered(0)) > 0


def test_unit_without_exit_waits_inside_until_there_is_one():
    game, hall = own(t.TOWN_HALL, 8, 4)
    for row, column in np.ndindex(16, 11):
        if game.occupant(row, column) == s.NO_UNIT:
            game.set_tile(row, column, t.WALL)
    game.make(hall, t.PEASANT)
    game.wait(130)
    assert game.queue(hall) == [t.PEASANT]
    assert of(game, 0, s.NUM_OWNED + t.PEASANT) == 1
    game.set_tile(6, 4, t.GRASS)
    game.wait(5)
    assert game.queue(hall) == []
    assert game.place(game.units_of(0)[-1]) == (6, 4)


def test_unit_does_not_leave_onto_lava():
    game, hall = own(t.TOWN_HALL)
    for row, column in np.ndindex(5, 5):
        game.set_tile(2 + row, 2 + column, t.LAVA)
    game.make(hall, t.PEASANT)
    game.wait(119)
    row, column = game.place(game.units_of(0)[-1])
    assert max(abs(row - 4), abs(column - 4)) == 3


# --- limits --------------------------------------------------------------------------------------


def test_farm_makes_food_while_it_stands():
    game, worker = start()
    game.make(worker, t.FARM)
    game.wait(148)
    assert of(game, 0, s.FOOD_MADE) == 0
    game.wait()
    assert of(game, 0, s.FOOD_MADE) == 5
    game.kill(game.occupant(8, 8))
    game.wait()
    assert of(game, 0, s.FOOD_MADE) == 0


def test_training_needs_food():
    game, _ = start()
    hall, house = game.put(0, t.TOWN_HALL, 4, 4), game.put(0, t.BARRACKS, 12, 4)
    feed(game, 0, 3)
    for _ in range(2):
        game.make(hall, t.PEASANT)
    game.select(house)
    assert game.is_legal(0, "make_footman")
    assert not game.is_legal(0, "make_cavalry")  # consumes 2
    game.make(house, t.FOOTMAN)
    game.select(house)
    assert not game.is_legal(0, "make_footman")
    assert of(game, 0, s.FOOD_USED) == 3


def test_food_of_dead_and_queued_units_is_free_again():
    game, house = own(t.BARRACKS, 12, 4)
    game.make(house, t.CAVALRY)
    game.wait(199)
    cavalry = game.units_of(0)[-1]
    for _ in range(3):
        game.make(house, t.CAVALRY)
    assert of(game, 0, s.FOOD_USED) == 8
    for unit, food in ((cavalry, 6), (house, 0)):
        game.kill(unit)
        game.wait()
        assert of(game, 0, s.FOOD_USED) == food


def test_food_never_exceeds_its_limit(monkeypatch):
    preset = dataclasses.replace(t.PRESETS["drill"], food_limit=7, start_food=1)
    monkeypatch.setitem(t.PRESETS, "poor", preset)
    game, hall = own(t.TOWN_HALL, preset="poor")
    house = game.put(0, t.BARRACKS, 12, 4)
    for building, kind in [(hall, t.PEASANT)] * 5 + [(house, t.FOOTMAN)] * 3:
        game.make(building, kind)
    assert of(game, 0, s.FOOD_USED) == 7
    assert game.illegal() == [1, 0]


def test_full_roster_takes_neither_site_nor_unit():
    game, worker = start(unit_capacity=3)
    feed(game, 0)
    hall, spare = game.put(0, t.TOWN_HALL, 4, 4), game.put(0, t.PEASANT, 12, 12)
    game.select(worker)
    assert not game.is_legal(0, "make_farm")
    game.make(hall, t.PEASANT)
    game.wait(200)
    assert game.queue(hall) == [t.PEASANT]
    assert of(game, 0, s.NUM_UNITS) == 3
    game.kill(spare)
    game.wait(6)
    assert game.queue(hall) == []
    assert of(game, 0, s.NUM_UNITS) == 3


def test_refund_does_not_overfill_the_store():
    game, house = own(t.BARRACKS)
    game.make(house, t.FOOTMAN)
    game.fill_store(0, t.MAX_RESOURCE - 10)
    game.select(house)
    game.play("cancel")
    assert game.store(0)[0] == t.MAX_RESOURCE


@pytest.mark.parametrize("price", [(59, 40), (60, 39), (60, 40)])
def test_product_needs_its_whole_price(price):
    game, worker = start()
    game.fill_store(0, *price)
    game.make(worker, t.FARM)
    is_paid = price == (60, 40)
    assert game.illegal() == [not is_paid, 0]
    assert game.store(0)[:2] == ([0, 0] if is_paid else list(price))


@pytest.mark.parametrize("preset", ["original", "thesis"])
def test_original_has_no_cavalry_smithy_or_well(preset):
    game, house = own(t.BARRACKS, preset=preset)
    game.select(game.units_of(0)[0])
    assert game.is_legal(0, "make_barracks")
    assert not game.is_legal(0, "make_smithy")
    game.set_tile(8, 9, t.OIL_TILE, 300)
    assert not game.is_legal(0, "make_oil_well")
    game.select(house)
    assert game.is_legal(0, "make_archer")
    assert not game.is_legal(0, "make_cavalry")


# --- upgrades ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("product", "name"), [(BLADES_PRODUCT, "blades"), (PLATES_PRODUCT, "plates")]
)
def test_upgrade_has_two_levels_of_300_ticks_each(product, name):
    game, smithy = own(t.SMITHY)
    game.make(smithy, product)
    assert game.store(0) == [4_850, 5_000, 5_000, 4_970]
    game.make(smithy, product)
    game.select(smithy)
    assert not game.is_legal(0, f"make_{name}")
    column = s.UPGRADES + product - t.FIRST_UPGRADE
    for level in range(2):
        assert of(game, 0, column) == level
        game.wait(300 - 2 * (level == 0) - 1)
        assert of(game, 0, column) == level
        game.wait()
    assert of(game, 0, column) == 2
    assert sum(of(game, 0, s.UPGRADES + upgrade) for upgrade in range(t.NUM_UPGRADES)) == 2
    assert of(game, 1, column) == 0
    game.select(smithy)
    assert not game.is_legal(0, f"make_{name}")


def test_two_smithies_do_not_buy_a_third_level_but_a_level_lost_with_its_smithy():
    game, first = own(t.SMITHY)
    second = game.put(0, t.SMITHY, 12, 4)
    for smithy in (first, second, first):
        game.make(smithy, BLADES_PRODUCT)
    assert game.illegal() == [1, 0]
    game.kill(second)
    game.wait()
    game.select(first)
    assert game.is_legal(0, "make_blades")
    game.wait(300)
    assert of(game, 0, s.UPGRADES + t.BLADES) == 1


# --- the cursor ----------------------------------------------------------------------------------


def test_cursor_goes_from_a_site_to_a_unit_that_waits_for_an_order():
    game, worker = start()
    busy, idle = game.put(0, t.PEASANT, 4, 4), game.put(0, t.PEASANT, 5, 5)
    game.order(busy, s.MOVE, 12, 12)
    game.make(worker, t.FARM)
    assert of(game, 0, s.CURSOR) == idle


def test_builder_inside_a_site_cannot_be_selected():
    game, worker = start()
    game.make(worker, t.FARM)
    site = game.occupant(8, 8)
    for _ in range(4):
        game.play("next_unit")
        assert of(game, 0, s.CURSOR) == site
    mask = game.engine.action_mask()[0, 0]
    names = np.array(game.engine.spec.action_names)[mask].tolist()
    assert names == ["noop", "cancel"]
