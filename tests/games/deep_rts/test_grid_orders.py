"""`grid`: what each order does, and where it is legal."""

from __future__ import annotations

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.orders.grid import FIRST_GO, NUM_GRID, REACH_TILES
from marl_cair.games.deep_rts.rules.rulebook import SEAT_FRAME
from tests.games.deep_rts.skirmish import CALM, Skirmish, feed, start


def meadow(**options) -> Skirmish:
    """A calm world. Player 0 sees the map's text; for player 1 up is right and left is down."""
    return Skirmish(**(CALM | {"actions": "grid"} | options))


def rich(**options) -> tuple[Skirmish, int]:
    return start(**({"actions": "grid"} | options))


# --- the space -----------------------------------------------------------------------------------


def test_a_window_reaches_as_far_as_the_longest_shot():
    for preset in t.PRESETS.values():
        assert max(preset.range_tiles) <= REACH_TILES


def test_names_tell_kind_and_place():
    spec = make_engine("deep_rts", actions="grid").spec
    names = spec.action_names
    assert spec.num_actions == NUM_GRID == 102
    assert names[:3] == ("noop", "stop", "cancel")
    window = [
        f"go_r{row:+d}_c{column:+d}"
        for row in range(-4, 5)
        for column in range(-4, 5)
        if (row, column) != (0, 0)
    ]
    assert list(names[FIRST_GO : FIRST_GO + 80]) == window
    assert names[-8:-4] == ("advance_up", "advance_right", "advance_down", "advance_left")
    groups = np.array(spec.action_group_names)[spec.action_groups].tolist()
    assert [name for name, group in zip(names, groups, strict=True) if name != group] == [
        *window,
        *names[-8:],
    ]


def test_actions_and_masks_have_the_shape_of_the_planes():
    engine = make_engine("deep_rts", "1v1-31x31", num_worlds=2, actions="grid")
    engine.reset(np.zeros(2, np.uint64))
    assert engine.spec.action_shape == engine.representation("planes").shape[-2:] == (31, 31)
    assert engine.action_mask().shape == (2, 2, 31, 31, NUM_GRID)


def test_only_cells_with_an_own_unit_take_orders():
    """A building takes them at its centre; a builder inside its site takes none."""
    skirmish, worker = rich()
    hall, other = skirmish.put(0, t.TOWN_HALL, 4, 4), skirmish.put(0, t.PEASANT, 12, 12)
    skirmish.tell({worker: "make_farm"})
    site = skirmish.occupant(8, 8)
    mask = skirmish.engine.action_mask()[0, 0]
    places = [tuple(place) for place in np.argwhere(mask[..., 1:].any(axis=-1)).tolist()]
    assert places == [(4, 4), (8, 8), (12, 12)]
    assert skirmish.may(site, "cancel")
    assert skirmish.get(worker, s.UNIT_STATE) == s.INSIDE
    assert mask[..., 0].all()
    assert not mask[4, 5, 1:].any()
    for unit, name in ((hall, "go_r+0_c+2"), (other, "go_r+0_c+1")):
        assert skirmish.may(unit, name)


# --- what an order does --------------------------------------------------------------------------


@pytest.mark.plain_python
@pytest.mark.parametrize("player", [0, 1])
@pytest.mark.parametrize(("rows", "columns"), [(-1, 0), (0, 1), (2, -1), (4, 4), (-4, -3)])
def test_go_walks_to_the_cell_so_far_away_in_the_own_view(player, rows, columns):
    skirmish = meadow()
    unit = skirmish.put(player, t.PEASANT, 8, 8)
    skirmish.tell({unit: f"go_r{rows:+d}_c{columns:+d}"})
    assert skirmish.get(unit, s.UNIT_ORDER) == s.MOVE
    skirmish.wait(80)
    away = (rows, columns) if player == 0 else (-columns, -rows)
    assert skirmish.place(unit) == (8 + away[0], 8 + away[1])
    assert skirmish.illegal() == [0, 0]


