"""Action space `grid`: one order for each own unit, given at the cell where the unit stands.

Orders point at cells relative to the unit, in the own view:

    0       no-op: the unit continues
    1, 2    stop, cancel
    3..     make, one for each product
    then    go to one of the 80 cells of a window of 9x9 around the unit, row by row
    then    advance in one of 8 directions

The window reaches as far as the longest shot. All orders are judged by the board that the players
saw. Orders of one player that cannot all be carried out are served in the order of its own cells.
"""

from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.orders import orders
from marl_cair.games.deep_rts.rules import board, work
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.paths import NOWHERE
from marl_cair.games.deep_rts.rules.roster import pay, refund

GRID_NOOP, GRID_STOP, GRID_CANCEL, FIRST_GRID_PRODUCT = range(4)
REACH_TILES = 4  # of the window, to each side
WINDOW_SIDE = 2 * REACH_TILES + 1
NUM_WINDOW = WINDOW_SIDE * WINDOW_SIDE - 1  # without the unit's own cell
FIRST_GO = FIRST_GRID_PRODUCT + t.NUM_PRODUCTS
FIRST_ADVANCE = FIRST_GO + NUM_WINDOW
NUM_GRID = FIRST_ADVANCE + rb.NUM_DIRECTIONS


# --- the meaning of an order -------------------------------------------------------------------


@compiled
def own_to_cell(world: Any, rules: Any, player: int, own: int) -> int:
    """The cell of the board at row * columns + column of the own view."""
    return int(rules.world_cell[board.frame_of(world, rules, player), own])


@compiled
def unit_at(world: Any, rules: Any, player: int, cell: int) -> int:
    """The player's unit that takes orders at a cell: it stands or is centred there; or NO_UNIT."""
    unit = int(world.board[s.OCCUPANT, cell])
    if unit != s.NO_UNIT and world.units[unit, s.UNIT_CELL] == cell:
        return unit if board.owner_of(rules, unit) == player else s.NO_UNIT
    return s.NO_UNIT


@compiled
def cell_away(world: Any, rules: Any, player: int, unit: int, rows: int, columns: int) -> int:
    """The cell that many rows and columns of the own view from the unit; NOWHERE off the board."""
    frame = board.frame_of(world, rules, player)
    row = int(rules.own_place[frame, world.units[unit, s.UNIT_CELL], 0]) + rows
    column = int(rules.own_place[frame, world.units[unit, s.UNIT_CELL], 1]) + columns
    if not 0 <= row < rules.rows or not 0 <= column < rules.columns:
        return NOWHERE
    return own_to_cell(world, rules, player, row * rules.columns + column)


@compiled
def window_cell(world: Any, rules: Any, player: int, unit: int, action: int) -> int:
    """The cell that a go leads to; NOWHERE off the board."""
    index = action - FIRST_GO
    index += index // (NUM_WINDOW // 2)  # the unit's own cell has no number
    rows, columns = index // WINDOW_SIDE - REACH_TILES, index % WINDOW_SIDE - REACH_TILES
    return cell_away(world, rules, player, unit, rows, columns)


@compiled
def advance_cell(world: Any, rules: Any, player: int, unit: int, action: int) -> int:
    """The farthest cell of an advance's direction within reach where it is legal; or NOWHERE."""
    rows, columns = rb.ROW_STEP[action - FIRST_ADVANCE], rb.COLUMN_STEP[action - FIRST_ADVANCE]
    for step in range(REACH_TILES, 0, -1):
        cell = cell_away(world, rules, player, unit, step * rows, step * columns)
        if cell != NOWHERE and orders.may_advance(world, rules, player, unit, cell):
            return cell
    return NOWHERE


@compiled
def is_grid_order_legal(world: Any, rules: Any, player: int, unit: int, action: int) -> bool:
    """True where the order is legal, if it were the only order of its player."""
    if action == GRID_NOOP:
        return True
    if action == GRID_STOP:
        return orders.may_stop(world, unit)
    if action == GRID_CANCEL:
        return work.can_cancel(world, unit)
    if action < FIRST_GO:
        return work.can_produce(world, rules, player, unit, action - FIRST_GRID_PRODUCT)
    if action >= FIRST_ADVANCE:
        return advance_cell(world, rules, player, unit, action) != NOWHERE
    cell = window_cell(world, rules, player, unit, action)
    if cell == NOWHERE:
        return False
    if board.is_building(world, unit):
        return orders.may_rally(world, rules, player, unit, cell)
    return orders.order_at(world, rules, player, unit, cell) != s.NO_ORDER


@compiled
def list_grid_orders(world: Any, rules: Any, player: int, out: Any) -> None:
    """Write the legal orders of each unit: out bool [H, W, A], which is all False."""
    out[:, :, GRID_NOOP] = True
    if not world.players[player, s.IS_ALIVE]:
        return
    frame = board.frame_of(world, rules, player)
    for place in range(world.players[player, s.NUM_UNITS]):
        unit = int(world.roster[player, place])
        cell = int(world.units[unit, s.UNIT_CELL])
        if unit_at(world, rules, player, cell) != unit:
            continue  # a builder inside its site
        row, column = rules.own_place[frame, cell, 0], rules.own_place[frame, cell, 1]
        for action in range(1, NUM_GRID):
            out[row, column, action] = is_grid_order_legal(world, rules, player, unit, action)


