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
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import rulebook as rb

Holds = NDArray[np.bool_]

_EMPTY = {s.UNIT_KIND: t.NO_KIND, s.UNIT_TARGET: s.NO_UNIT, s.UNIT_CARRY_KIND: t.NO_RESOURCE}
_EMPTY |= {s.UNIT_PARTNER: s.NO_UNIT, s.UNIT_HURT_BY: s.NO_UNIT}  # all other columns hold 0


class Placed(NamedTuple):
    """The cells that units cover, M of all worlds together."""

    world: NDArray[np.intp]
    unit: NDArray[np.intp]  # slot
    cell: NDArray[np.intp]


def list_conditions(worlds: s.World, rules: rb.Rules) -> Iterator[Condition]:
    """What must hold; worlds: arrays [N, ...] whose values are in their ranges."""
    yield has_time(worlds.clock[:, s.TICK], worlds.clock[:, s.PHASE] == s.RUNNING, rules.max_ticks)
    yield from _list_ground(worlds, rules)
    yield from _list_units(worlds, rules)
    yield from _list_rosters(worlds, rules)
    yield from _list_places(worlds, rules)
    yield from _list_work(worlds, rules)
    if rules.fog != 0:
        yield from _list_sight(worlds, rules)


def _list_ground(worlds: s.World, rules: rb.Rules) -> Iterator[Condition]:
    tiles, drawn = worlds.board[:, s.TILE], rules.map_tiles[worlds.clock[:, s.MAP_INDEX]]
    is_resource = rules.tiles[:, rb.TILE_RESOURCE] != t.NO_RESOURCE
    used_up = np.where(is_resource[drawn], t.GRASS, drawn)
    yield (
        "the tiles are those of its map, or grass where a resource was",
        ((tiles == drawn) | (tiles == used_up)).all(axis=1),
    )
    most = rules.tiles[tiles, rb.TILE_AMOUNT]
    yield "no tile holds more than a fresh one", (worlds.board[:, s.AMOUNT] <= most).all(axis=1)
    if rules.fog != 0:
        seen = worlds.known
        is_known = (seen == drawn[:, None]) | (seen == used_up[:, None]) | (seen == s.UNKNOWN)
        yield "players remember tiles of its map", is_known.all(axis=(1, 2))


def _list_units(worlds: s.World, rules: rb.Rules) -> Iterator[Condition]:
    units, tick = worlds.units, worlds.clock[:, s.TICK]
    kind = units[:, :, s.UNIT_KIND]
    is_free = kind == t.NO_KIND
    empty = np.zeros(units.shape[2], units.dtype)
    empty[list(_EMPTY)] = list(_EMPTY.values())
    yield "free unit slots are empty", ((units == empty).all(axis=2) | ~is_free).all(axis=1)
    health, most = units[:, :, s.UNIT_HEALTH], rules.kinds[kind, rb.KIND_HEALTH]
    yield (
        "every unit has from 1 hit point to those of its kind",
        (((health >= 1) & (health <= most)) | is_free).all(axis=1),
    )
    serial = units[:, :, s.UNIT_SERIAL]
    yield "every unit has a serial number", ((serial >= 1) | is_free).all(axis=1)
    target, its_serial = units[:, :, s.UNIT_TARGET], units[:, :, s.UNIT_TARGET_SERIAL]
    yield (
        "a target is named with its serial number",
        ((target == s.NO_UNIT) | (its_serial >= 1)).all(axis=1),
    )
    since = units[:, :, s.UNIT_SINCE]
    yield "no unit does something from later than now", (since <= tick[:, None]).all(axis=1)
    carried = units[:, :, s.UNIT_CARRY_KIND]
    yield (
        "units carry a resource, or nothing",
        ((units[:, :, s.UNIT_CARRY] == 0) | (carried != t.NO_RESOURCE)).all(axis=1),
    )


def _list_rosters(worlds: s.World, rules: rb.Rules) -> Iterator[Condition]:
    num_worlds, players, slots = worlds.roster.shape
    kind = worlds.units[:, :, s.UNIT_KIND].reshape(num_worlds, players, slots)
    num_units, cursor = worlds.players[:, :, s.NUM_UNITS], worlds.players[:, :, s.CURSOR]
    lists = np.arange(slots) < num_units[:, :, None]
    expected = np.where(
        kind != t.NO_KIND, np.arange(players * slots).reshape(players, slots), s.NO_UNIT
    )
    listed = np.where(lists, worlds.roster, s.NO_UNIT)
    holds = (np.sort(listed, axis=2) == np.sort(expected, axis=2)).all(axis=(1, 2))
    holds &= (num_units == (kind != t.NO_KIND).sum(axis=2)).all(axis=1)
    yield "each roster lists the units of its player, each once", holds
    owned = (kind[..., None] == np.arange(t.NUM_KINDS)).sum(axis=2)
    counted = worlds.players[:, :, s.NUM_OWNED : s.NUM_OWNED + t.NUM_KINDS]
    yield "NUM_OWNED counts the units of each kind", (counted == owned).all(axis=(1, 2))
    state = np.take_along_axis(worlds.units[:, :, s.UNIT_STATE], np.maximum(cursor, 0), axis=1)
    is_own = (worlds.roster == cursor[:, :, None]) & lists
    yield (
        "a cursor is on a unit of its player that is no builder inside a site",
        ((cursor == s.NO_UNIT) | (is_own.any(axis=2) & (state != s.INSIDE))).all(axis=1),
    )


