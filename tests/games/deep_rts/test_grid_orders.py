"""`grid`: what each order does, and where it is legal."""

from __future__ import annotations

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.orders.grid import FIRST_GO, NUM_GRID, REACH_TILES
from tests.games.deep_rts.skirmish import CALM, Skirmish, feed, start

WINDOW = [(row - 4, column - 4) for row, column in np.ndindex(9, 9) if (row, column) != (4, 4)]


def meadow(**options) -> Skirmish:
    """A calm world. Player 0 sees the map's text; for player 1 up is right and left is down."""
    return Skirmish(**(CALM | {"actions": "grid"} | options))


def rich(**options) -> tuple[Skirmish, int]:
    game, worker = start(**({"actions": "grid"} | options))
    feed(game, 0)
    return game, worker


def go(rows: int, columns: int) -> str:
    return f"go_r{rows:+d}_c{columns:+d}"


def order_of(game: Skirmish, unit: int, *names: str) -> tuple[int, int, int]:
    """The unit's order, goal and target after these orders, in one step each."""
    for name in names:
        game.command({unit: name})
    return game.get(unit, s.UNIT_ORDER, s.UNIT_GOAL, s.UNIT_TARGET)


# --- the space -----------------------------------------------------------------------------------


def test_window_reaches_as_far_as_the_longest_shot():
    assert max(max(preset.range_tiles) for preset in t.PRESETS.values()) <= REACH_TILES


def test_names_show_kind_and_place():
    spec = make_engine("deep_rts", actions="grid").spec
    names = spec.action_names
    assert spec.num_actions == NUM_GRID == 102
    assert names[:3] == ("noop", "stop", "cancel")
    window = [go(*step) for step in WINDOW]
    assert list(names[FIRST_GO : FIRST_GO + 80]) == window
    assert names[-8:-4] == ("advance_up", "advance_right", "advance_down", "advance_left")
    groups = np.array(spec.action_group_names)[spec.action_groups].tolist()
    grouped = [name for name, group in zip(names, groups, strict=True) if name != group]
    assert grouped == [*window, *names[-8:]]


def test_only_cells_with_an_own_unit_take_orders():
    """A building takes them at its centre; a builder inside its site takes none."""
    game, worker = rich()
    hall, other = game.put(0, t.TOWN_HALL, 4, 4), game.put(0, t.PEASANT, 12, 12)
    game.command({worker: "make_farm"})
    mask = game.engine.action_mask()[0, 0]
    places = [tuple(place) for place in np.argwhere(mask[..., 1:].any(axis=-1)).tolist()]
    assert places == [(4, 4), (8, 8), (12, 12)]
    assert game.may(game.occupant(8, 8), "cancel")
    assert game.get(worker, s.UNIT_STATE) == s.INSIDE
    assert mask[..., 0].all()
    assert game.may(hall, go(0, 2))
    assert game.may(other, go(0, 1))


# --- what an order does --------------------------------------------------------------------------


@pytest.mark.plain_python
@pytest.mark.parametrize("player", [0, 1])
@pytest.mark.parametrize(("rows", "columns"), [(-1, 0), (0, 1), (2, -1), (4, 4), (-4, -3)])
def test_go_walks_to_a_cell_relative_to_the_unit_in_the_own_view(player, rows, columns):
    game = meadow()
    unit = game.put(player, t.PEASANT, 8, 8)
    assert order_of(game, unit, go(rows, columns))[0] == s.MOVE
    game.wait(80)  # the no-op lets the unit continue
    away = (rows, columns) if player == 0 else (-columns, -rows)
    assert game.place(unit) == (8 + away[0], 8 + away[1])
    assert game.illegal() == [0, 0]


def test_go_harvests_attacks_repairs_and_brings_home():
    game, worker = rich(**CALM)
    game.set_tile(8, 10, t.GOLD_TILE, 100)
    foe, farm = game.put(1, t.PEASANT, 6, 8), game.put(0, t.FARM, 10, 8)
    hall = game.put(0, t.TOWN_HALL, 8, 5)
    game.set(farm, s.UNIT_HEALTH, 50)
    assert order_of(game, worker, go(0, 2)) == (s.HARVEST, game.cell(8, 10), s.NO_UNIT)
    for step, order, target in (((-2, 0), s.ATTACK, foe), ((2, 0), s.REPAIR, farm)):
        assert game.place(worker) == (8, 8)
        assert order_of(game, worker, "stop", go(*step)) == (order, s.NO_GOAL, target)
        game.set(worker, s.UNIT_ORDER, s.NO_ORDER)
        game.set(worker, s.UNIT_STATE, s.IDLE)
    assert not game.may(worker, go(0, -2))
    game.set(worker, s.UNIT_CARRY, 3)
    game.set(worker, s.UNIT_CARRY_KIND, t.GOLD)
    assert order_of(game, worker, go(0, -2)) == (s.RETURN, s.NO_GOAL, hall)


