"""What units do in peace: harvest and bring in, build, train, pump oil, repair."""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts.rules.board import (
    change_tile,
    is_finished,
    owner_of,
    put_on_board,
    unit_distance,
)
from marl_cair.games.deep_rts.rules.motion import claim_exit, wins_claim
from marl_cair.games.deep_rts.rules.roster import NO_SLOT, add_unit, enter_state, set_due, store
from marl_cair.games.deep_rts.rules.rulebook import (
    KIND_FOOD_PRODUCED,
    KIND_HEALTH,
    PRODUCT_COST,
    PRODUCT_TICKS,
    TILE_RESOURCE,
    TILE_YIELD,
)
from marl_cair.games.deep_rts.state import (
    AMOUNT,
    FOOD_MADE,
    GATHERED,
    HARVEST,
    IDLE,
    MOVE,
    NEVER,
    NO_GOAL,
    NO_ORDER,
    NO_UNIT,
    NUM_ACTING,
    NUM_CREATED,
    NUM_OWNED,
    NUM_UNITS,
    PUMPING,
    RESOURCES,
    TICK,
    TILE,
    TOOK,
    TRAINING,
    UNIT_CARRY,
    UNIT_CARRY_KIND,
    UNIT_CELL,
    UNIT_EXIT,
    UNIT_GOAL,
    UNIT_HEALTH,
    UNIT_KIND,
    UNIT_ORDER,
    UNIT_PARTNER,
    UNIT_QUEUE,
    UNIT_QUEUE_LENGTH,
    UNIT_RALLY,
    UNIT_SERIAL,
    UNIT_STATE,
    UNIT_TARGET,
    UNIT_TARGET_SERIAL,
    UPGRADES,
)
from marl_cair.games.deep_rts.tables import (
    FIRST_UPGRADE,
    GOLD,
    GRASS,
    MAX_RESOURCE,
    NO_RESOURCE,
    OIL,
    OIL_WELL,
    PEASANT,
    TOWN_HALL,
)

RETRY_TICKS = 5  # until a building looks again for ground where its unit can stand
REPAIR_TICKS = 10


# --- harvest ---------------------------------------------------------------------------------


@compiled
def nearest_hall(world: Any, rules: Any, unit: int) -> int:
    """The finished own town hall that is nearest in a straight line, the older one of two."""
    player, cell = owner_of(rules, unit), int(world.units[unit, UNIT_CELL])
    best, best_distance = NO_UNIT, NEVER
    if world.players[player, NUM_OWNED + TOWN_HALL] == 0:
        return best
    for place in range(world.players[player, NUM_UNITS]):
        hall = int(world.roster[player, place])
        if world.units[hall, UNIT_KIND] != TOWN_HALL or not is_finished(world, hall):
            continue
        distance = unit_distance(world, rules, cell, hall)
        if distance < best_distance:
            best, best_distance = hall, distance
    return best


@compiled
def gather(world: Any, rules: Any, unit: int) -> None:
    """One unit of the resource is in the worker's hands; the tile loses it after all have taken."""
    goal = int(world.units[unit, UNIT_GOAL])
    if world.board[AMOUNT, goal] <= 0:
        return
    tile = world.board[TILE, goal]
    resource = int(rules.tiles[tile, TILE_RESOURCE])
    take(world, unit, resource, int(rules.tiles[tile, TILE_YIELD]), owner_of(rules, unit))
    world.units[unit, UNIT_EXIT] = TOOK


@compiled
def take(world: Any, unit: int, resource: int, amount: int, player: int) -> None:
    """Into the hands of a worker; counted as gathered."""
    world.units[unit, UNIT_CARRY] += amount
    world.units[unit, UNIT_CARRY_KIND] = resource
    count_gathered(world, player, resource, amount)


@compiled_copy
def count_gathered(world: Any, player: int, resource: int, amount: int) -> None:
    """The statistics of what was taken from the ground, up to MAX_RESOURCE."""
    full = world.players[player, GATHERED + resource] + amount
    world.players[player, GATHERED + resource] = min(MAX_RESOURCE, full)


