"""Fighting: exact ticks, rolls, armour, range, who strikes back, lava and repair."""

from __future__ import annotations

import numpy as np
import pytest

from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from tests.games.deep_rts.skirmish import CALM, LASTING, Skirmish, face_off


def blows_of(skirmish: Skirmish, unit: int, num_ticks: int) -> list[int]:
    """The ticks from now in which the unit loses health."""
    start, before, ticks = skirmish.tick, skirmish.get(unit, s.UNIT_HEALTH), []
    for _ in range(num_ticks):
        skirmish.wait()
        if skirmish.get(unit, s.UNIT_HEALTH) < before:
            ticks.append(skirmish.tick - start)
        before = skirmish.get(unit, s.UNIT_HEALTH)
    return ticks


# --- time --------------------------------------------------------------------------------------


@pytest.mark.plain_python
@pytest.mark.parametrize("kind", [t.PEASANT, t.FOOTMAN, t.ARCHER, t.CAVALRY])
def test_the_first_blow_falls_after_a_tick_and_then_one_every_10_ticks(kind):
    skirmish, unit, other = face_off(kind, t.PEASANT, preset="original")
    skirmish.set(unit, s.UNIT_HEALTH, LASTING)
    skirmish.attack(unit, other)
    assert blows_of(skirmish, other, 60) == [2, 12, 22, 32, 42, 52]


def test_new_orders_do_not_make_blows_faster():
    skirmish, unit, other = face_off(t.FOOTMAN, t.PEASANT)
    skirmish.set(unit, s.UNIT_HEALTH, LASTING)
    skirmish.attack(unit, other)
    blows = []
    for tick in range(1, 40):
        before = skirmish.get(other, s.UNIT_HEALTH)
        skirmish.wait()
        if skirmish.get(other, s.UNIT_HEALTH) < before:
            blows.append(tick)
        if tick % 3 == 0:
            skirmish.attack(unit, other)
    assert np.diff(blows).min() >= 10


def test_a_unit_walks_into_range_and_strikes():
    """5 tiles away: 1 to set out, 4 tiles of 11, 1 for the blow."""
    skirmish, unit, other = face_off(t.FOOTMAN, t.PEASANT, away=5)
    skirmish.attack(unit, other)
    assert blows_of(skirmish, other, 60)[0] == 1 + 4 * 11 + 1
    assert skirmish.place(unit) == (8, 8)


# --- range ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [t.FOOTMAN, t.ARCHER])
@pytest.mark.parametrize("across", range(6))
@pytest.mark.parametrize("along", range(6))
def test_range_is_the_distance_rounded_down(kind, along, across):
    if along == across == 0:
        return
    skirmish = Skirmish(**CALM)
    unit, other = skirmish.put(0, kind, 4, 4), skirmish.put(1, t.PEASANT, 4 + along, 4 + across)
    skirmish.attack(unit, other)
    skirmish.wait()
    is_in_range = int(np.hypot(along, across)) <= t.PRESETS["thesis"].range_tiles[kind]
    assert (skirmish.get(unit, s.UNIT_STATE) == s.FIGHTING) == is_in_range


def test_range_is_measured_to_the_nearest_wall_of_a_building():
    skirmish, unit, other = face_off(t.ARCHER, t.TOWN_HALL, away=5)
    skirmish.put(1, t.PEASANT, 1, 1)
    skirmish.attack(unit, other)
    assert blows_of(skirmish, other, 20)[0] == 2
    assert skirmish.place(unit) == (8, 4)


def test_an_archer_outranges_a_footman():
    """It shoots while the footman still walks: 1 to set out, 3 tiles, 1 for the blow."""
    skirmish = Skirmish()
    archer, footman = skirmish.put(0, t.ARCHER, 8, 4), skirmish.put(1, t.FOOTMAN, 8, 8)
    for unit in (archer, footman):
        skirmish.set(unit, s.UNIT_HEALTH, LASTING)
    skirmish.attack(archer, footman)
    skirmish.attack(footman, archer)
    hits = {archer: [], footman: []}
    for _ in range(40):
        before = {unit: skirmish.get(unit, s.UNIT_HEALTH) for unit in hits}
        skirmish.wait()
        for unit, ticks in hits.items():
            if skirmish.get(unit, s.UNIT_HEALTH) < before[unit]:
                ticks.append(skirmish.tick)
    assert hits[footman] == [2, 12, 22, 32]
    assert hits[archer] == [1 + 3 * 11 + 1]


# --- who fights whom -----------------------------------------------------------------------------


