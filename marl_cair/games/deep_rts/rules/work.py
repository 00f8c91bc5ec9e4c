"""Economy: harvest and repair; sites, queues and products of buildings; oil wells."""

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import board, roster
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.motion import wins_claim
from marl_cair.games.deep_rts.rules.paths import NOWHERE, forget_path

REPAIR_TICKS = 10
RETRY_TICKS = 5  # until a building looks again for a free cell where its unit can leave


@compiled
def nearest_hall(world: Any, rules: Any, unit: int) -> int:
    """The finished own town hall that is nearest in a straight line, the older one of two."""
    player, cell = board.owner_of(rules, unit), int(world.units[unit, s.UNIT_CELL])
    best, best_distance = s.NO_UNIT, s.NEVER
    for place in range(world.players[player, s.NUM_UNITS]):
        hall = int(world.roster[player, place])
        if world.units[hall, s.UNIT_KIND] == t.TOWN_HALL and board.is_finished(world, hall):
            distance = board.unit_distance(world, rules, cell, hall)
            if distance < best_distance:
                best, best_distance = hall, distance
    return best


@compiled
def gather(world: Any, rules: Any, unit: int) -> None:
    """Take one unit of the resource; the tile loses it in `settle_harvest`."""
    goal = int(world.units[unit, s.UNIT_GOAL])
    if world.board[s.AMOUNT, goal] <= 0:
        return
    resource = board.tile_value(world, rules, goal, rb.TILE_RESOURCE)
    amount = board.tile_value(world, rules, goal, rb.TILE_YIELD)
    world.units[unit, s.UNIT_CARRY] += amount
    world.units[unit, s.UNIT_CARRY_KIND] = resource
    count_gathered(world, board.owner_of(rules, unit), resource, amount)
    world.units[unit, s.UNIT_EXIT] = s.TOOK


@compiled_copy
def count_gathered(world: Any, player: int, resource: int, amount: int) -> None:
    """Count what was taken from the ground, up to MAX_RESOURCE."""
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
            if world.board[s.AMOUNT, goal] <= 0:
                clear_tile(world, rules, goal)


@compiled
def clear_tile(world: Any, rules: Any, cell: int) -> None:
    """Turn a used-up tile to grass, also in the memory of players that see it."""
    world.board[s.TILE, cell] = t.GRASS
    world.board[s.AMOUNT, cell] = 0
    if rules.fog != 0:
        for player in range(rules.num_players):
            if world.vision[player, cell] > 0:
                world.known[rules.team[player], cell] = t.GRASS


@compiled
def deliver(world: Any, rules: Any, unit: int) -> None:
    """Empty the load into the store; go back for more where preset and order say so."""
    load, carried = int(world.units[unit, s.UNIT_CARRY]), int(world.units[unit, s.UNIT_CARRY_KIND])
    if carried != t.NO_RESOURCE:
        roster.store(world, board.owner_of(rules, unit), carried, load)
    world.units[unit, s.UNIT_CARRY] = 0
    goes_back = rules.harvests_forever != 0 and world.units[unit, s.UNIT_GOAL] != s.NO_GOAL
    world.units[unit, s.UNIT_ORDER] = s.HARVEST if goes_back else s.NO_ORDER


@compiled
def can_repair(world: Any, rules: Any, building: int) -> bool:
    """True for a finished building that is damaged."""
    health = board.kind_value(world, rules, building, rb.KIND_HEALTH)
    is_damaged = world.units[building, s.UNIT_HEALTH] < health
    return bool(is_damaged and board.is_finished(world, building))


