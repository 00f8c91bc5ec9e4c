"""Orders: what each action does and when it is legal. Both action spaces move the same cursor.

`unit`: no-op, next unit, stop, cancel, one action per product, then three boards of cells in the
own view: go to (or work at, attack, repair, rally to) a cell, advance to it, select the unit on it.
`classic`: the original's 16, mended.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts.board import is_building, is_finished, sees
from marl_cair.games.deep_rts.building import (
    can_cancel,
    can_produce,
    cancel,
    claim_site,
    clear_site_claims,
    is_site_product,
    produce,
)
from marl_cair.games.deep_rts.combat import aim_at, in_range, is_enemy, is_on_board, is_soldier
from marl_cair.games.deep_rts.paths import NOWHERE, forget_path
from marl_cair.games.deep_rts.roster import enter_state
from marl_cair.games.deep_rts.rulebook import (
    CLASSIC_ACTIONS,
    KIND_DAMAGE_MAX,
    NUM_DIRECTIONS,
    SEAT_FRAME,
    TILE_RESOURCE,
)
from marl_cair.games.deep_rts.sights import CAN_ADVANCE, CAN_RALLY, kind_of_place, order_at
from marl_cair.games.deep_rts.state import (
    ADVANCE,
    AMOUNT,
    ATTACK,
    CURSOR,
    HARVEST,
    IDLE,
    INSIDE,
    IS_ALIVE,
    MAP_INDEX,
    MOVE,
    NEVER,
    NO_GOAL,
    NO_ORDER,
    NO_UNIT,
    NUM_UNITS,
    OCCUPANT,
    TICK,
    TILE,
    UNIT_BLOCKED,
    UNIT_CELL,
    UNIT_GOAL,
    UNIT_KIND,
    UNIT_ORDER,
    UNIT_RALLY,
    UNIT_SERIAL,
    UNIT_STATE,
    UNIT_TARGET,
    WALKING,
)
from marl_cair.games.deep_rts.tables import (
    NO_RESOURCE,
    NUM_MOBILE_KINDS,
    NUM_PRODUCTS,
    OIL,
    PEASANT,
)

NOOP, NEXT_UNIT, STOP, CANCEL, FIRST_PRODUCT = range(5)
FIRST_CELL = FIRST_PRODUCT + NUM_PRODUCTS
NUM_CELL_ORDERS = 3
GO_THERE, ADVANCE_THERE, SELECT_THERE = range(NUM_CELL_ORDERS)

CLASSIC_PREVIOUS, CLASSIC_NEXT, CLASSIC_MOVE = 0, 1, 2
CLASSIC_ATTACK, CLASSIC_HARVEST, CLASSIC_BUILD, CLASSIC_NOOP = 10, 11, 12, 15
NUM_CLASSIC_BUILDS = 3
NUM_CLASSIC = 16
# Left, right, up, down, then the diagonals: directions of the own view.
CLASSIC_DIRECTIONS = (3, 1, 0, 2, 7, 4, 6, 5)


# --- the cursor ------------------------------------------------------------------------------


@compiled_copy
def is_selectable(world: Any, unit: int) -> bool:
    """False for a builder inside its site."""
    return bool(world.units[unit, UNIT_STATE] != INSIDE)


@compiled
def place_in_roster(world: Any, player: int, unit: int) -> int:
    """The unit's place, -1 for none."""
    for place in range(world.players[player, NUM_UNITS]):
        if world.roster[player, place] == unit:
            return place
    return -1


@compiled
def step_cursor(world: Any, player: int, step: int) -> None:
    """Select the next (1) or previous (-1) unit, the first or last if none is selected."""
    count = int(world.players[player, NUM_UNITS])
    place = place_in_roster(world, player, world.players[player, CURSOR])
    if place < 0 and step < 0:
        place = 0
    for _ in range(count):
        place = (place + step) % count
        if is_selectable(world, world.roster[player, place]):
            world.players[player, CURSOR] = world.roster[player, place]
            return
    world.players[player, CURSOR] = NO_UNIT


@compiled_copy
def waits_for_order(world: Any, unit: int) -> bool:
    """True for units that walk and have nothing to do."""
    if world.units[unit, UNIT_KIND] < NUM_MOBILE_KINDS:
        return bool(world.units[unit, UNIT_ORDER] == NO_ORDER and is_selectable(world, unit))
    return False


@compiled
def pass_cursor(world: Any, player: int) -> None:
    """After an order: to the next unit that waits for one, else to the next unit."""
    count = int(world.players[player, NUM_UNITS])
    start = place_in_roster(world, player, world.players[player, CURSOR])
    for step in range(1, count + 1):
        unit = world.roster[player, (start + step) % count]
        if waits_for_order(world, unit):
            world.players[player, CURSOR] = unit
            return
    step_cursor(world, player, 1)


@compiled
def num_others(world: Any, player: int) -> int:
    """Units that the cursor could go to."""
    count = 0
    for place in range(world.players[player, NUM_UNITS]):
        unit = world.roster[player, place]
        if unit != world.players[player, CURSOR] and is_selectable(world, unit):
            count += 1
    return count


