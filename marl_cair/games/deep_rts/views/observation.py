"""Writes the planes that each player of Deep RTS observes, turned or mirrored to its own side.

Under fog they hold only what is in sight, and remembered ground. Hidden from an agent are others'
stores, orders, queues and selections, and the random word.

Only changes since the last observation are written: units that look different, ground and stores,
cells that came into sight. A memory holds what the planes show; a blank memory makes all planes
again. So the planes are a function of the state alone.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.board import owner_of, remembered_tile, sees
from marl_cair.games.deep_rts.rules.roster import food_limit
from marl_cair.games.deep_rts.scenarios import Scenario
from marl_cair.games.deep_rts.views import appearance, planes
from marl_cair.games.loops import make_world_at

IS_DRAWN, DRAWN_MAP, NUM_SHOWN = range(3)  # columns of `page`
WIPE, DRAW, NEW_PROGRESS = range(3)  # what changes of a unit
NEVER_SHOWN = -1  # below every number of a store


class Shown(NamedTuple):
    """The contents of the planes of B worlds, or of one world (the same without B).

    P players, U unit slots, N cells with the border.
    """

    page: NDArray[np.int32]  # [B, 3] see above; the rest holds only where IS_DRAWN is 1
    ground: NDArray[np.int16]  # [B, 2, N] TILE and AMOUNT
    units: NDArray[np.int64]  # [B, U] words of `appearance`
    looks: NDArray[np.int64]  # [B, U] scratch: the words of now, of units that are shown
    slots: NDArray[np.int16]  # [B, U] the first NUM_SHOWN: units that are shown
    numbers: NDArray[np.int32]  # [B, P, NUM_UNIFORM] what the uniform planes show
    sight: NDArray[np.uint8]  # [B, P, N] 1: the cell is shown as visible (under fog only)
    tiles: NDArray[np.uint8]  # [B, P, N] tile shown, or UNKNOWN (under fog only)


def make_memory(scenario: Scenario, num_worlds: int) -> Shown:
    """The memory of planes that nothing has been written to."""
    players, cells = scenario.num_players, scenario.num_cells
    units = players * scenario.slots_per_player
    seen_cells = cells if scenario.fog else 1
    return Shown(
        page=np.zeros((num_worlds, 3), np.int32),
        ground=np.empty((num_worlds, 2, cells), np.int16),
        units=np.empty((num_worlds, units), np.int64),
        looks=np.empty((num_worlds, units), np.int64),
        slots=np.empty((num_worlds, units), np.int16),
        numbers=np.empty((num_worlds, players, planes.NUM_UNIFORM), np.int32),
        sight=np.empty((num_worlds, players, seen_cells), np.uint8),
        tiles=np.empty((num_worlds, players, seen_cells), np.uint8),
    )


shown_at = make_world_at(Shown)  # the memory of one world: views of its rows


@compiled
def log_level(amount: int) -> int:
    """A store of 0..10**6 on a scale that separates small amounts, 0..239."""
    return int(planes.LOG_STEP * np.log2(1.0 + amount) + 0.5)


@compiled
def blank(world: Any, rules: Any, shown: Any, out: Any) -> None:
    """Make the board and its memory empty."""
    for player in range(rules.num_players):
        out[player, : planes.FIRST_UNIFORM] = 0
        if rules.fog == 0:
            out[player, planes.VISIBLE : planes.FIRST_UNIFORM] = planes.FULL
    shown.page[IS_DRAWN] = 1
    shown.page[DRAWN_MAP] = world.clock[s.MAP_INDEX]
    shown.page[NUM_SHOWN] = 0
    shown.ground[s.TILE] = t.GRASS
    shown.ground[s.AMOUNT] = 0
    shown.units[:] = appearance.NOT_SHOWN
    shown.numbers[:] = NEVER_SHOWN
    shown.sight[:] = 0
    shown.tiles[:] = s.UNKNOWN


@compiled_copy
def frame_of(world: Any, rules: Any, player: int) -> int:
    """The frame of the player's view."""
    return int(rules.seats[world.clock[s.MAP_INDEX], player, rb.SEAT_FRAME])


@compiled
def mark_unit(
    world: Any, rules: Any, shown: Any, unit: int, word: int, change: int, out: Any
) -> None:
    """WIPE or DRAW a unit for all seats that see it, or write its NEW_PROGRESS alone."""
    owner = owner_of(rules, unit)
    centre = int(word >> appearance.CELL_BIT & appearance.CELL_MASK)
    kind = word >> appearance.KIND_BIT & appearance.KIND_MASK
    half = int(rules.kinds[kind, rb.KIND_HALF_SIZE])
    for player in range(rules.num_players):
        frame, side = frame_of(world, rules, player), appearance.side_of(rules, player, owner)
        for rows in range(-half, half + 1):
            for cell in range(
                centre + rows * rules.stride - half, centre + rows * rules.stride + half + 1
            ):
                if rules.fog == 0 or shown.sight[player, cell] != 0:
                    row, column = rules.own_place[frame, cell, 0], rules.own_place[frame, cell, 1]
                    if change == NEW_PROGRESS:
                        appearance.mark_progress(word, side, int(row), int(column), 1, out[player])
                    else:
                        appearance.mark(word, side, int(row), int(column), change, out[player])


