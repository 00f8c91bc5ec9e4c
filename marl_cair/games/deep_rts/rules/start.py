"""A new game: the map, and every player's base or army."""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.board import is_free
from marl_cair.games.deep_rts.rules.roster import NO_SLOT, add_unit, clear_unit, enter_state
from marl_cair.games.game import NO_WINNER
from marl_cair.games.randomness import GOLDEN_STEP, mix

_SHIFT_32 = np.uint64(32)
CELLS_BESIDE_SPAWN, CELLS_BESIDE_HALL = 8, 24  # as many steps of `rules.exits`


@compiled
def clear_world(world: Any, rules: Any) -> None:
    """Nothing of the last game stays in the state."""
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


@compiled
def lay_out_map(world: Any, rules: Any) -> None:
    """Fresh tiles of the game's map."""
    tiles = rules.map_tiles[world.clock[s.MAP_INDEX]]
    for cell in range(len(tiles)):
        world.board[s.TILE, cell] = tiles[cell]
        world.board[s.AMOUNT, cell] = rules.tiles[tiles[cell], rb.TILE_AMOUNT]


@compiled
def settle_player(world: Any, rules: Any, player: int) -> None:
    """The base (or the army) around the player's spawn: hall, workers, store."""
    spawn = int(rules.seats[world.clock[s.MAP_INDEX], player, rb.SEAT_SPAWN])
    world.players[player, s.IS_ALIVE] = True
    for resource in range(t.NUM_RESOURCES):
        world.players[player, s.RESOURCES + resource] = rules.start[rb.START_RESOURCES + resource]
    is_army = False
    for kind in range(t.NUM_MOBILE_KINDS):
        is_army = is_army or rules.start[rb.START_ARMY + kind] > 0
    has_hall = rules.starts_with_hall != 0 and not is_army
    if has_hall:
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
def start_cell(world: Any, rules: Any, player: int, step: int) -> int:
    """The `step`-th cell around the player's spawn, NO_GOAL where no unit can stand."""
    index = world.clock[s.MAP_INDEX]
    spawn = int(rules.seats[index, player, rb.SEAT_SPAWN])
    frame = rules.seats[index, player, rb.SEAT_FRAME]
    rows, columns = (
        int(rules.exits[frame, step, rb.EXIT_ROW]),
        int(rules.exits[frame, step, rb.EXIT_COLUMN]),
    )
    row, column = int(rules.cells[spawn, rb.CELL_ROW]), int(rules.cells[spawn, rb.CELL_COLUMN])
    if not 0 <= row + rows < rules.rows or not 0 <= column + columns < rules.columns:
        return s.NO_GOAL
    cell = spawn + rows * rules.stride + columns
    is_safe = rules.tiles[world.board[s.TILE, cell], rb.TILE_DAMAGE] == 0
    return cell if is_safe and is_free(world, rules, cell) else s.NO_GOAL


@compiled
def place_near(world: Any, rules: Any, player: int, kind: int, num_beside: int) -> None:
    """A unit on one of the free cells beside the spawn, drawn by the seed, else on the nearest.

    `num_beside` cells lie beside it. All seats draw alike, so that a mirrored start is mirrored.
    """
    num_free, nearest = 0, s.NO_GOAL
    for step in range(rules.exits.shape[1]):
        cell = start_cell(world, rules, player, step)
        if cell != s.NO_GOAL:
            nearest = cell if nearest == s.NO_GOAL else nearest
            num_free += int(step < num_beside)
    if num_free > 0:
        key = np.uint64(world.players[player, s.NEXT_SERIAL] + 1)
        word = mix(world.seed[0] + key * GOLDEN_STEP) >> _SHIFT_32
        chosen = np.int64((word * np.uint64(num_free)) >> _SHIFT_32)
        for step in range(num_beside):
            cell = start_cell(world, rules, player, step)
            if cell != s.NO_GOAL:
                if chosen == 0:
                    nearest = cell
                chosen -= 1
    if nearest != s.NO_GOAL:
        unit = add_unit(world, rules, player, kind, nearest)
        if unit == NO_SLOT:
            return
        world.players[player, s.FOOD_USED] += rules.kinds[kind, rb.KIND_FOOD_CONSUMED]
        enter_state(world, unit, s.IDLE, 1)


@compiled
def reset_world(world: Any, rules: Any, seed: Any) -> None:
    """A new game on one of the scenario's maps, drawn by the seed."""
    clear_world(world, rules)
    world.seed[0] = mix(seed)
    maps = np.uint64(rules.map_tiles.shape[0])
    world.clock[s.MAP_INDEX] = np.int64(((mix(world.seed[0]) >> _SHIFT_32) * maps) >> _SHIFT_32)
    lay_out_map(world, rules)
    for player in range(rules.num_players):
        settle_player(world, rules, player)