def test_go_of_a_building_sets_its_rally_point():
    game, _ = rich()
    hall = game.put(0, t.TOWN_HALL, 4, 4)
    assert not game.may(hall, go(1, 0))  # a cell of its own
    game.command({hall: go(-2, 4)})
    assert game.get(hall, s.UNIT_RALLY) == game.cell(2, 8)


@pytest.mark.parametrize(
    ("way", "rows", "columns"),
    [("up", -1, 0), ("right", 0, 1), ("down_left", 1, -1), ("up_left", -1, -1)],
)
def test_advance_leads_as_far_in_a_direction_as_the_ground_does(way, rows, columns):
    game = meadow()
    soldier = game.put(0, t.FOOTMAN, 8, 8)
    for step in range(4, 0, -1):
        place = 8 + step * rows, 8 + step * columns
        order = order_of(game, soldier, f"advance_{way}")
        assert order == (s.ADVANCE, game.cell(*place), s.NO_UNIT)
        assert game.illegal() == [0, 0]
        game.set_tile(*place, t.WALL)
        game.command({soldier: "stop"})
        game.set(soldier, s.UNIT_STATE, s.IDLE)
    assert not game.may(soldier, f"advance_{way}")


def test_only_soldiers_advance():
    game, worker = rich()
    assert not game.may(worker, "advance_up")
    assert not game.may(game.put(0, t.TOWN_HALL, 4, 4), "advance_up")


def test_stop_and_cancel_and_make():
    game, worker = rich()
    house = game.put(0, t.BARRACKS, 4, 4)
    assert not game.may(worker, "stop")
    game.command({worker: go(0, 3), house: "make_footman"})
    assert game.queue(house) == [t.FOOTMAN]
    assert game.may(worker, "stop")
    game.command({worker: "stop", house: "cancel"})
    assert game.get(worker, s.UNIT_ORDER) == s.NO_ORDER
    assert game.queue(house) == []
    assert game.store(0) == [5_000] * 4
    game.wait(12)
    game.command({worker: "make_farm"})
    site = game.units_of(0)[-1]
    assert game.get(site, s.UNIT_STATE) == s.RISING
    game.command({site: "cancel"})
    assert not game.is_alive(site)
    assert game.illegal() == [0, 0]


def test_all_units_of_both_players_take_an_order_at_once():
    game = meadow()
    places = [(6 + 4 * player, 4 + 2 * n) for player in (0, 1) for n in range(4)]
    units = [game.put(n // 4, t.ARCHER, *place) for n, place in enumerate(places)]
    game.command(dict.fromkeys(units, go(-1, 0)))
    assert [game.get(unit, s.UNIT_ORDER) for unit in units] == [s.MOVE] * 8
    game.wait(11)
    expected = [(5, 4), (5, 6), (5, 8), (5, 10), (10, 5), (10, 7), (10, 9), (10, 11)]
    assert [game.place(unit) for unit in units] == expected


def test_no_unit_is_selected_in_planes_and_pictures():
    grid, unit = (make_engine("deep_rts", actions=actions) for actions in ("grid", "unit"))
    for engine in (grid, unit):
        engine.reset(0)
    selected = list(grid.representation("planes").plane_names).index("selected")
    seen, other = grid.observe("planes"), unit.observe("planes")
    assert not seen[:, :, selected].any()
    others = [np.delete(planes, selected, axis=2) for planes in (seen, other)]
    np.testing.assert_array_equal(*others)
    for name in ("classic", "image", "gray"):
        assert grid.observe(name).any()
    assert not np.array_equal(grid.render(0, 1), unit.render(0, 1))


# --- where it is legal ---------------------------------------------------------------------------


def test_enemy_in_the_fog_is_ground_to_walk_to():
    masks = []
    for has_hidden in (False, True):
        game = meadow(fog=True)
        game.world.known[:] = s.UNKNOWN
        soldier, seen = game.put(0, t.FOOTMAN, 8, 8), game.put(1, t.PEASANT, 8, 11)
        if has_hidden:
            game.put(1, t.FARM, 12, 12)
        masks.append(game.engine.action_mask()[0, 0])
    np.testing.assert_array_equal(*masks)
    assert order_of(game, soldier, go(4, 4)) == (s.MOVE, game.cell(12, 12), s.NO_UNIT)
    assert order_of(game, soldier, go(0, 3)) == (s.ATTACK, s.NO_GOAL, seen)