@compiled
def wipe_changed_units(world: Any, rules: Any, shown: Any, out: Any) -> None:
    """Wipe units that look different now, before other units are drawn on their cells."""
    for place in range(shown.page[NUM_SHOWN]):
        unit = int(shown.slots[place])
        was = shown.units[unit]
        look = appearance.NOT_SHOWN
        if world.units[unit, s.UNIT_KIND] != t.NO_KIND:
            look = appearance.pack_appearance(world, rules, unit)
        shown.looks[unit] = look
        if look == was:
            continue
        is_alike = (look ^ was) & appearance.ALL_BUT_PROGRESS == 0
        if look != appearance.NOT_SHOWN and is_alike:
            mark_unit(world, rules, shown, unit, look, NEW_PROGRESS, out)
            shown.units[unit] = look
            continue
        mark_unit(world, rules, shown, unit, was, WIPE, out)
        if look == appearance.NOT_SHOWN:
            shown.units[unit] = appearance.NOT_SHOWN


@compiled
def draw_changed_units(world: Any, rules: Any, shown: Any, out: Any) -> None:
    """Draw units that are new or look different, and list all that are shown."""
    count = 0
    for owner in range(rules.num_players):
        for place in range(world.players[owner, s.NUM_UNITS]):
            unit = int(world.roster[owner, place])
            was = shown.units[unit]
            look = shown.looks[unit]
            if was == appearance.NOT_SHOWN:
                look = appearance.pack_appearance(world, rules, unit)
                if look == appearance.NOT_SHOWN:
                    continue
            if look != was:
                mark_unit(world, rules, shown, unit, look, DRAW, out)
                shown.units[unit] = look
            shown.slots[count] = unit
            count += 1
    shown.page[NUM_SHOWN] = count


@compiled
def has_new_ground(world: Any, shown: Any, first: int, last: int) -> bool:
    """True where a tile or its amount differs from what is shown, in the cells first..last - 1."""
    difference = np.int16(0)
    for cell in range(first, last):
        difference |= world.board[s.TILE, cell] ^ shown.ground[s.TILE, cell]
        difference |= world.board[s.AMOUNT, cell] ^ shown.ground[s.AMOUNT, cell]
    return bool(difference != 0)


@compiled
def mark_tile(tile: int, row: int, column: int, level: int, out: Any) -> None:
    """Write the plane of a tile; there is none for grass and what is unknown."""
    if not (tile == t.GRASS or tile == s.UNKNOWN):  # noqa: PLR1714  # faster
        out[planes.FIRST_TILE + tile - 1, row, column] = level


