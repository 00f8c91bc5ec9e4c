"""Training, food, limits, upgrades and the cursor: exact ticks and prices."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from tests.games.deep_rts.skirmish import feed, of, start

BLADES_PRODUCT, PLATES_PRODUCT = t.FIRST_UPGRADE + t.BLADES, t.FIRST_UPGRADE + t.PLATES


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
    skirmish, _ = start()
    feed(skirmish, 0)
    house = skirmish.put(0, building, 4, 4)
    skirmish.make(house, kind)
    preset = t.PRESETS["drill"]
    price = (preset.cost_gold[kind], preset.cost_lumber[kind], 0, preset.cost_oil[kind])
    assert skirmish.store(0) == [5_000 - cost for cost in price]
    assert of(skirmish, 0, s.FOOD_USED) == preset.food_consumed[kind]
    skirmish.wait(ticks - 2)
    assert of(skirmish, 0, s.NUM_OWNED + kind) == (kind == t.PEASANT)
    assert skirmish.get(house, s.UNIT_STATE) == s.TRAINING
    skirmish.wait()
    assert of(skirmish, 0, s.NUM_CREATED + kind) == 1
    unit = skirmish.units_of(0)[-1]
    row, column = skirmish.place(unit)
    assert max(abs(row - 4), abs(column - 4)) == 2
    assert of(skirmish, 0, s.FOOD_USED) == preset.food_consumed[kind]


def test_a_queue_takes_five_and_works_them_off_one_after_another():
    skirmish, _ = start()
    feed(skirmish, 0)
    house = skirmish.put(0, t.BARRACKS, 4, 4)
    kinds = [t.FOOTMAN, t.ARCHER, t.FOOTMAN, t.ARCHER, t.FOOTMAN]
    for kind in kinds:
        skirmish.make(house, kind)
    assert skirmish.queue(house) == kinds
    skirmish.select(house)
    assert not skirmish.is_legal(0, "make_footman")
    skirmish.make(house, t.FOOTMAN)
    assert skirmish.queue(house) == kinds
    assert skirmish.illegal() == [1, 0]
    skirmish.wait(149 - 5)
    for done in range(1, 6):
        assert skirmish.queue(house) == kinds[done:]
        skirmish.wait(149)
        assert skirmish.queue(house) == kinds[done:]
        skirmish.wait()
    assert of(skirmish, 0, s.NUM_CREATED + t.FOOTMAN) == 3
    assert of(skirmish, 0, s.NUM_CREATED + t.ARCHER) == 2


def test_cancelling_gives_back_the_last_of_the_queue_in_full():
    skirmish, _ = start()
    feed(skirmish, 0)
    house = skirmish.put(0, t.BARRACKS, 4, 4)
    skirmish.make(house, t.FOOTMAN)
    skirmish.make(house, t.CAVALRY)
    assert of(skirmish, 0, s.FOOD_USED) == 3
    for queue, gold, oil, food in (([t.FOOTMAN], 4_920, 5_000, 1), ([], 5_000, 5_000, 0)):
        skirmish.select(house)
        skirmish.play("cancel")
        assert skirmish.queue(house) == queue
        assert skirmish.store(0) == [gold, 5_000, 5_000, oil]
        assert of(skirmish, 0, s.FOOD_USED) == food
    skirmish.wait(300)
    assert skirmish.get(house, s.UNIT_STATE) == s.IDLE
    assert of(skirmish, 0, s.NUM_CREATED + t.FOOTMAN) == 0
    skirmish.select(house)
    assert not skirmish.is_legal(0, "cancel")


def test_what_was_begun_goes_on_when_the_next_is_cancelled():
    skirmish, _ = start()
    feed(skirmish, 0)
    house = skirmish.put(0, t.BARRACKS, 4, 4)
    skirmish.make(house, t.FOOTMAN)
    skirmish.make(house, t.FOOTMAN)
    skirmish.wait(50)
    skirmish.select(house)
    skirmish.play("cancel")
    skirmish.wait(149 - 52)
    assert of(skirmish, 0, s.NUM_CREATED + t.FOOTMAN) == 1


@pytest.mark.parametrize("goal", [(10, 10), (0, 15)])
def test_a_new_unit_follows_the_rally_point(goal):
    """To open ground, or to the gold in the corner, where a worker harvests."""
    skirmish, _ = start()
    feed(skirmish, 0)
    hall = skirmish.put(0, t.TOWN_HALL, 4, 4)
    skirmish.select(hall)
    skirmish.play(f"go_r{goal[0]}_c{goal[1]}")
    skirmish.make(hall, t.PEASANT)
    skirmish.wait(119 + 150)
    unit = skirmish.units_of(0)[-1]
    if goal == (10, 10):
        assert skirmish.place(unit) == goal
        assert skirmish.get(unit, s.UNIT_ORDER) == s.NO_ORDER
    else:
        assert sum(skirmish.gathered(0)) > 0


def test_without_an_exit_a_unit_waits_inside_until_there_is_one():
    skirmish, _ = start()
    feed(skirmish, 0)
    hall = skirmish.put(0, t.TOWN_HALL, 8, 4)
    for row in range(16):
        for column in range(11):
            if skirmish.occupant(row, column) == s.NO_UNIT:
                skirmish.world.board[s.TILE, skirmish.cell(row, column)] = t.WALL
    skirmish.make(hall, t.PEASANT)
    skirmish.wait(130)
    assert skirmish.queue(hall) == [t.PEASANT]
    assert of(skirmish, 0, s.NUM_OWNED + t.PEASANT) == 1
    skirmish.world.board[s.TILE, skirmish.cell(6, 4)] = 0
    skirmish.wait(5)
    assert skirmish.queue(hall) == []
    assert skirmish.place(skirmish.units_of(0)[-1]) == (6, 4)


def test_a_unit_does_not_come_out_onto_lava():
    skirmish, _ = start()
    feed(skirmish, 0)
    hall = skirmish.put(0, t.TOWN_HALL, 4, 4)
    for row in range(2, 7):
        for column in range(2, 7):
            skirmish.world.board[s.TILE, skirmish.cell(row, column)] = 2
    skirmish.make(hall, t.PEASANT)
    skirmish.wait(119)
    row, column = skirmish.place(skirmish.units_of(0)[-1])
    assert max(abs(row - 4), abs(column - 4)) == 3


# --- limits --------------------------------------------------------------------------------------


def test_food_is_made_when_the_farm_stands_and_lost_with_it():
    skirmish, worker = start()
    assert of(skirmish, 0, s.FOOD_MADE) == 0
    skirmish.make(worker, t.FARM)
    skirmish.wait(148)
    assert of(skirmish, 0, s.FOOD_MADE) == 0
    skirmish.wait()
    assert of(skirmish, 0, s.FOOD_MADE) == 5
    farm = skirmish.occupant(8, 8)
    skirmish.set(farm, s.UNIT_HEALTH, 0)
    skirmish.world.clock[s.NUM_FALLEN] += 1
    skirmish.wait()
    assert of(skirmish, 0, s.FOOD_MADE) == 0


def test_nobody_is_trained_without_food():
    skirmish, _ = start()
    hall, house = skirmish.put(0, t.TOWN_HALL, 4, 4), skirmish.put(0, t.BARRACKS, 12, 4)
    feed(skirmish, 0, 3)
    for _ in range(2):
        skirmish.make(hall, t.PEASANT)
    skirmish.select(house)
    assert skirmish.is_legal(0, "make_footman")
    assert not skirmish.is_legal(0, "make_cavalry")  # eats 2
    skirmish.make(house, t.FOOTMAN)
    skirmish.select(house)
    assert not skirmish.is_legal(0, "make_footman")
    assert of(skirmish, 0, s.FOOD_USED) == 3


def test_food_is_free_again_when_its_eater_or_the_queue_dies():
    skirmish, _ = start()
    feed(skirmish, 0)
    house = skirmish.put(0, t.BARRACKS, 12, 4)
    skirmish.make(house, t.CAVALRY)
    skirmish.wait(199)
    cavalry = skirmish.units_of(0)[-1]
    for _ in range(3):
        skirmish.make(house, t.CAVALRY)
    assert of(skirmish, 0, s.FOOD_USED) == 8
    for unit, food in ((cavalry, 6), (house, 0)):
        skirmish.set(unit, s.UNIT_HEALTH, 0)
        skirmish.world.clock[s.NUM_FALLEN] += 1
        skirmish.wait()
        assert of(skirmish, 0, s.FOOD_USED) == food


def test_food_never_exceeds_its_limit(monkeypatch):
    preset = dataclasses.replace(t.PRESETS["drill"], food_limit=7, start_food=1)
    monkeypatch.setitem(t.PRESETS, "poor", preset)
    skirmish, _ = start(preset="poor")
    feed(skirmish, 0, 50)
    hall = skirmish.put(0, t.TOWN_HALL, 4, 4)
    house = skirmish.put(0, t.BARRACKS, 12, 4)
    for building, kind in [(hall, t.PEASANT)] * 5 + [(house, t.FOOTMAN)] * 3:
        skirmish.make(building, kind)
    assert of(skirmish, 0, s.FOOD_USED) == 7
    assert skirmish.illegal() == [1, 0]


def test_a_full_roster_takes_neither_site_nor_unit():
    skirmish, worker = start(unit_capacity=3)
    feed(skirmish, 0)
    hall = skirmish.put(0, t.TOWN_HALL, 4, 4)
    spare = skirmish.put(0, t.PEASANT, 12, 12)
    skirmish.select(worker)
    assert not skirmish.is_legal(0, "make_farm")
    skirmish.make(hall, t.PEASANT)
    skirmish.wait(200)
    assert skirmish.queue(hall) == [t.PEASANT]
    assert of(skirmish, 0, s.NUM_UNITS) == 3
    skirmish.set(spare, s.UNIT_HEALTH, 0)
    skirmish.world.clock[s.NUM_FALLEN] += 1
    skirmish.wait(6)
    assert skirmish.queue(hall) == []
    assert of(skirmish, 0, s.NUM_UNITS) == 3


def test_a_refund_does_not_overfill_the_store():
    skirmish, _ = start()
    feed(skirmish, 0)
    house = skirmish.put(0, t.BARRACKS, 4, 4)
    skirmish.make(house, t.FOOTMAN)
    skirmish.fill_store(0, t.MAX_RESOURCE - 10)
    skirmish.select(house)
    skirmish.play("cancel")
    assert skirmish.store(0)[0] == t.MAX_RESOURCE


def test_what_cannot_be_paid_is_refused():
    skirmish, worker = start()
    for short in range(2):
        price = [60, 40]
        price[short] -= 1
        skirmish.fill_store(0, *price)
        skirmish.make(worker, t.FARM)
        assert skirmish.illegal() == [short + 1, 0]
        assert skirmish.store(0)[:2] == price
    skirmish.fill_store(0, 60, 40)
    skirmish.make(worker, t.FARM)
    assert skirmish.store(0)[:2] == [0, 0]


@pytest.mark.parametrize("preset", ["original", "thesis"])
def test_the_original_knows_no_cavalry_smithy_or_well(preset):
    skirmish, worker = start(preset=preset)
    feed(skirmish, 0)
    house = skirmish.put(0, t.BARRACKS, 4, 4)
    skirmish.select(worker)
    assert skirmish.is_legal(0, "make_barracks")
    assert not skirmish.is_legal(0, "make_smithy")
    skirmish.select(house)
    assert skirmish.is_legal(0, "make_archer")
    assert not skirmish.is_legal(0, "make_cavalry")


# --- upgrades ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("product", "name"), [(BLADES_PRODUCT, "blades"), (PLATES_PRODUCT, "plates")]
)
def test_an_upgrade_has_two_levels_of_300_ticks_each(product, name):
    skirmish, _ = start()
    smithy = skirmish.put(0, t.SMITHY, 4, 4)
    skirmish.make(smithy, product)
    assert skirmish.store(0) == [4_850, 5_000, 5_000, 4_970]
    skirmish.make(smithy, product)
    skirmish.select(smithy)
    assert not skirmish.is_legal(0, f"make_{name}")
    column = s.UPGRADES + product - t.FIRST_UPGRADE
    for level in range(2):
        assert of(skirmish, 0, column) == level
        skirmish.wait(300 - 2 * (level == 0) - 1)
        assert of(skirmish, 0, column) == level
        skirmish.wait()
    assert of(skirmish, 0, column) == 2
    assert sum(of(skirmish, 0, s.UPGRADES + upgrade) for upgrade in range(t.NUM_UPGRADES)) == 2
    assert of(skirmish, 1, column) == 0
    skirmish.select(smithy)
    assert not skirmish.is_legal(0, f"make_{name}")


def test_two_smithies_do_not_buy_a_third_level():
    skirmish, _ = start()
    first, second = skirmish.put(0, t.SMITHY, 4, 4), skirmish.put(0, t.SMITHY, 12, 4)
    skirmish.make(first, BLADES_PRODUCT)
    skirmish.make(second, BLADES_PRODUCT)
    skirmish.make(first, BLADES_PRODUCT)
    assert skirmish.illegal() == [1, 0]
    skirmish.wait(301)
    assert of(skirmish, 0, s.UPGRADES + t.BLADES) == 2


def test_an_upgrade_that_is_lost_with_its_smithy_can_be_bought_again():
    skirmish, _ = start()
    first, second = skirmish.put(0, t.SMITHY, 4, 4), skirmish.put(0, t.SMITHY, 12, 4)
    for _ in range(2):
        skirmish.make(first, BLADES_PRODUCT)
    skirmish.set(first, s.UNIT_HEALTH, 0)
    skirmish.world.clock[s.NUM_FALLEN] += 1
    skirmish.wait()
    skirmish.select(second)
    assert skirmish.is_legal(0, "make_blades")


# --- the cursor ----------------------------------------------------------------------------------


def test_after_a_site_the_cursor_goes_to_who_waits_for_an_order():
    skirmish, worker = start()
    busy, idle = skirmish.put(0, t.PEASANT, 4, 4), skirmish.put(0, t.PEASANT, 5, 5)
    skirmish.order(busy, s.MOVE, 12, 12)
    skirmish.make(worker, t.FARM)
    assert of(skirmish, 0, s.CURSOR) == idle


def test_a_builder_inside_cannot_be_selected():
    skirmish, worker = start()
    skirmish.make(worker, t.FARM)
    site = skirmish.occupant(8, 8)
    for _ in range(4):
        skirmish.play("next_unit")
        assert of(skirmish, 0, s.CURSOR) == site
    mask = skirmish.engine.action_mask()[0, 0]
    names = np.array(skirmish.engine.spec.action_names)[mask].tolist()
    assert names == ["noop", "cancel"]
