"""Sites, queues, cancelling: what a peasant builds and what a building makes."""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts.rules.board import is_building, is_finished, take_off_board
from marl_cair.games.deep_rts.rules.paths import NOWHERE, forget_path
from marl_cair.games.deep_rts.rules.roster import (
    NO_SLOT,
    add_unit,
    can_pay,
    enter_state,
    free_slot,
    has_food,
    pay,
    refund,
    refund_food,
    store,
)
from marl_cair.games.deep_rts.rules.rulebook import (
    CELL_COLUMN,
    CELL_ROW,
    KIND_FOOD_CONSUMED,
    KIND_HALF_SIZE,
    KIND_HEALTH,
    NUM_DIRECTIONS,
    PRODUCT_COST,
    PRODUCT_IS_ENABLED,
    PRODUCT_TICKS,
    SEAT_FRAME,
    UPGRADE_LEVELS,
    WALK_PERCENT,
)
from marl_cair.games.deep_rts.rules.work import drop_from_queue
from marl_cair.games.deep_rts.state import (
    CLAIM,
    CURSOR,
    FOOD_USED,
    IDLE,
    INSIDE,
    IS_ALIVE,
    MAP_INDEX,
    NEVER,
    NO_GOAL,
    NO_ORDER,
    NO_UNIT,
    NUM_FALLEN,
    NUM_UNITS,
    OCCUPANT,
    QUEUE_LENGTH,
    RISING,
    TICK,
    TILE,
    TRAINING,
    UNIT_CELL,
    UNIT_GOAL,
    UNIT_HEALTH,
    UNIT_KIND,
    UNIT_ORDER,
    UNIT_PARTNER,
    UNIT_QUEUE,
    UNIT_QUEUE_LENGTH,
    UNIT_STATE,
    UNIT_TARGET,
    UPGRADES,
)
from marl_cair.games.deep_rts.tables import (
    FIRST_UPGRADE,
    LAVA,
    NUM_RESOURCES,
    OIL_TILE,
    OIL_WELL,
)


@compiled
def site_cell(world: Any, rules: Any, player: int, unit: int, product: int) -> int:
    """Centre of the site that a peasant would build on; NOWHERE where none fits.

    A building rises around its builder; a well on the first oil beside it, in its own directions.
    """
    cell = int(world.units[unit, UNIT_CELL])
    if product == OIL_WELL:
        frame = rules.seats[world.clock[MAP_INDEX], player, SEAT_FRAME]
        for own in range(NUM_DIRECTIONS):
            beside = int(cell + rules.offset[rules.own_direction[frame, own]])
            if world.board[TILE, beside] == OIL_TILE and world.board[OCCUPANT, beside] == NO_UNIT:
                return beside
        return NOWHERE
    half = int(rules.kinds[product, KIND_HALF_SIZE])
    row, column = int(rules.cells[cell, CELL_ROW]), int(rules.cells[cell, CELL_COLUMN])
    if row < half or row + half >= rules.rows or column < half or column + half >= rules.columns:
        return NOWHERE
    for rows in range(-half, half + 1):
        for columns in range(-half, half + 1):
            there = cell + rows * rules.stride + columns
            tile, occupant = world.board[TILE, there], world.board[OCCUPANT, there]
            if rules.tiles[tile, WALK_PERCENT] == 0 or tile == LAVA:
                return NOWHERE
            if not (occupant == NO_UNIT or occupant == unit):  # noqa: PLR1714, SIM109  # the types differ
                return NOWHERE
    return cell


@compiled
def can_produce(world: Any, rules: Any, player: int, unit: int, product: int) -> bool:
    """True where the player's unit (or NO_UNIT) can make the product now."""
    if product < 0 or unit == NO_UNIT or not world.players[player, IS_ALIVE]:
        return False
    if (
        not rules.product[product, PRODUCT_IS_ENABLED]
        or not rules.can_make[world.units[unit, UNIT_KIND], product]
    ):
        return False
    if not can_pay(world, rules, player, product):
        return False
    if not has_food(world, rules, player, product):
        return False
    if not is_building(world, unit):
        if (
            world.units[unit, UNIT_STATE] == INSIDE
            or world.players[player, NUM_UNITS] >= rules.slots
        ):
            return False
        return site_cell(world, rules, player, unit, product) != NOWHERE
    if not is_finished(world, unit) or world.units[unit, UNIT_QUEUE_LENGTH] >= QUEUE_LENGTH:
        return False
    if product >= FIRST_UPGRADE:
        return not is_at_top(world, rules, player, product)
    return True


@compiled
def is_at_top(world: Any, rules: Any, player: int, product: int) -> bool:
    """True where all levels of an upgrade are known or on their way."""
    upgrade = product - FIRST_UPGRADE
    levels = int(world.players[player, UPGRADES + upgrade])
    for place in range(world.players[player, NUM_UNITS]):
        unit = world.roster[player, place]
        for index in range(world.units[unit, UNIT_QUEUE_LENGTH]):
            levels += int(world.units[unit, UNIT_QUEUE + index] == product)
    return bool(levels >= rules.upgrade[upgrade, UPGRADE_LEVELS])


