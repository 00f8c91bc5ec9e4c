"""Orders in the action spaces `unit` and `classic`: for the unit under the player's cursor."""

from typing import Any

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.orders import orders
from marl_cair.games.deep_rts.rules import board, combat, paths, work
from marl_cair.games.deep_rts.rules import rulebook as rb

CLASSIC_PREVIOUS, CLASSIC_NEXT, CLASSIC_MOVE = 0, 1, 2
CLASSIC_ATTACK, CLASSIC_HARVEST, CLASSIC_BUILD, CLASSIC_NOOP = 10, 11, 12, 15
NUM_CLASSIC_BUILDS = 3
NUM_CLASSIC = 16
# Left, right, up, down, then the diagonals: directions of the own view.
CLASSIC_DIRECTIONS = (3, 1, 0, 2, 7, 4, 6, 5)


# --- the cursor --------------------------------------------------------------------------------


@compiled_copy
def is_selectable(world: Any, unit: int) -> bool:
    """False for a builder inside its site."""
    return bool(world.units[unit, s.UNIT_STATE] != s.INSIDE)


@compiled
def has_others(world: Any, player: int) -> bool:
    """True where there is another unit that the cursor could go to."""
    for place in range(world.players[player, s.NUM_UNITS]):
        unit = world.roster[player, place]
        if unit != world.players[player, s.CURSOR] and is_selectable(world, unit):
            return True
    return False


@compiled
def cursor_place(world: Any, player: int) -> int:
    """The place in the roster of the unit under the cursor, -1 for none."""
    for place in range(world.players[player, s.NUM_UNITS]):
        if world.roster[player, place] == world.players[player, s.CURSOR]:
            return place
    return -1


@compiled
def step_cursor(world: Any, player: int, step: int) -> None:
    """Select the next (1) or previous (-1) unit, the first or last if none is selected."""
    count = int(world.players[player, s.NUM_UNITS])
    place = cursor_place(world, player)
    if place < 0 and step < 0:
        place = 0
    for _ in range(count):
        place = (place + step) % count
        if is_selectable(world, world.roster[player, place]):
            world.players[player, s.CURSOR] = world.roster[player, place]
            return
    world.players[player, s.CURSOR] = s.NO_UNIT


@compiled
def pass_cursor(world: Any, player: int) -> None:
    """After an order: select the next unit that waits for one, else the next unit."""
    count = int(world.players[player, s.NUM_UNITS])
    start = cursor_place(world, player)
    for step in range(1, count + 1):
        unit = world.roster[player, (start + step) % count]
        is_idle = world.units[unit, s.UNIT_ORDER] == s.NO_ORDER and is_selectable(world, unit)
        if is_idle and not board.is_building(world, unit):
            world.players[player, s.CURSOR] = unit
            return
    step_cursor(world, player, 1)


# --- the original's 16 actions, corrected: diagonals lead where they say, archers shoot ---


@compiled
def classic_cell(world: Any, rules: Any, player: int, direction: int) -> int:
    """The neighbour of the cursor's unit in a direction of the own view."""
    frame = board.frame_of(world, rules, player)
    cell = world.units[world.players[player, s.CURSOR], s.UNIT_CELL]
    return int(cell + rules.own_offset[frame, direction])


@compiled
def may_step(world: Any, rules: Any, player: int, cell: int) -> bool:
    """True where a move to a cell next to the cursor's unit leads to free ground or to work."""
    occupant = int(world.board[s.OCCUPANT, cell])
    if orders.place_of_tile(rules, int(world.board[s.TILE, cell])) == orders.BARRIER:
        return False  # seen from beside it, but for what lies off the board
    if occupant != s.NO_UNIT and rules.team[board.owner_of(rules, occupant)] == rules.team[player]:
        return False
    unit = int(world.players[player, s.CURSOR])
    return orders.order_at(world, rules, player, unit, cell) != s.NO_ORDER


@compiled
def classic_victim(world: Any, rules: Any, player: int) -> int:
    """The enemy in sight and range that the cursor's unit would attack: the oldest; or NO_UNIT."""
    unit = int(world.players[player, s.CURSOR])
    if board.kind_value(world, rules, unit, rb.KIND_DAMAGE_MAX) == 0:
        return s.NO_UNIT
    return combat.find_enemy(world, rules, unit, board.reach_of(world, rules, unit), True)


@compiled
def classic_tile(world: Any, rules: Any, player: int) -> int:
    """The resource tile beside the cursor's peasant, the first in its view; or paths.NOWHERE."""
    unit = int(world.players[player, s.CURSOR])
    if world.units[unit, s.UNIT_KIND] != t.PEASANT:
        return paths.NOWHERE
    frame, cell = board.frame_of(world, rules, player), int(world.units[unit, s.UNIT_CELL])
    return paths.resource_beside(world, rules, frame, cell, paths.ANY_RESOURCE)


@compiled
def obey_classic_action(world: Any, rules: Any, player: int, action: int) -> bool:
    """Carry out a move, attack, harvest or no-op; False for an illegal one."""
    if action == CLASSIC_NOOP:
        return True
    unit = int(world.players[player, s.CURSOR])
    if unit == s.NO_UNIT or board.is_building(world, unit):
        return False
    if action < CLASSIC_ATTACK:
        cell = classic_cell(world, rules, player, CLASSIC_DIRECTIONS[action - CLASSIC_MOVE])
        is_legal = may_step(world, rules, player, cell)
        return is_legal and orders.obey_go(world, rules, player, unit, cell)
    if action == CLASSIC_ATTACK:
        victim = classic_victim(world, rules, player)
        if victim != s.NO_UNIT:
            orders.give_order(world, unit, s.ATTACK, s.NO_GOAL)
            combat.aim_at(world, unit, victim)
        return victim != s.NO_UNIT
    if action == CLASSIC_HARVEST:
        tile = classic_tile(world, rules, player)
        if tile != paths.NOWHERE:
            orders.give_order(world, unit, s.HARVEST, tile)
        return tile != paths.NOWHERE
    return False  # a build of a unit that has no such product


