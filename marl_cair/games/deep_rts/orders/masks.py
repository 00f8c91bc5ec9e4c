"""Which actions are legal, exactly as `cursor_orders.py` and `grid.py` take them."""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.orders import classic, orders, sights
from marl_cair.games.deep_rts.orders.cursor import is_selectable, num_others
from marl_cair.games.deep_rts.orders.grid import list_grid_orders
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.board import is_building, known_tile, sees
from marl_cair.games.deep_rts.rules.building import can_cancel, can_produce
from marl_cair.games.deep_rts.rules.combat import is_soldier
from marl_cair.games.deep_rts.rules.paths import NOWHERE


@compiled
def may_go_to(world: Any, rules: Any, unit: int, place: int, occupant: int) -> bool:
    """True where a unit walks to such a place, or sends units there that it trains."""
    if is_building(world, unit):
        return bool(sights.CAN_RALLY[place])
    return sights.order_to(world, rules, unit, place, occupant) != s.NO_ORDER


@compiled
def list_ground(
    world: Any, rules: Any, player: int, frame: int, tiles: int, out: Any, first: int
) -> None:
    """What the ground of each cell of the own view allows. tiles: bits of the kinds that do; what
    is unknown always does.
    """
    if rules.fog == 0:
        for own in range(rules.rows * rules.columns):
            tile = int(world.board[s.TILE, rules.world_cell[frame, own]])
            out[first + own] = tiles >> tile & 1 != 0
        return
    for own in range(rules.rows * rules.columns):
        tile = known_tile(world, rules, player, int(rules.world_cell[frame, own]))
        out[first + own] = tile == s.UNKNOWN or tiles >> tile & 1 != 0


@compiled
def list_cells_of(
    world: Any, rules: Any, player: int, frame: int, unit: int, is_legal: bool, out: Any, first: int
) -> None:
    """What a unit allows in the cells that it covers, as far as the player sees them."""
    half = int(rules.kinds[world.units[unit, s.UNIT_KIND], rb.KIND_HALF_SIZE])
    for rows in range(-half, half + 1):
        for columns in range(-half, half + 1):
            cell = int(world.units[unit, s.UNIT_CELL] + rows * rules.stride + columns)
            if sees(world, rules, player, cell):
                out[first + rules.own_cell[frame, cell]] = is_legal


@compiled
def list_ways(world: Any, rules: Any, player: int, frame: int, unit: int, out: Any) -> None:
    """Go to and advance to, for each cell: first the ground, then those who stand on it.

    They are few, so that nothing is asked twice of the many free cells.
    """
    if is_building(world, unit) and not orders.can_rally(world, rules, unit):
        return
    fights = is_soldier(world.units[unit, s.UNIT_KIND])
    first_advance = orders.FIRST_CELL + int(rules.rows * rules.columns)
    go, advance = 0, 0
    for tile in range(t.NUM_TILE_KINDS):
        place = sights.place_of_tile(rules, tile)
        go |= int(may_go_to(world, rules, unit, place, s.NO_UNIT)) << tile
        advance |= int(sights.CAN_ADVANCE[place]) << tile
    list_ground(world, rules, player, frame, go, out, orders.FIRST_CELL)
    if fights:
        list_ground(world, rules, player, frame, advance, out, first_advance)
    for owner in range(rules.num_players):
        for index in range(world.players[owner, s.NUM_UNITS]):
            other = int(world.roster[owner, index])
            if not is_selectable(world, other):
                continue
            place = sights.place_of_unit(world, rules, player, other)
            is_legal = may_go_to(world, rules, unit, place, other)
            list_cells_of(world, rules, player, frame, other, is_legal, out, orders.FIRST_CELL)
            if fights:
                is_legal = bool(sights.CAN_ADVANCE[place])
                list_cells_of(world, rules, player, frame, other, is_legal, out, first_advance)


@compiled
def list_cell_orders(world: Any, rules: Any, player: int, out: Any) -> None:
    """Go to, advance to, select: for each cell of the own view."""
    frame = int(rules.seats[world.clock[s.MAP_INDEX], player, rb.SEAT_FRAME])
    unit = int(world.players[player, s.CURSOR])
    if unit != s.NO_UNIT:
        list_ways(world, rules, player, frame, unit, out)
    first_selection = orders.FIRST_CELL + 2 * int(rules.rows * rules.columns)
    for place in range(world.players[player, s.NUM_UNITS]):
        other = int(world.roster[player, place])
        if other != unit and is_selectable(world, other):
            list_cells_of(world, rules, player, frame, other, True, out, first_selection)


@compiled
def list_unit_actions(world: Any, rules: Any, player: int, out: Any) -> None:
    """The actions of the `unit` space: out bool [A]."""
    out[orders.NOOP] = True
    if not world.players[player, s.IS_ALIVE]:
        return
    unit = int(world.players[player, s.CURSOR])
    out[orders.NEXT_UNIT] = num_others(world, player) > 0
    if unit != s.NO_UNIT:
        out[orders.STOP] = orders.may_stop(world, unit)
        out[orders.CANCEL] = can_cancel(world, unit)
        for slot in range(t.MAX_PRODUCTS):
            product = int(rules.products[world.units[unit, s.UNIT_KIND], slot])
            if can_produce(world, rules, player, unit, product):
                out[orders.FIRST_PRODUCT + product] = True
    list_cell_orders(world, rules, player, out)


@compiled
def list_classic_actions(world: Any, rules: Any, player: int, out: Any) -> None:
    """The original's 16 actions: out bool [16]."""
    out[classic.CLASSIC_NOOP] = True
    if not world.players[player, s.IS_ALIVE]:
        return
    has_others = num_others(world, player) > 0
    out[classic.CLASSIC_PREVIOUS] = has_others
    out[classic.CLASSIC_NEXT] = has_others
    unit = int(world.players[player, s.CURSOR])
    if unit == s.NO_UNIT:
        return
    for slot in range(classic.NUM_CLASSIC_BUILDS):
        product = int(rules.products[world.units[unit, s.UNIT_KIND], slot])
        out[classic.CLASSIC_BUILD + slot] = can_produce(world, rules, player, unit, product)
    if is_building(world, unit):
        return
    for index in range(classic.CLASSIC_ATTACK - classic.CLASSIC_MOVE):
        cell = classic.classic_cell(world, rules, player, classic.CLASSIC_DIRECTIONS[index])
        out[classic.CLASSIC_MOVE + index] = classic.may_step(world, rules, player, cell)
    out[classic.CLASSIC_ATTACK] = classic.classic_victim(world, rules, player) != s.NO_UNIT
    out[classic.CLASSIC_HARVEST] = classic.classic_tile(world, rules, player) != NOWHERE


@compiled
def legal_actions(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write the legal actions of every seat: out bool [B, P, A], of `grid` [B, P, H, W, A]."""
    for index in range(first, last):
        world = s.world_at(worlds, index)
        for player in range(rules.num_players):
            out[index, player, :] = False
            if out.ndim != 3:  # known when compiling
                list_grid_orders(world, rules, player, out[index, player])
            elif rules.action_space == rb.CLASSIC_ACTIONS:
                list_classic_actions(world, rules, player, out[index, player])
            else:
                list_unit_actions(world, rules, player, out[index, player])