@compiled
def settle_harvest(world: Any, rules: Any) -> None:
    """The tiles lose what was taken in this tick; an empty one becomes grass."""
    for place in range(world.clock[NUM_ACTING]):
        unit = int(world.acting[place])
        if world.units[unit, UNIT_EXIT] == TOOK:
            world.board[AMOUNT, world.units[unit, UNIT_GOAL]] -= 1
    for place in range(world.clock[NUM_ACTING]):
        unit = int(world.acting[place])
        if world.units[unit, UNIT_EXIT] == TOOK:
            world.units[unit, UNIT_EXIT] = NO_GOAL
            goal = int(world.units[unit, UNIT_GOAL])
            if world.board[AMOUNT, goal] <= 0 and world.board[TILE, goal] != GRASS:
                change_tile(world, rules, goal, GRASS)


@compiled_copy
def is_used_up(world: Any, rules: Any, tile: int) -> bool:
    """True where nothing can be gathered by hand (any more)."""
    resource = rules.tiles[world.board[TILE, tile], TILE_RESOURCE]
    return bool(resource in (NO_RESOURCE, OIL) or world.board[AMOUNT, tile] <= 0)


@compiled
def deliver(world: Any, rules: Any, unit: int) -> None:
    """Fill the store; the worker goes back for more where the rules and its order say so."""
    carried = int(world.units[unit, UNIT_CARRY_KIND])
    if carried != NO_RESOURCE:
        store(world, owner_of(rules, unit), carried, int(world.units[unit, UNIT_CARRY]))
    world.units[unit, UNIT_CARRY] = 0
    goes_back = rules.harvests_forever != 0 and world.units[unit, UNIT_GOAL] != NO_GOAL
    world.units[unit, UNIT_ORDER] = HARVEST if goes_back else NO_ORDER


# --- buildings -------------------------------------------------------------------------------


@compiled
def finish_site(world: Any, rules: Any, site: int) -> None:
    """The building stands and its builder steps out, where there is ground for that."""
    if not wins_claim(world, site):
        set_due(world, site, int(world.clock[TICK]) + RETRY_TICKS)
        return
    kind, player = world.units[site, UNIT_KIND], owner_of(rules, site)
    builder = int(world.units[site, UNIT_PARTNER])
    world.units[site, UNIT_PARTNER] = NO_UNIT
    world.units[builder, UNIT_PARTNER] = NO_UNIT
    put_on_board(world, rules, builder, int(world.units[site, UNIT_EXIT]))
    enter_state(world, builder, IDLE, world.clock[TICK] + 1)
    health = int(rules.kinds[kind, KIND_HEALTH])
    world.units[site, UNIT_HEALTH] += health - health // 10
    world.players[player, FOOD_MADE] += rules.kinds[kind, KIND_FOOD_PRODUCED]
    world.players[player, NUM_CREATED + kind] += 1
    enter_state(world, site, IDLE, world.clock[TICK] + 1)


@compiled
def finish_product(world: Any, rules: Any, building: int) -> None:
    """The trained unit steps out, or the upgrade is known; the next in the queue begins."""
    player = owner_of(rules, building)
    product = int(world.units[building, UNIT_QUEUE + 0])
    if product >= FIRST_UPGRADE:
        world.players[player, UPGRADES + product - FIRST_UPGRADE] += 1
    else:
        if not wins_claim(world, building):
            set_due(world, building, int(world.clock[TICK]) + RETRY_TICKS)
            return
        unit = add_unit(world, rules, player, product, int(world.units[building, UNIT_EXIT]))
        if unit == NO_SLOT:
            set_due(world, building, int(world.clock[TICK]) + RETRY_TICKS)
            return
        world.players[player, NUM_CREATED + product] += 1
        send_to_rally(world, rules, building, unit)
    drop_from_queue(world, building, 0)
    enter_state(world, building, IDLE, world.clock[TICK])  # so that the next begins in this tick


