"""What must hold between the fields of a state of Deep RTS, for N worlds at once.

The rules rely on it without looking: a unit that is on the roster has a kind, every site a builder,
every cell the unit that stands there. They keep it so; a damaged file may not.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.checks.state import Condition, has_time
from marl_cair.games.deep_rts.rules.rulebook import (
    KIND_HALF_SIZE,
    KIND_HEALTH,
    KIND_SIGHT,
    TILE_AMOUNT,
    TILE_DAMAGE,
    TILE_RESOURCE,
    Rules,
)
from marl_cair.games.deep_rts.state import (
    AMOUNT,
    CURSOR,
    FIGHTING,
    IDLE,
    INSIDE,
    MAP_INDEX,
    NEVER,
    NO_UNIT,
    NUM_BURNING,
    NUM_OWNED,
    NUM_UNITS,
    OCCUPANT,
    PHASE,
    PUMPING,
    QUEUE_LENGTH,
    REPAIR,
    REPAIRING,
    RISING,
    RUNNING,
    TICK,
    TILE,
    TRAINING,
    UNIT_CARRY,
    UNIT_CARRY_KIND,
    UNIT_CELL,
    UNIT_HEALTH,
    UNIT_HURT_BY,
    UNIT_KIND,
    UNIT_ORDER,
    UNIT_PARTNER,
    UNIT_QUEUE,
    UNIT_QUEUE_LENGTH,
    UNIT_SERIAL,
    UNIT_SINCE,
    UNIT_STATE,
    UNIT_TARGET,
    UNIT_TARGET_SERIAL,
    UNKNOWN,
    World,
)
from marl_cair.games.deep_rts.tables import (
    GRASS,
    NO_KIND,
    NO_RESOURCE,
    NUM_KINDS,
    NUM_MOBILE_KINDS,
    PEASANT,
)

Holds = NDArray[np.bool_]

_EMPTY = {UNIT_KIND: NO_KIND, UNIT_TARGET: NO_UNIT, UNIT_CARRY_KIND: NO_RESOURCE}
_EMPTY |= {UNIT_PARTNER: NO_UNIT, UNIT_HURT_BY: NO_UNIT}  # all other columns hold 0


class Placed(NamedTuple):
    """The cells that units cover, M of all worlds together."""

    world: NDArray[np.intp]
    unit: NDArray[np.intp]  # slot
    cell: NDArray[np.intp]


def list_conditions(worlds: World, rules: Rules) -> Iterator[Condition]:
    """What must hold; worlds: arrays [N, ...] whose values are in their ranges."""
    yield has_time(worlds.clock[:, TICK], worlds.clock[:, PHASE] == RUNNING, rules.max_ticks)
    yield from _list_ground(worlds, rules)
    yield from _list_units(worlds, rules)
    yield from _list_rosters(worlds, rules)
    yield from _list_places(worlds, rules)
    yield from _list_work(worlds, rules)
    if rules.fog != 0:
        yield from _list_sight(worlds, rules)


def _list_ground(worlds: World, rules: Rules) -> Iterator[Condition]:
    tiles, drawn = worlds.board[:, TILE], rules.map_tiles[worlds.clock[:, MAP_INDEX]]
    is_resource = rules.tiles[:, TILE_RESOURCE] != NO_RESOURCE
    used_up = np.where(is_resource[drawn], GRASS, drawn)
    yield (
        "the tiles are those of its map, or grass where a resource was",
        ((tiles == drawn) | (tiles == used_up)).all(axis=1),
    )
    most = rules.tiles[tiles, TILE_AMOUNT]
    yield "no tile holds more than a fresh one", (worlds.board[:, AMOUNT] <= most).all(axis=1)
    if rules.fog != 0:
        seen = worlds.known
        is_known = (seen == drawn[:, None]) | (seen == used_up[:, None]) | (seen == UNKNOWN)
        yield "players remember tiles of its map", is_known.all(axis=(1, 2))


def _list_units(worlds: World, rules: Rules) -> Iterator[Condition]:
    units, tick = worlds.units, worlds.clock[:, TICK]
    kind = units[:, :, UNIT_KIND]
    is_free = kind == NO_KIND
    empty = np.zeros(units.shape[2], units.dtype)
    empty[list(_EMPTY)] = list(_EMPTY.values())
    yield "free unit slots are empty", ((units == empty).all(axis=2) | ~is_free).all(axis=1)
    health, most = units[:, :, UNIT_HEALTH], rules.kinds[kind, KIND_HEALTH]
    yield (
        "every unit has from 1 hit point to those of its kind",
        (((health >= 1) & (health <= most)) | is_free).all(axis=1),
    )
    serial = units[:, :, UNIT_SERIAL]
    yield "every unit has a serial number", ((serial >= 1) | is_free).all(axis=1)
    target, its_serial = units[:, :, UNIT_TARGET], units[:, :, UNIT_TARGET_SERIAL]
    yield (
        "a target is named with its serial number",
        ((target == NO_UNIT) | (its_serial >= 1)).all(axis=1),
    )
    since = units[:, :, UNIT_SINCE]
    yield "no unit does something from later than now", (since <= tick[:, None]).all(axis=1)
    carried = units[:, :, UNIT_CARRY_KIND]
    yield (
        "units carry a resource, or nothing",
        ((units[:, :, UNIT_CARRY] == 0) | (carried != NO_RESOURCE)).all(axis=1),
    )


def _list_rosters(worlds: World, rules: Rules) -> Iterator[Condition]:
    num_worlds, players, slots = worlds.roster.shape
    kind = worlds.units[:, :, UNIT_KIND].reshape(num_worlds, players, slots)
    num_units, cursor = worlds.players[:, :, NUM_UNITS], worlds.players[:, :, CURSOR]
    lists = np.arange(slots) < num_units[:, :, None]
    expected = np.where(
        kind != NO_KIND, np.arange(players * slots).reshape(players, slots), NO_UNIT
    )
    listed = np.where(lists, worlds.roster, NO_UNIT)
    holds = (np.sort(listed, axis=2) == np.sort(expected, axis=2)).all(axis=(1, 2))
    holds &= (num_units == (kind != NO_KIND).sum(axis=2)).all(axis=1)
    yield "each roster lists the units of its player, each once", holds
    owned = (kind[..., None] == np.arange(NUM_KINDS)).sum(axis=2)
    counted = worlds.players[:, :, NUM_OWNED : NUM_OWNED + NUM_KINDS]
    yield "NUM_OWNED counts the units of each kind", (counted == owned).all(axis=(1, 2))
    state = np.take_along_axis(worlds.units[:, :, UNIT_STATE], np.maximum(cursor, 0), axis=1)
    is_own = (worlds.roster == cursor[:, :, None]) & lists
    yield (
        "a cursor is on a unit of its player that is no builder inside a site",
        ((cursor == NO_UNIT) | (is_own.any(axis=2) & (state != INSIDE))).all(axis=1),
    )


def _list_places(worlds: World, rules: Rules) -> Iterator[Condition]:
    units = worlds.units
    kind, centre = units[:, :, UNIT_KIND], units[:, :, UNIT_CELL]
    stands = (kind != NO_KIND) & (units[:, :, UNIT_STATE] != INSIDE)
    half = rules.kinds[kind, KIND_HALF_SIZE]
    row, column = np.moveaxis(rules.cells[centre], -1, 0)
    is_inside = (row >= half) & (row < rules.rows - half)
    is_inside &= (column >= half) & (column < rules.columns - half)
    yield "all units stand on the board", (is_inside | (kind == NO_KIND)).all(axis=1)
    placed = _list_covered(stands, half, centre, rules)
    occupant = worlds.board[:, OCCUPANT]
    wrong = occupant[placed.world, placed.cell] != placed.unit
    holds = np.bincount(placed.world[wrong], minlength=len(units)) == 0
    num_covered = np.bincount(placed.world, minlength=len(units))
    holds &= (occupant != NO_UNIT).sum(axis=1) == num_covered
    yield "each cell is held by the unit that covers it, and no other", holds
    tile = np.take_along_axis(worlds.board[:, TILE], centre.astype(np.intp), axis=1)
    burns = stands & (rules.tiles[tile, TILE_DAMAGE] > 0)
    yield (
        "NUM_BURNING counts the units on lava",
        worlds.clock[:, NUM_BURNING] == burns.sum(axis=1),
    )


def _list_covered(
    stands: Holds, half: NDArray[np.int32], centre: NDArray[np.int32], rules: Rules
) -> Placed:
    """The cells of all units that stand on the board; half, centre: int [N, U]."""
    found = []
    for size in np.unique(half[stands]).tolist():
        world, unit = np.nonzero(stands & (half == size))
        steps = np.arange(-size, size + 1)
        offset = (steps[:, None] * rules.stride + steps).ravel()
        cell = centre[world, unit][:, None] + offset
        found.append((np.repeat(world, len(offset)), np.repeat(unit, len(offset)), cell.ravel()))
    joined = [np.concatenate(parts) for parts in zip(*found, strict=True)] if found else []
    return Placed(*joined) if joined else Placed(*[np.zeros(0, np.intp)] * 3)


def _list_work(worlds: World, rules: Rules) -> Iterator[Condition]:
    units = worlds.units
    kind, state = units[:, :, UNIT_KIND], units[:, :, UNIT_STATE]
    is_building, is_free = kind >= NUM_MOBILE_KINDS, kind == NO_KIND
    of_buildings = np.isin(state, (IDLE, RISING, TRAINING, PUMPING))
    of_mobile = ~np.isin(state, (RISING, TRAINING, PUMPING))
    yield (
        "units walk and fight, and buildings rise, train and pump",
        (np.where(is_building, of_buildings, of_mobile) | is_free).all(axis=1),
    )
    is_inside = state == INSIDE
    yield "nobody inside a site acts", ((worlds.due == NEVER) | ~is_inside).all(axis=1)
    needs_target = (state == REPAIRING) | (units[:, :, UNIT_ORDER] == REPAIR)
    needs_target |= state == FIGHTING
    has_target = units[:, :, UNIT_TARGET] != NO_UNIT
    yield "who fights or repairs has a target", (has_target | ~needs_target).all(axis=1)
    queue = units[:, :, UNIT_QUEUE : UNIT_QUEUE + QUEUE_LENGTH]
    length = units[:, :, UNIT_QUEUE_LENGTH]
    is_queued = np.arange(QUEUE_LENGTH) < length[:, :, None]
    can_make = rules.can_make[kind[:, :, None], queue]
    holds = (can_make | ~is_queued).all(axis=(1, 2))
    holds &= ((length == 0) | (is_building & (state != RISING))).all(axis=1)
    holds &= ((length > 0) | (state != TRAINING)).all(axis=1)
    yield "queues hold what their building makes, and who trains has one", holds
    yield (
        "every site has a builder of its player inside, and every builder its site",
        _have_partners(units, kind, state, rules.slots),
    )


def _have_partners(
    units: NDArray[np.int32], kind: NDArray[np.int32], state: NDArray[np.int32], slots: int
) -> Holds:
    """Whether sites and builders inside them name each other, in each world: bool [N]."""
    partner, unit = units[:, :, UNIT_PARTNER], np.arange(units.shape[1])
    is_site, is_builder = state == RISING, state == INSIDE
    at = np.maximum(partner, 0).astype(np.intp)
    back, its_state, its_cell = (
        np.take_along_axis(units[:, :, column], at, axis=1)
        for column in (UNIT_PARTNER, UNIT_STATE, UNIT_CELL)
    )
    fits = (back == unit) & (partner // slots == unit // slots)
    fits &= (its_cell == units[:, :, UNIT_CELL]) & (its_state == np.where(is_site, INSIDE, RISING))
    fits &= is_site | (kind == PEASANT)
    has_partner = is_site | is_builder
    holds: Holds = np.where(has_partner, fits & (partner != NO_UNIT), partner == NO_UNIT).all(
        axis=1
    )
    return holds


def _list_sight(worlds: World, rules: Rules) -> Iterator[Condition]:
    """Each player's count of own units that see a cell, summed up along the rows of their discs."""
    kind, centre = worlds.units[:, :, UNIT_KIND], worlds.units[:, :, UNIT_CELL]
    stands = (kind != NO_KIND) & (worlds.units[:, :, UNIT_STATE] != INSIDE)
    world, unit = np.nonzero(stands)
    its_kind = kind[world, unit]
    radius = np.minimum(
        15, rules.kinds[its_kind, KIND_SIGHT] + rules.kinds[its_kind, KIND_HALF_SIZE]
    )
    row, column = np.moveaxis(rules.cells[centre[world, unit]].astype(np.intp), -1, 0)
    shape = (*worlds.vision.shape[:2], rules.rows + 2, rules.stride)
    changes = np.zeros(shape, np.int32)
    for away in range(-int(radius.max(initial=0)), int(radius.max(initial=0)) + 1):
        span = rules.sight_span[radius, abs(away)]
        sees = (span >= 0) & (row + away >= 0) & (row + away < rules.rows)
        at = (world[sees], unit[sees] // rules.slots, row[sees] + away + 1)
        left = np.maximum(0, column - span)[sees] + 1
        right = np.minimum(rules.columns - 1, column + span)[sees] + 2
        np.add.at(changes, (*at, left), 1)
        np.add.at(changes, (*at, right), -1)
    expected = changes.cumsum(axis=3).reshape(worlds.vision.shape)
    yield "vision counts the units that see each cell", (worlds.vision == expected).all(axis=(1, 2))