@compiled
def repair(world: Any, rules: Any, unit: int) -> None:
    """Give a building as much health as building takes in these ticks, for a share of its gold."""
    building = int(world.units[unit, s.UNIT_TARGET])
    if world.units[building, s.UNIT_SERIAL] != world.units[unit, s.UNIT_TARGET_SERIAL]:
        return
    kind, player = world.units[building, s.UNIT_KIND], board.owner_of(rules, unit)
    full = int(rules.kinds[kind, rb.KIND_HEALTH])
    amount = max(1, full * REPAIR_TICKS // max(1, int(rules.product[kind, rb.PRODUCT_TICKS])))
    amount = min(amount, full - int(world.units[building, s.UNIT_HEALTH]))
    price = np.int64(rules.product[kind, rb.PRODUCT_COST + t.GOLD]) * rules.repair_percent * amount
    price = (price + 100 * full - 1) // (100 * full)
    can_pay = world.players[player, s.RESOURCES + t.GOLD] >= price
    if can_pay and can_repair(world, rules, building):
        world.players[player, s.RESOURCES + t.GOLD] -= price
        world.units[building, s.UNIT_HEALTH] += amount


# --- what can be produced ------------------------------------------------------------------------


@compiled
def site_cell(world: Any, rules: Any, player: int, unit: int, product: int) -> int:
    """Centre of the site that a peasant would build on; NOWHERE where none fits.

    It lies around the builder; of a well on the first oil beside it, in its own directions.
    """
    cell = int(world.units[unit, s.UNIT_CELL])
    if product == t.OIL_WELL:
        frame = board.frame_of(world, rules, player)
        for own in range(rb.NUM_DIRECTIONS):
            beside = int(cell + rules.offset[rules.own_direction[frame, own]])
            is_oil = world.board[s.TILE, beside] == t.OIL_TILE
            if is_oil and world.board[s.OCCUPANT, beside] == s.NO_UNIT:
                return beside
        return NOWHERE
    half = int(rules.kinds[product, rb.KIND_HALF_SIZE])
    row, column = int(rules.cells[cell, rb.CELL_ROW]), int(rules.cells[cell, rb.CELL_COLUMN])
    if row < half or row + half >= rules.rows or column < half or column + half >= rules.columns:
        return NOWHERE
    for rows in range(-half, half + 1):
        for columns in range(-half, half + 1):
            there = cell + rows * rules.stride + columns
            tile, occupant = world.board[s.TILE, there], world.board[s.OCCUPANT, there]
            if rules.tiles[tile, rb.WALK_PERCENT] == 0 or tile == t.LAVA:
                return NOWHERE
            if not (occupant == s.NO_UNIT or occupant == unit):  # noqa: PLR1714  # the types differ
                return NOWHERE
    return cell


@compiled
def can_produce(world: Any, rules: Any, player: int, unit: int, product: int) -> bool:
    """True where the player's unit (or NO_UNIT) can make the product (or -1) now."""
    if product < 0 or unit == s.NO_UNIT or not world.players[player, s.IS_ALIVE]:
        return False
    if (
        not rules.product[product, rb.PRODUCT_IS_ENABLED]
        or not rules.can_make[world.units[unit, s.UNIT_KIND], product]
        or not roster.can_pay(world, rules, player, product)
        or not roster.has_food(world, rules, player, product)
    ):
        return False
    if not board.is_building(world, unit):
        is_inside = world.units[unit, s.UNIT_STATE] == s.INSIDE
        if is_inside or world.players[player, s.NUM_UNITS] >= rules.slots:
            return False
        return site_cell(world, rules, player, unit, product) != NOWHERE
    is_full = world.units[unit, s.UNIT_QUEUE_LENGTH] >= s.QUEUE_LENGTH
    if is_full or not board.is_finished(world, unit):
        return False
    return product < t.FIRST_UPGRADE or not has_all_levels(world, rules, player, product)


@compiled
def has_all_levels(world: Any, rules: Any, player: int, product: int) -> bool:
    """True where the player has or has queued all levels of an upgrade."""
    upgrade = product - t.FIRST_UPGRADE
    levels = int(world.players[player, s.UPGRADES + upgrade])
    for place in range(world.players[player, s.NUM_UNITS]):
        unit = world.roster[player, place]
        for index in range(world.units[unit, s.UNIT_QUEUE_LENGTH]):
            levels += int(world.units[unit, s.UNIT_QUEUE + index] == product)
    return bool(levels >= rules.upgrade[upgrade, rb.UPGRADE_LEVELS])


# --- starting ------------------------------------------------------------------------------------


@compiled
def claim_site(world: Any, rules: Any, player: int, centre: int, product: int) -> None:
    """Mark the cells of a site that a player wants in this step with the player's bit."""
    half = int(rules.kinds[product, rb.KIND_HALF_SIZE])
    for rows in range(-half, half + 1):
        for columns in range(-half, half + 1):
            cell = centre + rows * rules.stride + columns
            world.board[s.CLAIM, cell] = int(world.board[s.CLAIM, cell]) | (1 << player)


@compiled
def site_claims(world: Any, rules: Any, centre: int, product: int) -> int:
    """Bits of the players that want any cell of a site in this step."""
    half, players = int(rules.kinds[product, rb.KIND_HALF_SIZE]), 0
    for rows in range(-half, half + 1):
        for columns in range(-half, half + 1):
            players |= int(world.board[s.CLAIM, centre + rows * rules.stride + columns])
    return players


@compiled
def produce(world: Any, rules: Any, player: int, unit: int, product: int) -> None:
    """Pay, and queue the product or begin its site; needs `can_produce`.

    A site that another player wants too is refused and costs nothing.
    """
    if not board.is_building(world, unit):
        centre = site_cell(world, rules, player, unit, product)
        if site_claims(world, rules, centre, product) & ~(1 << player) == 0:
            roster.pay(world, rules, player, product)
            begin_site(world, rules, player, unit, product, centre)
        return
    roster.pay(world, rules, player, product)
    if product < t.FIRST_UPGRADE:
        world.players[player, s.FOOD_USED] += rules.kinds[product, rb.KIND_FOOD_CONSUMED]
    world.units[unit, s.UNIT_QUEUE + world.units[unit, s.UNIT_QUEUE_LENGTH]] = product
    world.units[unit, s.UNIT_QUEUE_LENGTH] += 1
    if world.units[unit, s.UNIT_STATE] == s.IDLE:
        run_building(world, rules, unit)


@compiled
def begin_site(world: Any, rules: Any, player: int, unit: int, product: int, centre: int) -> None:
    """Put the builder inside a site that has been paid."""
    board.take_off_board(world, rules, unit)
    world.units[unit, s.UNIT_ORDER] = s.NO_ORDER
    world.units[unit, s.UNIT_GOAL] = s.NO_GOAL
    world.units[unit, s.UNIT_TARGET] = s.NO_UNIT
    forget_path(world, unit)
    roster.enter_state(world, unit, s.INSIDE, s.NEVER)
    world.units[unit, s.UNIT_CELL] = centre
    site = roster.add_unit(world, rules, player, product, centre)
    world.units[site, s.UNIT_HEALTH] = max(1, int(rules.kinds[product, rb.KIND_HEALTH]) // 10)
    world.units[site, s.UNIT_PARTNER] = unit
    world.units[unit, s.UNIT_PARTNER] = site
    ticks = int(rules.product[product, rb.PRODUCT_TICKS])
    roster.enter_state(world, site, s.RISING, world.clock[s.TICK] + ticks)
    if world.players[player, s.CURSOR] == unit:
        world.players[player, s.CURSOR] = s.NO_UNIT


@compiled_copy
def can_cancel(world: Any, unit: int) -> bool:
    """True for sites, and for buildings with something in the queue."""
    is_site = world.units[unit, s.UNIT_STATE] == s.RISING
    return bool(is_site or world.units[unit, s.UNIT_QUEUE_LENGTH] > 0)


@compiled
def cancel(world: Any, rules: Any, player: int, unit: int) -> None:
    """Give up a site for three quarters of its price, or the last of the queue for all of it."""
    if world.units[unit, s.UNIT_STATE] == s.RISING:
        kind = world.units[unit, s.UNIT_KIND]
        for resource in range(t.NUM_RESOURCES):
            price = int(rules.product[kind, rb.PRODUCT_COST + resource])
            roster.store(world, player, resource, price * 3 // 4)
        world.units[unit, s.UNIT_HEALTH] = 0
        world.clock[s.NUM_FALLEN] += 1
        return
    last = int(world.units[unit, s.UNIT_QUEUE_LENGTH]) - 1
    product = int(world.units[unit, s.UNIT_QUEUE + last])
    roster.refund(world, rules, player, product)
    roster.refund_food(world, rules, player, product)
    drop_from_queue(world, unit, last)
    if last == 0:
        roster.enter_state(world, unit, s.IDLE, s.NEVER)


# --- finishing -----------------------------------------------------------------------------------


@compiled
def finish_site(world: Any, rules: Any, site: int) -> None:
    """Complete the building; its builder steps out. Retry later if there is no free cell for it."""
    if not wins_claim(world, site):
        roster.set_due(world, site, int(world.clock[s.TICK]) + RETRY_TICKS)
        return
    kind, player = world.units[site, s.UNIT_KIND], board.owner_of(rules, site)
    roster.release_builder(world, rules, site, int(world.units[site, s.UNIT_EXIT]))
    health = int(rules.kinds[kind, rb.KIND_HEALTH])
    world.units[site, s.UNIT_HEALTH] += health - health // 10
    world.players[player, s.FOOD_MADE] += rules.kinds[kind, rb.KIND_FOOD_PRODUCED]
    world.players[player, s.NUM_CREATED + kind] += 1
    roster.enter_state(world, site, s.IDLE, world.clock[s.TICK] + 1)


@compiled
def finish_product(world: Any, rules: Any, building: int) -> None:
    """Place the trained unit, or raise the upgrade; retry later without a free cell or slot."""
    player, tick = board.owner_of(rules, building), int(world.clock[s.TICK])
    product = int(world.units[building, s.UNIT_QUEUE + 0])
    if product >= t.FIRST_UPGRADE:
        world.players[player, s.UPGRADES + product - t.FIRST_UPGRADE] += 1
    else:
        unit = roster.NO_SLOT
        if wins_claim(world, building):
            cell = int(world.units[building, s.UNIT_EXIT])
            unit = roster.add_unit(world, rules, player, product, cell)
        if unit == roster.NO_SLOT:
            roster.set_due(world, building, tick + RETRY_TICKS)
            return
        world.players[player, s.NUM_CREATED + product] += 1
        send_to_rally(world, rules, building, unit)
    drop_from_queue(world, building, 0)
    roster.enter_state(world, building, s.IDLE, tick)  # due now: the next begins in this tick


@compiled
def send_to_rally(world: Any, rules: Any, building: int, unit: int) -> None:
    """Send a new unit to the rally point; workers harvest there."""
    rally = int(world.units[building, s.UNIT_RALLY])
    if rally == s.NO_GOAL:
        return
    world.units[unit, s.UNIT_GOAL] = rally
    resource = board.tile_value(world, rules, rally, rb.TILE_RESOURCE)
    is_peasant = world.units[unit, s.UNIT_KIND] == t.PEASANT
    harvests = is_peasant and resource not in (t.NO_RESOURCE, t.OIL)
    world.units[unit, s.UNIT_ORDER] = s.HARVEST if harvests else s.MOVE


@compiled
def drop_from_queue(world: Any, building: int, place: int) -> None:
    """Remove one product from the queue."""
    last = world.units[building, s.UNIT_QUEUE_LENGTH] - 1
    for column in range(s.UNIT_QUEUE + place, s.UNIT_QUEUE + last):
        world.units[building, column] = world.units[building, column + 1]
    world.units[building, s.UNIT_QUEUE + last] = 0
    world.units[building, s.UNIT_QUEUE_LENGTH] = last


@compiled
def run_building(world: Any, rules: Any, building: int) -> None:
    """Begin the next product of the queue, or pump, or idle."""
    tick = world.clock[s.TICK]
    if world.units[building, s.UNIT_QUEUE_LENGTH] > 0:
        product = int(world.units[building, s.UNIT_QUEUE + 0])
        ticks = int(rules.product[product, rb.PRODUCT_TICKS])
        roster.enter_state(world, building, s.TRAINING, tick + ticks)
    elif (
        world.units[building, s.UNIT_KIND] == t.OIL_WELL
        and world.board[s.AMOUNT, world.units[building, s.UNIT_CELL]] > 0
    ):
        roster.enter_state(world, building, s.PUMPING, tick + rules.oil_ticks)
    else:
        roster.enter_state(world, building, s.IDLE, s.NEVER)


@compiled
def pump(world: Any, rules: Any, well: int) -> None:
    """Move one unit of oil into the owner's store."""
    cell, player = int(world.units[well, s.UNIT_CELL]), board.owner_of(rules, well)
    if world.board[s.AMOUNT, cell] > 0:
        world.board[s.AMOUNT, cell] -= 1
        amount = board.tile_value(world, rules, cell, rb.TILE_YIELD)
        roster.store(world, player, t.OIL, amount)
        count_gathered(world, player, t.OIL, amount)