@compiled
def claim_site(world: Any, rules: Any, player: int, unit: int, product: int) -> None:
    """Mark the cells that a player wants to build on in this decision with its bit."""
    centre, half = (
        site_cell(world, rules, player, unit, product),
        int(rules.kinds[product, KIND_HALF_SIZE]),
    )
    for rows in range(-half, half + 1):
        for columns in range(-half, half + 1):
            cell = centre + rows * rules.stride + columns
            world.board[CLAIM, cell] = int(world.board[CLAIM, cell]) | (1 << player)


@compiled
def site_claims(world: Any, rules: Any, centre: int, product: int) -> int:
    """Bits of the players who want to build on any cell of a site in this decision."""
    half, players = int(rules.kinds[product, KIND_HALF_SIZE]), 0
    for rows in range(-half, half + 1):
        for columns in range(-half, half + 1):
            players |= int(world.board[CLAIM, centre + rows * rules.stride + columns])
    return players


@compiled
def is_contested(world: Any, rules: Any, player: int, centre: int, product: int) -> bool:
    """True where another player wants to build on one of the cells too."""
    return bool(site_claims(world, rules, centre, product) & ~(1 << player) != 0)


@compiled
def clear_site_claims(world: Any) -> None:
    """Wipe the marks."""
    world.board[CLAIM, :] = 0


@compiled
def produce(world: Any, rules: Any, player: int, unit: int, product: int) -> None:
    """Begin a site, or join the queue; needs `can_produce`. A contested site costs nothing."""
    if is_building(world, unit):
        pay(world, rules, player, product)
        if product < FIRST_UPGRADE:
            world.players[player, FOOD_USED] += rules.kinds[product, KIND_FOOD_CONSUMED]
        world.units[unit, UNIT_QUEUE + world.units[unit, UNIT_QUEUE_LENGTH]] = product
        world.units[unit, UNIT_QUEUE_LENGTH] += 1
        if world.units[unit, UNIT_STATE] == IDLE:
            ticks = int(rules.product[product, PRODUCT_TICKS])
            enter_state(world, unit, TRAINING, world.clock[TICK] + ticks)
        return
    centre = site_cell(world, rules, player, unit, product)
    if is_contested(world, rules, player, centre, product):
        return
    if free_slot(world, rules, player) == NO_SLOT:
        return
    pay(world, rules, player, product)
    begin_site(world, rules, player, unit, product, centre)


@compiled
def begin_site(world: Any, rules: Any, player: int, unit: int, product: int, centre: int) -> None:
    """The builder goes inside a site that has been paid."""
    take_off_board(world, rules, unit)
    world.units[unit, UNIT_ORDER] = NO_ORDER
    world.units[unit, UNIT_GOAL] = NO_GOAL
    world.units[unit, UNIT_TARGET] = NO_UNIT
    forget_path(world, unit)
    enter_state(world, unit, INSIDE, NEVER)
    world.units[unit, UNIT_CELL] = centre
    site = add_unit(world, rules, player, product, centre)
    world.units[site, UNIT_HEALTH] = max(1, int(rules.kinds[product, KIND_HEALTH]) // 10)
    world.units[site, UNIT_PARTNER] = unit
    world.units[unit, UNIT_PARTNER] = site
    enter_state(world, site, RISING, world.clock[TICK] + int(rules.product[product, PRODUCT_TICKS]))
    if world.players[player, CURSOR] == unit:
        world.players[player, CURSOR] = NO_UNIT


@compiled_copy
def can_cancel(world: Any, unit: int) -> bool:
    """True for sites, and for buildings with something in the queue."""
    return bool(world.units[unit, UNIT_STATE] == RISING or world.units[unit, UNIT_QUEUE_LENGTH] > 0)


@compiled
def cancel(world: Any, rules: Any, player: int, unit: int) -> None:
    """Give up a site for three quarters of its price, or the last of the queue for all of it."""
    if world.units[unit, UNIT_STATE] == RISING:
        for resource in range(NUM_RESOURCES):
            share = (
                int(rules.product[world.units[unit, UNIT_KIND], PRODUCT_COST + resource]) * 3 // 4
            )
            store(world, player, resource, share)
        world.units[unit, UNIT_HEALTH] = 0
        world.clock[NUM_FALLEN] += 1
        return
    last = int(world.units[unit, UNIT_QUEUE_LENGTH]) - 1
    product = int(world.units[unit, UNIT_QUEUE + last])
    refund(world, rules, player, product)
    refund_food(world, rules, player, product)
    drop_from_queue(world, unit, last)
    if last == 0:
        enter_state(world, unit, IDLE, NEVER)
