"""Which actions are legal, exactly as `orders.obey_all` takes them."""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts.orders.classic import (
    CLASSIC_ATTACK,
    CLASSIC_BUILD,
    CLASSIC_DIRECTIONS,
    CLASSIC_HARVEST,
    CLASSIC_MOVE,
    CLASSIC_NEXT,
    CLASSIC_NOOP,
    CLASSIC_PREVIOUS,
    NUM_CLASSIC_BUILDS,
    classic_cell,
    classic_tile,
    classic_victim,
    may_step,
)
from marl_cair.games.deep_rts.orders.cursor import is_selectable, num_others
from marl_cair.games.deep_rts.orders.grid import list_grid_orders
from marl_cair.games.deep_rts.orders.orders import (
    CANCEL,
    FIRST_CELL,
    FIRST_PRODUCT,
    NEXT_UNIT,
    NOOP,
    STOP,
    can_rally,
    may_stop,
)
from marl_cair.games.deep_rts.orders.sights import (
    CAN_ADVANCE,
    CAN_RALLY,
    order_to,
    place_of_tile,
    place_of_unit,
)
from marl_cair.games.deep_rts.rules.board import is_building, known_tile, sees
from marl_cair.games.deep_rts.rules.building import can_cancel, can_produce
from marl_cair.games.deep_rts.rules.combat import is_soldier
from marl_cair.games.deep_rts.rules.paths import NOWHERE
from marl_cair.games.deep_rts.rules.rulebook import CLASSIC_ACTIONS, KIND_HALF_SIZE, SEAT_FRAME
from marl_cair.games.deep_rts.state import (
    CURSOR,
    IS_ALIVE,
    MAP_INDEX,
    NO_ORDER,
    NO_UNIT,
    NUM_UNITS,
    TILE,
    UNIT_CELL,
    UNIT_KIND,
    UNKNOWN,
    world_at,
)
from marl_cair.games.deep_rts.tables import MAX_PRODUCTS, NUM_TILE_KINDS


@compiled
def may_go_to(world: Any, rules: Any, unit: int, place: int, occupant: int) -> bool:
    """True where a unit walks to such a place, or sends there whom it trains."""
    if is_building(world, unit):
        return bool(CAN_RALLY[place])
    return order_to(world, rules, unit, place, occupant) != NO_ORDER


@compiled
def list_ground(
    world: Any, rules: Any, player: int, frame: int, tiles: int, out: Any, first: int
) -> None:
    """What the ground of each cell of the own view allows. tiles: bits of the kinds that do; what
    is unknown always does.
    """
    if rules.fog == 0:
        for own in range(rules.rows * rules.columns):
            tile = int(world.board[TILE, rules.world_cell[frame, own]])
            out[first + own] = tiles >> tile & 1 != 0
        return
    for own in range(rules.rows * rules.columns):
        tile = known_tile(world, rules, player, int(rules.world_cell[frame, own]))
        out[first + own] = tile == UNKNOWN or tiles >> tile & 1 != 0


@compiled
def list_cells_of(
    world: Any, rules: Any, player: int, frame: int, unit: int, is_legal: bool, out: Any, first: int
) -> None:
    """What a unit allows in the cells that it covers, as far as the player sees them."""
    half = int(rules.kinds[world.units[unit, UNIT_KIND], KIND_HALF_SIZE])
    for rows in range(-half, half + 1):
        for columns in range(-half, half + 1):
            cell = int(world.units[unit, UNIT_CELL] + rows * rules.stride + columns)
            if sees(world, rules, player, cell):
                out[first + rules.own_cell[frame, cell]] = is_legal


