"""A new game: the map, everybody's base or army, nothing left of the last game."""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts.board import is_free
from marl_cair.games.deep_rts.roster import add_unit, clear_unit, enter_state
from marl_cair.games.deep_rts.rulebook import (
    CELL_COLUMN,
    CELL_ROW,
    EXIT_COLUMN,
    EXIT_ROW,
    KIND_FOOD_CONSUMED,
    KIND_FOOD_PRODUCED,
    SEAT_FRAME,
    SEAT_SPAWN,
    START_ARMY,
    START_RESOURCES,
    TILE_AMOUNT,
    TILE_DAMAGE,
)
from marl_cair.games.deep_rts.state import (
    AMOUNT,
    CURSOR,
    FOOD_MADE,
    FOOD_USED,
    IDLE,
    IS_ALIVE,
    MAP_INDEX,
    NEVER,
    NO_UNIT,
    OCCUPANT,
    RESOURCES,
    TILE,
    UNKNOWN,
    WAKE,
    WINNER,
)
from marl_cair.games.deep_rts.tables import NUM_MOBILE_KINDS, NUM_RESOURCES, PEASANT, TOWN_HALL
from marl_cair.games.game import NO_WINNER
from marl_cair.games.randomness import mix

_SHIFT_32 = np.uint64(32)


@compiled
def clear_world(world: Any, rules: Any) -> None:
    """Nothing of the last game stays in the state."""
    world.clock[:] = 0
    world.clock[WINNER] = NO_WINNER
    world.clock[WAKE] = NEVER
    world.board[:] = 0
    world.board[OCCUPANT, :] = NO_UNIT
    world.players[:] = 0
    world.players[:, CURSOR] = NO_UNIT
    world.illegal[:] = 0
    world.roster[:] = NO_UNIT
    world.vision[:] = 0
    world.known[:] = UNKNOWN
    world.acting[:] = 0
    for unit in range(rules.num_players * rules.slots):
        clear_unit(world, unit)


@compiled
def lay_out_map(world: Any, rules: Any) -> None:
    """Fresh tiles of the game's map."""
    tiles = rules.map_tiles[world.clock[MAP_INDEX]]
    for cell in range(len(tiles)):
        world.board[TILE, cell] = tiles[cell]
        world.board[AMOUNT, cell] = rules.tiles[tiles[cell], TILE_AMOUNT]


@compiled
def settle_player(world: Any, rules: Any, player: int) -> None:
    """The base (or the army) around the player's spawn: hall, workers, store."""
    spawn = int(rules.seats[world.clock[MAP_INDEX], player, SEAT_SPAWN])
    world.players[player, IS_ALIVE] = True
    for resource in range(NUM_RESOURCES):
        world.players[player, RESOURCES + resource] = rules.start[START_RESOURCES + resource]
    is_army = False
    for kind in range(NUM_MOBILE_KINDS):
        is_army = is_army or rules.start[START_ARMY + kind] > 0
    has_hall = rules.starts_with_hall != 0 and not is_army
    if has_hall:
        hall = add_unit(world, rules, player, TOWN_HALL, spawn)
        world.players[player, FOOD_MADE] += rules.kinds[TOWN_HALL, KIND_FOOD_PRODUCED]
        enter_state(world, hall, IDLE, NEVER)
    for kind in range(NUM_MOBILE_KINDS):
        count = rules.start[START_ARMY + kind]
        if not is_army:
            count = rules.start_peasants if kind == PEASANT else 0
        for _ in range(count):
            place_near(world, rules, player, kind, spawn)
    world.players[player, CURSOR] = world.roster[player, 1 if has_hall else 0]


@compiled
def place_near(world: Any, rules: Any, player: int, kind: int, spawn: int) -> None:
    """A unit on the nearest free ground around the spawn, in an order of the owner's own view."""
    frame = rules.seats[world.clock[MAP_INDEX], player, SEAT_FRAME]
    row, column = int(rules.cells[spawn, CELL_ROW]), int(rules.cells[spawn, CELL_COLUMN])
    place = spawn
    if not is_free(world, rules, spawn):
        place = 0
        for step in range(rules.exits.shape[1]):
            rows = int(rules.exits[frame, step, EXIT_ROW])
            columns = int(rules.exits[frame, step, EXIT_COLUMN])
            if not 0 <= row + rows < rules.rows or not 0 <= column + columns < rules.columns:
                continue
            cell = spawn + rows * rules.stride + columns
            if (
                is_free(world, rules, cell)
                and rules.tiles[world.board[TILE, cell], TILE_DAMAGE] == 0
            ):
                place = cell
                break
    if place != 0:
        unit = add_unit(world, rules, player, kind, place)
        world.players[player, FOOD_USED] += rules.kinds[kind, KIND_FOOD_CONSUMED]
        enter_state(world, unit, IDLE, 1)


@compiled
def reset_world(world: Any, rules: Any, seed: Any) -> None:
    """A new game on one of the scenario's maps, drawn by the seed."""
    clear_world(world, rules)
    world.seed[0] = mix(seed)
    maps = np.uint64(rules.map_tiles.shape[0])
    world.clock[MAP_INDEX] = np.int64(((mix(world.seed[0]) >> _SHIFT_32) * maps) >> _SHIFT_32)
    lay_out_map(world, rules)
    for player in range(rules.num_players):
        settle_player(world, rules, player)