def test_go_harvests_attacks_repairs_and_brings_home():
    skirmish, worker = rich(**CALM)
    gold = skirmish.cell(8, 10)
    skirmish.world.board[s.TILE, gold] = t.GOLD_TILE
    skirmish.set_amount(8, 10, 100)
    foe = skirmish.put(1, t.PEASANT, 6, 8)
    farm, hall = skirmish.put(0, t.FARM, 10, 8), skirmish.put(0, t.TOWN_HALL, 8, 5)
    skirmish.set(farm, s.UNIT_HEALTH, 50)
    skirmish.tell({worker: "go_r+0_c+2"})
    assert (skirmish.get(worker, s.UNIT_ORDER), skirmish.get(worker, s.UNIT_GOAL)) == (
        s.HARVEST,
        gold,
    )
    for name, order, target in (
        ("go_r-2_c+0", s.ATTACK, foe),
        ("go_r+2_c+0", s.REPAIR, farm),
    ):
        assert skirmish.place(worker) == (8, 8)
        skirmish.tell({worker: "stop"})
        skirmish.tell({worker: name})
        found = skirmish.get(worker, s.UNIT_ORDER), skirmish.get(worker, s.UNIT_TARGET)
        assert found == (order, target)
        skirmish.set(worker, s.UNIT_ORDER, s.NO_ORDER)
        skirmish.set(worker, s.UNIT_STATE, 0)
    assert not skirmish.may(worker, "go_r+0_c-2")
    skirmish.set(worker, s.UNIT_CARRY, 3)
    skirmish.set(worker, s.UNIT_CARRY_KIND, t.GOLD)
    skirmish.tell({worker: "go_r+0_c-2"})
    assert (skirmish.get(worker, s.UNIT_ORDER), skirmish.get(worker, s.UNIT_TARGET)) == (
        s.RETURN,
        hall,
    )


def test_a_building_sends_whom_it_trains():
    skirmish, _ = rich()
    feed(skirmish, 0)
    hall = skirmish.put(0, t.TOWN_HALL, 4, 4)
    assert not skirmish.may(hall, "go_r+1_c+0")  # a cell of its own
    skirmish.tell({hall: "go_r-2_c+4"})
    assert skirmish.get(hall, s.UNIT_RALLY) == skirmish.cell(2, 8)


@pytest.mark.parametrize(
    ("way", "rows", "columns"),
    [("up", -1, 0), ("right", 0, 1), ("down_left", 1, -1), ("up_left", -1, -1)],
)
def test_advance_leads_as_far_in_a_direction_as_the_ground_does(way, rows, columns):
    skirmish = meadow()
    soldier = skirmish.put(0, t.FOOTMAN, 8, 8)
    name = f"advance_{way}"
    for step in range(4, 0, -1):
        skirmish.tell({soldier: name})
        goal = skirmish.cell(8 + step * rows, 8 + step * columns)
        assert (skirmish.get(soldier, s.UNIT_ORDER), skirmish.get(soldier, s.UNIT_GOAL)) == (
            s.ADVANCE,
            goal,
        )
        assert skirmish.illegal() == [0, 0]
        skirmish.world.board[s.TILE, goal] = t.WALL
        skirmish.tell({soldier: "stop"})
        skirmish.set(soldier, s.UNIT_STATE, 0)
    assert not skirmish.may(soldier, name)


def test_only_soldiers_advance():
    skirmish, worker = rich()
    hall = skirmish.put(0, t.TOWN_HALL, 4, 4)
    for unit in (worker, hall):
        assert not skirmish.may(unit, "advance_up")


def test_stop_and_cancel_and_make():
    skirmish, worker = rich()
    feed(skirmish, 0)
    house = skirmish.put(0, t.BARRACKS, 4, 4)
    assert not skirmish.may(worker, "stop")
    skirmish.tell({worker: "go_r+0_c+3", house: "make_footman"})
    assert skirmish.queue(house) == [t.FOOTMAN]
    assert skirmish.may(worker, "stop")
    skirmish.tell({worker: "stop", house: "cancel"})
    assert skirmish.get(worker, s.UNIT_ORDER) == s.NO_ORDER
    assert skirmish.queue(house) == []
    assert skirmish.store(0) == [5_000] * 4
    skirmish.wait(12)
    skirmish.tell({worker: "make_farm"})
    site = skirmish.units_of(0)[-1]
    assert skirmish.get(site, s.UNIT_STATE) == s.RISING
    skirmish.tell({site: "cancel"})
    assert not skirmish.is_alive(site)
    assert skirmish.illegal() == [0, 0]


def test_a_noop_lets_units_go_on():
    skirmish = meadow()
    unit = skirmish.put(0, t.PEASANT, 8, 8)
    skirmish.tell({unit: "go_r+0_c+4"})
    skirmish.wait(60)
    assert skirmish.place(unit) == (8, 12)


def test_all_units_are_told_at_once():
    skirmish = meadow()
    units = [
        skirmish.put(player, t.ARCHER, 6 + 4 * player, 4 + 2 * n)
        for player in (0, 1)
        for n in range(4)
    ]
    skirmish.tell(dict.fromkeys(units, "go_r-1_c+0"))
    assert [skirmish.get(unit, s.UNIT_ORDER) for unit in units] == [s.MOVE] * 8
    skirmish.wait(11)
    places = [(5, 4), (5, 6), (5, 8), (5, 10), (10, 5), (10, 7), (10, 9), (10, 11)]
    assert [skirmish.place(unit) for unit in units] == places


