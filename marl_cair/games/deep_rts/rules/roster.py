"""Units come and go: slots, the roster of each player, what a unit is worth to its owner."""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.board import owner_of, put_on_board, take_off_board

NO_SLOT = -1
FACING_AT_START = 2  # towards the viewer, in the own view


@compiled_copy
def set_due(world: Any, unit: int, tick: int) -> None:
    """The unit acts at `tick`."""
    world.due[unit] = tick
    world.clock[s.WAKE] = min(world.clock[s.WAKE], tick)


@compiled_copy
def enter_state(world: Any, unit: int, state: int, due: int) -> None:
    """The unit does something until `due`."""
    world.units[unit, s.UNIT_STATE] = state
    world.units[unit, s.UNIT_SINCE] = world.clock[s.TICK]
    set_due(world, unit, due)


@compiled
def free_slot(world: Any, rules: Any, player: int) -> int:
    """A slot of the player without a unit, or NO_SLOT."""
    first = player * rules.slots
    if world.players[player, s.NUM_UNITS] >= rules.slots:
        return NO_SLOT
    for slot in range(first, first + rules.slots):
        if world.units[slot, s.UNIT_KIND] == t.NO_KIND:
            return slot
    return NO_SLOT


@compiled
def clear_unit(world: Any, unit: int) -> None:
    """Leave nothing of the last unit in a slot."""
    world.units[unit, :] = 0
    world.units[unit, s.UNIT_KIND] = t.NO_KIND
    world.units[unit, s.UNIT_TARGET] = s.NO_UNIT
    world.units[unit, s.UNIT_CARRY_KIND] = t.NO_RESOURCE
    world.units[unit, s.UNIT_PARTNER] = s.NO_UNIT
    world.units[unit, s.UNIT_HURT_BY] = s.NO_UNIT
    world.due[unit] = s.NEVER
    world.path[unit] = np.uint64(0)


@compiled
def add_unit(world: Any, rules: Any, player: int, kind: int, cell: int) -> int:
    """A finished unit of full health at `cell`; its slot, or NO_SLOT where the player has none."""
    unit = free_slot(world, rules, player)
    if unit == NO_SLOT:
        return NO_SLOT
    clear_unit(world, unit)
    world.players[player, s.NEXT_SERIAL] += 1
    world.units[unit, s.UNIT_SERIAL] = world.players[player, s.NEXT_SERIAL]
    world.units[unit, s.UNIT_KIND] = kind
    world.units[unit, s.UNIT_HEALTH] = rules.kinds[kind, rb.KIND_HEALTH]
    frame = rules.seats[world.clock[s.MAP_INDEX], player, rb.SEAT_FRAME]
    world.units[unit, s.UNIT_FACING] = rules.own_direction[frame, FACING_AT_START]
    world.roster[player, world.players[player, s.NUM_UNITS]] = unit
    world.players[player, s.NUM_UNITS] += 1
    world.players[player, s.NUM_OWNED + kind] += 1
    put_on_board(world, rules, unit, cell)
    enter_state(world, unit, s.IDLE, world.clock[s.TICK] + 1)
    return unit


@compiled
def remove_unit(world: Any, rules: Any, unit: int) -> None:
    """A unit dies: its food is free again, its roof is gone, its builder steps out."""
    player = owner_of(rules, unit)
    kind = world.units[unit, s.UNIT_KIND]
    state = world.units[unit, s.UNIT_STATE]
    if state == s.INSIDE:
        return  # no unit reaches a builder before its site falls
    take_off_board(world, rules, unit)
    if state == s.RISING:
        release_builder(world, rules, unit)
    else:
        world.players[player, s.FOOD_MADE] -= rules.kinds[kind, rb.KIND_FOOD_PRODUCED]
    world.players[player, s.FOOD_USED] -= rules.kinds[kind, rb.KIND_FOOD_CONSUMED]
    for place in range(world.units[unit, s.UNIT_QUEUE_LENGTH]):
        refund_food(world, rules, player, world.units[unit, s.UNIT_QUEUE + place])
    strike_from_roster(world, player, unit)
    world.players[player, s.NUM_OWNED + kind] -= 1
    clear_unit(world, unit)


@compiled
def strike_from_roster(world: Any, player: int, unit: int) -> None:
    """Close the gap in the roster and in the selection."""
    found = False
    last = world.players[player, s.NUM_UNITS] - 1
    for place in range(last):
        found = found or world.roster[player, place] == unit
        if found:
            world.roster[player, place] = world.roster[player, place + 1]
    world.roster[player, last] = s.NO_UNIT
    world.players[player, s.NUM_UNITS] = last
    if world.players[player, s.CURSOR] == unit:
        world.players[player, s.CURSOR] = s.NO_UNIT


@compiled
def release_builder(world: Any, rules: Any, site: int) -> None:
    """The builder stands where its site was, that of a well in the pool, from which it can walk;
    needs the site off the board.
    """
    builder = int(world.units[site, s.UNIT_PARTNER])
    world.units[builder, s.UNIT_PARTNER] = s.NO_UNIT
    put_on_board(world, rules, builder, int(world.units[site, s.UNIT_CELL]))
    enter_state(world, builder, s.IDLE, world.clock[s.TICK] + 1)


# --- the store -------------------------------------------------------------------------------


@compiled
def can_pay(world: Any, rules: Any, player: int, product: int) -> bool:
    """True where the store holds the price of a product."""
    for resource in range(t.NUM_RESOURCES):
        if (
            world.players[player, s.RESOURCES + resource]
            < rules.product[product, rb.PRODUCT_COST + resource]
        ):
            return False
    return True


@compiled
def pay(world: Any, rules: Any, player: int, product: int) -> None:
    """Take the price out of the store."""
    for resource in range(t.NUM_RESOURCES):
        world.players[player, s.RESOURCES + resource] -= rules.product[
            product, rb.PRODUCT_COST + resource
        ]


@compiled
def refund(world: Any, rules: Any, player: int, product: int) -> None:
    """Give the price back."""
    for resource in range(t.NUM_RESOURCES):
        store(world, player, resource, rules.product[product, rb.PRODUCT_COST + resource])


@compiled_copy
def store(world: Any, player: int, resource: int, amount: int) -> None:
    """Add to the store, which holds MAX_RESOURCE of each."""
    full = world.players[player, s.RESOURCES + resource] + amount
    world.players[player, s.RESOURCES + resource] = min(t.MAX_RESOURCE, full)


@compiled_copy
def food_limit(world: Any, rules: Any, player: int) -> int:
    """How much the player's units may eat."""
    return int(min(rules.food_limit, rules.start_food + world.players[player, s.FOOD_MADE]))


@compiled
def has_food(world: Any, rules: Any, player: int, product: int) -> bool:
    """True where one more of a product can be fed."""
    if product >= t.FIRST_UPGRADE:
        return True
    eaten = world.players[player, s.FOOD_USED] + rules.kinds[product, rb.KIND_FOOD_CONSUMED]
    return bool(
        rules.kinds[product, rb.KIND_FOOD_CONSUMED] == 0
        or eaten <= food_limit(world, rules, player)
    )


@compiled
def refund_food(world: Any, rules: Any, player: int, product: int) -> None:
    """What was ordered will not be fed."""
    if product < t.FIRST_UPGRADE:
        world.players[player, s.FOOD_USED] -= rules.kinds[product, rb.KIND_FOOD_CONSUMED]
