"""Limits of saved states of Deep RTS: the range of each field, and conditions between fields.

The rules do not check the conditions: a unit on the roster has a kind, every site has a builder,
every cell holds the unit that covers it. They keep them true; a damaged file may not.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.checks import state as checks
from marl_cair.games.checks.state import Condition, Range
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.orders.grid import NUM_GRID
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.board import MAX_SIGHT
from marl_cair.games.deep_rts.rules.motion import MAX_BLOCKED
from marl_cair.games.deep_rts.rules.paths import ANY_RESOURCE, LAST_SEARCH, NOT_FOR_RESOURCE
from marl_cair.games.deep_rts.scenarios import Scenario
from marl_cair.games.game import NO_WINNER

_MOST_SERIALS = 2**24 - 1  # of these numbers, the dice give each its own rolls in a tick
_WIDEST = 2  # cells from the centre of the largest building to its side
_FARTHEST = 16**2  # the reach of a destination, from a range of 15

Columns = dict[str, tuple[int, int]]  # the range of each column of a table, in its order


def state_limits(scenario: Scenario) -> checks.StateLimits:
    """Ranges and conditions for the worlds of `scenario`."""
    rules, cells = rb.make_rules(scenario), scenario.num_cells
    units = scenario.num_players * scenario.slots_per_player
    clock = {
        "TICK": (0, rules.max_ticks),
        "PHASE": (s.RUNNING, s.TRUNCATED),
        "WINNER": (NO_WINNER, rules.num_players - 1),
        "MAP_INDEX": (0, len(rules.map_tiles) - 1),
        "WAKE": (0, s.NEVER),
        "NUM_BURNING": (0, units),
        "NUM_SEARCHES": (0, LAST_SEARCH),
        "NUM_ACTING": (0, units),
        "NUM_FALLEN": (0, 0),
        "DESTINATION goal": (0, cells - 1),
        "DESTINATION half": (0, _WIDEST),
        "DESTINATION reach": (0, _FARTHEST),
        "DESTINATION resource": (NOT_FOR_RESOURCE, ANY_RESOURCE),
    }
    layers = {
        "TILE": (0, t.NUM_TILE_KINDS - 1),
        "AMOUNT": (0, int(rules.tiles[:, rb.TILE_AMOUNT].max())),
        "OCCUPANT": (s.NO_UNIT, units - 1),
        "CLAIM": (0, 0),
        "REACHED": (0, LAST_SEARCH),
        "CAME": (0, rb.NUM_DIRECTIONS - 1),
        "FRONTIER": (0, max(cells, NUM_GRID) - 1),
    }
    ranges = {
        "clock": _join(clock),
        "seed": Range(*checks.ANY_WORD),
        "board": _join(layers, axis=-2),
        "players": _join(_player_columns(rules, units)),
        "illegal": Range(0, checks.MOST_COUNTED),
        "roster": Range(s.NO_UNIT, units - 1),
        "vision": Range(0, scenario.slots_per_player if scenario.fog else 0),
        "known": Range(0 if scenario.fog else s.UNKNOWN, s.UNKNOWN),
        "units": _join(_unit_columns(rules, units, cells)),
        "due": Range(0, s.NEVER),
        "path": Range(*checks.ANY_WORD),
        "acting": Range(0, units - 1),
    }
    return checks.StateLimits(ranges, partial(list_conditions, rules=rules))


def _join(columns: Columns, axis: int = -1) -> Range:
    low, high = np.transpose(list(columns.values())).reshape(2, -1, *[1] * (-axis - 1))
    return Range(low, high, tuple(columns), axis)


def _player_columns(rules: rb.Rules, units: int) -> Columns:
    food = (0, 2 * rules.slots * (s.QUEUE_LENGTH + 1) * max(1, rules.food_limit))
    levels = zip(t.UPGRADE_NAMES, rules.upgrade[:, rb.UPGRADE_LEVELS].tolist(), strict=True)
    return {
        "IS_ALIVE": (0, 1),
        "FOOD_USED": food,
        "FOOD_MADE": food,
        "CURSOR": (s.NO_UNIT, units - 1),
        "DAMAGE_DONE": (0, checks.MOST_COUNTED),
        "DAMAGE_TAKEN": (0, checks.MOST_COUNTED),
        "NEXT_SERIAL": (0, _MOST_SERIALS),
        "NUM_UNITS": (0, rules.slots),
        "IS_OUT": (0, 1),
        **{f"RESOURCES {name}": (0, t.MAX_RESOURCE) for name in t.RESOURCE_NAMES},
        **{f"GATHERED {name}": (0, t.MAX_RESOURCE) for name in t.RESOURCE_NAMES},
        **{f"UPGRADES {name}": (0, level) for name, level in levels},
        **{f"NUM_CREATED {name}": (0, _MOST_SERIALS) for name in t.UNIT_NAMES},
        **{f"NUM_OWNED {name}": (0, rules.slots) for name in t.UNIT_NAMES},
    }


def _unit_columns(rules: rb.Rules, units: int, cells: int) -> Columns:
    last_ready = rules.max_ticks + int(rules.kinds[:, rb.KIND_ATTACK_TICKS].max())
    most_carried = rules.carry_capacity + int(rules.tiles[:, rb.TILE_YIELD].max())
    return {
        "UNIT_KIND": (t.NO_KIND, t.NUM_KINDS - 1),
        "UNIT_STATE": (0, s.PUMPING),
        "UNIT_CELL": (0, cells - 1),
        "UNIT_HEALTH": (0, int(rules.kinds[:, rb.KIND_HEALTH].max())),
        "UNIT_ORDER": (s.NO_ORDER, s.REPAIR),
        "UNIT_FACING": (0, rb.NUM_DIRECTIONS - 1),
        "UNIT_GOAL": (0, cells - 1),
        "UNIT_TARGET": (s.NO_UNIT, units - 1),
        "UNIT_TARGET_SERIAL": (0, _MOST_SERIALS),
        "UNIT_PATH_STEPS": (0, s.PATH_STEPS),
        "UNIT_BLOCKED": (0, MAX_BLOCKED),
        "UNIT_EXIT": (s.NO_GOAL, s.NO_GOAL),
        "UNIT_SERIAL": (0, _MOST_SERIALS),
        "UNIT_SINCE": (0, rules.max_ticks),
        "UNIT_READY": (0, last_ready),
        "UNIT_CARRY": (0, most_carried),
        "UNIT_CARRY_KIND": (t.NO_RESOURCE, t.NUM_RESOURCES - 1),
        "UNIT_PARTNER": (s.NO_UNIT, units - 1),
        "UNIT_RALLY": (0, cells - 1),
        "UNIT_HURT": (0, 0),
        "UNIT_HURT_BY": (s.NO_UNIT, units - 1),
        "UNIT_QUEUE_LENGTH": (0, s.QUEUE_LENGTH),
        **{f"UNIT_QUEUE {place}": (0, t.NUM_PRODUCTS - 1) for place in range(s.QUEUE_LENGTH)},
    }


# --- conditions between fields: each bool [N] or [N, ...], true everywhere in a sound world ------


def list_conditions(worlds: s.World, rules: rb.Rules) -> Iterator[Condition]:
    """The conditions in words, and where they hold; worlds: arrays [N, ...] within their ranges."""
    yield checks.has_time(
        worlds.clock[:, s.TICK], worlds.clock[:, s.PHASE] == s.RUNNING, rules.max_ticks
    )
    listed = [_list_ground, _list_units, _list_rosters, _list_places, _list_work]
    for check in [*listed, _list_sight] if rules.fog else listed:
        for condition, holds in check(worlds, rules):
            yield condition, np.all(holds, axis=tuple(range(1, holds.ndim)))


def _list_ground(worlds: s.World, rules: rb.Rules) -> Iterator[Condition]:
    tiles, drawn = worlds.board[:, s.TILE], rules.map_tiles[worlds.clock[:, s.MAP_INDEX]]
    is_resource = rules.tiles[:, rb.TILE_RESOURCE] != t.NO_RESOURCE
    used_up = np.where(is_resource[drawn], t.GRASS, drawn)
    is_known = (tiles == drawn) | (tiles == used_up)
    yield "the tiles are those of its map, or grass where a resource was", is_known
    most = rules.tiles[tiles, rb.TILE_AMOUNT]
    yield "no tile holds more than a fresh one", worlds.board[:, s.AMOUNT] <= most
    if rules.fog != 0:
        seen, drawn, used_up = worlds.known, drawn[:, None], used_up[:, None]
        is_known = (seen == drawn) | (seen == used_up) | (seen == s.UNKNOWN)
        yield "players remember tiles of its map", is_known


def _list_units(worlds: s.World, rules: rb.Rules) -> Iterator[Condition]:
    units, tick = worlds.units, worlds.clock[:, s.TICK]
    kind, health = units[:, :, s.UNIT_KIND], units[:, :, s.UNIT_HEALTH]
    is_free = kind == t.NO_KIND
    empty = np.zeros(units.shape[2], units.dtype)
    empty[[s.UNIT_KIND, s.UNIT_CARRY_KIND]] = t.NO_KIND, t.NO_RESOURCE
    empty[[s.UNIT_TARGET, s.UNIT_PARTNER, s.UNIT_HURT_BY]] = s.NO_UNIT
    yield "free unit slots are empty", (units == empty).all(axis=2) | ~is_free
    is_healthy = (health >= 1) & (health <= rules.kinds[kind, rb.KIND_HEALTH])
    yield "every unit has from 1 hit point to those of its kind", is_healthy | is_free
    yield "every unit has a serial number", (units[:, :, s.UNIT_SERIAL] >= 1) | is_free
    has_target = units[:, :, s.UNIT_TARGET] != s.NO_UNIT
    has_serial = units[:, :, s.UNIT_TARGET_SERIAL] >= 1
    yield "every target has a serial number", ~has_target | has_serial
    yield "no state of a unit began later than now", units[:, :, s.UNIT_SINCE] <= tick[:, None]
    has_resource = units[:, :, s.UNIT_CARRY_KIND] != t.NO_RESOURCE
    yield "units carry a resource, or nothing", (units[:, :, s.UNIT_CARRY] == 0) | has_resource


def _list_rosters(worlds: s.World, rules: rb.Rules) -> Iterator[Condition]:
    num_worlds, players, slots = worlds.roster.shape
    kind = worlds.units[:, :, s.UNIT_KIND].reshape(num_worlds, players, slots)
    num_units, cursor = worlds.players[:, :, s.NUM_UNITS], worlds.players[:, :, s.CURSOR]
    lists = np.arange(slots) < num_units[:, :, None]
    numbers = np.arange(players * slots).reshape(players, slots)
    expected = np.where(kind != t.NO_KIND, numbers, s.NO_UNIT)
    listed = np.where(lists, worlds.roster, s.NO_UNIT)
    holds = (np.sort(listed, axis=2) == np.sort(expected, axis=2)).all(axis=2)
    holds &= num_units == (kind != t.NO_KIND).sum(axis=2)
    yield "each roster lists the units of its player, each once", holds
    owned = (kind[..., None] == np.arange(t.NUM_KINDS)).sum(axis=2)
    counted = worlds.players[:, :, s.NUM_OWNED : s.NUM_OWNED + t.NUM_KINDS]
    yield "NUM_OWNED counts the units of each kind", counted == owned
    state = np.take_along_axis(worlds.units[:, :, s.UNIT_STATE], np.maximum(cursor, 0), axis=1)
    is_own = ((worlds.roster == cursor[:, :, None]) & lists).any(axis=2)
    holds = (cursor == s.NO_UNIT) | (is_own & (state != s.INSIDE))
    yield "a cursor is on a unit of its player that is no builder inside a site", holds


def _list_places(worlds: s.World, rules: rb.Rules) -> Iterator[Condition]:
    units, occupant = worlds.units, worlds.board[:, s.OCCUPANT]
    kind, centre = units[:, :, s.UNIT_KIND], units[:, :, s.UNIT_CELL]
    stands = (kind != t.NO_KIND) & (units[:, :, s.UNIT_STATE] != s.INSIDE)
    half = rules.kinds[kind, rb.KIND_HALF_SIZE]
    row, column = np.moveaxis(rules.cells[centre], -1, 0)
    is_inside = (row >= half) & (row < rules.rows - half)
    is_inside &= (column >= half) & (column < rules.columns - half)
    yield "all units stand on the board", is_inside | (kind == t.NO_KIND)
    num_covered = np.where(stands, (2 * half + 1) ** 2, 0).sum(axis=1)
    holds = (occupant != s.NO_UNIT).sum(axis=1) == num_covered
    for size in range(_WIDEST + 1):
        world, unit = np.nonzero(stands & (half == size))
        steps = np.arange(-size, size + 1)
        cells = centre[world, unit][:, None] + (steps[:, None] * rules.stride + steps).ravel()
        np.logical_and.at(holds, world, (occupant[world[:, None], cells] == unit[:, None]).all(1))
    yield "each cell is held by the unit that covers it, and no other", holds
    tile = np.take_along_axis(worlds.board[:, s.TILE], centre.astype(np.intp), axis=1)
    num_burning = (stands & (rules.tiles[tile, rb.TILE_DAMAGE] > 0)).sum(axis=1)
    yield "NUM_BURNING counts the units on lava", worlds.clock[:, s.NUM_BURNING] == num_burning


def _list_work(worlds: s.World, rules: rb.Rules) -> Iterator[Condition]:
    units = worlds.units
    kind, state = units[:, :, s.UNIT_KIND], units[:, :, s.UNIT_STATE]
    is_building, is_free = kind >= t.NUM_MOBILE_KINDS, kind == t.NO_KIND
    in_building = np.isin(state, (s.RISING, s.TRAINING, s.PUMPING))
    holds: Any = np.where(is_building, in_building | (state == s.IDLE), ~in_building)
    yield "units walk and fight, and buildings rise, train and pump", holds | is_free
    is_inside = state == s.INSIDE
    yield "no unit inside a site acts", (worlds.due == s.NEVER) | ~is_inside
    needs_target = np.isin(state, (s.REPAIRING, s.FIGHTING))
    needs_target |= units[:, :, s.UNIT_ORDER] == s.REPAIR
    has_target = units[:, :, s.UNIT_TARGET] != s.NO_UNIT
    yield "units that fight or repair have a target", has_target | ~needs_target
    queue = units[:, :, s.UNIT_QUEUE : s.UNIT_QUEUE + s.QUEUE_LENGTH]
    length = units[:, :, s.UNIT_QUEUE_LENGTH]
    is_queued = np.arange(s.QUEUE_LENGTH) < length[:, :, None]
    holds = (rules.can_make[kind[:, :, None], queue] | ~is_queued).all(axis=2)
    holds &= (length == 0) | (is_building & (state != s.RISING))
    holds &= (length > 0) | (state != s.TRAINING)
    yield "queues hold what their building makes, and a building that trains has one", holds
    partner, unit = units[:, :, s.UNIT_PARTNER], np.arange(units.shape[1])
    is_site = state == s.RISING
    at = np.maximum(partner, 0).astype(np.intp)
    back, its_state, its_cell = (
        np.take_along_axis(units[:, :, column], at, axis=1)
        for column in (s.UNIT_PARTNER, s.UNIT_STATE, s.UNIT_CELL)
    )
    fits = (back == unit) & (partner // rules.slots == unit // rules.slots)
    fits &= its_cell == units[:, :, s.UNIT_CELL]
    fits &= its_state == np.where(is_site, s.INSIDE, s.RISING)
    fits &= (is_site | (kind == t.PEASANT)) & (partner != s.NO_UNIT)
    holds = np.where(is_site | is_inside, fits, partner == s.NO_UNIT)
    yield "every site has a builder of its player inside, and every builder its site", holds


def _list_sight(worlds: s.World, rules: rb.Rules) -> Iterator[Condition]:
    """The count of own units that see a cell, summed up along the rows of their discs."""
    units = worlds.units
    stands = (units[:, :, s.UNIT_KIND] != t.NO_KIND) & (units[:, :, s.UNIT_STATE] != s.INSIDE)
    world, unit = np.nonzero(stands)
    kind, centre = units[world, unit, s.UNIT_KIND], units[world, unit, s.UNIT_CELL]
    radius = rules.kinds[kind, rb.KIND_SIGHT] + rules.kinds[kind, rb.KIND_HALF_SIZE]
    radius = np.minimum(MAX_SIGHT, radius)
    row, column = np.moveaxis(rules.cells[centre].astype(np.intp), -1, 0)
    changes = np.zeros((*worlds.vision.shape[:2], rules.rows + 2, rules.stride), np.int32)
    for away in range(-MAX_SIGHT, MAX_SIGHT + 1):
        span = rules.sight_span[radius, abs(away)]
        sees = (span >= 0) & (row + away >= 0) & (row + away < rules.rows)
        at = (world[sees], unit[sees] // rules.slots, row[sees] + away + 1)
        left = np.maximum(0, column - span)[sees] + 1
        right = np.minimum(rules.columns - 1, column + span)[sees] + 2
        np.add.at(changes, (*at, left), 1)
        np.add.at(changes, (*at, right), -1)
    expected: NDArray[Any] = changes.cumsum(axis=3).reshape(worlds.vision.shape)
    yield "vision counts the units that see each cell", worlds.vision == expected