# --- carrying out the orders of a step -----------------------------------------------------------


@compiled
def record_orders(world: Any, rules: Any, player: int, actions: Any) -> None:
    """Write the legal orders of a player to the layer FRONTIER, and count the illegal ones."""
    for own in range(rules.rows * rules.columns):
        action = int(actions[own // rules.columns, own % rules.columns])
        if action == GRID_NOOP:
            continue
        cell = own_to_cell(world, rules, player, own)
        unit = unit_at(world, rules, player, cell)
        if unit != s.NO_UNIT and is_grid_order_legal(world, rules, player, unit, action):
            world.board[s.FRONTIER, cell] = action
        else:
            world.illegal[player] += 1


@compiled
def reserve_site(world: Any, rules: Any, player: int, unit: int, product: int, sites: int) -> bool:
    """Claim and pay a site; False where earlier orders took the money, the slots or the ground.

    sites: how many the player has reserved in this step.
    """
    if not work.can_produce(world, rules, player, unit, product):
        return False
    if world.players[player, s.NUM_UNITS] + sites >= rules.slots:
        return False
    centre = work.site_cell(world, rules, player, unit, product)
    if work.site_claims(world, rules, centre, product) >> player & 1 != 0:
        return False
    work.claim_site(world, rules, player, centre, product)
    pay(world, rules, player, product)
    return True


@compiled
def obey_grid_order(world: Any, rules: Any, player: int, unit: int, action: int) -> None:
    """Carry out a legal order that is no site; nothing without the money or food that it needs."""
    if action == GRID_STOP:
        orders.give_order(world, unit, s.NO_ORDER, s.NO_GOAL)
    elif action == GRID_CANCEL:
        work.cancel(world, rules, player, unit)
    elif action < FIRST_GO:
        if work.can_produce(world, rules, player, unit, action - FIRST_GRID_PRODUCT):
            work.produce(world, rules, player, unit, action - FIRST_GRID_PRODUCT)
    elif action < FIRST_ADVANCE:
        cell = window_cell(world, rules, player, unit, action)
        orders.obey_go(world, rules, player, unit, cell)
    else:
        goal = advance_cell(world, rules, player, unit, action)
        orders.give_order(world, unit, s.ADVANCE, goal)


@compiled
def obey_grid(world: Any, rules: Any, player: int) -> int:
    """Carry out the recorded orders, in the order of the own view's cells; sites wait.

    Sites that are claimed and paid stay recorded; returns their number.
    """
    sites = 0
    for own in range(rules.rows * rules.columns):
        cell = own_to_cell(world, rules, player, own)
        action, unit = int(world.board[s.FRONTIER, cell]), unit_at(world, rules, player, cell)
        if action == GRID_NOOP or unit == s.NO_UNIT:
            continue
        if FIRST_GRID_PRODUCT <= action < FIRST_GO and not board.is_building(world, unit):
            product = action - FIRST_GRID_PRODUCT
            if reserve_site(world, rules, player, unit, product, sites):
                sites += 1
                continue
        else:
            obey_grid_order(world, rules, player, unit, action)
        world.board[s.FRONTIER, cell] = GRID_NOOP
    return sites


@compiled
def begin_sites(world: Any, rules: Any, player: int) -> None:
    """Begin the paid sites; return the money of those that another player wants too."""
    for own in range(rules.rows * rules.columns):
        cell = own_to_cell(world, rules, player, own)
        action, unit = int(world.board[s.FRONTIER, cell]), unit_at(world, rules, player, cell)
        if action == GRID_NOOP or unit == s.NO_UNIT:
            continue
        world.board[s.FRONTIER, cell] = GRID_NOOP
        product = action - FIRST_GRID_PRODUCT
        centre = work.site_cell(world, rules, player, unit, product)
        if work.site_claims(world, rules, centre, product) & ~(1 << player) != 0:
            refund(world, rules, player, product)
        else:
            work.begin_site(world, rules, player, unit, product, centre)


@compiled
def obey_grids(world: Any, rules: Any, actions: Any) -> None:
    """Carry out the orders of all players, actions [P, H, W]. Sites come last."""
    world.board[s.FRONTIER, :] = GRID_NOOP
    for player in range(rules.num_players):
        if world.players[player, s.IS_ALIVE] != 0:
            record_orders(world, rules, player, actions[player])
    sites = 0
    for player in range(rules.num_players):
        if world.players[player, s.IS_ALIVE] != 0:
            sites += obey_grid(world, rules, player)
    if sites > 0:
        for player in range(rules.num_players):
            begin_sites(world, rules, player)
        world.board[s.CLAIM, :] = 0
