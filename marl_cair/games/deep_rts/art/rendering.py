"""Renders a world of Deep RTS for people, and as the observations `image` and `gray`.

Only reads the state. A seat's view has the orientation of its planes and shows the seat in blue.
Cells that it never saw are black, cells that it does not see now are dim. The spectator sees all.

`gray` shows the economy as bars over the board. Its levels from dark to light: ground and
resources, own team's buildings and units, the others' buildings and units.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games import drawing
from marl_cair.games.compiled import compiled_compact
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.art import sprites
from marl_cair.games.deep_rts.art.painting import paint_ground, paint_marks, paint_pieces
from marl_cair.games.deep_rts.art.scene import SPECTATOR, colour_of, scene_of
from marl_cair.games.deep_rts.rules.board import known_tile, sees, sees_unit
from marl_cair.games.deep_rts.rules.judging import score_of

LARGE_TILE, MIDDLE_TILE, SMALL_TILE = 32, 24, 16
LARGE_BOARD, MAX_BOARD_PIXELS = 24, 1024
MARGIN = 6  # pixels around the board and between the rows of the panel
LEAST_WIDTH = 520  # so that a player's numbers fit
CLOCK_HEIGHT, ROW_HEIGHT = 22, 24
ICON_PIXELS, GLYPH_SCALE = 16, 2
NUM_ENTRIES = 7  # resources, food, units, score

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

BACKGROUND, PANEL, INK, DIM, TRACK = np.array(
    [(22, 24, 30), (58, 62, 74), (240, 242, 246), (132, 136, 150), (58, 62, 74)], np.uint8
)


def tile_side(rows: int, columns: int) -> int:
    """Pixels along a tile in the pictures for people: 32 up to 24 tiles a side, then fewer."""
    side = max(rows, columns)
    if side <= LARGE_BOARD:
        return LARGE_TILE
    if side * MIDDLE_TILE <= MAX_BOARD_PIXELS:
        return MIDDLE_TILE
    return max(1, min(SMALL_TILE, MAX_BOARD_PIXELS // side))


@compiled_compact
def paint_row(numbers: Any, colour: int, top: int, is_alive: bool, image: Any) -> None:
    """Paint a player's colour and numbers [NUM_ENTRIES + 1]; the last is the food limit."""
    ink = INK if is_alive else DIM
    width = image.shape[2] - 2 * MARGIN
    drawing.fill_box(image, top, MARGIN, ROW_HEIGHT - 3, width, PANEL)
    drawing.fill_box(image, top, MARGIN, ROW_HEIGHT - 3, 10, sprites.PLAYER_COLOURS[colour])
    step = (width - 20) // NUM_ENTRIES
    advance = (drawing.GLYPH_COLUMNS + 1) * GLYPH_SCALE
    for entry in range(NUM_ENTRIES):
        left = MARGIN + 16 + entry * step
        icon, palette = sprites.ICONS[entry], sprites.PALETTES[0]
        drawing.draw_smooth(image, icon, palette, top + 2, left, ICON_PIXELS, False, 0)
        left += ICON_PIXELS + 3
        number = max(0, int(numbers[entry]))
        drawing.draw_number(image, number, top + 6, left, GLYPH_SCALE, ink, False)
        if entry == sprites.FOOD_ICON:
            left += drawing.num_digits(number) * advance
            drawing.draw_line(image, top + 15.0, float(left), top + 6.0, left + 4.0, 1, DIM)
            limit = int(numbers[NUM_ENTRIES])
            drawing.draw_number(image, limit, top + 6, left + 7, GLYPH_SCALE, ink, False)


@compiled_compact
def paint_clock(tick: int, max_ticks: int, image: Any) -> None:
    """Paint the ticks played, and a bar of the time left."""
    icon = sprites.ICONS[sprites.TIME_ICON]
    drawing.draw_smooth(image, icon, sprites.PALETTES[0], 3, MARGIN, ICON_PIXELS, False, 0)
    drawing.draw_number(image, tick, 7, MARGIN + ICON_PIXELS + 4, GLYPH_SCALE, INK, False)
    left = MARGIN + ICON_PIXELS + 80
    share = 1.0 - tick / max_ticks
    drawing.draw_bar(image, 10, left, 4, image.shape[2] - MARGIN - left, share, DIM, TRACK)


@compiled_compact
def paint_world(
    worlds: Any, rules: Any, index: int, viewer: int, tile: int, top: int, left: int, image: Any
) -> None:
    """Paint the board of world `index`, its corner at (top, left)."""
    scene = scene_of(worlds, rules, index, viewer, tile, top, left)
    paint_ground(scene, image)
    paint_pieces(scene, image)
    paint_marks(scene, image)


@compiled_compact
def observe_image(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write every seat's board to out [B, P, 3, rows * tile_pixels, columns * tile_pixels]."""
    out[first:last] = 0
    corner = first - first  # a literal 0 would be compiled again, as another type
    for index in range(first, last):
        for player in range(rules.num_players):
            image = out[index, player]
            paint_world(worlds, rules, index, player, rules.tile_pixels, corner, corner, image)


def _numbers_of(worlds: s.World, rules: Any, world: int, player: int) -> NDArray[np.int64]:
    """Numbers in a row of the panel."""
    row = worlds.players[world, player]
    plain_score = getattr(score_of, "py_func", score_of)  # compiling it would take longer
    score = int(plain_score(s.World(*(field[world] for field in worlds)), player))
    limit = min(int(rules.food_limit), int(rules.start_food) + int(row[s.FOOD_MADE]))
    store = row[s.RESOURCES : s.RESOURCES + t.NUM_RESOURCES]
    return np.array([*store, row[s.FOOD_USED], row[s.NUM_UNITS], score, limit], np.int64)


def draw(worlds: s.World, rules: Any, world: int, player: int | None) -> NDArray[np.uint8]:
    """The picture of one world, uint8 [h, w, 3]: of a seat's own view, or the spectator's (None).

    The spectator's panel lists all players, a seat's only its own.
    """
    viewer = SPECTATOR if player is None else player
    shown = range(rules.num_players) if player is None else (player,)
    tile = tile_side(rules.rows, rules.columns)
    width = max(LEAST_WIDTH, rules.columns * tile + 2 * MARGIN)
    top = CLOCK_HEIGHT + len(shown) * ROW_HEIGHT + MARGIN
    left, bottom = (width - rules.columns * tile) // 2, top + rules.rows * tile
    image = np.empty((3, bottom + MARGIN, width), np.uint8)
    image[:] = BACKGROUND[:, None, None]
    image[:, top:bottom, left : left + rules.columns * tile] = 0
    paint_world(worlds, rules, world, viewer, tile, top, left, image)
    image[:, :top] = BACKGROUND[:, None, None]  # units at the edge reach a little over the board
    paint_clock(int(worlds.clock[world, s.TICK]), rules.max_ticks, image)
    for row, seat in enumerate(shown):
        colour = colour_of(rules.team, viewer, seat)
        is_alive = bool(worlds.players[world, seat, s.IS_ALIVE])
        numbers = _numbers_of(worlds, rules, world, seat)
        paint_row(numbers, colour, CLOCK_HEIGHT + row * ROW_HEIGHT, is_alive, image)
    return np.ascontiguousarray(image.transpose(1, 2, 0))


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
            drawing.fill_gray_cell(
                image, GRAY_BARS, own // columns, own % columns, rows, columns, level
            )
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
