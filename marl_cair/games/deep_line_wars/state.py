"""The state of Deep Line Wars: struct of arrays, first axis B worlds.

Rows and columns are always in the owner's own view: column 0 is the own base, so that both seats
are the same code and a mirrored game is the same bits with the seats swapped.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import make_world_at
from marl_cair.games.deep_line_wars.scenarios import Scenario

NUM_PLAYERS = 2
NO_TARGET = -1
NO_TOWER = -1
RUNNING, TERMINATED, TRUNCATED = range(3)


class World(NamedTuple):
    """B worlds (arrays [B, ...]), or one world (the same fields without B).

    P = 2 players, U unit slots, T tower slots, H rows, Q build columns.
    """

    tick: NDArray[np.int32]  # [B, 1] ticks played
    phase: NDArray[np.int8]  # [B, 1] RUNNING, TERMINATED or TRUNCATED
    random: NDArray[np.uint64]  # [B, P] generator words: spawn cells and damage rolls of a player
    health: NDArray[np.int16]  # [B, P]
    gold: NDArray[np.int32]  # [B, P]
    lumber: NDArray[np.int32]  # [B, P]
    income: NDArray[np.int32]  # [B, P] gold per income interval
    cursor: NDArray[np.int8]  # [B, P, 2] row, column; only the classic actions move it
    illegal: NDArray[np.int32]  # [B, P] illegal actions since reset
    first_unit: NDArray[np.int16]  # [B, P] slot of the oldest unit; slots are a ring by age
    num_units: NDArray[np.int16]  # [B, P] slots in use from first_unit on, dead ones included
    unit_kind: NDArray[np.int8]  # [B, P, U]
    unit_health: NDArray[np.int16]  # [B, P, U] hit points, 0 = dead or empty
    unit_row: NDArray[np.int8]  # [B, P, U]
    unit_column: NDArray[np.int8]  # [B, P, U]
    unit_progress: NDArray[np.int16]  # [B, P, U] 0..PROGRESS_PER_TILE-1 within the cell
    num_towers: NDArray[np.int16]  # [B, P]
    tower_kind: NDArray[np.int8]  # [B, P, T] in the order of building
    tower_row: NDArray[np.int8]  # [B, P, T]
    tower_column: NDArray[np.int8]  # [B, P, T]
    tower_ready: NDArray[np.int32]  # [B, P, T] the tick from which it may fire
    tower_spare: NDArray[np.int8]  # [B, P, T] charge beyond CHARGE_PER_SHOT at that tick
    num_shots: NDArray[np.int16]  # [B, P] projectiles in flight
    shot_target: NDArray[np.int16]  # [B, P, T] enemy unit slot of the projectile, or NO_TARGET
    shot_ticks: NDArray[np.int8]  # [B, P, T] ticks until the projectile lands
    shot_flight_ticks: NDArray[np.int8]  # [B, P, T] ticks of the whole flight
    shot_damage: NDArray[np.int16]  # [B, P, T] hit points before armour
    tower_at: NDArray[np.int8]  # [B, P, H, Q] kind of the tower in the cell, or NO_TOWER


def allocate(scenario: Scenario, num_worlds: int) -> World:
    """Zeroed arrays for `num_worlds` worlds; play starts with `rules.reset`."""
    units, rows, build_columns = scenario.unit_capacity, scenario.rows, scenario.build_columns
    towers = rows * build_columns

    def zeros(dtype: type, *shape: int) -> NDArray[Any]:
        return np.zeros((num_worlds, *shape), dtype)

    def per_player(dtype: type, *shape: int) -> NDArray[Any]:
        return zeros(dtype, NUM_PLAYERS, *shape)

    return World(
        tick=zeros(np.int32, 1),
        phase=zeros(np.int8, 1),
        random=per_player(np.uint64),
        health=per_player(np.int16),
        gold=per_player(np.int32),
        lumber=per_player(np.int32),
        income=per_player(np.int32),
        cursor=per_player(np.int8, 2),
        illegal=per_player(np.int32),
        first_unit=per_player(np.int16),
        num_units=per_player(np.int16),
        unit_kind=per_player(np.int8, units),
        unit_health=per_player(np.int16, units),
        unit_row=per_player(np.int8, units),
        unit_column=per_player(np.int8, units),
        unit_progress=per_player(np.int16, units),
        num_towers=per_player(np.int16),
        tower_kind=per_player(np.int8, towers),
        tower_row=per_player(np.int8, towers),
        tower_column=per_player(np.int8, towers),
        tower_ready=per_player(np.int32, towers),
        tower_spare=per_player(np.int8, towers),
        num_shots=per_player(np.int16),
        shot_target=per_player(np.int16, towers),
        shot_ticks=per_player(np.int8, towers),
        shot_flight_ticks=per_player(np.int8, towers),
        shot_damage=per_player(np.int16, towers),
        tower_at=per_player(np.int8, rows, build_columns),
    )


world_at = make_world_at(World)
