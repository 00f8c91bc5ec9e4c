"""Orders: what each action does and when it is legal. `unit` and `classic` move the same cursor.

`unit`: no-op, next unit, stop, cancel, one action per product, then three boards of cells in the
own view: go to (or work at, attack, repair, rally to) a cell, advance to it, select the unit on it.
`classic`: the original's 16, corrected, in classic.py; `grid`: in grid.py.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.orders.cursor import num_others, pass_cursor, step_cursor
from marl_cair.games.deep_rts.orders.sights import CAN_ADVANCE, CAN_RALLY, kind_of_place, order_at
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.board import is_building, is_finished
from marl_cair.games.deep_rts.rules.building import can_cancel, cancel
from marl_cair.games.deep_rts.rules.combat import aim_at, is_soldier
from marl_cair.games.deep_rts.rules.paths import forget_path
from marl_cair.games.deep_rts.rules.roster import enter_state

NOOP, NEXT_UNIT, STOP, CANCEL, FIRST_PRODUCT = range(5)
FIRST_CELL = FIRST_PRODUCT + t.NUM_PRODUCTS
NUM_CELL_ORDERS = 3
GO_THERE, ADVANCE_THERE, SELECT_THERE = range(NUM_CELL_ORDERS)


# --- what an action means ----------------------------------------------------------------------


@compiled
def give_order(world: Any, unit: int, order: int, goal: int) -> None:
    """Replace the unit's order; a step that has begun is finished first."""
    world.units[unit, s.UNIT_ORDER] = order
    world.units[unit, s.UNIT_GOAL] = goal
    world.units[unit, s.UNIT_BLOCKED] = 0
    forget_path(world, unit)
    if order != s.ATTACK:
        world.units[unit, s.UNIT_TARGET] = s.NO_UNIT
    if world.units[unit, s.UNIT_STATE] != s.WALKING:
        enter_state(world, unit, s.IDLE, world.clock[s.TICK] + 1)


@compiled
def obey_go(world: Any, rules: Any, player: int, unit: int, cell: int) -> bool:
    """Do at a cell what is to be done there; False where nothing is."""
    if is_building(world, unit):
        if not may_rally(world, rules, player, unit, cell):
            return False
        world.units[unit, s.UNIT_RALLY] = cell
        return True
    order = order_at(world, rules, player, unit, cell)
    if order == s.NO_ORDER:
        return False
    target = world.board[s.OCCUPANT, cell]
    goal = cell if order in (s.MOVE, s.HARVEST) else s.NO_GOAL
    give_order(world, unit, order, goal)
    if order not in (s.MOVE, s.HARVEST):
        aim_at(world, unit, target)
    return True


@compiled
def can_rally(world: Any, rules: Any, unit: int) -> bool:
    """True for finished buildings that train units."""
    first = rules.products[world.units[unit, s.UNIT_KIND], 0]
    return bool(0 <= first < t.NUM_MOBILE_KINDS and is_finished(world, unit))


@compiled
def may_rally(world: Any, rules: Any, player: int, unit: int, cell: int) -> bool:
    """True where a building can send units that it trains."""
    return can_rally(world, rules, unit) and bool(
        CAN_RALLY[kind_of_place(world, rules, player, cell)]
    )


@compiled
def may_advance(world: Any, rules: Any, player: int, unit: int, cell: int) -> bool:
    """True where a soldier can be sent to fight its way."""
    if not is_soldier(world.units[unit, s.UNIT_KIND]) or world.units[unit, s.UNIT_CELL] == cell:
        return False
    return bool(CAN_ADVANCE[kind_of_place(world, rules, player, cell)])


@compiled
def may_select(world: Any, rules: Any, player: int, cell: int) -> bool:
    """True on another own unit."""
    unit = world.board[s.OCCUPANT, cell]
    return bool(
        unit != s.NO_UNIT
        and unit // rules.slots == player
        and unit != world.players[player, s.CURSOR]
    )


@compiled
def obey_cell_order(world: Any, rules: Any, player: int, action: int) -> bool:
    """Orders that point at a cell of the own view."""
    frame = rules.seats[world.clock[s.MAP_INDEX], player, rb.SEAT_FRAME]
    own = (action - FIRST_CELL) % (rules.rows * rules.columns)
    what = (action - FIRST_CELL) // (rules.rows * rules.columns)
    cell = int(rules.world_cell[frame, own])
    unit = int(world.players[player, s.CURSOR])
    if what == SELECT_THERE:
        is_legal = may_select(world, rules, player, cell)
        if is_legal:
            world.players[player, s.CURSOR] = world.board[s.OCCUPANT, cell]
        return is_legal
    if unit == s.NO_UNIT:
        return False
    if what == GO_THERE:
        is_legal = obey_go(world, rules, player, unit, cell)
    else:
        is_legal = may_advance(world, rules, player, unit, cell)
        if is_legal:
            give_order(world, unit, s.ADVANCE, cell)
    if is_legal:
        pass_cursor(world, player)
    return is_legal


@compiled
def obey_unit_action(world: Any, rules: Any, player: int, action: int) -> bool:
    """One action of the `unit` space but products; False for an illegal one."""
    unit = int(world.players[player, s.CURSOR])
    if action >= FIRST_CELL:
        return obey_cell_order(world, rules, player, action)
    if action == NEXT_UNIT:
        is_legal = num_others(world, player) > 0
        if is_legal:
            step_cursor(world, player, 1)
        return is_legal
    if unit == s.NO_UNIT:
        return action == NOOP
    if action == STOP:
        is_legal = may_stop(world, unit)
        if is_legal:
            give_order(world, unit, s.NO_ORDER, s.NO_GOAL)
        return is_legal
    if action == CANCEL:
        is_legal = can_cancel(world, unit)
        if is_legal:
            cancel(world, rules, player, unit)
        return is_legal
    return action == NOOP


@compiled_copy
def may_stop(world: Any, unit: int) -> bool:
    """True for a unit that walks or works."""
    return bool(
        world.units[unit, s.UNIT_KIND] < t.NUM_MOBILE_KINDS
        and world.units[unit, s.UNIT_ORDER] != s.NO_ORDER
    )