# --- what an action means ----------------------------------------------------------------------


@compiled
def product_of(world: Any, rules: Any, player: int, action: int) -> int:
    """The product that an action asks the cursor's unit for, NOWHERE for none."""
    if rules.action_space == CLASSIC_ACTIONS:
        unit = world.players[player, CURSOR]
        slot = action - CLASSIC_BUILD
        if unit == NO_UNIT or not 0 <= slot < NUM_CLASSIC_BUILDS:
            return NOWHERE
        return int(rules.products[world.units[unit, UNIT_KIND], slot])
    product = action - FIRST_PRODUCT
    return int(product) if 0 <= product < NUM_PRODUCTS else NOWHERE


@compiled
def give_order(world: Any, unit: int, order: int, goal: int) -> None:
    """Replace what the unit was told; a step that has begun is finished first."""
    world.units[unit, UNIT_ORDER] = order
    world.units[unit, UNIT_GOAL] = goal
    world.units[unit, UNIT_BLOCKED] = 0
    forget_path(world, unit)
    if order != ATTACK:
        world.units[unit, UNIT_TARGET] = NO_UNIT
    if world.units[unit, UNIT_STATE] != WALKING:
        enter_state(world, unit, IDLE, world.clock[TICK] + 1)


@compiled
def obey_go(world: Any, rules: Any, player: int, unit: int, cell: int) -> bool:
    """Do at a cell what is to be done there; False where nothing is."""
    if is_building(world, unit):
        if not can_rally(world, rules, unit):
            return False
        if not CAN_RALLY[kind_of_place(world, rules, player, cell)]:
            return False
        world.units[unit, UNIT_RALLY] = cell
        return True
    order = order_at(world, rules, player, unit, cell)
    if order == NO_ORDER:
        return False
    target = world.board[OCCUPANT, cell]
    goal = cell if order in (MOVE, HARVEST) else NO_GOAL
    give_order(world, unit, order, goal)
    if order not in (MOVE, HARVEST):
        aim_at(world, unit, target)
    return True


@compiled
def can_rally(world: Any, rules: Any, unit: int) -> bool:
    """True for finished buildings that train units."""
    first = rules.products[world.units[unit, UNIT_KIND], 0]
    return bool(0 <= first < NUM_MOBILE_KINDS and is_finished(world, unit))


@compiled
def may_advance(world: Any, rules: Any, player: int, unit: int, cell: int) -> bool:
    """True where a soldier can be sent to fight its way."""
    if not is_soldier(world.units[unit, UNIT_KIND]) or world.units[unit, UNIT_CELL] == cell:
        return False
    return bool(CAN_ADVANCE[kind_of_place(world, rules, player, cell)])


@compiled
def may_select(world: Any, rules: Any, player: int, cell: int) -> bool:
    """True on another own unit."""
    unit = world.board[OCCUPANT, cell]
    return bool(
        unit != NO_UNIT and unit // rules.slots == player and unit != world.players[player, CURSOR]
    )


@compiled
def obey_cell_order(world: Any, rules: Any, player: int, action: int) -> bool:
    """Orders that point at a cell of the own view."""
    frame = rules.seats[world.clock[MAP_INDEX], player, SEAT_FRAME]
    own = (action - FIRST_CELL) % (rules.rows * rules.columns)
    what = (action - FIRST_CELL) // (rules.rows * rules.columns)
    cell = int(rules.world_cell[frame, own])
    unit = int(world.players[player, CURSOR])
    if what == SELECT_THERE:
        is_legal = may_select(world, rules, player, cell)
        if is_legal:
            world.players[player, CURSOR] = world.board[OCCUPANT, cell]
        return is_legal
    if unit == NO_UNIT:
        return False
    if what == GO_THERE:
        is_legal = obey_go(world, rules, player, unit, cell)
    else:
        is_legal = may_advance(world, rules, player, unit, cell)
        if is_legal:
            give_order(world, unit, ADVANCE, cell)
    if is_legal:
        pass_cursor(world, player)
    return is_legal


@compiled
def obey_unit_action(world: Any, rules: Any, player: int, action: int) -> bool:
    """One action of the `unit` space but products; False for an illegal one."""
    unit = int(world.players[player, CURSOR])
    if action >= FIRST_CELL:
        return obey_cell_order(world, rules, player, action)
    if action == NEXT_UNIT:
        is_legal = num_others(world, player) > 0
        if is_legal:
            step_cursor(world, player, 1)
        return is_legal
    if unit == NO_UNIT:
        return action == NOOP
    if action == STOP:
        is_legal = may_stop(world, unit)
        if is_legal:
            give_order(world, unit, NO_ORDER, NO_GOAL)
        return is_legal
    if action == CANCEL:
        is_legal = can_cancel(world, unit)
        if is_legal:
            cancel(world, rules, player, unit)
        return is_legal
    return action == NOOP


@compiled_copy
def may_stop(world: Any, unit: int) -> bool:
    """True for a unit that walks or works."""
    return bool(
        world.units[unit, UNIT_KIND] < NUM_MOBILE_KINDS
        and world.units[unit, UNIT_ORDER] != NO_ORDER
    )


