"""What units do in peace: harvest and bring in, build, train, pump oil, repair."""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import board
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.motion import claim_exit, wins_claim
from marl_cair.games.deep_rts.rules.roster import NO_SLOT, add_unit, enter_state, set_due, store

RETRY_TICKS = 5  # until a building looks again for ground where its unit can stand
REPAIR_TICKS = 10


# --- harvest ---------------------------------------------------------------------------------


@compiled
def nearest_hall(world: Any, rules: Any, unit: int) -> int:
    """The finished own town hall that is nearest in a straight line, the older one of two."""
    player, cell = board.owner_of(rules, unit), int(world.units[unit, s.UNIT_CELL])
    best, best_distance = s.NO_UNIT, s.NEVER
    if world.players[player, s.NUM_OWNED + t.TOWN_HALL] == 0:
        return best
    for place in range(world.players[player, s.NUM_UNITS]):
        hall = int(world.roster[player, place])
        if world.units[hall, s.UNIT_KIND] != t.TOWN_HALL or not board.is_finished(world, hall):
            continue
        distance = board.unit_distance(world, rules, cell, hall)
        if distance < best_distance:
            best, best_distance = hall, distance
    return best


@compiled
def gather(world: Any, rules: Any, unit: int) -> None:
    """One unit of the resource is in the worker's hands; the tile loses it after all have taken."""
    goal = int(world.units[unit, s.UNIT_GOAL])
    if world.board[s.AMOUNT, goal] <= 0:
        return
    tile = world.board[s.TILE, goal]
    resource = int(rules.tiles[tile, rb.TILE_RESOURCE])
    take(world, unit, resource, int(rules.tiles[tile, rb.TILE_YIELD]), board.owner_of(rules, unit))
    world.units[unit, s.UNIT_EXIT] = s.TOOK


@compiled
def take(world: Any, unit: int, resource: int, amount: int, player: int) -> None:
    """Into the hands of a worker; counted as gathered."""
    world.units[unit, s.UNIT_CARRY] += amount
    world.units[unit, s.UNIT_CARRY_KIND] = resource
    count_gathered(world, player, resource, amount)


@compiled_copy
def count_gathered(world: Any, player: int, resource: int, amount: int) -> None:
    """The statistics of what was taken from the ground, up to MAX_RESOURCE."""
    full = world.players[player, s.GATHERED + resource] + amount
    world.players[player, s.GATHERED + resource] = min(t.MAX_RESOURCE, full)


@compiled
def settle_harvest(world: Any, rules: Any) -> None:
    """The tiles lose what was taken in this tick; an empty one becomes grass."""
    for place in range(world.clock[s.NUM_ACTING]):
        unit = int(world.acting[place])
        if world.units[unit, s.UNIT_EXIT] == s.TOOK:
            world.board[s.AMOUNT, world.units[unit, s.UNIT_GOAL]] -= 1
    for place in range(world.clock[s.NUM_ACTING]):
        unit = int(world.acting[place])
        if world.units[unit, s.UNIT_EXIT] == s.TOOK:
            world.units[unit, s.UNIT_EXIT] = s.NO_GOAL
            goal = int(world.units[unit, s.UNIT_GOAL])
            if world.board[s.AMOUNT, goal] <= 0 and world.board[s.TILE, goal] != t.GRASS:
                board.change_tile(world, rules, goal, t.GRASS)


@compiled_copy
def is_used_up(world: Any, rules: Any, tile: int) -> bool:
    """True where nothing can be gathered by hand (any more)."""
    resource = rules.tiles[world.board[s.TILE, tile], rb.TILE_RESOURCE]
    return bool(resource in (t.NO_RESOURCE, t.OIL) or world.board[s.AMOUNT, tile] <= 0)


@compiled
def deliver(world: Any, rules: Any, unit: int) -> None:
    """Fill the store; the worker goes back for more where the rules and its order say so."""
    carried = int(world.units[unit, s.UNIT_CARRY_KIND])
    if carried != t.NO_RESOURCE:
        store(world, board.owner_of(rules, unit), carried, int(world.units[unit, s.UNIT_CARRY]))
    world.units[unit, s.UNIT_CARRY] = 0
    goes_back = rules.harvests_forever != 0 and world.units[unit, s.UNIT_GOAL] != s.NO_GOAL
    world.units[unit, s.UNIT_ORDER] = s.HARVEST if goes_back else s.NO_ORDER


# --- buildings -------------------------------------------------------------------------------


@compiled
def finish_site(world: Any, rules: Any, site: int) -> None:
    """The building stands and its builder steps out, where there is ground for that."""
    if not wins_claim(world, site):
        set_due(world, site, int(world.clock[s.TICK]) + RETRY_TICKS)
        return
    kind, player = world.units[site, s.UNIT_KIND], board.owner_of(rules, site)
    builder = int(world.units[site, s.UNIT_PARTNER])
    world.units[site, s.UNIT_PARTNER] = s.NO_UNIT
    world.units[builder, s.UNIT_PARTNER] = s.NO_UNIT
    board.put_on_board(world, rules, builder, int(world.units[site, s.UNIT_EXIT]))
    enter_state(world, builder, s.IDLE, world.clock[s.TICK] + 1)
    health = int(rules.kinds[kind, rb.KIND_HEALTH])
    world.units[site, s.UNIT_HEALTH] += health - health // 10
    world.players[player, s.FOOD_MADE] += rules.kinds[kind, rb.KIND_FOOD_PRODUCED]
    world.players[player, s.NUM_CREATED + kind] += 1
    enter_state(world, site, s.IDLE, world.clock[s.TICK] + 1)


