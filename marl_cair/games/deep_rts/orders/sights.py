"""What a player knows of a cell, and what a unit of it can therefore be told to do there.

Legality depends only on what the player's team sees or remembers, so that masks leak nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts.rules.board import (
    is_building,
    is_finished,
    known_tile,
    owner_of,
    sees,
)
from marl_cair.games.deep_rts.rules.rulebook import (
    KIND_DAMAGE_MAX,
    KIND_HEALTH,
    TILE_RESOURCE,
    WALK_PERCENT,
)
from marl_cair.games.deep_rts.state import (
    ATTACK,
    HARVEST,
    MOVE,
    NO_ORDER,
    NO_UNIT,
    OCCUPANT,
    REPAIR,
    RETURN,
    UNIT_CARRY,
    UNIT_CELL,
    UNIT_HEALTH,
    UNIT_KIND,
    UNKNOWN,
)
from marl_cair.games.deep_rts.tables import NO_RESOURCE, OIL, PEASANT, TOWN_HALL

# What is known of a cell, the most telling first.
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
    if tile == UNKNOWN:
        return UNSEEN
    resource = rules.tiles[tile, TILE_RESOURCE]
    if resource not in (NO_RESOURCE, OIL):
        return BY_HAND
    return OPEN_GROUND if rules.tiles[tile, WALK_PERCENT] > 0 else BARRIER


@compiled
def place_of_unit(world: Any, rules: Any, player: int, unit: int) -> int:
    """What the cells of a unit that the player sees are to it."""
    owner = owner_of(rules, unit)
    if owner == player:
        return OWN_BUILDING if is_building(world, unit) else OWN_UNIT
    return ALLY if rules.team[owner] == rules.team[player] else ENEMY


@compiled
def kind_of_place(world: Any, rules: Any, player: int, cell: int) -> int:
    """What the player knows of a cell."""
    occupant = int(world.board[OCCUPANT, cell])
    if occupant != NO_UNIT and sees(world, rules, player, cell):
        return place_of_unit(world, rules, player, occupant)
    return place_of_tile(rules, known_tile(world, rules, player, cell))


@compiled
def order_to(world: Any, rules: Any, unit: int, place: int, occupant: int) -> int:
    """What "go" to such a place, not its own, means for a unit that walks; or NO_ORDER."""
    kind = world.units[unit, UNIT_KIND]
    if place in (UNSEEN, OPEN_GROUND):
        return MOVE
    if place == ENEMY:
        return ATTACK if rules.kinds[kind, KIND_DAMAGE_MAX] > 0 else NO_ORDER
    if place == BY_HAND:
        return HARVEST if kind == PEASANT else NO_ORDER
    if place == OWN_BUILDING and kind == PEASANT:
        other = world.units[occupant, UNIT_KIND]
        if not is_finished(world, occupant):
            return NO_ORDER
        if world.units[occupant, UNIT_HEALTH] < rules.kinds[other, KIND_HEALTH]:
            return REPAIR
        if other == TOWN_HALL and world.units[unit, UNIT_CARRY] > 0:
            return RETURN
    return NO_ORDER


@compiled
def order_at(world: Any, rules: Any, player: int, unit: int, cell: int) -> int:
    """What "go" to a cell means for a unit that walks; NO_ORDER where it means nothing."""
    if world.units[unit, UNIT_CELL] == cell:
        return NO_ORDER
    place = kind_of_place(world, rules, player, cell)
    return order_to(world, rules, unit, place, int(world.board[OCCUPANT, cell]))
