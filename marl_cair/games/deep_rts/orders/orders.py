"""Orders: the numbers of the `unit` actions, what "go" to a cell means, when orders are legal.

`unit`: no-op, next unit, stop, cancel, one action per product, then three boards of cells in the
own view: go to (or work at, attack, repair, rally to) a cell, advance to it, select the unit on it.
`classic`: the original's 16, in cursor.py; `grid`: in grid.py. Legality depends only on what the
player's team sees or remembers, so that masks leak nothing.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import board
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.combat import aim_at, is_soldier
from marl_cair.games.deep_rts.rules.paths import forget_path
from marl_cair.games.deep_rts.rules.roster import enter_state

NOOP, NEXT_UNIT, STOP, CANCEL, FIRST_PRODUCT = range(5)
FIRST_CELL = FIRST_PRODUCT + t.NUM_PRODUCTS
GO_THERE, ADVANCE_THERE, SELECT_THERE = range(3)

# The knowledge of a player about a cell.
UNSEEN, BARRIER, OPEN_GROUND, BY_HAND, OWN_UNIT, OWN_BUILDING, ALLY, ENEMY = range(8)
CAN_ADVANCE: NDArray[np.bool_] = np.isin(np.arange(8), (UNSEEN, OPEN_GROUND, ENEMY))
CAN_RALLY: NDArray[np.bool_] = np.isin(np.arange(8), (UNSEEN, OPEN_GROUND, BY_HAND, OWN_UNIT))


# --- knowledge of a cell -----------------------------------------------------------------------


@compiled
def place_of_tile(rules: Any, tile: int) -> int:
    """The knowledge of a player about free ground, by its tile or UNKNOWN."""
    if tile == s.UNKNOWN:
        return UNSEEN
    if rules.tiles[tile, rb.TILE_RESOURCE] not in (t.NO_RESOURCE, t.OIL):
        return BY_HAND
    return OPEN_GROUND if rules.tiles[tile, rb.WALK_PERCENT] > 0 else BARRIER


@compiled
def place_of_unit(world: Any, rules: Any, player: int, unit: int) -> int:
    """The knowledge of a player about the cells of a unit that it sees."""
    owner = board.owner_of(rules, unit)
    if owner == player:
        return OWN_BUILDING if board.is_building(world, unit) else OWN_UNIT
    return ALLY if rules.team[owner] == rules.team[player] else ENEMY


@compiled
def place_at(world: Any, rules: Any, player: int, cell: int) -> int:
    """The knowledge of the player about a cell."""
    occupant = int(world.board[s.OCCUPANT, cell])
    if occupant != s.NO_UNIT and board.sees(world, rules, player, cell):
        return place_of_unit(world, rules, player, occupant)
    return place_of_tile(rules, board.known_tile(world, rules, player, cell))


# --- what is legal -----------------------------------------------------------------------------


@compiled
def order_to(world: Any, rules: Any, unit: int, place: int, occupant: int) -> int:
    """The order that "go" to such a place gives to a unit that walks, or NO_ORDER."""
    kind = world.units[unit, s.UNIT_KIND]
    if place in (UNSEEN, OPEN_GROUND):
        return s.MOVE
    if place == ENEMY:
        return s.ATTACK if rules.kinds[kind, rb.KIND_DAMAGE_MAX] > 0 else s.NO_ORDER
    if place == BY_HAND:
        return s.HARVEST if kind == t.PEASANT else s.NO_ORDER
    if place == OWN_BUILDING and kind == t.PEASANT and board.is_finished(world, occupant):
        health = board.kind_value(world, rules, occupant, rb.KIND_HEALTH)
        if world.units[occupant, s.UNIT_HEALTH] < health:
            return s.REPAIR
        is_hall = world.units[occupant, s.UNIT_KIND] == t.TOWN_HALL
        if is_hall and world.units[unit, s.UNIT_CARRY] > 0:
            return s.RETURN
    return s.NO_ORDER


@compiled
def order_at(world: Any, rules: Any, player: int, unit: int, cell: int) -> int:
    """The order that "go" to a cell gives to a unit that walks, or NO_ORDER."""
    if world.units[unit, s.UNIT_CELL] == cell:
        return s.NO_ORDER
    place = place_at(world, rules, player, cell)
    return order_to(world, rules, unit, place, int(world.board[s.OCCUPANT, cell]))


@compiled
def can_rally(world: Any, rules: Any, unit: int) -> bool:
    """True for finished buildings that train units."""
    first = rules.products[world.units[unit, s.UNIT_KIND], 0]
    return bool(0 <= first < t.NUM_MOBILE_KINDS and board.is_finished(world, unit))


@compiled
def may_rally(world: Any, rules: Any, player: int, unit: int, cell: int) -> bool:
    """True where a building can send units that it trains."""
    return can_rally(world, rules, unit) and bool(CAN_RALLY[place_at(world, rules, player, cell)])


@compiled
def may_advance(world: Any, rules: Any, player: int, unit: int, cell: int) -> bool:
    """True where a soldier can be sent to fight on its way."""
    if not is_soldier(world.units[unit, s.UNIT_KIND]) or world.units[unit, s.UNIT_CELL] == cell:
        return False
    return bool(CAN_ADVANCE[place_at(world, rules, player, cell)])


@compiled_copy
def may_stop(world: Any, unit: int) -> bool:
    """True for a unit that walks or works."""
    has_order = world.units[unit, s.UNIT_ORDER] != s.NO_ORDER
    return bool(has_order and not board.is_building(world, unit))


# --- what orders do ----------------------------------------------------------------------------


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
    """Carry out "go" to a cell; False if it is illegal."""
    if board.is_building(world, unit):
        is_legal = may_rally(world, rules, player, unit, cell)
        if is_legal:
            world.units[unit, s.UNIT_RALLY] = cell
        return is_legal
    order = order_at(world, rules, player, unit, cell)
    if order == s.NO_ORDER:
        return False
    if order in (s.MOVE, s.HARVEST):
        give_order(world, unit, order, cell)
    else:
        give_order(world, unit, order, s.NO_GOAL)
        aim_at(world, unit, world.board[s.OCCUPANT, cell])
    return True