@pytest.mark.parametrize("order", [s.NO_ORDER, s.MOVE])
def test_a_unit_strikes_back_only_if_it_is_idle(order):
    skirmish, unit, other = face_off(t.FOOTMAN, t.PEASANT)
    if order == s.MOVE:
        skirmish.order(other, s.MOVE, 8, 6)
    skirmish.attack(unit, other)
    skirmish.wait(2)
    if order == s.NO_ORDER:
        assert skirmish.get(other, s.UNIT_ORDER) == s.ATTACK
        assert skirmish.get(other, s.UNIT_TARGET) == unit
        assert blows_of(skirmish, unit, 5) == [2]
    else:
        assert skirmish.get(other, s.UNIT_ORDER) == s.MOVE


def test_a_building_does_not_strike_back():
    skirmish, unit, other = face_off(t.FOOTMAN, t.FARM)
    skirmish.put(1, t.PEASANT, 1, 1)
    skirmish.attack(unit, other)
    skirmish.wait(30)
    assert skirmish.get(other, s.UNIT_ORDER) == s.NO_ORDER
    assert skirmish.get(unit, s.UNIT_HEALTH) == 60


def test_who_is_struck_by_two_answers_the_nearer():
    skirmish, near, other = face_off(t.ARCHER, t.PEASANT)
    far = skirmish.put(0, t.ARCHER, 8, 3)
    for unit in (far, near):
        skirmish.attack(unit, other)
    skirmish.wait(2)
    assert skirmish.get(other, s.UNIT_TARGET) == near


@pytest.mark.parametrize(
    ("preset", "attacks"), [("balanced", True), ("thesis", False), ("original", False)]
)
def test_idle_soldiers_attack_what_comes_into_sight_where_the_rules_say_so(preset, attacks):
    skirmish = Skirmish(preset=preset)
    soldier, other = skirmish.put(0, t.FOOTMAN, 8, 4), skirmish.put(1, t.PEASANT, 8, 8)
    skirmish.wait(6)
    assert (skirmish.get(soldier, s.UNIT_ORDER) == s.ATTACK) == attacks
    assert (skirmish.get(soldier, s.UNIT_TARGET) == other) == attacks


def test_peasants_do_not_attack_by_themselves_and_soldiers_not_beyond_their_sight():
    skirmish = Skirmish()
    skirmish.put(0, t.PEASANT, 8, 5)
    soldier = skirmish.put(0, t.FOOTMAN, 8, 3)
    skirmish.put(1, t.PEASANT, 8, 8)
    skirmish.wait(30)
    assert [skirmish.get(unit, s.UNIT_ORDER) for unit in skirmish.units_of(0)] == [s.NO_ORDER] * 2
    assert skirmish.place(soldier) == (8, 3)


def test_a_soldier_prefers_fighters_then_workers_then_buildings():
    skirmish = Skirmish()
    skirmish.put(1, t.FARM, 8, 5)
    worker = skirmish.put(1, t.PEASANT, 7, 6)
    fighter = skirmish.put(1, t.ARCHER, 8, 7)
    soldier = skirmish.put(0, t.FOOTMAN, 8, 4)
    skirmish.wait()
    assert skirmish.get(soldier, s.UNIT_TARGET) == fighter
    skirmish.set(fighter, s.UNIT_HEALTH, 0)
    skirmish.world.clock[8] += 1  # NUM_FALLEN
    skirmish.wait(40)
    assert skirmish.get(soldier, s.UNIT_TARGET) == worker


def test_two_may_kill_each_other_in_one_tick():
    skirmish = Skirmish(**CALM)
    units = [skirmish.put(player, t.FOOTMAN, 8, 4 + player) for player in (0, 1)]
    for player in (0, 1):
        skirmish.put(player, t.PEASANT, 2 + 10 * player, 2)
        skirmish.set(units[player], s.UNIT_HEALTH, 1)
        skirmish.attack(units[player], units[1 - player])
    skirmish.wait(2)
    assert not any(skirmish.is_alive(unit) for unit in units)
    assert skirmish.world.players[:, s.DAMAGE_DONE].tolist() == [1, 1]


def test_an_attack_chases_its_target():
    skirmish, unit, other = face_off(t.CAVALRY, t.PEASANT, away=3, preset="drill")
    skirmish.attack(unit, other)
    skirmish.order(other, s.MOVE, 8, 14)
    skirmish.wait(40)
    assert skirmish.get(unit, s.UNIT_ORDER) == s.ATTACK
    assert skirmish.get(other, s.UNIT_HEALTH) < LASTING
    assert skirmish.place(unit)[1] > 7