def _list_places(worlds: s.World, rules: rb.Rules) -> Iterator[Condition]:
    units = worlds.units
    kind, centre = units[:, :, s.UNIT_KIND], units[:, :, s.UNIT_CELL]
    stands = (kind != t.NO_KIND) & (units[:, :, s.UNIT_STATE] != s.INSIDE)
    half = rules.kinds[kind, rb.KIND_HALF_SIZE]
    row, column = np.moveaxis(rules.cells[centre], -1, 0)
    is_inside = (row >= half) & (row < rules.rows - half)
    is_inside &= (column >= half) & (column < rules.columns - half)
    yield "all units stand on the board", (is_inside | (kind == t.NO_KIND)).all(axis=1)
    placed = _list_covered(stands, half, centre, rules)
    occupant = worlds.board[:, s.OCCUPANT]
    wrong = occupant[placed.world, placed.cell] != placed.unit
    holds = np.bincount(placed.world[wrong], minlength=len(units)) == 0
    num_covered = np.bincount(placed.world, minlength=len(units))
    holds &= (occupant != s.NO_UNIT).sum(axis=1) == num_covered
    yield "each cell is held by the unit that covers it, and no other", holds
    tile = np.take_along_axis(worlds.board[:, s.TILE], centre.astype(np.intp), axis=1)
    burns = stands & (rules.tiles[tile, rb.TILE_DAMAGE] > 0)
    yield (
        "NUM_BURNING counts the units on lava",
        worlds.clock[:, s.NUM_BURNING] == burns.sum(axis=1),
    )


def _list_covered(
    stands: Holds, half: NDArray[np.int32], centre: NDArray[np.int32], rules: rb.Rules
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


def _list_work(worlds: s.World, rules: rb.Rules) -> Iterator[Condition]:
    units = worlds.units
    kind, state = units[:, :, s.UNIT_KIND], units[:, :, s.UNIT_STATE]
    is_building, is_free = kind >= t.NUM_MOBILE_KINDS, kind == t.NO_KIND
    of_buildings = np.isin(state, (s.IDLE, s.RISING, s.TRAINING, s.PUMPING))
    of_mobile = ~np.isin(state, (s.RISING, s.TRAINING, s.PUMPING))
    yield (
        "units walk and fight, and buildings rise, train and pump",
        (np.where(is_building, of_buildings, of_mobile) | is_free).all(axis=1),
    )
    is_inside = state == s.INSIDE
    yield "no unit inside a site acts", ((worlds.due == s.NEVER) | ~is_inside).all(axis=1)
    needs_target = (state == s.REPAIRING) | (units[:, :, s.UNIT_ORDER] == s.REPAIR)
    needs_target |= state == s.FIGHTING
    has_target = units[:, :, s.UNIT_TARGET] != s.NO_UNIT
    yield "who fights or repairs has a target", (has_target | ~needs_target).all(axis=1)
    queue = units[:, :, s.UNIT_QUEUE : s.UNIT_QUEUE + s.QUEUE_LENGTH]
    length = units[:, :, s.UNIT_QUEUE_LENGTH]
    is_queued = np.arange(s.QUEUE_LENGTH) < length[:, :, None]
    can_make = rules.can_make[kind[:, :, None], queue]
    holds = (can_make | ~is_queued).all(axis=(1, 2))
    holds &= ((length == 0) | (is_building & (state != s.RISING))).all(axis=1)
    holds &= ((length > 0) | (state != s.TRAINING)).all(axis=1)
    yield "queues hold what their building makes, and who trains has one", holds
    yield (
        "every site has a builder of its player inside, and every builder its site",
        _have_partners(units, kind, state, rules.slots),
    )


def _have_partners(
    units: NDArray[np.int32], kind: NDArray[np.int32], state: NDArray[np.int32], slots: int
) -> Holds:
    """Whether sites and builders inside them name each other, in each world: bool [N]."""
    partner, unit = units[:, :, s.UNIT_PARTNER], np.arange(units.shape[1])
    is_site, is_builder = state == s.RISING, state == s.INSIDE
    at = np.maximum(partner, 0).astype(np.intp)
    back, its_state, its_cell = (
        np.take_along_axis(units[:, :, column], at, axis=1)
        for column in (s.UNIT_PARTNER, s.UNIT_STATE, s.UNIT_CELL)
    )
    fits = (back == unit) & (partner // slots == unit // slots)
    fits &= (its_cell == units[:, :, s.UNIT_CELL]) & (
        its_state == np.where(is_site, s.INSIDE, s.RISING)
    )
    fits &= is_site | (kind == t.PEASANT)
    has_partner = is_site | is_builder
    holds: Holds = np.where(has_partner, fits & (partner != s.NO_UNIT), partner == s.NO_UNIT).all(
        axis=1
    )
    return holds


def _list_sight(worlds: s.World, rules: rb.Rules) -> Iterator[Condition]:
    """Each player's count of own units that see a cell, summed up along the rows of their discs."""
    kind, centre = worlds.units[:, :, s.UNIT_KIND], worlds.units[:, :, s.UNIT_CELL]
    stands = (kind != t.NO_KIND) & (worlds.units[:, :, s.UNIT_STATE] != s.INSIDE)
    world, unit = np.nonzero(stands)
    its_kind = kind[world, unit]
    radius = np.minimum(
        15, rules.kinds[its_kind, rb.KIND_SIGHT] + rules.kinds[its_kind, rb.KIND_HALF_SIZE]
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