# --- the classic actions -----------------------------------------------------------------------


@compiled
def classic_cell(world: Any, rules: Any, player: int, direction: int) -> int:
    """The neighbour of the cursor's unit in a direction of the own view."""
    frame = rules.seats[world.clock[MAP_INDEX], player, SEAT_FRAME]
    offset = rules.offset[rules.own_direction[frame, direction]]
    return int(world.units[world.players[player, CURSOR], UNIT_CELL] + offset)


@compiled
def may_step(world: Any, rules: Any, player: int, cell: int) -> bool:
    """True where a classic move leads somewhere or to something to do."""
    unit = int(world.players[player, CURSOR])
    if world.board[OCCUPANT, cell] != NO_UNIT and not is_enemy(
        rules, unit, int(world.board[OCCUPANT, cell])
    ):
        return False
    return order_at(world, rules, player, unit, cell) != NO_ORDER


@compiled
def classic_victim(world: Any, rules: Any, player: int) -> int:
    """The enemy in range that the cursor's unit would attack: the nearest, oldest, next in seat."""
    unit = int(world.players[player, CURSOR])
    if rules.kinds[world.units[unit, UNIT_KIND], KIND_DAMAGE_MAX] == 0:
        return NO_UNIT
    best, best_serial = NO_UNIT, NEVER
    for step in range(1, rules.num_players):
        other = (player + step) % rules.num_players
        if rules.team[other] == rules.team[player]:
            continue
        for place in range(world.players[other, NUM_UNITS]):
            enemy = int(world.roster[other, place])
            if (
                world.units[enemy, UNIT_SERIAL] < best_serial
                and in_range(world, rules, unit, enemy)
                and is_on_board(world, enemy)
                and sees(world, rules, player, int(world.units[enemy, UNIT_CELL]))
            ):
                best, best_serial = enemy, world.units[enemy, UNIT_SERIAL]
    return best


@compiled
def classic_tile(world: Any, rules: Any, player: int) -> int:
    """The resource tile beside the cursor's peasant, the first in its view; or NOWHERE."""
    unit = int(world.players[player, CURSOR])
    if world.units[unit, UNIT_KIND] != PEASANT:
        return NOWHERE
    for direction in range(NUM_DIRECTIONS):
        cell = classic_cell(world, rules, player, direction)
        resource = rules.tiles[world.board[TILE, cell], TILE_RESOURCE]
        if resource not in (NO_RESOURCE, OIL) and world.board[AMOUNT, cell] > 0:
            return cell
    return NOWHERE


@compiled
def obey_classic_action(world: Any, rules: Any, player: int, action: int) -> bool:
    """One of the 16 actions but the builds; False for an illegal one."""
    if action <= CLASSIC_NEXT:
        is_legal = num_others(world, player) > 0
        if is_legal:
            step_cursor(world, player, 1 if action == CLASSIC_NEXT else -1)
        return is_legal
    if action == CLASSIC_NOOP:
        return True
    unit = int(world.players[player, CURSOR])
    if unit == NO_UNIT or is_building(world, unit):
        return False
    if action < CLASSIC_ATTACK:
        cell = classic_cell(world, rules, player, CLASSIC_DIRECTIONS[action - CLASSIC_MOVE])
        return may_step(world, rules, player, cell) and obey_go(world, rules, player, unit, cell)
    if action == CLASSIC_ATTACK:
        victim = classic_victim(world, rules, player)
        if victim != NO_UNIT:
            give_order(world, unit, ATTACK, NO_GOAL)
            aim_at(world, unit, victim)
        return victim != NO_UNIT
    if action == CLASSIC_HARVEST:
        tile = classic_tile(world, rules, player)
        if tile != NOWHERE:
            give_order(world, unit, HARVEST, tile)
        return tile != NOWHERE
    return False


# --- all players -------------------------------------------------------------------------------


@compiled
def obey_all(world: Any, rules: Any, actions: Any) -> None:
    """The orders of a decision. Sites that two players want to build on at once are refused."""
    num_sites = 0
    for player in range(rules.num_players):
        product = product_of(world, rules, player, actions[player])
        if product != NOWHERE and is_site_product(world, rules, player, product):
            num_sites += 1
            claim_site(world, rules, player, product)
    for player in range(rules.num_players):
        if not world.players[player, IS_ALIVE]:
            continue
        product = product_of(world, rules, player, actions[player])
        if product != NOWHERE:
            is_legal = can_produce(world, rules, player, product)
            if is_legal:
                produce(world, rules, player, product)
                if rules.action_space != CLASSIC_ACTIONS:
                    pass_cursor(world, player)
        elif rules.action_space == CLASSIC_ACTIONS:
            is_legal = obey_classic_action(world, rules, player, actions[player])
        else:
            is_legal = obey_unit_action(world, rules, player, actions[player])
        if not is_legal:
            world.illegal[player] += 1
    if num_sites > 0:
        clear_site_claims(world)
