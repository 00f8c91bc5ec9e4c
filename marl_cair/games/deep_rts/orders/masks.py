"""Legal actions, exactly as `cursor.py` and `grid.py` carry them out."""

from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.orders import cursor, orders
from marl_cair.games.deep_rts.orders.grid import list_grid_orders
from marl_cair.games.deep_rts.rules import board
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.combat import is_soldier
from marl_cair.games.deep_rts.rules.paths import NOWHERE
from marl_cair.games.deep_rts.rules.work import can_cancel, can_produce


@compiled
def may_go_to(world: Any, rules: Any, unit: int, place: int, occupant: int) -> bool:
    """True where a unit may go to such a place, or a building set its rally point there."""
    if board.is_building(world, unit):
        return bool(orders.CAN_RALLY[place])
    return orders.order_to(world, rules, unit, place, occupant) != s.NO_ORDER


@compiled
def list_ground(
    world: Any, rules: Any, player: int, frame: int, tiles: int, out: Any, first: int
) -> None:
    """Write what the ground of each cell of the own view allows.

    tiles: bits of the tile kinds that allow it; unknown tiles always do.
    """
    for own in range(rules.rows * rules.columns):
        cell = int(rules.world_cell[frame, own])
        tile = int(world.board[s.TILE, cell])
        if rules.fog != 0:
            tile = board.known_tile(world, rules, player, cell)
        out[first + own] = tile == s.UNKNOWN or tiles >> tile & 1 != 0


@compiled
def list_cells_of(
    world: Any, rules: Any, player: int, frame: int, unit: int, is_legal: bool, out: Any, first: int
) -> None:
    """Write what a unit allows in the cells that it covers, where the player sees them."""
    half = board.kind_value(world, rules, unit, rb.KIND_HALF_SIZE)
    for rows in range(-half, half + 1):
        for columns in range(-half, half + 1):
            cell = int(world.units[unit, s.UNIT_CELL] + rows * rules.stride + columns)
            if board.sees(world, rules, player, cell):
                out[first + rules.own_cell[frame, cell]] = is_legal


@compiled
def list_ways(world: Any, rules: Any, player: int, frame: int, unit: int, out: Any) -> None:
    """Write go to and advance to for each cell: first by the ground, then by the units on it.

    Units are few: so nothing is computed twice for the many free cells.
    """
    if board.is_building(world, unit) and not orders.can_rally(world, rules, unit):
        return
    fights = is_soldier(world.units[unit, s.UNIT_KIND])
    first_advance = orders.FIRST_CELL + int(rules.rows * rules.columns)
    go, advance = 0, 0
    for tile in range(t.NUM_TILE_KINDS):
        place = orders.place_of_tile(rules, tile)
        go |= int(may_go_to(world, rules, unit, place, s.NO_UNIT)) << tile
        advance |= int(orders.CAN_ADVANCE[place]) << tile
    list_ground(world, rules, player, frame, go, out, orders.FIRST_CELL)
    if fights:
        list_ground(world, rules, player, frame, advance, out, first_advance)
    for owner in range(rules.num_players):
        for index in range(world.players[owner, s.NUM_UNITS]):
            other = int(world.roster[owner, index])
            if not cursor.is_selectable(world, other):
                continue
            place = orders.place_of_unit(world, rules, player, other)
            is_legal = may_go_to(world, rules, unit, place, other)
            list_cells_of(world, rules, player, frame, other, is_legal, out, orders.FIRST_CELL)
            if fights:
                is_legal = bool(orders.CAN_ADVANCE[place])
                list_cells_of(world, rules, player, frame, other, is_legal, out, first_advance)


@compiled
def list_unit_actions(world: Any, rules: Any, player: int, out: Any) -> None:
    """Write the legal actions of the `unit` space: out bool [A]."""
    out[orders.NOOP] = True
    if not world.players[player, s.IS_ALIVE]:
        return
    unit, frame = int(world.players[player, s.CURSOR]), board.frame_of(world, rules, player)
    out[orders.NEXT_UNIT] = cursor.has_others(world, player)
    if unit != s.NO_UNIT:
        out[orders.STOP] = orders.may_stop(world, unit)
        out[orders.CANCEL] = can_cancel(world, unit)
        for slot in range(t.MAX_PRODUCTS):
            product = int(rules.products[world.units[unit, s.UNIT_KIND], slot])
            if can_produce(world, rules, player, unit, product):
                out[orders.FIRST_PRODUCT + product] = True
        list_ways(world, rules, player, frame, unit, out)
    first_selection = orders.FIRST_CELL + 2 * int(rules.rows * rules.columns)
    for place in range(world.players[player, s.NUM_UNITS]):
        other = int(world.roster[player, place])
        if other != unit and cursor.is_selectable(world, other):
            list_cells_of(world, rules, player, frame, other, True, out, first_selection)


@compiled
def list_classic_actions(world: Any, rules: Any, player: int, out: Any) -> None:
    """Write the legal ones of the original's 16 actions: out bool [16]."""
    out[cursor.CLASSIC_NOOP] = True
    if not world.players[player, s.IS_ALIVE]:
        return
    out[cursor.CLASSIC_PREVIOUS : cursor.CLASSIC_NEXT + 1] = cursor.has_others(world, player)
    unit = int(world.players[player, s.CURSOR])
    if unit == s.NO_UNIT:
        return
    for slot in range(cursor.NUM_CLASSIC_BUILDS):
        product = int(rules.products[world.units[unit, s.UNIT_KIND], slot])
        out[cursor.CLASSIC_BUILD + slot] = can_produce(world, rules, player, unit, product)
    if board.is_building(world, unit):
        return
    for index in range(cursor.CLASSIC_ATTACK - cursor.CLASSIC_MOVE):
        cell = cursor.classic_cell(world, rules, player, cursor.CLASSIC_DIRECTIONS[index])
        out[cursor.CLASSIC_MOVE + index] = cursor.may_step(world, rules, player, cell)
    out[cursor.CLASSIC_ATTACK] = cursor.classic_victim(world, rules, player) != s.NO_UNIT
    out[cursor.CLASSIC_HARVEST] = cursor.classic_tile(world, rules, player) != NOWHERE


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
