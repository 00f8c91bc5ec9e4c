"""Fighting: exact ticks, range, striking back, choice of target, lava and repair."""

from __future__ import annotations

import numpy as np
import pytest

from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from tests.games.deep_rts.skirmish import CALM, LASTING, Skirmish, face_off


def blows_of(game: Skirmish, num_ticks: int, *units: int, renew=None) -> list[list[int]]:
    """The ticks from now in which each unit loses health; `renew` is called every three ticks."""
    start, found = game.tick, [[] for _ in units]
    for tick in range(1, num_ticks + 1):
        before = [game.get(unit, s.UNIT_HEALTH) for unit in units]
        game.wait()
        for unit, health, ticks in zip(units, before, found, strict=True):
            if game.get(unit, s.UNIT_HEALTH) < health:
                ticks.append(game.tick - start)
        if renew is not None and tick % 3 == 0:
            renew()
    return found


# --- time --------------------------------------------------------------------------------------


@pytest.mark.plain_python
@pytest.mark.parametrize("kind", [t.PEASANT, t.FOOTMAN, t.ARCHER, t.CAVALRY])
def test_first_blow_falls_after_a_tick_and_then_one_every_10_ticks(kind):
    game, unit, other = face_off(kind, t.PEASANT, preset="original")
    game.set(unit, s.UNIT_HEALTH, LASTING)
    game.attack(unit, other)
    assert blows_of(game, 60, other) == [[2, 12, 22, 32, 42, 52]]


def test_new_orders_do_not_make_blows_faster():
    game, unit, other = face_off(t.FOOTMAN, t.PEASANT)
    game.set(unit, s.UNIT_HEALTH, LASTING)
    game.attack(unit, other)
    (blows,) = blows_of(game, 39, other, renew=lambda: game.attack(unit, other))
    assert len(blows) > 2
    assert np.diff(blows).min() >= 10


def test_unit_walks_into_range_and_strikes():
    """5 tiles away: 1 tick to set out, 4 tiles of 11, 1 for the blow."""
    game, unit, other = face_off(t.FOOTMAN, t.PEASANT, away=5)
    game.attack(unit, other)
    assert blows_of(game, 60, other)[0][0] == 1 + 4 * 11 + 1
    assert game.place(unit) == (8, 8)


# --- range ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", [t.FOOTMAN, t.ARCHER])
@pytest.mark.parametrize(("along", "across"), list(np.ndindex(6, 6))[1:])
def test_range_is_the_distance_rounded_down(kind, along, across):
    game = Skirmish(**CALM)
    unit, other = game.put(0, kind, 4, 4), game.put(1, t.PEASANT, 4 + along, 4 + across)
    game.attack(unit, other)
    game.wait()
    is_in_range = int(np.hypot(along, across)) <= t.PRESETS["thesis"].range_tiles[kind]
    assert (game.get(unit, s.UNIT_STATE) == s.FIGHTING) == is_in_range


def test_range_is_measured_to_the_nearest_wall_of_a_building():
    game, unit, other = face_off(t.ARCHER, t.TOWN_HALL, away=5)
    game.put(1, t.PEASANT, 1, 1)
    game.attack(unit, other)
    assert blows_of(game, 20, other)[0][0] == 2
    assert game.place(unit) == (8, 4)


def test_archer_outranges_a_footman():
    """It shoots while the footman still walks: 1 to set out, 3 tiles, 1 for the blow."""
    game = Skirmish()
    archer, footman = game.put(0, t.ARCHER, 8, 4), game.put(1, t.FOOTMAN, 8, 8)
    for unit, other in ((archer, footman), (footman, archer)):
        game.set(unit, s.UNIT_HEALTH, LASTING)
        game.attack(unit, other)
    assert blows_of(game, 40, footman, archer) == [[2, 12, 22, 32], [1 + 3 * 11 + 1]]


# --- targets -------------------------------------------------------------------------------------