@compiled
def level_left(world: Any, rules: Any, tile: int, cell: int) -> int:
    """Remaining amount of a resource in sight, 0..255."""
    if tile == s.UNKNOWN or rules.tiles[tile, rb.TILE_AMOUNT] == 0:
        return 0
    left = max(0, int(world.board[s.AMOUNT, cell]))
    return int(min(planes.FULL, planes.FULL * left // int(rules.tiles[tile, rb.TILE_AMOUNT])))


@compiled
def renew_ground(world: Any, rules: Any, shown: Any, out: Any) -> None:
    """Tiles and amounts that changed, where everything is in sight."""
    for row in range(rules.rows):
        first = (row + 1) * rules.stride + 1
        if not has_new_ground(world, shown, first, first + rules.columns):
            continue
        for cell in range(first, first + rules.columns):
            tile, was = int(world.board[s.TILE, cell]), int(shown.ground[s.TILE, cell])
            if tile == was and world.board[s.AMOUNT, cell] == shown.ground[s.AMOUNT, cell]:
                continue
            level = level_left(world, rules, tile, cell)
            for player in range(rules.num_players):
                frame = frame_of(world, rules, player)
                own_row = int(rules.own_place[frame, cell, 0])
                own_column = int(rules.own_place[frame, cell, 1])
                mark_tile(was, own_row, own_column, 0, out[player])
                mark_tile(tile, own_row, own_column, planes.FULL, out[player])
                out[player, planes.RESOURCE_LEFT, own_row, own_column] = level


@compiled
def renew_foggy_ground(world: Any, rules: Any, shown: Any, player: int, out: Any) -> None:
    """Update ground that a seat sees or remembers, and units that came into sight or left it.

    Units that look different have been wiped and will be drawn; they are left alone here.
    """
    frame = frame_of(world, rules, player)
    for own in range(rules.rows * rules.columns):
        cell = int(rules.world_cell[frame, own])
        is_seen = int(sees(world, rules, player, cell))
        tile = int(world.board[s.TILE, cell])
        if is_seen == 0:
            tile = remembered_tile(world, rules, player, cell)
        was_seen, was = int(shown.sight[player, cell]), int(shown.tiles[player, cell])
        is_new_amount = world.board[s.AMOUNT, cell] != shown.ground[s.AMOUNT, cell]
        if is_seen == was_seen and tile == was and not is_new_amount:
            continue
        row, column = own // rules.columns, own % rules.columns
        mark_tile(was, row, column, 0, out)
        mark_tile(tile, row, column, planes.FULL, out)
        level = level_left(world, rules, tile, cell) if is_seen else 0
        out[planes.RESOURCE_LEFT, row, column] = level
        out[planes.VISIBLE, row, column] = planes.FULL * is_seen
        out[planes.EXPLORED, row, column] = planes.FULL * int(tile != s.UNKNOWN)
        shown.sight[player, cell] = is_seen
        shown.tiles[player, cell] = tile
        unit = int(world.board[s.OCCUPANT, cell])
        if is_seen != was_seen and unit != s.NO_UNIT:
            word = shown.units[unit]
            if word != appearance.NOT_SHOWN and word == shown.looks[unit]:
                side = appearance.side_of(rules, player, owner_of(rules, unit))
                appearance.mark(word, side, row, column, is_seen, out)


@compiled
def renew_number(shown: Any, player: int, plane: int, number: int, level: int, out: Any) -> None:
    """Fill a uniform plane of a seat with a level where its number has changed."""
    index = plane - planes.FIRST_UNIFORM
    if shown.numbers[player, index] != number:
        shown.numbers[player, index] = number
        out[plane] = min(planes.FULL, level)


@compiled
def renew_numbers(world: Any, rules: Any, shown: Any, player: int, out: Any) -> None:
    """The planes that hold one number over the whole board."""
    for resource in range(t.NUM_RESOURCES):
        store = int(world.players[player, s.RESOURCES + resource])
        if shown.numbers[player, resource] != store:  # a logarithm takes time
            plane = planes.FIRST_UNIFORM + resource
            renew_number(shown, player, plane, store, log_level(store), out)
    food = int(world.players[player, s.FOOD_USED])
    renew_number(shown, player, planes.OWN_FOOD, food, planes.FOOD_STEP * food, out)
    limit = food_limit(world, rules, player)
    renew_number(shown, player, planes.FOOD_LIMIT, limit, planes.FOOD_STEP * limit, out)
    for upgrade in range(t.NUM_UPGRADES):
        level = int(world.players[player, s.UPGRADES + upgrade])
        plane = planes.FIRST_UPGRADE_PLANE + upgrade
        renew_number(shown, player, plane, level, planes.UPGRADE_STEP * level, out)
    left = planes.FULL * (int(rules.max_ticks) - int(world.clock[s.TICK])) // int(rules.max_ticks)
    renew_number(shown, player, planes.TIME_LEFT, left, left, out)


@compiled
def renew_planes(world: Any, rules: Any, shown: Any, out: Any) -> None:
    """All planes of one world: out uint8 [P, C, H, W] holds what `shown` says, and then what is."""
    if shown.page[IS_DRAWN] == 0 or shown.page[DRAWN_MAP] != world.clock[s.MAP_INDEX]:
        blank(world, rules, shown, out)
    wipe_changed_units(world, rules, shown, out)
    cells = rules.rows * rules.stride + rules.stride
    if rules.fog != 0:
        for player in range(rules.num_players):
            renew_foggy_ground(world, rules, shown, player, out[player])
    if has_new_ground(world, shown, int(rules.stride), cells):
        if rules.fog == 0:
            renew_ground(world, rules, shown, out)
        for cell in range(rules.stride, cells):
            shown.ground[s.TILE, cell] = world.board[s.TILE, cell]
            shown.ground[s.AMOUNT, cell] = world.board[s.AMOUNT, cell]
    draw_changed_units(world, rules, shown, out)
    for player in range(rules.num_players):
        renew_numbers(world, rules, shown, player, out[player])


@compiled
def observe_planes(worlds: Any, rules: Any, shown: Any, out: Any, first: int, last: int) -> None:
    """Update every seat's planes: out uint8 [B, P, C, H, W], whose contents `shown` describes."""
    for index in range(first, last):
        renew_planes(s.world_at(worlds, index), rules, shown_at(shown, index), out[index])