@compiled
def list_ways(world: Any, rules: Any, player: int, frame: int, unit: int, out: Any) -> None:
    """Go to and advance to, for each cell: first the ground, then those who stand on it.

    They are few, so that nothing is asked twice of the many free cells.
    """
    if is_building(world, unit) and not can_rally(world, rules, unit):
        return
    fights = is_soldier(world.units[unit, UNIT_KIND])
    first_advance = FIRST_CELL + int(rules.rows * rules.columns)
    go, advance = 0, 0
    for tile in range(NUM_TILE_KINDS):
        place = place_of_tile(rules, tile)
        go |= int(may_go_to(world, rules, unit, place, NO_UNIT)) << tile
        advance |= int(CAN_ADVANCE[place]) << tile
    list_ground(world, rules, player, frame, go, out, FIRST_CELL)
    if fights:
        list_ground(world, rules, player, frame, advance, out, first_advance)
    for owner in range(rules.num_players):
        for index in range(world.players[owner, NUM_UNITS]):
            other = int(world.roster[owner, index])
            if not is_selectable(world, other):
                continue
            place = place_of_unit(world, rules, player, other)
            is_legal = may_go_to(world, rules, unit, place, other)
            list_cells_of(world, rules, player, frame, other, is_legal, out, FIRST_CELL)
            if fights:
                is_legal = bool(CAN_ADVANCE[place])
                list_cells_of(world, rules, player, frame, other, is_legal, out, first_advance)


@compiled
def list_cell_orders(world: Any, rules: Any, player: int, out: Any) -> None:
    """Go to, advance to, select: for each cell of the own view."""
    frame = int(rules.seats[world.clock[MAP_INDEX], player, SEAT_FRAME])
    unit = int(world.players[player, CURSOR])
    if unit != NO_UNIT:
        list_ways(world, rules, player, frame, unit, out)
    first_selection = FIRST_CELL + 2 * int(rules.rows * rules.columns)
    for place in range(world.players[player, NUM_UNITS]):
        other = int(world.roster[player, place])
        if other != unit and is_selectable(world, other):
            list_cells_of(world, rules, player, frame, other, True, out, first_selection)


@compiled
def list_unit_actions(world: Any, rules: Any, player: int, out: Any) -> None:
    """The actions of the `unit` space: out bool [A]."""
    out[NOOP] = True
    if not world.players[player, IS_ALIVE]:
        return
    unit = int(world.players[player, CURSOR])
    out[NEXT_UNIT] = num_others(world, player) > 0
    if unit != NO_UNIT:
        out[STOP] = may_stop(world, unit)
        out[CANCEL] = can_cancel(world, unit)
        for slot in range(MAX_PRODUCTS):
            product = int(rules.products[world.units[unit, UNIT_KIND], slot])
            if can_produce(world, rules, player, unit, product):
                out[FIRST_PRODUCT + product] = True
    list_cell_orders(world, rules, player, out)


@compiled
def list_classic_actions(world: Any, rules: Any, player: int, out: Any) -> None:
    """The original's 16 actions: out bool [16]."""
    out[CLASSIC_NOOP] = True
    if not world.players[player, IS_ALIVE]:
        return
    has_others = num_others(world, player) > 0
    out[CLASSIC_PREVIOUS] = has_others
    out[CLASSIC_NEXT] = has_others
    unit = int(world.players[player, CURSOR])
    if unit == NO_UNIT:
        return
    for slot in range(NUM_CLASSIC_BUILDS):
        product = int(rules.products[world.units[unit, UNIT_KIND], slot])
        out[CLASSIC_BUILD + slot] = can_produce(world, rules, player, unit, product)
    if is_building(world, unit):
        return
    for index in range(CLASSIC_ATTACK - CLASSIC_MOVE):
        cell = classic_cell(world, rules, player, CLASSIC_DIRECTIONS[index])
        out[CLASSIC_MOVE + index] = may_step(world, rules, player, cell)
    out[CLASSIC_ATTACK] = classic_victim(world, rules, player) != NO_UNIT
    out[CLASSIC_HARVEST] = classic_tile(world, rules, player) != NOWHERE


@compiled
def legal_actions(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write the legal actions of every seat: out bool [B, P, A], of `grid` [B, P, H, W, A]."""
    for index in range(first, last):
        world = world_at(worlds, index)
        for player in range(rules.num_players):
            out[index, player, :] = False
            if out.ndim != 3:  # known when compiling
                list_grid_orders(world, rules, player, out[index, player])
            elif rules.action_space == CLASSIC_ACTIONS:
                list_classic_actions(world, rules, player, out[index, player])
            else:
                list_unit_actions(world, rules, player, out[index, player])
