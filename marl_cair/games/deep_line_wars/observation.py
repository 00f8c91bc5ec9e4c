"""Observations of Deep Line Wars, always from the player's own side: own base at column 0.

Hidden from an agent: the enemy's cursor and all random words. Everything else is public.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_line_wars import tables as t
from marl_cair.games.deep_line_wars.rulebook import CENTRE, CLASSIC, ENEMY_SPAWN, OWN_SPAWN
from marl_cair.games.deep_line_wars.state import NUM_PLAYERS, seen_column, unit_slot, world_at
from marl_cair.games.loops import loop_over_seats

FULL = 255
UNIT_LEVEL = 64  # one unit as healthy as one bought now; four or more in a cell saturate
_OWNED = ("health", "gold", "lumber", "income")
UNIFORM_NAMES = (
    *(f"{whose} {name}" for name in _OWNED for whose in ("own", "enemy")),
    *("time to next income", "time left"),
)
PLANE_NAMES = (
    *(f"own {name} towers" for name in t.TOWER_NAMES),
    *(f"enemy {name} towers" for name in t.TOWER_NAMES),
    *(f"own {name} units" for name in t.UNIT_NAMES),
    *(f"enemy {name} units" for name in t.UNIT_NAMES),
    *("own unit progress", "enemy unit progress", "terrain", "own cursor"),
    *UNIFORM_NAMES,
)
OWN_TOWERS = 0
ENEMY_TOWERS = OWN_TOWERS + t.NUM_TOWER_KINDS
OWN_UNITS = ENEMY_TOWERS + t.NUM_TOWER_KINDS
ENEMY_UNITS = OWN_UNITS + t.NUM_UNIT_KINDS
OWN_PROGRESS = ENEMY_UNITS + t.NUM_UNIT_KINDS
ENEMY_PROGRESS = OWN_PROGRESS + 1
TERRAIN = ENEMY_PROGRESS + 1
CURSOR = TERRAIN + 1
FIRST_UNIFORM = CURSOR + 1
OWN_HEALTH, ENEMY_HEALTH, OWN_GOLD, ENEMY_GOLD = range(FIRST_UNIFORM, FIRST_UNIFORM + 4)
OWN_LUMBER, ENEMY_LUMBER, OWN_INCOME, ENEMY_INCOME = range(ENEMY_GOLD + 1, ENEMY_GOLD + 5)
TIME_TO_INCOME, TIME_LEFT = ENEMY_INCOME + 1, ENEMY_INCOME + 2

# Income from 0 to 1,500 gold on a scale that separates 20 from 22 as well as 1,000 from 1,100.
LOG_LEVELS: NDArray[np.uint8] = np.minimum(
    FULL, np.floor(24.0 * np.log2(1.0 + np.arange(1_501)) + 0.5)
).astype(np.uint8)

VECTOR_NAMES = (
    *(f"{whose} {name}" for whose in ("own", "enemy") for name in _OWNED),
    *("ticks to next income", "ticks left"),
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
    return int(rules.income_interval_ticks - world.tick[0] % rules.income_interval_ticks)


@compiled
def see_towers(world: Any, rules: Any, owner: int, is_mirrored: bool, first: int, out: Any) -> None:
    """Mark the towers of `owner` in the planes of their kinds, from `first` on."""
    for tower in range(world.num_towers[owner]):
        column = seen_column(rules, world.tower_column[owner, tower], is_mirrored)
        out[first + world.tower_kind[owner, tower], world.tower_row[owner, tower], column] = FULL


@compiled
def see_units(world: Any, rules: Any, owner: int, is_mirrored: bool, first: int, out: Any) -> None:
    """Add the units of `owner` to the planes from `first` on, and their progress."""
    progress_plane = OWN_PROGRESS + int(is_mirrored)
    for age in range(world.num_units[owner]):
        slot = unit_slot(world, owner, age)
        health = int(world.unit_health[owner, slot])
        if health <= 0:
            continue
        kind, row = world.unit_kind[owner, slot], world.unit_row[owner, slot]
        column = seen_column(rules, world.unit_column[owner, slot], is_mirrored)
        # At least 1, so that a unit near death is not mistaken for an empty cell.
        level = max(1, UNIT_LEVEL * health // rules.unit_health[kind])
        out[first + kind, row, column] = min(FULL, int(out[first + kind, row, column]) + level)
        progress = FULL * int(world.unit_progress[owner, slot]) // t.PROGRESS_PER_TILE
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
    see_towers(world, rules, player, False, OWN_TOWERS, out)
    see_towers(world, rules, 1 - player, True, ENEMY_TOWERS, out)
    see_units(world, rules, player, False, OWN_UNITS, out)
    see_units(world, rules, 1 - player, True, ENEMY_UNITS, out)
    see_economy(world, rules, player, OWN_HEALTH, flat, cells)
    see_economy(world, rules, 1 - player, ENEMY_HEALTH, flat, cells)
    next_income = FULL * ticks_to_income(world, rules) // rules.income_interval_ticks
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
    for side in range(NUM_PLAYERS):
        owner = player if side == 0 else 1 - player
        # From the youngest to the oldest, own first: what is drawn last shows.
        for age in range(world.num_units[owner] - 1, -1, -1):
            slot = unit_slot(world, owner, age)
            if world.unit_health[owner, slot] <= 0:
                continue
            row = world.unit_row[owner, slot]
            column = seen_column(rules, world.unit_column[owner, slot], side == 1)
            out[1, row, column] = world.unit_kind[owner, slot] + 1
            out[2, row, column] = CLASSIC_SELF + side
        for tower in range(world.num_towers[owner]):
            row = world.tower_row[owner, tower]
            column = seen_column(rules, world.tower_column[owner, tower], side == 1)
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
    for age in range(world.num_units[enemy]):
        slot = unit_slot(world, enemy, age)
        if world.unit_health[enemy, slot] > 0:
            column = seen_column(rules, world.unit_column[enemy, slot], True)
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


@compiled
def see_heatmap(world: Any, rules: Any, player: int, out: Any) -> None:
    """The thesis's heat map in colour, uint8 [3, H, W], or in grey, uint8 [1, H, W]."""
    if out.shape[0] == 3:
        paint_heatmap(world, rules, player, out, (FULL, 0, 0), (0, FULL, 0), (0, FULL, FULL))
    else:
        paint_heatmap(world, rules, player, out, (GRAY_TOWER,), (GRAY_UNIT,), (GRAY_CURSOR,))


observe_planes = loop_over_seats(see_planes, world_at)  # out uint8 [B, P, C, H, W]
observe_classic = loop_over_seats(see_classic, world_at)  # out uint8 [B, P, 5, H, W]
observe_heatmap = loop_over_seats(see_heatmap, world_at)  # out uint8 [B, P, 3 or 1, H, W]
observe_vector = loop_over_seats(see_vector, world_at)  # out float32 [B, P, V]
