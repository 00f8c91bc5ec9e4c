"""Observations of Deep Line Wars, always from the player's own side: own base at column 0.

Hidden from an agent: the enemy's cursor and all random words. Everything else is public.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_line_wars.rulebook import CENTRE, CLASSIC, ENEMY_SPAWN, OWN_SPAWN
from marl_cair.games.deep_line_wars.state import NUM_PLAYERS, world_at
from marl_cair.games.deep_line_wars.tables import (
    NUM_TOWER_KINDS,
    NUM_UNIT_KINDS,
    PROGRESS_PER_TILE,
    TOWER_NAMES,
    UNIT_NAMES,
)

FULL = 255
UNIT_LEVEL = 64  # one unit as healthy as one bought now; four or more in a cell saturate
UNIFORM_NAMES = (
    "own health",
    "enemy health",
    "own gold",
    "enemy gold",
    "own lumber",
    "enemy lumber",
    "own income",
    "enemy income",
    "time to next income",
    "time left",
)
PLANE_NAMES = (
    *(f"own {name} towers" for name in TOWER_NAMES),
    *(f"enemy {name} towers" for name in TOWER_NAMES),
    *(f"own {name} units" for name in UNIT_NAMES),
    *(f"enemy {name} units" for name in UNIT_NAMES),
    "own unit progress",
    "enemy unit progress",
    "terrain",
    "own cursor",
    *UNIFORM_NAMES,
)
OWN_TOWERS = 0
ENEMY_TOWERS = OWN_TOWERS + NUM_TOWER_KINDS
OWN_UNITS = ENEMY_TOWERS + NUM_TOWER_KINDS
ENEMY_UNITS = OWN_UNITS + NUM_UNIT_KINDS
OWN_PROGRESS = ENEMY_UNITS + NUM_UNIT_KINDS
ENEMY_PROGRESS = OWN_PROGRESS + 1
TERRAIN = ENEMY_PROGRESS + 1
CURSOR = TERRAIN + 1
FIRST_UNIFORM = CURSOR + 1
(
    OWN_HEALTH,
    ENEMY_HEALTH,
    OWN_GOLD,
    ENEMY_GOLD,
    OWN_LUMBER,
    ENEMY_LUMBER,
    OWN_INCOME,
    ENEMY_INCOME,
    TIME_TO_INCOME,
    TIME_LEFT,
) = range(FIRST_UNIFORM, FIRST_UNIFORM + len(UNIFORM_NAMES))

# Income from 0 to 1,500 gold on a scale that separates 20 from 22 as well as 1,000 from 1,100.
LOG_LEVELS: NDArray[np.uint8] = np.minimum(
    FULL, np.floor(24.0 * np.log2(1.0 + np.arange(1_501)) + 0.5)
).astype(np.uint8)

VECTOR_NAMES = (
    "own health",
    "own gold",
    "own lumber",
    "own income",
    "enemy health",
    "enemy gold",
    "enemy lumber",
    "enemy income",
    "ticks to next income",
    "ticks left",
)

CLASSIC_NAMES = ("terrain", "unit kind", "unit owner", "tower owner", "tower kind")
CLASSIC_GRASS, CLASSIC_GOAL, CLASSIC_CENTRE = range(3)
CLASSIC_SELF, CLASSIC_ENEMY = 1, 2

HEATMAP_NAMES = ("red: own towers", "green: enemy units", "blue: own cursor")
# Grey levels of red, green and teal by the luma weights 0.299, 0.587, 0.114.
GRAY_TOWER, GRAY_UNIT, GRAY_CURSOR = 76, 150, 179


@compiled
def ticks_to_income(world: Any, rules: Any) -> int:
    """Ticks until both players are paid, 1..interval."""
    return int(rules.interval_ticks - world.tick[0] % rules.interval_ticks)


@compiled
def see_towers(world: Any, rules: Any, player: int, out: Any) -> None:
    """Mark the towers of both players in the planes of their kinds."""
    enemy = 1 - player
    for tower in range(world.num_towers[player]):
        plane = OWN_TOWERS + world.tower_kind[player, tower]
        out[plane, world.tower_row[player, tower], world.tower_column[player, tower]] = FULL
    for tower in range(world.num_towers[enemy]):
        plane = ENEMY_TOWERS + world.tower_kind[enemy, tower]
        column = rules.columns - 1 - world.tower_column[enemy, tower]
        out[plane, world.tower_row[enemy, tower], column] = FULL


@compiled
def see_units(world: Any, rules: Any, owner: int, mirrored: bool, first: int, out: Any) -> None:
    """Add the units of `owner` to the planes from `first` on, and their progress."""
    slots = world.unit_kind.shape[1] - 1
    progress_plane = OWN_PROGRESS + int(mirrored)
    for age in range(world.num_units[owner]):
        slot = (world.first_unit[owner] + age) & slots
        health = int(world.unit_health[owner, slot])
        if health <= 0:
            continue
        kind = world.unit_kind[owner, slot]
        row, column = world.unit_row[owner, slot], world.unit_column[owner, slot]
        if mirrored:
            column = rules.columns - 1 - column
        # At least 1, so that a unit near death is not mistaken for an empty cell.
        level = max(1, UNIT_LEVEL * health // rules.unit_health[kind])
        out[first + kind, row, column] = min(FULL, int(out[first + kind, row, column]) + level)
        progress = FULL * int(world.unit_progress[owner, slot]) // PROGRESS_PER_TILE
        out[progress_plane, row, column] = max(int(out[progress_plane, row, column]), progress)


@compiled
def fill_plane(flat: Any, cells: int, plane: int, level: int) -> None:
    """Write one value 0..255 into every cell of a plane."""
    flat[plane * cells : (plane + 1) * cells] = level


@compiled
def see_economy(world: Any, rules: Any, owner: int, first: int, flat: Any, cells: int) -> None:
    """Fill the uniform planes of one player: every second one from `first` on."""
    health = max(0, int(world.health[owner]))
    fill_plane(flat, cells, first, FULL * health // rules.start_health)
    fill_plane(flat, cells, first + 2, min(FULL, int(world.gold[owner])))
    fill_plane(flat, cells, first + 4, min(FULL, int(world.lumber[owner])))
    income = min(len(LOG_LEVELS) - 1, int(world.income[owner]))
    fill_plane(flat, cells, first + 6, LOG_LEVELS[income])


@compiled
def see_planes(world: Any, rules: Any, player: int, out: Any) -> None:
    """Write the planes of PLANE_NAMES."""
    cells = rules.rows * rules.columns
    flat = out.reshape(out.size)
    flat[: TERRAIN * cells] = 0
    for cell in range(cells):
        flat[TERRAIN * cells + cell] = rules.terrain[cell]
    flat[CURSOR * cells : FIRST_UNIFORM * cells] = 0
    if rules.action_space == CLASSIC:
        out[CURSOR, world.cursor[player, 0], world.cursor[player, 1]] = FULL
    see_towers(world, rules, player, out)
    see_units(world, rules, player, False, OWN_UNITS, out)
    see_units(world, rules, 1 - player, True, ENEMY_UNITS, out)
    see_economy(world, rules, player, OWN_HEALTH, flat, cells)
    see_economy(world, rules, 1 - player, ENEMY_HEALTH, flat, cells)
    next_income = FULL * ticks_to_income(world, rules) // rules.interval_ticks
    fill_plane(flat, cells, TIME_TO_INCOME, next_income)
    time_left = FULL * max(0, rules.max_ticks - world.tick[0]) // rules.max_ticks
    fill_plane(flat, cells, TIME_LEFT, time_left)


@compiled
def see_classic(world: Any, rules: Any, player: int, out: Any) -> None:
    """Write the original's five layers, in rows and columns.

    Where several units share a cell, the oldest enemy unit shows, else the oldest own.
    """
    out[:] = 0
    for column in range(rules.columns):
        level = rules.terrain[column]
        if level == CENTRE:
            out[0, :, column] = CLASSIC_CENTRE
        elif level in (OWN_SPAWN, ENEMY_SPAWN):
            out[0, :, column] = CLASSIC_GOAL
    slots = world.unit_kind.shape[1] - 1
    for side in range(NUM_PLAYERS):
        owner = player if side == 0 else 1 - player
        # From the youngest to the oldest, own first: what is drawn last shows.
        for age in range(world.num_units[owner] - 1, -1, -1):
            slot = (world.first_unit[owner] + age) & slots
            if world.unit_health[owner, slot] <= 0:
                continue
            row, column = world.unit_row[owner, slot], int(world.unit_column[owner, slot])
            if side == 1:
                column = rules.columns - 1 - column
            out[1, row, column] = world.unit_kind[owner, slot] + 1
            out[2, row, column] = CLASSIC_SELF + side
        for tower in range(world.num_towers[owner]):
            row, column = world.tower_row[owner, tower], int(world.tower_column[owner, tower])
            if side == 1:
                column = rules.columns - 1 - column
            out[3, row, column] = CLASSIC_SELF + side
            out[4, row, column] = world.tower_kind[owner, tower] + 1


@compiled
def paint_heatmap(
    world: Any, rules: Any, player: int, out: Any, tower: Any, unit: Any, cursor: Any
) -> None:
    """Colour cells of `out` [C, H, W]: own towers, over them enemy units, over them the cursor."""
    enemy = 1 - player
    out[:] = 0
    for index in range(world.num_towers[player]):
        row, column = world.tower_row[player, index], world.tower_column[player, index]
        for channel in range(out.shape[0]):
            out[channel, row, column] = tower[channel]
    slots = world.unit_kind.shape[1] - 1
    for age in range(world.num_units[enemy]):
        slot = (world.first_unit[enemy] + age) & slots
        if world.unit_health[enemy, slot] > 0:
            column = rules.columns - 1 - int(world.unit_column[enemy, slot])
            for channel in range(out.shape[0]):
                out[channel, world.unit_row[enemy, slot], column] = unit[channel]
    if rules.action_space == CLASSIC:
        for channel in range(out.shape[0]):
            out[channel, world.cursor[player, 0], world.cursor[player, 1]] = cursor[channel]


@compiled
def see_vector(world: Any, rules: Any, player: int, out: Any) -> None:
    """The economy in its own units: hit points, gold, lumber, gold per interval, ticks."""
    for side in range(NUM_PLAYERS):
        owner = player if side == 0 else 1 - player
        out[4 * side] = max(0, int(world.health[owner]))
        out[4 * side + 1] = world.gold[owner]
        out[4 * side + 2] = world.lumber[owner]
        out[4 * side + 3] = world.income[owner]
    out[8] = ticks_to_income(world, rules)
    out[9] = max(0, rules.max_ticks - world.tick[0])


# --- slices of worlds ------------------------------------------------------------------------


@compiled
def observe_planes(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write what every seat sees: out uint8 [B, P, C, H, W]."""
    for index in range(first, last):
        world = world_at(worlds, index)
        for player in range(NUM_PLAYERS):
            see_planes(world, rules, player, out[index, player])


