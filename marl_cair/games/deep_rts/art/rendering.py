"""Renders a world of Deep RTS for people, and as the observations `image` and `gray`.

Only reads the state. A seat's view has the orientation of its planes and shows the seat in blue.
Cells that it never saw are black, cells that it does not see now are dim. The spectator sees all.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games import drawing
from marl_cair.games.compiled import compiled_compact
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts.art import sprites
from marl_cair.games.deep_rts.art.gray import GRAY_SIDE, observe_gray
from marl_cair.games.deep_rts.art.marks import paint_marks
from marl_cair.games.deep_rts.art.painting import paint_ground, paint_pieces
from marl_cair.games.deep_rts.art.scene import SPECTATOR, colour_of, scene_of
from marl_cair.games.deep_rts.rules.judging import score_of
from marl_cair.games.deep_rts.tables import NUM_RESOURCES

__all__ = ["GRAY_SIDE", "draw", "observe_gray", "observe_image", "tile_side"]

LARGE_TILE, MIDDLE_TILE, SMALL_TILE = 32, 24, 16
LARGE_BOARD, MAX_BOARD_PIXELS = 24, 1024
MARGIN = 6  # pixels around the board and between the rows of the panel
LEAST_WIDTH = 520  # so that a player's numbers fit
CLOCK_HEIGHT, ROW_HEIGHT = 22, 24
ICON_PIXELS, GLYPH_SCALE = 16, 2
NUM_ENTRIES = 7  # resources, food, units, score

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
    store = row[s.RESOURCES : s.RESOURCES + NUM_RESOURCES]
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
