"""Units come and go: slots, the roster and the store of each player."""

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import board
from marl_cair.games.deep_rts.rules import rulebook as rb

NO_SLOT = -1
FACING_AT_START = 2  # towards the viewer, in the own view


@compiled_copy
def set_due(world: Any, unit: int, tick: int) -> None:
    """The unit acts at `tick`."""
    world.due[unit] = tick
    world.clock[s.WAKE] = min(world.clock[s.WAKE], tick)


@compiled_copy
def enter_state(world: Any, unit: int, state: int, due: int) -> None:
    """Set the unit's state, which lasts until `due`."""
    world.units[unit, s.UNIT_STATE] = state
    world.units[unit, s.UNIT_SINCE] = world.clock[s.TICK]
    set_due(world, unit, due)


@compiled
def clear_unit(world: Any, unit: int) -> None:
    """Reset a slot to its empty values."""
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
    """Add a finished unit of full health at `cell`; returns its slot, or NO_SLOT."""
    if world.players[player, s.NUM_UNITS] >= rules.slots:
        return NO_SLOT
    unit = int(player * rules.slots)
    while world.units[unit, s.UNIT_KIND] != t.NO_KIND:
        unit += 1
    clear_unit(world, unit)
    world.players[player, s.NEXT_SERIAL] += 1
    world.units[unit, s.UNIT_SERIAL] = world.players[player, s.NEXT_SERIAL]
    world.units[unit, s.UNIT_KIND] = kind
    world.units[unit, s.UNIT_HEALTH] = rules.kinds[kind, rb.KIND_HEALTH]
    frame = board.frame_of(world, rules, player)
    world.units[unit, s.UNIT_FACING] = rules.own_direction[frame, FACING_AT_START]
    world.roster[player, world.players[player, s.NUM_UNITS]] = unit
    world.players[player, s.NUM_UNITS] += 1
    world.players[player, s.NUM_OWNED + kind] += 1
    board.put_on_board(world, rules, unit, cell)
    enter_state(world, unit, s.IDLE, world.clock[s.TICK] + 1)
    return unit


@compiled
def remove_unit(world: Any, rules: Any, unit: int) -> None:
    """Remove a dead unit: it frees its food and its place in the roster; a site, its builder."""
    player = board.owner_of(rules, unit)
    state = world.units[unit, s.UNIT_STATE]
    if state == s.INSIDE:
        return  # a builder cannot be hit before its site falls
    board.take_off_board(world, rules, unit)
    if state == s.RISING:
        release_builder(world, rules, unit, int(world.units[unit, s.UNIT_CELL]))
    else:
        food = board.kind_value(world, rules, unit, rb.KIND_FOOD_PRODUCED)
        world.players[player, s.FOOD_MADE] -= food
    kind = int(world.units[unit, s.UNIT_KIND])
    refund_food(world, rules, player, kind)
    for place in range(world.units[unit, s.UNIT_QUEUE_LENGTH]):
        refund_food(world, rules, player, world.units[unit, s.UNIT_QUEUE + place])
    world.players[player, s.NUM_OWNED + kind] -= 1
    remove_from_roster(world, player, unit)
    clear_unit(world, unit)


@compiled
def remove_from_roster(world: Any, player: int, unit: int) -> None:
    """Close the gap in the roster; clear the cursor if it was on the unit."""
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
def release_builder(world: Any, rules: Any, site: int, cell: int) -> None:
    """Place the builder of a site at `cell`."""
    builder = int(world.units[site, s.UNIT_PARTNER])
    world.units[site, s.UNIT_PARTNER] = s.NO_UNIT
    world.units[builder, s.UNIT_PARTNER] = s.NO_UNIT
    board.put_on_board(world, rules, builder, cell)
    enter_state(world, builder, s.IDLE, world.clock[s.TICK] + 1)


@compiled
def can_pay(world: Any, rules: Any, player: int, product: int) -> bool:
    """True where the store holds the price of a product."""
    for resource in range(t.NUM_RESOURCES):
        price = rules.product[product, rb.PRODUCT_COST + resource]
        if world.players[player, s.RESOURCES + resource] < price:
            return False
    return True


@compiled
def pay(world: Any, rules: Any, player: int, product: int) -> None:
    """Take the price out of the store."""
    for resource in range(t.NUM_RESOURCES):
        price = rules.product[product, rb.PRODUCT_COST + resource]
        world.players[player, s.RESOURCES + resource] -= price


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
    """Food that the player's units may consume."""
    return int(min(rules.food_limit, rules.start_food + world.players[player, s.FOOD_MADE]))


@compiled
def has_food(world: Any, rules: Any, player: int, product: int) -> bool:
    """True where there is food for one more of a product."""
    if product >= t.FIRST_UPGRADE:
        return True
    eaten = rules.kinds[product, rb.KIND_FOOD_CONSUMED]
    used = world.players[player, s.FOOD_USED] + eaten
    return bool(eaten == 0 or used <= food_limit(world, rules, player))


@compiled
def refund_food(world: Any, rules: Any, player: int, product: int) -> None:
    """Free the food of a unit that is dead or no longer ordered; upgrades have none."""
    if product < t.FIRST_UPGRADE:
        world.players[player, s.FOOD_USED] -= rules.kinds[product, rb.KIND_FOOD_CONSUMED]
