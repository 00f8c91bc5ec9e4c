"""Which actions are legal, exactly as `orders.obey_all` takes them."""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts.board import is_building
from marl_cair.games.deep_rts.building import can_cancel, can_produce
from marl_cair.games.deep_rts.classic_orders import (
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
from marl_cair.games.deep_rts.combat import is_soldier
from marl_cair.games.deep_rts.cursor import is_selectable, num_others
from marl_cair.games.deep_rts.grid_orders import list_grid_orders
from marl_cair.games.deep_rts.orders import (
    CANCEL,
    FIRST_CELL,
    FIRST_PRODUCT,
    NEXT_UNIT,
    NOOP,
    STOP,
    can_rally,
    may_stop,
)
from marl_cair.games.deep_rts.paths import NOWHERE
from marl_cair.games.deep_rts.rulebook import (
    CLASSIC_ACTIONS,
    KIND_HALF_SIZE,
    SEAT_FRAME,
)
from marl_cair.games.deep_rts.sights import CAN_ADVANCE, CAN_RALLY, kind_of_place, order_at
from marl_cair.games.deep_rts.state import (
    CURSOR,
    IS_ALIVE,
    MAP_INDEX,
    NO_ORDER,
    NO_UNIT,
    NUM_UNITS,
    UNIT_CELL,
    UNIT_KIND,
    world_at,
)
from marl_cair.games.deep_rts.tables import NUM_PRODUCTS


@compiled
def list_cell_orders(world: Any, rules: Any, player: int, out: Any) -> None:
    """Go to, advance to, select: for each cell of the own view."""
    frame = rules.seats[world.clock[MAP_INDEX], player, SEAT_FRAME]
    size = rules.rows * rules.columns
    unit = int(world.players[player, CURSOR])
    if unit != NO_UNIT:
        walks = not is_building(world, unit)
        rallies = not walks and can_rally(world, rules, unit)
        fights = is_soldier(world.units[unit, UNIT_KIND])
        here = world.units[unit, UNIT_CELL]
        for own in range(size):
            cell = int(rules.world_cell[frame, own])
            if walks:
                go = order_at(world, rules, player, unit, cell) != NO_ORDER
                out[FIRST_CELL + own] = go
            elif rallies:
                out[FIRST_CELL + own] = CAN_RALLY[kind_of_place(world, rules, player, cell)]
            if fights and cell != here:
                place = kind_of_place(world, rules, player, cell)
                out[FIRST_CELL + size + own] = CAN_ADVANCE[place]
    for place in range(world.players[player, NUM_UNITS]):
        other = int(world.roster[player, place])
        if other != unit and is_selectable(world, other):
            list_selection(world, rules, frame, other, out, FIRST_CELL + 2 * size)


@compiled
def list_selection(world: Any, rules: Any, frame: int, unit: int, out: Any, first: int) -> None:
    """Every cell that a unit covers selects it."""
    half = int(rules.kinds[world.units[unit, UNIT_KIND], KIND_HALF_SIZE])
    for rows in range(-half, half + 1):
        for columns in range(-half, half + 1):
            cell = world.units[unit, UNIT_CELL] + rows * rules.stride + columns
            out[first + rules.own_cell[frame, cell]] = True


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
        for product in range(NUM_PRODUCTS):
            out[FIRST_PRODUCT + product] = can_produce(world, rules, player, unit, product)
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
