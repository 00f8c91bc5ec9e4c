"""A new game: the map, and the base or the army of every player."""

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import board
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.dice import number_below
from marl_cair.games.deep_rts.rules.motion import exit_cell
from marl_cair.games.deep_rts.rules.roster import NO_SLOT, add_unit, clear_unit, enter_state
from marl_cair.games.game import NO_WINNER
from marl_cair.games.randomness import GOLDEN_STEP, mix

CELLS_BESIDE_SPAWN, CELLS_BESIDE_HALL = 8, 24  # as many steps of `rules.exits`


@compiled
def reset_world(world: Any, rules: Any, seed: Any) -> None:
    """Start a new game on one of the scenario's maps, drawn by the seed."""
    world.clock[:] = 0
    world.clock[s.WINNER] = NO_WINNER
    world.clock[s.WAKE] = s.NEVER
    world.board[:] = 0
    world.board[s.OCCUPANT, :] = s.NO_UNIT
    world.players[:] = 0
    world.players[:, s.CURSOR] = s.NO_UNIT
    world.illegal[:] = 0
    world.roster[:] = s.NO_UNIT
    world.vision[:] = 0
    world.known[:] = s.UNKNOWN
    world.acting[:] = 0
    for unit in range(rules.num_players * rules.slots):
        clear_unit(world, unit)
    world.seed[0] = mix(seed)
    world.clock[s.MAP_INDEX] = number_below(mix(world.seed[0]), rules.map_tiles.shape[0])
    tiles = rules.map_tiles[world.clock[s.MAP_INDEX]]
    for cell in range(len(tiles)):
        world.board[s.TILE, cell] = tiles[cell]
        world.board[s.AMOUNT, cell] = rules.tiles[tiles[cell], rb.TILE_AMOUNT]
    for player in range(rules.num_players):
        settle_player(world, rules, player)


@compiled
def settle_player(world: Any, rules: Any, player: int) -> None:
    """Fill the player's store; place its base or army around its spawn."""
    world.players[player, s.IS_ALIVE] = True
    wealth = 1 + number_below(mix(~world.seed[0]), rules.wealth)
    for resource in range(t.NUM_RESOURCES):
        store = wealth * rules.start[rb.START_RESOURCES + resource]
        world.players[player, s.RESOURCES + resource] = store
    is_army = False
    for kind in range(t.NUM_MOBILE_KINDS):
        is_army = is_army or rules.start[rb.START_ARMY + kind] > 0
    has_hall = rules.starts_with_hall != 0 and not is_army
    if has_hall:
        spawn = int(rules.seats[world.clock[s.MAP_INDEX], player, rb.SEAT_SPAWN])
        hall = add_unit(world, rules, player, t.TOWN_HALL, spawn)
        world.players[player, s.FOOD_MADE] += rules.kinds[t.TOWN_HALL, rb.KIND_FOOD_PRODUCED]
        enter_state(world, hall, s.IDLE, s.NEVER)
    num_beside = CELLS_BESIDE_HALL if has_hall else CELLS_BESIDE_SPAWN
    for kind in range(t.NUM_MOBILE_KINDS):
        count = rules.start[rb.START_ARMY + kind]
        if not is_army:
            count = rules.start_peasants if kind == t.PEASANT else 0
        for _ in range(count):
            place_near(world, rules, player, kind, num_beside)
    if rules.action_space != rb.GRID_ACTIONS:
        world.players[player, s.CURSOR] = world.roster[player, 1 if has_hall else 0]


@compiled
def place_near(world: Any, rules: Any, player: int, kind: int, num_beside: int) -> None:
    """Add a unit on one of the `num_beside` cells beside the spawn, or on the nearest free one.

    The seed draws one of those that are free, alike for all seats: a mirrored start is mirrored.
    """
    spawn = int(rules.seats[world.clock[s.MAP_INDEX], player, rb.SEAT_SPAWN])
    frame = board.frame_of(world, rules, player)
    num_free, chosen_cell = 0, s.NO_GOAL
    for place in range(rules.exits.shape[1]):
        cell = exit_cell(world, rules, frame, spawn, place)
        if cell != s.NO_GOAL:
            chosen_cell = cell if chosen_cell == s.NO_GOAL else chosen_cell
            num_free += int(place < num_beside)
    if num_free > 0:
        key = np.uint64(world.players[player, s.NEXT_SERIAL] + 1)
        chosen = number_below(mix(world.seed[0] + key * GOLDEN_STEP), num_free)
        for place in range(num_beside):
            cell = exit_cell(world, rules, frame, spawn, place)
            if cell != s.NO_GOAL:
                if chosen == 0:
                    chosen_cell = cell
                chosen -= 1
    if chosen_cell == s.NO_GOAL:
        return
    unit = add_unit(world, rules, player, kind, chosen_cell)
    if unit != NO_SLOT:
        world.players[player, s.FOOD_USED] += rules.kinds[kind, rb.KIND_FOOD_CONSUMED]
        enter_state(world, unit, s.IDLE, 1)