@pytest.mark.parametrize("is_idle", [True, False])
def test_unit_strikes_back_only_if_it_is_idle(is_idle):
    game, unit, other = face_off(t.FOOTMAN, t.PEASANT)
    if not is_idle:
        game.order(other, s.MOVE, 8, 6)
    game.attack(unit, other)
    game.wait(2)
    assert game.get(other, s.UNIT_ORDER) == (s.ATTACK if is_idle else s.MOVE)
    if is_idle:
        assert game.get(other, s.UNIT_TARGET) == unit
        assert blows_of(game, 5, unit) == [[2]]


def test_building_does_not_strike_back():
    game, unit, other = face_off(t.FOOTMAN, t.FARM)
    game.put(1, t.PEASANT, 1, 1)
    game.attack(unit, other)
    game.wait(30)
    assert game.get(other, s.UNIT_ORDER) == s.NO_ORDER
    assert game.get(unit, s.UNIT_HEALTH) == 60


def test_unit_that_two_strike_answers_the_nearer():
    game, near, other = face_off(t.ARCHER, t.PEASANT)
    for unit in (game.put(0, t.ARCHER, 8, 3), near):
        game.attack(unit, other)
    game.wait(2)
    assert game.get(other, s.UNIT_TARGET) == near


@pytest.mark.parametrize(
    ("preset", "attacks"), [("balanced", True), ("thesis", False), ("original", False)]
)
def test_idle_soldiers_attack_enemies_in_sight_in_presets_with_auto_attack(preset, attacks):
    game = Skirmish(preset=preset)
    soldier, other = game.put(0, t.FOOTMAN, 8, 4), game.put(1, t.PEASANT, 8, 8)
    game.wait(6)
    assert (game.get(soldier, s.UNIT_ORDER) == s.ATTACK) == attacks
    assert (game.get(soldier, s.UNIT_TARGET) == other) == attacks


def test_peasants_never_attack_without_an_order_and_soldiers_not_beyond_their_sight():
    game = Skirmish()
    game.put(0, t.PEASANT, 8, 5)
    soldier = game.put(0, t.FOOTMAN, 8, 3)
    game.put(1, t.PEASANT, 8, 8)
    game.wait(30)
    assert [game.get(unit, s.UNIT_ORDER) for unit in game.units_of(0)] == [s.NO_ORDER] * 2
    assert game.place(soldier) == (8, 3)


def test_soldier_prefers_fighters_then_workers_then_buildings():
    game = Skirmish()
    game.put(1, t.FARM, 8, 5)
    worker, fighter = game.put(1, t.PEASANT, 7, 6), game.put(1, t.ARCHER, 8, 7)
    soldier = game.put(0, t.FOOTMAN, 8, 4)
    game.wait()
    assert game.get(soldier, s.UNIT_TARGET) == fighter
    game.kill(fighter)
    game.wait(40)
    assert game.get(soldier, s.UNIT_TARGET) == worker


def test_two_may_kill_each_other_in_one_tick():
    game = Skirmish(**CALM)
    units = [game.put(player, t.FOOTMAN, 8, 4 + player) for player in (0, 1)]
    for player in (0, 1):
        game.put(player, t.PEASANT, 2 + 10 * player, 2)
        game.set(units[player], s.UNIT_HEALTH, 1)
        game.attack(units[player], units[1 - player])
    game.wait(2)
    assert not any(game.is_alive(unit) for unit in units)
    for column in (s.DAMAGE_DONE, s.DAMAGE_TAKEN):  # up to the remaining health
        assert game.world.players[:, column].tolist() == [1, 1]


def test_attack_chases_its_target():
    game, unit, other = face_off(t.CAVALRY, t.PEASANT, away=3, preset="drill")
    game.attack(unit, other)
    game.order(other, s.MOVE, 8, 14)
    game.wait(40)
    assert game.get(unit, s.UNIT_ORDER) == s.ATTACK
    assert game.get(other, s.UNIT_HEALTH) < LASTING
    assert game.place(unit)[1] > 7