# --- one player --------------------------------------------------------------------------------


@compiled
def product_of(world: Any, rules: Any, player: int, action: int) -> int:
    """The product that an action orders from the unit under the cursor, paths.NOWHERE for none."""
    if rules.action_space == rb.CLASSIC_ACTIONS:
        unit, slot = world.players[player, s.CURSOR], action - CLASSIC_BUILD
        if unit == s.NO_UNIT or not 0 <= slot < NUM_CLASSIC_BUILDS:
            return paths.NOWHERE
        return int(rules.products[world.units[unit, s.UNIT_KIND], slot])
    product = action - orders.FIRST_PRODUCT
    return int(product) if 0 <= product < t.NUM_PRODUCTS else paths.NOWHERE


@compiled
def obey(world: Any, rules: Any, player: int, action: int, may_build: bool) -> bool:
    """Carry out the order of one player; False for an illegal one."""
    is_classic = rules.action_space == rb.CLASSIC_ACTIONS
    product = product_of(world, rules, player, action)
    if product != paths.NOWHERE:
        unit = int(world.players[player, s.CURSOR])
        is_legal = may_build or work.can_produce(world, rules, player, unit, product)
        if is_legal:
            work.produce(world, rules, player, unit, product)
            if not is_classic:
                pass_cursor(world, player)
        return is_legal
    step = int(action == orders.NEXT_UNIT)
    if is_classic:
        step = int(action == CLASSIC_NEXT) - int(action == CLASSIC_PREVIOUS)
    if step != 0:
        is_legal = has_others(world, player)
        if is_legal:
            step_cursor(world, player, step)
        return is_legal
    if is_classic:
        return obey_classic_action(world, rules, player, action)
    return obey_unit_action(world, rules, player, action)


@compiled
def obey_unit_action(world: Any, rules: Any, player: int, action: int) -> bool:
    """Carry out another action of the `unit` space; False for an illegal one."""
    unit = int(world.players[player, s.CURSOR])
    if action == orders.NOOP:
        return True
    if action >= orders.FIRST_CELL:
        return obey_cell_order(world, rules, player, action)
    if unit == s.NO_UNIT:
        return False
    if action == orders.STOP:
        is_legal = orders.may_stop(world, unit)
        if is_legal:
            orders.give_order(world, unit, s.NO_ORDER, s.NO_GOAL)
        return is_legal
    is_legal = work.can_cancel(world, unit)
    if is_legal:
        work.cancel(world, rules, player, unit)
    return is_legal


@compiled
def obey_cell_order(world: Any, rules: Any, player: int, action: int) -> bool:
    """Go to, advance to or select at a cell of the own view; False if it is illegal."""
    num_cells = rules.rows * rules.columns
    order, own = (action - orders.FIRST_CELL) // num_cells, (action - orders.FIRST_CELL) % num_cells
    cell = int(rules.world_cell[board.frame_of(world, rules, player), own])
    unit = int(world.players[player, s.CURSOR])
    if order == orders.SELECT_THERE:
        other = int(world.board[s.OCCUPANT, cell])
        is_own = other != s.NO_UNIT and board.owner_of(rules, other) == player
        if is_own and other != unit:
            world.players[player, s.CURSOR] = other
            return True
        return False
    if unit == s.NO_UNIT:
        return False
    if order == orders.GO_THERE:
        is_legal = orders.obey_go(world, rules, player, unit, cell)
    else:
        is_legal = orders.may_advance(world, rules, player, unit, cell)
        if is_legal:
            orders.give_order(world, unit, s.ADVANCE, cell)
    if is_legal:
        pass_cursor(world, player)
    return is_legal


# --- all players -------------------------------------------------------------------------------


@compiled
def obey_cursors(world: Any, rules: Any, actions: Any) -> None:
    """One order of each player, for the unit under its cursor: actions [P].

    Sites come last: all other orders are about the board that their players saw. Sites that two
    players want at once are refused to both.
    """
    sites, allowed = 0, 0  # bits of the players that order a site; of those that may have one
    for player in range(rules.num_players):
        unit = int(world.players[player, s.CURSOR])
        product = product_of(world, rules, player, actions[player])
        if unit != s.NO_UNIT and product != paths.NOWHERE and not board.is_building(world, unit):
            sites |= 1 << player
            if work.can_produce(world, rules, player, unit, product):
                allowed |= 1 << player
                centre = work.site_cell(world, rules, player, unit, product)
                work.claim_site(world, rules, player, centre, product)
    for turn in range(2 * rules.num_players):
        player = turn % rules.num_players
        is_site, is_allowed = sites >> player & 1, allowed >> player & 1 != 0
        if world.players[player, s.IS_ALIVE] == 0 or is_site != turn // rules.num_players:
            continue
        is_refused = is_site != 0 and not is_allowed
        if is_refused or not obey(world, rules, player, actions[player], is_allowed):
            world.illegal[player] += 1
    if allowed > 0:
        world.board[s.CLAIM, :] = 0