@compiled
def send_to_rally(world: Any, rules: Any, building: int, unit: int) -> None:
    """A new unit follows the rally point: workers harvest there, others go there."""
    rally = int(world.units[building, UNIT_RALLY])
    if rally == NO_GOAL:
        return
    world.units[unit, UNIT_GOAL] = rally
    world.units[unit, UNIT_ORDER] = MOVE
    resource = rules.tiles[world.board[TILE, rally], TILE_RESOURCE]
    if world.units[unit, UNIT_KIND] == PEASANT and resource not in (NO_RESOURCE, OIL):
        world.units[unit, UNIT_ORDER] = HARVEST


@compiled
def drop_from_queue(world: Any, building: int, place: int) -> None:
    """Take one product out of the queue."""
    last = world.units[building, UNIT_QUEUE_LENGTH] - 1
    for index in range(place, last):
        world.units[building, UNIT_QUEUE + index] = world.units[building, UNIT_QUEUE + index + 1]
    world.units[building, UNIT_QUEUE + last] = 0
    world.units[building, UNIT_QUEUE_LENGTH] = last


@compiled
def run_building(world: Any, rules: Any, building: int) -> None:
    """Begin the next product; a well goes on pumping."""
    if world.units[building, UNIT_QUEUE_LENGTH] > 0:
        product = int(world.units[building, UNIT_QUEUE + 0])
        ticks = int(rules.product[product, PRODUCT_TICKS])
        enter_state(world, building, TRAINING, world.clock[TICK] + ticks)
    elif (
        world.units[building, UNIT_KIND] == OIL_WELL
        and world.board[AMOUNT, world.units[building, UNIT_CELL]] > 0
    ):
        enter_state(world, building, PUMPING, world.clock[TICK] + rules.oil_ticks)
    else:
        enter_state(world, building, IDLE, NEVER)


@compiled
def pump(world: Any, rules: Any, well: int) -> None:
    """One unit of oil flows into the owner's store."""
    cell, player = int(world.units[well, UNIT_CELL]), owner_of(rules, well)
    if world.board[AMOUNT, cell] > 0:
        world.board[AMOUNT, cell] -= 1
        amount = int(rules.tiles[world.board[TILE, cell], TILE_YIELD])
        store(world, player, OIL, amount)
        count_gathered(world, player, OIL, amount)


# --- repair ------------------------------------------------------------------------------------


@compiled
def can_repair(world: Any, rules: Any, building: int) -> bool:
    """True for a finished building that is damaged."""
    kind = world.units[building, UNIT_KIND]
    return bool(
        is_finished(world, building)
        and world.units[building, UNIT_HEALTH] < rules.kinds[kind, KIND_HEALTH]
    )


@compiled
def mend(world: Any, rules: Any, unit: int) -> None:
    """Give back as much health as building takes for it, for a share of the price in gold."""
    building = int(world.units[unit, UNIT_TARGET])
    if world.units[building, UNIT_SERIAL] != world.units[unit, UNIT_TARGET_SERIAL]:
        return
    kind, player = world.units[building, UNIT_KIND], owner_of(rules, unit)
    full = int(rules.kinds[kind, KIND_HEALTH])
    amount = max(1, full * REPAIR_TICKS // max(1, int(rules.product[kind, PRODUCT_TICKS])))
    amount = min(amount, full - int(world.units[building, UNIT_HEALTH]))
    price = np.int64(rules.product[kind, PRODUCT_COST + GOLD]) * rules.repair_percent * amount
    price = (price + 100 * full - 1) // (100 * full)
    if (
        amount > 0
        and world.players[player, RESOURCES + GOLD] >= price
        and can_repair(world, rules, building)
    ):
        world.players[player, RESOURCES + GOLD] -= price
        world.units[building, UNIT_HEALTH] += amount


@compiled
def claim_for(world: Any, rules: Any, building: int) -> None:
    """A building whose unit is ready wants ground for it."""
    is_upgrade = (
        world.units[building, UNIT_STATE] == TRAINING
        and world.units[building, UNIT_QUEUE + 0] >= FIRST_UPGRADE
    )
    if not is_upgrade:
        claim_exit(world, rules, building)
