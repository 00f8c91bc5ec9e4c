"""Paints the representation `gray` of Deep RTS: the economy as bars, the board in gray levels.

Levels from dark to light: ground and resources, own team's buildings and units, the others'
buildings and units. Cells that a seat remembers but does not see now are a little darker.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled_compact
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.art.scene import scene_of
from marl_cair.games.deep_rts.rules.board import known_tile, sees, sees_unit
from marl_cair.games.drawing import fill_gray_cell

GRAY_SIDE = 84
GRAY_BARS = 12  # rows over the board: gold, lumber, stone, oil, food used, food made
_BAR_ROWS = 2
_EIGHTHS = 8  # steps of a bar per doubling of a resource
_FULL_BAR = 159  # the level of MAX_RESOURCE, which is near 2 ** 20
# grass, desert, lava, wall, water, lumber, gold, stone, oil
GRAY_TILES = (20, 30, 10, 50, 40, 60, 90, 70, 80)
GRAY_REMEMBERED = 5  # darker
GRAY_SITE, GRAY_BUILDING, GRAY_UNIT, GRAY_CURSOR = 110, 116, 150, 180  # of the own team
GRAY_ENEMY = 76  # lighter than the own team
GRAY_ALLY = 3  # lighter than the own
GRAY_KIND_STEP = 6  # between two kinds of buildings, or of units


@compiled_compact
def log_level(number: int) -> int:
    """Eighths of doublings from 0 to `number`, in whole numbers."""
    value, doublings = number + 1, 0
    while value >> (doublings + 1) > 0:
        doublings += 1
    base = 1 << doublings
    return int(_EIGHTHS * doublings + _EIGHTHS * (value - base) // base)


@compiled_compact
def gray_bars(player: Any, food_used: int, food_made: int, food_limit: int, image: Any) -> None:
    """Paint resources (log scale) and food as bars; player: a row of `World.players`."""
    for bar in range(GRAY_BARS // _BAR_ROWS):
        level, full = food_used if bar == t.NUM_RESOURCES else food_made, food_limit
        if bar < t.NUM_RESOURCES:
            level, full = log_level(int(player[s.RESOURCES + bar])), _FULL_BAR
        length = max(0, min(GRAY_SIDE, level * GRAY_SIDE // max(1, full)))
        top = bar * _BAR_ROWS
        image[top : top + _BAR_ROWS, :length] = 130 + 20 * bar


@compiled_compact
def gray_cursor(image: Any, row: int, column: int, rows: int, columns: int) -> None:
    """Mark the cell of the selected unit with a dot in its middle."""
    height = GRAY_SIDE - GRAY_BARS
    y = GRAY_BARS + (2 * row + 1) * height // (2 * rows)
    x = (2 * column + 1) * GRAY_SIDE // (2 * columns)
    reach = 1 if height >= 4 * rows else 0
    image[y - reach : y + 1, x - reach : x + 1] = GRAY_CURSOR


@compiled_compact
def ground_level(scene: Any, cell: int) -> int:
    """Gray level of the ground of a cell, as the viewer knows it."""
    kind = known_tile(scene, scene, scene.viewer, cell)
    if kind == s.UNKNOWN:
        return 0
    level = int(GRAY_TILES[kind])
    return level if sees(scene, scene, scene.viewer, cell) else level - GRAY_REMEMBERED


@compiled_compact
def unit_level(kind: int, state: int, is_own: bool, is_ally: bool) -> int:
    """Level of a unit or building."""
    level = GRAY_UNIT + GRAY_KIND_STEP * kind
    if kind >= t.NUM_MOBILE_KINDS:
        level = GRAY_BUILDING + GRAY_KIND_STEP * (kind - t.NUM_MOBILE_KINDS)
        if state == s.RISING:
            level = GRAY_SITE
    if not is_ally:
        return level + GRAY_ENEMY
    return level if is_own else level + GRAY_ALLY


@compiled_compact
def paint_gray(scene: Any, image: Any) -> None:
    """Paint the board of a seat below GRAY_BARS rows; units come last."""
    rows, columns = scene.rows, scene.columns
    for layer in range(3):
        for own in range(rows * columns):
            cell, level = int(scene.world_cell[own]), 0
            if layer == 0:
                level = ground_level(scene, cell)
            else:
                unit = int(scene.board[s.OCCUPANT, cell])
                if unit == s.NO_UNIT or (scene.units[unit, s.UNIT_KIND] < t.NUM_MOBILE_KINDS) != (
                    layer == 2
                ):
                    continue
                if not sees_unit(scene, scene, scene.viewer, unit):
                    continue
                owner = unit // scene.slots
                is_ally = scene.team[owner] == scene.team[scene.viewer]
                kind, state = (
                    int(scene.units[unit, s.UNIT_KIND]),
                    int(scene.units[unit, s.UNIT_STATE]),
                )
                level = unit_level(kind, state, owner == scene.viewer, is_ally)
            fill_gray_cell(image, GRAY_BARS, own // columns, own % columns, rows, columns, level)
    unit = int(scene.players[scene.viewer, s.CURSOR])
    if unit != s.NO_UNIT and scene.units[unit, s.UNIT_KIND] >= 0:
        own = int(scene.own_cell[scene.units[unit, s.UNIT_CELL]])
        gray_cursor(image, own // columns, own % columns, rows, columns)


@compiled_compact
def observe_gray(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write every seat's small picture to out [B, P, 1, GRAY_SIDE, GRAY_SIDE]."""
    out[first:last] = 0
    corner = first - first  # a literal 0 would be compiled again, as another type
    for index in range(first, last):
        for player in range(rules.num_players):
            image = out[index, player, 0]
            limit = min(
                rules.food_limit, rules.start_food + int(worlds.players[index, player, s.FOOD_MADE])
            )
            used = int(worlds.players[index, player, s.FOOD_USED])
            gray_bars(worlds.players[index, player], used, limit, rules.food_limit, image)
            scene = scene_of(worlds, rules, index, player, corner, corner, corner)
            paint_gray(scene, image)