def test_an_attack_ends_with_its_target():
    skirmish, unit, other = face_off(t.FOOTMAN, t.PEASANT)
    skirmish.put(1, t.PEASANT, 1, 1)
    skirmish.set(other, s.UNIT_HEALTH, 1)
    skirmish.attack(unit, other)
    skirmish.wait(13)
    assert skirmish.get(unit, s.UNIT_STATE) == s.IDLE
    assert skirmish.get(unit, s.UNIT_ORDER) == s.NO_ORDER
    assert skirmish.get(unit, s.UNIT_TARGET) == s.NO_UNIT


def test_an_advance_fights_on_its_way_and_then_goes_on():
    skirmish = Skirmish()
    skirmish.put(1, t.PEASANT, 1, 14)
    unit, other = skirmish.put(0, t.FOOTMAN, 8, 2), skirmish.put(1, t.FARM, 6, 7)
    skirmish.set(other, s.UNIT_HEALTH, 20)
    skirmish.order(unit, s.ADVANCE, 8, 13)
    skirmish.wait(400)
    assert not skirmish.is_alive(other)
    assert skirmish.place(unit) == (8, 13)
    assert skirmish.get(unit, s.UNIT_ORDER) == s.NO_ORDER


def test_a_move_passes_enemies_by():
    skirmish = Skirmish()
    skirmish.put(1, t.PEASANT, 1, 14)
    unit, other = skirmish.put(0, t.FOOTMAN, 8, 2), skirmish.put(1, t.FARM, 7, 7)
    skirmish.order(unit, s.MOVE, 8, 13)
    skirmish.wait(1 + 11 * 11)
    assert skirmish.place(unit) == (8, 13)
    assert skirmish.get(other, s.UNIT_HEALTH) == 200


# --- lava and repair -----------------------------------------------------------------------------


def test_lava_burns_one_point_a_tick_from_the_tick_of_arrival():
    skirmish = Skirmish()
    skirmish.put(0, t.PEASANT, 1, 1)
    skirmish.world.board[s.TILE, skirmish.cell(8, 5)] = t.LAVA
    unit = skirmish.put(0, t.FOOTMAN, 8, 4)
    skirmish.order(unit, s.MOVE, 8, 5)
    skirmish.wait(1 + 5)
    assert skirmish.place(unit) == (8, 5)
    for left in range(59, 0, -1):
        assert skirmish.get(unit, s.UNIT_HEALTH) == left
        skirmish.wait()
    assert not skirmish.is_alive(unit)
    assert skirmish.occupant(8, 5) == s.NO_UNIT
    assert skirmish.world.players[:, s.DAMAGE_DONE].tolist() == [0, 0]


def test_who_leaves_lava_burns_no_more():
    skirmish = Skirmish()
    skirmish.world.board[s.TILE, skirmish.cell(8, 5)] = t.LAVA
    unit = skirmish.put(0, t.FOOTMAN, 8, 5)
    skirmish.order(unit, s.MOVE, 8, 6)
    skirmish.wait(60)
    assert skirmish.get(unit, s.UNIT_HEALTH) == 60 - 11  # the tick of leaving is free


@pytest.mark.parametrize(("kind", "gain", "price"), [(t.BARRACKS, 13, 2), (t.FARM, 13, 1)])
def test_a_peasant_repairs_in_steps_of_10_ticks_for_a_quarter_of_the_price(kind, gain, price):
    """Barracks: 400 points in 300 ticks; a step of 10 gives 13 and costs 150 / 4 * 13 / 400."""
    skirmish = Skirmish()
    skirmish.fill_store(0, 100)
    worker, house = (
        skirmish.put(0, t.PEASANT, 8, 4),
        skirmish.put(0, kind, 8, 6 if kind == t.BARRACKS else 5),
    )
    full = t.PRESETS["drill"].health[kind]
    skirmish.set(house, s.UNIT_HEALTH, full - 20)
    skirmish.attack(worker, house, s.REPAIR)
    skirmish.wait(10)
    assert skirmish.get(house, s.UNIT_HEALTH) == full - 20
    skirmish.wait()
    assert skirmish.get(house, s.UNIT_HEALTH) == full - 20 + gain
    assert skirmish.store(0)[0] == 100 - price
    skirmish.wait(10)
    assert skirmish.get(house, s.UNIT_HEALTH) == full
    assert skirmish.get(worker, s.UNIT_ORDER) == s.NO_ORDER


def test_nobody_repairs_for_free():
    skirmish = Skirmish()
    skirmish.fill_store(0, 0)
    worker, house = skirmish.put(0, t.PEASANT, 8, 4), skirmish.put(0, t.FARM, 8, 5)
    skirmish.set(house, s.UNIT_HEALTH, 100)
    skirmish.attack(worker, house, s.REPAIR)
    skirmish.wait(100)
    assert skirmish.get(house, s.UNIT_HEALTH) == 100