def test_nothing_is_selected_in_planes_and_pictures():
    grid, unit = (make_engine("deep_rts", actions=actions) for actions in ("grid", "unit"))
    for engine in (grid, unit):
        engine.reset(0)
    planes = list(grid.representation("planes").plane_names)
    seen, other = grid.observe("planes"), unit.observe("planes")
    assert not seen[:, :, planes.index("selected")].any()
    np.testing.assert_array_equal(
        np.delete(seen, planes.index("selected"), axis=2),
        np.delete(other, planes.index("selected"), axis=2),
    )
    for name in ("classic", "image", "gray"):
        assert grid.observe(name).any()
    assert not np.array_equal(grid.render(0, 1), unit.render(0, 1))


# --- where it is legal ---------------------------------------------------------------------------


def test_the_window_ends_at_the_board():
    skirmish = meadow()
    unit = skirmish.put(0, t.PEASANT, 0, 2)
    for rows in range(-4, 5):
        for columns in range(-4, 5):
            if (rows, columns) != (0, 0):
                is_inside = rows >= 0 and columns >= -2
                assert skirmish.may(unit, f"go_r{rows:+d}_c{columns:+d}") == is_inside


def test_an_enemy_in_the_fog_is_ground_to_walk_to():
    skirmish = meadow(fog=True)
    skirmish.world.known[:] = s.UNKNOWN
    soldier = skirmish.put(0, t.FOOTMAN, 8, 8)
    seen, hidden = skirmish.put(1, t.PEASANT, 8, 11), skirmish.put(1, t.FARM, 12, 12)
    before = skirmish.engine.action_mask()[0, 0]
    skirmish.tell({soldier: "go_r+4_c+4"})
    assert (skirmish.get(soldier, s.UNIT_ORDER), skirmish.get(soldier, s.UNIT_TARGET)) == (
        s.MOVE,
        s.NO_UNIT,
    )
    skirmish.tell({soldier: "go_r+0_c+3"})
    assert (skirmish.get(soldier, s.UNIT_ORDER), skirmish.get(soldier, s.UNIT_TARGET)) == (
        s.ATTACK,
        seen,
    )
    other = meadow(fog=True)
    other.world.known[:] = s.UNKNOWN
    other.put(0, t.FOOTMAN, 8, 8)
    other.put(1, t.PEASANT, 8, 11)
    assert skirmish.is_alive(hidden)
    np.testing.assert_array_equal(other.engine.action_mask()[0, 0], before)


def test_an_illegal_order_of_a_unit_is_counted_and_does_nothing():
    skirmish, worker = rich()
    hall = skirmish.put(0, t.TOWN_HALL, 4, 4)
    mask = skirmish.engine.action_mask()[0]
    before = skirmish.engine.snapshot()
    for unit in (worker, hall):
        place = skirmish.own_place(unit)
        for action in np.flatnonzero(~mask[place]):
            skirmish.engine.restore(before)
            skirmish.wait()
            expected = [field.copy() for field in skirmish.engine._worlds]
            skirmish.engine.restore(before)
            skirmish.tell({unit: skirmish.engine.spec.action_names[action]})
            assert skirmish.illegal() == [1, 0]
            skirmish.world.illegal[:] = 0
            for field, other in zip(skirmish.engine._worlds, expected, strict=True):
                np.testing.assert_array_equal(field, other)


def test_a_building_takes_no_orders_at_its_sides():
    skirmish, _ = rich()
    feed(skirmish, 0)
    hall = skirmish.put(0, t.TOWN_HALL, 4, 4)
    actions = skirmish.noops.copy()
    actions[0, 0, 4, 5] = skirmish.action("make_peasant")
    skirmish.engine.step(actions)
    assert skirmish.queue(hall) == []
    assert skirmish.illegal() == [1, 0]
    skirmish.tell({hall: "make_peasant"})
    assert skirmish.queue(hall) == [t.PEASANT]
    assert skirmish.illegal() == [1, 0]


def test_orders_at_empty_cells_and_at_others_units_are_counted():
    skirmish, worker = rich()
    actions = skirmish.noops.copy()
    player, row, column = skirmish.own_place(worker)
    actions[0, player, row, column + 1] = skirmish.action("go_r+0_c+1")
    foe = skirmish.units_of(1)[0]
    cell = skirmish.get(foe, s.UNIT_CELL)
    own = divmod(int(skirmish.rules.own_cell[skirmish.rules.seats[0, 0, SEAT_FRAME], cell]), 16)
    actions[(0, 0, *own)] = skirmish.action("go_r+0_c+1")
    skirmish.engine.step(actions)
    assert skirmish.illegal() == [2, 0]
    assert skirmish.get(foe, s.UNIT_ORDER) == s.NO_ORDER