def test_attack_ends_with_its_target():
    game, unit, other = face_off(t.FOOTMAN, t.PEASANT)
    game.put(1, t.PEASANT, 1, 1)
    game.set(other, s.UNIT_HEALTH, 1)
    game.attack(unit, other)
    game.wait(13)
    assert game.get(unit, s.UNIT_STATE) == s.IDLE
    assert game.get(unit, s.UNIT_ORDER) == s.NO_ORDER
    assert game.get(unit, s.UNIT_TARGET) == s.NO_UNIT


@pytest.mark.parametrize(("order", "fights"), [(s.ADVANCE, True), (s.MOVE, False)])
def test_advance_fights_on_its_way_and_a_move_does_not(order, fights):
    game = Skirmish()
    game.put(1, t.PEASANT, 1, 14)
    unit, other = game.put(0, t.FOOTMAN, 8, 2), game.put(1, t.FARM, 6, 7)
    game.set(other, s.UNIT_HEALTH, 20)
    game.order(unit, order, 8, 13)
    if not fights:
        game.wait(1 + 11 * 11)
        assert game.place(unit) == (8, 13)
        assert game.get(other, s.UNIT_HEALTH) == 20
        return
    game.wait(400)
    assert not game.is_alive(other)
    assert game.place(unit) == (8, 13)
    assert game.get(unit, s.UNIT_ORDER) == s.NO_ORDER


# --- lava and repair -----------------------------------------------------------------------------


def test_lava_burns_one_point_a_tick_from_the_tick_of_arrival():
    game = Skirmish()
    game.put(0, t.PEASANT, 1, 1)
    game.set_tile(8, 5, t.LAVA)
    unit = game.put(0, t.FOOTMAN, 8, 4)
    game.order(unit, s.MOVE, 8, 5)
    game.wait(1 + 5)
    assert game.place(unit) == (8, 5)
    for left in range(59, 0, -1):
        assert game.get(unit, s.UNIT_HEALTH) == left
        game.wait()
    assert not game.is_alive(unit)
    assert game.occupant(8, 5) == s.NO_UNIT
    assert game.world.players[:, s.DAMAGE_DONE].tolist() == [0, 0]


def test_unit_that_leaves_lava_burns_no_more():
    game = Skirmish()
    game.set_tile(8, 5, t.LAVA)
    unit = game.put(0, t.FOOTMAN, 8, 5)
    game.order(unit, s.MOVE, 8, 6)
    game.wait(60)
    assert game.get(unit, s.UNIT_HEALTH) == 60 - 11  # the tick of leaving is free


@pytest.mark.parametrize(
    ("kind", "gain", "price", "gold"),
    [(t.BARRACKS, 13, 2, 100), (t.FARM, 13, 1, 100), (t.FARM, 0, 0, 0)],
)
def test_repair_takes_steps_of_10_ticks_and_a_quarter_of_the_price(kind, gain, price, gold):
    """Barracks: 400 points in 300 ticks; a step of 10 gives 13 and costs 150 / 4 * 13 / 400."""
    game = Skirmish()
    game.fill_store(0, gold)
    worker = game.put(0, t.PEASANT, 8, 4)
    house = game.put(0, kind, 8, 6 if kind == t.BARRACKS else 5)
    full = t.PRESETS["drill"].health[kind]
    game.set(house, s.UNIT_HEALTH, full - 20)
    game.attack(worker, house, s.REPAIR)
    game.wait(10)
    assert game.get(house, s.UNIT_HEALTH) == full - 20
    game.wait()
    assert game.get(house, s.UNIT_HEALTH) == full - 20 + gain
    assert game.store(0)[0] == gold - price
    game.wait(10)
    assert game.get(house, s.UNIT_HEALTH) == (full if gold else full - 20)
    assert game.get(worker, s.UNIT_ORDER) == (s.NO_ORDER if gold else s.REPAIR)
