"""What a player knows of a cell, and the order that its unit can get there.

Legality depends only on what the player's team sees or remembers, so that masks leak nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import board
from marl_cair.games.deep_rts.rules import rulebook as rb

# What is known of a cell, the most specific first.
(
    UNSEEN,
    BARRIER,
    OPEN_GROUND,
    BY_HAND,
    OWN_UNIT,
    OWN_BUILDING,
    ALLY,
    ENEMY,
) = range(8)
CAN_ADVANCE: NDArray[np.bool_] = np.isin(np.arange(8), (UNSEEN, OPEN_GROUND, ENEMY))
CAN_RALLY: NDArray[np.bool_] = np.isin(np.arange(8), (UNSEEN, OPEN_GROUND, BY_HAND, OWN_UNIT))


@compiled
def place_of_tile(rules: Any, tile: int) -> int:
    """What a player who knows the tile of a cell, or that it is UNKNOWN, knows of free ground."""
    if tile == s.UNKNOWN:
        return UNSEEN
    resource = rules.tiles[tile, rb.TILE_RESOURCE]
    if resource not in (t.NO_RESOURCE, t.OIL):
        return BY_HAND
    return OPEN_GROUND if rules.tiles[tile, rb.WALK_PERCENT] > 0 else BARRIER


@compiled
def place_of_unit(world: Any, rules: Any, player: int, unit: int) -> int:
    """What the cells of a unit that the player sees are to it."""
    owner = board.owner_of(rules, unit)
    if owner == player:
        return OWN_BUILDING if board.is_building(world, unit) else OWN_UNIT
    return ALLY if rules.team[owner] == rules.team[player] else ENEMY


@compiled
def kind_of_place(world: Any, rules: Any, player: int, cell: int) -> int:
    """What the player knows of a cell."""
    occupant = int(world.board[s.OCCUPANT, cell])
    if occupant != s.NO_UNIT and board.sees(world, rules, player, cell):
        return place_of_unit(world, rules, player, occupant)
    return place_of_tile(rules, board.known_tile(world, rules, player, cell))


@compiled
def order_to(world: Any, rules: Any, unit: int, place: int, occupant: int) -> int:
    """What "go" to such a place, not its own, means for a unit that walks; or NO_ORDER."""
    kind = world.units[unit, s.UNIT_KIND]
    if place in (UNSEEN, OPEN_GROUND):
        return s.MOVE
    if place == ENEMY:
        return s.ATTACK if rules.kinds[kind, rb.KIND_DAMAGE_MAX] > 0 else s.NO_ORDER
    if place == BY_HAND:
        return s.HARVEST if kind == t.PEASANT else s.NO_ORDER
    if place == OWN_BUILDING and kind == t.PEASANT:
        other = world.units[occupant, s.UNIT_KIND]
        if not board.is_finished(world, occupant):
            return s.NO_ORDER
        if world.units[occupant, s.UNIT_HEALTH] < rules.kinds[other, rb.KIND_HEALTH]:
            return s.REPAIR
        if other == t.TOWN_HALL and world.units[unit, s.UNIT_CARRY] > 0:
            return s.RETURN
    return s.NO_ORDER


@compiled
def order_at(world: Any, rules: Any, player: int, unit: int, cell: int) -> int:
    """What "go" to a cell means for a unit that walks; NO_ORDER where it means nothing."""
    if world.units[unit, s.UNIT_CELL] == cell:
        return s.NO_ORDER
    place = kind_of_place(world, rules, player, cell)
    return order_to(world, rules, unit, place, int(world.board[s.OCCUPANT, cell]))