@compiled
def observe_classic(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write the original's layers: out uint8 [B, P, 5, H, W]."""
    for index in range(first, last):
        world = world_at(worlds, index)
        for player in range(NUM_PLAYERS):
            see_classic(world, rules, player, out[index, player])


@compiled
def observe_heatmap(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write the thesis's heat map in colour: out uint8 [B, P, 3, H, W]."""
    red, green, teal = (FULL, 0, 0), (0, FULL, 0), (0, FULL, FULL)
    for index in range(first, last):
        world = world_at(worlds, index)
        for player in range(NUM_PLAYERS):
            paint_heatmap(world, rules, player, out[index, player], red, green, teal)


@compiled
def observe_heatmap_gray(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write the thesis's heat map in grey: out uint8 [B, P, 1, H, W]."""
    tower, unit, cursor = (GRAY_TOWER,), (GRAY_UNIT,), (GRAY_CURSOR,)
    for index in range(first, last):
        world = world_at(worlds, index)
        for player in range(NUM_PLAYERS):
            paint_heatmap(world, rules, player, out[index, player], tower, unit, cursor)


@compiled
def observe_vector(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write the economy of every seat: out float32 [B, P, V]."""
    for index in range(first, last):
        world = world_at(worlds, index)
        for player in range(NUM_PLAYERS):
            see_vector(world, rules, player, out[index, player])