@compiled
def finish_product(world: Any, rules: Any, building: int) -> None:
    """The trained unit steps out, or the upgrade is known; the next in the queue begins."""
    player = board.owner_of(rules, building)
    product = int(world.units[building, s.UNIT_QUEUE + 0])
    if product >= t.FIRST_UPGRADE:
        world.players[player, s.UPGRADES + product - t.FIRST_UPGRADE] += 1
    else:
        if not wins_claim(world, building):
            set_due(world, building, int(world.clock[s.TICK]) + RETRY_TICKS)
            return
        unit = add_unit(world, rules, player, product, int(world.units[building, s.UNIT_EXIT]))
        if unit == NO_SLOT:
            set_due(world, building, int(world.clock[s.TICK]) + RETRY_TICKS)
            return
        world.players[player, s.NUM_CREATED + product] += 1
        send_to_rally(world, rules, building, unit)
    drop_from_queue(world, building, 0)
    enter_state(
        world, building, s.IDLE, world.clock[s.TICK]
    )  # so that the next begins in this tick


@compiled
def send_to_rally(world: Any, rules: Any, building: int, unit: int) -> None:
    """A new unit follows the rally point: workers harvest there, others go there."""
    rally = int(world.units[building, s.UNIT_RALLY])
    if rally == s.NO_GOAL:
        return
    world.units[unit, s.UNIT_GOAL] = rally
    world.units[unit, s.UNIT_ORDER] = s.MOVE
    resource = rules.tiles[world.board[s.TILE, rally], rb.TILE_RESOURCE]
    if world.units[unit, s.UNIT_KIND] == t.PEASANT and resource not in (t.NO_RESOURCE, t.OIL):
        world.units[unit, s.UNIT_ORDER] = s.HARVEST


@compiled
def drop_from_queue(world: Any, building: int, place: int) -> None:
    """Take one product out of the queue."""
    last = world.units[building, s.UNIT_QUEUE_LENGTH] - 1
    for index in range(place, last):
        world.units[building, s.UNIT_QUEUE + index] = world.units[
            building, s.UNIT_QUEUE + index + 1
        ]
    world.units[building, s.UNIT_QUEUE + last] = 0
    world.units[building, s.UNIT_QUEUE_LENGTH] = last


@compiled
def run_building(world: Any, rules: Any, building: int) -> None:
    """Begin the next product; a well goes on pumping."""
    if world.units[building, s.UNIT_QUEUE_LENGTH] > 0:
        product = int(world.units[building, s.UNIT_QUEUE + 0])
        ticks = int(rules.product[product, rb.PRODUCT_TICKS])
        enter_state(world, building, s.TRAINING, world.clock[s.TICK] + ticks)
    elif (
        world.units[building, s.UNIT_KIND] == t.OIL_WELL
        and world.board[s.AMOUNT, world.units[building, s.UNIT_CELL]] > 0
    ):
        enter_state(world, building, s.PUMPING, world.clock[s.TICK] + rules.oil_ticks)
    else:
        enter_state(world, building, s.IDLE, s.NEVER)


@compiled
def pump(world: Any, rules: Any, well: int) -> None:
    """One unit of oil flows into the owner's store."""
    cell, player = int(world.units[well, s.UNIT_CELL]), board.owner_of(rules, well)
    if world.board[s.AMOUNT, cell] > 0:
        world.board[s.AMOUNT, cell] -= 1
        amount = int(rules.tiles[world.board[s.TILE, cell], rb.TILE_YIELD])
        store(world, player, t.OIL, amount)
        count_gathered(world, player, t.OIL, amount)


# --- repair ------------------------------------------------------------------------------------


@compiled
def can_repair(world: Any, rules: Any, building: int) -> bool:
    """True for a finished building that is damaged."""
    kind = world.units[building, s.UNIT_KIND]
    return bool(
        board.is_finished(world, building)
        and world.units[building, s.UNIT_HEALTH] < rules.kinds[kind, rb.KIND_HEALTH]
    )


@compiled
def repair(world: Any, rules: Any, unit: int) -> None:
    """Give back as much health as building takes for it, for a share of the price in gold."""
    building = int(world.units[unit, s.UNIT_TARGET])
    if world.units[building, s.UNIT_SERIAL] != world.units[unit, s.UNIT_TARGET_SERIAL]:
        return
    kind, player = world.units[building, s.UNIT_KIND], board.owner_of(rules, unit)
    full = int(rules.kinds[kind, rb.KIND_HEALTH])
    amount = max(1, full * REPAIR_TICKS // max(1, int(rules.product[kind, rb.PRODUCT_TICKS])))
    amount = min(amount, full - int(world.units[building, s.UNIT_HEALTH]))
    price = np.int64(rules.product[kind, rb.PRODUCT_COST + t.GOLD]) * rules.repair_percent * amount
    price = (price + 100 * full - 1) // (100 * full)
    if (
        amount > 0
        and world.players[player, s.RESOURCES + t.GOLD] >= price
        and can_repair(world, rules, building)
    ):
        world.players[player, s.RESOURCES + t.GOLD] -= price
        world.units[building, s.UNIT_HEALTH] += amount


@compiled
def claim_for(world: Any, rules: Any, building: int) -> None:
    """A building whose unit is ready wants ground for it."""
    is_upgrade = (
        world.units[building, s.UNIT_STATE] == s.TRAINING
        and world.units[building, s.UNIT_QUEUE + 0] >= t.FIRST_UPGRADE
    )
    if not is_upgrade:
        claim_exit(world, rules, building)
