"""What a player knows of a cell, and what a unit of it can therefore be told to do there.

Legality depends only on what the player's team sees or remembers, so that masks leak nothing.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts.board import (
    is_building,
    is_finished,
    known_tile,
    owner_of,
    sees,
)
from marl_cair.games.deep_rts.rulebook import (
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
def kind_of_place(world: Any, rules: Any, player: int, cell: int) -> int:
    """What the player knows of a cell."""
    occupant = int(world.board[OCCUPANT, cell])
    if occupant != NO_UNIT and sees(world, rules, player, cell):
        owner = owner_of(rules, occupant)
        if owner == player:
            return OWN_BUILDING if is_building(world, occupant) else OWN_UNIT
        return ALLY if rules.team[owner] == rules.team[player] else ENEMY
    tile = known_tile(world, rules, player, cell)
    if tile == UNKNOWN:
        return UNSEEN
    resource = rules.tiles[tile, TILE_RESOURCE]
    if resource not in (NO_RESOURCE, OIL):
        return BY_HAND
    return OPEN_GROUND if rules.tiles[tile, WALK_PERCENT] > 0 else BARRIER


@compiled
def order_at(world: Any, rules: Any, player: int, unit: int, cell: int) -> int:
    """What "go" to a cell means for a unit that walks; NO_ORDER where it means nothing."""
    place = kind_of_place(world, rules, player, cell)
    kind = world.units[unit, UNIT_KIND]
    if place in (UNSEEN, OPEN_GROUND):
        return MOVE if world.units[unit, UNIT_CELL] != cell else NO_ORDER
    if place == ENEMY:
        return ATTACK if rules.kinds[kind, KIND_DAMAGE_MAX] > 0 else NO_ORDER
    if place == BY_HAND:
        return HARVEST if kind == PEASANT else NO_ORDER
    if place == OWN_BUILDING and kind == PEASANT:
        building = int(world.board[OCCUPANT, cell])
        other = world.units[building, UNIT_KIND]
        if not is_finished(world, building):
            return NO_ORDER
        if world.units[building, UNIT_HEALTH] < rules.kinds[other, KIND_HEALTH]:
            return REPAIR
        if other == TOWN_HALL and world.units[unit, UNIT_CARRY] > 0:
            return RETURN
    return NO_ORDER
