"""Sites, queues, cancelling: what a peasant builds and what a building makes."""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import roster
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.board import is_building, is_finished, take_off_board
from marl_cair.games.deep_rts.rules.paths import NOWHERE, forget_path
from marl_cair.games.deep_rts.rules.work import drop_from_queue


@compiled
def site_cell(world: Any, rules: Any, player: int, unit: int, product: int) -> int:
    """Centre of the site that a peasant would build on; NOWHERE where none fits.

    A building rises around its builder; a well on the first oil beside it, in its own directions.
    """
    cell = int(world.units[unit, s.UNIT_CELL])
    if product == t.OIL_WELL:
        frame = rules.seats[world.clock[s.MAP_INDEX], player, rb.SEAT_FRAME]
        for own in range(rb.NUM_DIRECTIONS):
            beside = int(cell + rules.offset[rules.own_direction[frame, own]])
            if (
                world.board[s.TILE, beside] == t.OIL_TILE
                and world.board[s.OCCUPANT, beside] == s.NO_UNIT
            ):
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
    """True where the player's unit (or NO_UNIT) can make the product now."""
    if product < 0 or unit == s.NO_UNIT or not world.players[player, s.IS_ALIVE]:
        return False
    if (
        not rules.product[product, rb.PRODUCT_IS_ENABLED]
        or not rules.can_make[world.units[unit, s.UNIT_KIND], product]
    ):
        return False
    if not roster.can_pay(world, rules, player, product):
        return False
    if not roster.has_food(world, rules, player, product):
        return False
    if not is_building(world, unit):
        if (
            world.units[unit, s.UNIT_STATE] == s.INSIDE
            or world.players[player, s.NUM_UNITS] >= rules.slots
        ):
            return False
        return site_cell(world, rules, player, unit, product) != NOWHERE
    if not is_finished(world, unit) or world.units[unit, s.UNIT_QUEUE_LENGTH] >= s.QUEUE_LENGTH:
        return False
    if product >= t.FIRST_UPGRADE:
        return not is_at_top(world, rules, player, product)
    return True


@compiled
def is_at_top(world: Any, rules: Any, player: int, product: int) -> bool:
    """True where all levels of an upgrade are known or on their way."""
    upgrade = product - t.FIRST_UPGRADE
    levels = int(world.players[player, s.UPGRADES + upgrade])
    for place in range(world.players[player, s.NUM_UNITS]):
        unit = world.roster[player, place]
        for index in range(world.units[unit, s.UNIT_QUEUE_LENGTH]):
            levels += int(world.units[unit, s.UNIT_QUEUE + index] == product)
    return bool(levels >= rules.upgrade[upgrade, rb.UPGRADE_LEVELS])


@compiled
def claim_site(world: Any, rules: Any, player: int, unit: int, product: int) -> None:
    """Mark the cells that a player wants to build on in this decision with its bit."""
    centre, half = (
        site_cell(world, rules, player, unit, product),
        int(rules.kinds[product, rb.KIND_HALF_SIZE]),
    )
    for rows in range(-half, half + 1):
        for columns in range(-half, half + 1):
            cell = centre + rows * rules.stride + columns
            world.board[s.CLAIM, cell] = int(world.board[s.CLAIM, cell]) | (1 << player)


@compiled
def site_claims(world: Any, rules: Any, centre: int, product: int) -> int:
    """Bits of the players who want to build on any cell of a site in this decision."""
    half, players = int(rules.kinds[product, rb.KIND_HALF_SIZE]), 0
    for rows in range(-half, half + 1):
        for columns in range(-half, half + 1):
            players |= int(world.board[s.CLAIM, centre + rows * rules.stride + columns])
    return players


@compiled
def is_contested(world: Any, rules: Any, player: int, centre: int, product: int) -> bool:
    """True where another player wants to build on one of the cells too."""
    return bool(site_claims(world, rules, centre, product) & ~(1 << player) != 0)


@compiled
def clear_site_claims(world: Any) -> None:
    """Wipe the marks."""
    world.board[s.CLAIM, :] = 0


@compiled
def produce(world: Any, rules: Any, player: int, unit: int, product: int) -> None:
    """Begin a site, or join the queue; needs `can_produce`. A contested site costs nothing."""
    if is_building(world, unit):
        roster.pay(world, rules, player, product)
        if product < t.FIRST_UPGRADE:
            world.players[player, s.FOOD_USED] += rules.kinds[product, rb.KIND_FOOD_CONSUMED]
        world.units[unit, s.UNIT_QUEUE + world.units[unit, s.UNIT_QUEUE_LENGTH]] = product
        world.units[unit, s.UNIT_QUEUE_LENGTH] += 1
        if world.units[unit, s.UNIT_STATE] == s.IDLE:
            ticks = int(rules.product[product, rb.PRODUCT_TICKS])
            roster.enter_state(world, unit, s.TRAINING, world.clock[s.TICK] + ticks)
        return
    centre = site_cell(world, rules, player, unit, product)
    if is_contested(world, rules, player, centre, product):
        return
    if roster.free_slot(world, rules, player) == roster.NO_SLOT:
        return
    roster.pay(world, rules, player, product)
    begin_site(world, rules, player, unit, product, centre)


@compiled
def begin_site(world: Any, rules: Any, player: int, unit: int, product: int, centre: int) -> None:
    """The builder goes inside a site that has been paid."""
    take_off_board(world, rules, unit)
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
    roster.enter_state(
        world, site, s.RISING, world.clock[s.TICK] + int(rules.product[product, rb.PRODUCT_TICKS])
    )
    if world.players[player, s.CURSOR] == unit:
        world.players[player, s.CURSOR] = s.NO_UNIT


@compiled_copy
def can_cancel(world: Any, unit: int) -> bool:
    """True for sites, and for buildings with something in the queue."""
    return bool(
        world.units[unit, s.UNIT_STATE] == s.RISING or world.units[unit, s.UNIT_QUEUE_LENGTH] > 0
    )


@compiled
def cancel(world: Any, rules: Any, player: int, unit: int) -> None:
    """Give up a site for three quarters of its price, or the last of the queue for all of it."""
    if world.units[unit, s.UNIT_STATE] == s.RISING:
        for resource in range(t.NUM_RESOURCES):
            share = (
                int(rules.product[world.units[unit, s.UNIT_KIND], rb.PRODUCT_COST + resource])
                * 3
                // 4
            )
            roster.store(world, player, resource, share)
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
