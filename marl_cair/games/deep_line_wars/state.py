"""The state of Deep Line Wars: struct of arrays, first axis B worlds.

Rows and columns are always in the owner's own view: column 0 is the own base, so that both seats
are the same code and a mirrored game is the same bits with the seats swapped.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_line_wars.scenarios import Scenario
from marl_cair.games.game_package import allocate_world
from marl_cair.games.loops import make_world_at

NUM_PLAYERS = 2
NO_TARGET = -1
NO_TOWER = -1
RUNNING, TERMINATED, TRUNCATED = range(3)


class World(NamedTuple):
    """B worlds (arrays [B, ...]), or one world (the same fields without B).

    P = 2 players, U unit slots, T tower slots, H rows, Q build columns.
    """

    tick: Annotated[NDArray[np.int32], "1"]  # ticks played
    phase: Annotated[NDArray[np.int8], "1"]  # RUNNING, TERMINATED or TRUNCATED
    random: Annotated[NDArray[np.uint64], "P"]  # generator words of each player
    health: Annotated[NDArray[np.int16], "P"]
    gold: Annotated[NDArray[np.int32], "P"]
    lumber: Annotated[NDArray[np.int32], "P"]
    income: Annotated[NDArray[np.int32], "P"]  # gold per income interval
    cursor: Annotated[NDArray[np.int8], "P 2"]  # row, column; only the classic actions move it
    illegal: Annotated[NDArray[np.int32], "P"]  # illegal actions since reset
    first_unit: Annotated[NDArray[np.int16], "P"]  # slot of the oldest unit; a ring by age
    num_units: Annotated[NDArray[np.int16], "P"]  # slots from first_unit on, dead units included
    unit_kind: Annotated[NDArray[np.int8], "P U"]
    unit_health: Annotated[NDArray[np.int16], "P U"]  # hit points, 0 = dead or empty
    unit_row: Annotated[NDArray[np.int8], "P U"]
    unit_column: Annotated[NDArray[np.int8], "P U"]
    unit_progress: Annotated[NDArray[np.int16], "P U"]  # 0..PROGRESS_PER_TILE-1 within the cell
    num_towers: Annotated[NDArray[np.int16], "P"]
    tower_kind: Annotated[NDArray[np.int8], "P T"]  # in the order of building
    tower_row: Annotated[NDArray[np.int8], "P T"]
    tower_column: Annotated[NDArray[np.int8], "P T"]
    tower_ready: Annotated[NDArray[np.int32], "P T"]  # the tick from which it may fire
    tower_spare: Annotated[NDArray[np.int8], "P T"]  # charge beyond CHARGE_PER_SHOT at that tick
    num_shots: Annotated[NDArray[np.int16], "P"]  # projectiles in flight
    shot_target: Annotated[NDArray[np.int16], "P T"]  # enemy unit slot of the shot, or NO_TARGET
    shot_ticks: Annotated[NDArray[np.int8], "P T"]  # ticks until the projectile lands
    shot_flight_ticks: Annotated[NDArray[np.int8], "P T"]  # ticks of the whole flight
    shot_damage: Annotated[NDArray[np.int16], "P T"]  # hit points before armour
    tower_at: Annotated[NDArray[np.int8], "P H Q"]  # kind of the tower in the cell, or NO_TOWER


def allocate(scenario: Scenario, num_worlds: int) -> World:
    """Zeroed arrays for `num_worlds` worlds; play starts with `rules.reset`."""
    rows, columns, units = scenario.rows, scenario.build_columns, scenario.unit_capacity
    sizes = {"P": NUM_PLAYERS, "U": units, "T": rows * columns, "H": rows, "Q": columns}
    return allocate_world(World, num_worlds, **sizes)


world_at = make_world_at(World)


@compiled
def unit_slot(world: World, player: int, age: int) -> int:
    """The slot of a player's unit by age, 0 for the oldest; it may be dead."""
    return int((world.first_unit[player] + age) & (world.unit_kind.shape[1] - 1))


@compiled
def seen_column(rules: Any, column: int, is_mirrored: bool) -> int:
    """A column of the owner's view as it is, or in the view of the enemy."""
    return int(rules.columns - 1 - column) if is_mirrored else int(column)
