"""Draws boxes, sprites, discs, bars and digits on an image [3, h, w], without a display."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled_compact
from marl_cair.games.loops import write_loop

TRANSPARENT = 0
SPECTATOR = -1  # the viewer of a picture that is of no seat
GLYPH_ROWS, GLYPH_COLUMNS = 5, 3
_GLYPHS = (
    ("###", "#.#", "#.#", "#.#", "###"),
    (".#.", "##.", ".#.", ".#.", "###"),
    ("###", "..#", "###", "#..", "###"),
    ("###", "..#", ".##", "..#", "###"),
    ("#.#", "#.#", "###", "..#", "..#"),
    ("###", "#..", "###", "..#", "###"),
    ("###", "#..", "###", "#.#", "###"),
    ("###", "..#", ".#.", ".#.", ".#."),
    ("###", "#.#", "###", "#.#", "###"),
    ("###", "#.#", "###", "..#", "###"),
    ("...", ".#.", "###", ".#.", "..."),
)
PLUS = 10
GLYPHS: NDArray[np.bool_] = np.array([[[c == "#" for c in row] for row in g] for g in _GLYPHS])


def read_atlas(path: Path) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Read an indexed PNG: palette indices [h, w], 0 for transparent, and its palette [n, 3].

    Players' colours are rows of the palette, which a game replaces for each player.
    """
    from PIL import Image

    with Image.open(path) as image:
        if image.mode != "P":
            raise ValueError(f"{path} is a PNG of mode {image.mode}, must be indexed (mode P)")
        indices = np.array(image)
        palette = np.array(image.getpalette(), np.uint8).reshape(-1, 3)
    return indices, palette[: indices.max() + 1]


def cut_cells(atlas: NDArray[np.uint8], side: int) -> NDArray[np.uint8]:
    """Cut an atlas [h, w] into square sprites [rows, columns, side, side]."""
    rows, columns = atlas.shape[0] // side, atlas.shape[1] // side
    return np.ascontiguousarray(atlas.reshape(rows, side, columns, side).swapaxes(1, 2))


def read_colours(colours: str) -> NDArray[np.uint8]:
    """RGB uint8 [n, 3] of n colours in hexadecimal: "ff0000 00ff00"."""
    return np.array([list(bytes.fromhex(colour)) for colour in colours.split()], np.uint8)


_PAINT = """
def over_{name}(worlds, rules, index, viewer, image):
    rule(world_at(worlds, index), rules, viewer, image)
"""


def make_draw(
    rule: Any, world_at: Any, height: int, width: int
) -> Callable[[Any, Any, int, int | None], NDArray[np.uint8]]:
    """`Game.draw` of a rule (world, rules, viewer, image [3, height, width]) that paints a world:
    the picture uint8 [height, width, 3] of a seat's own view, or of the SPECTATOR's (None).
    """
    paint = compiled_compact(write_loop(_PAINT, rule, world_at))

    def draw(worlds: Any, rules: Any, world: int, player: int | None) -> NDArray[np.uint8]:
        image = np.zeros((3, height, width), np.uint8)
        paint(worlds, rules, world, SPECTATOR if player is None else player, image)
        return np.ascontiguousarray(image.transpose(1, 2, 0))

    return draw


@compiled_compact
def fill_box(image: Any, top: int, left: int, height: int, width: int, colour: Any) -> None:
    """Fill a box, cut at the edges of the image; colour uint8 [3]."""
    bottom, right = min(top + height, image.shape[1]), min(left + width, image.shape[2])
    for channel in range(3):
        for y in range(max(0, top), bottom):
            for x in range(max(0, left), right):
                image[channel, y, x] = colour[channel]


@compiled_compact
def fill_disc(image: Any, y_centre: int, x_centre: int, radius: int, colour: Any) -> None:
    """Fill a disc, cut at the edges of the image."""
    for y in range(max(0, y_centre - radius), min(image.shape[1], y_centre + radius + 1)):
        for x in range(max(0, x_centre - radius), min(image.shape[2], x_centre + radius + 1)):
            if (y - y_centre) ** 2 + (x - x_centre) ** 2 <= radius * radius:
                for channel in range(3):
                    image[channel, y, x] = colour[channel]


@compiled_compact
def draw_sprite(
    image: Any, sprite: Any, palette: Any, top: int, left: int, size: int, flip: bool
) -> None:
    """Draw a square sprite [side, side] of palette [n, 3] indices at `size` pixels; `flip` mirrors
    it left to right.
    """
    side = sprite.shape[0]
    for y in range(size):
        row = top + y
        if row < 0 or row >= image.shape[1]:
            continue
        for x in range(size):
            column = left + x
            if column < 0 or column >= image.shape[2]:
                continue
            across = x * side // size
            if flip:
                across = side - 1 - across
            index = sprite[y * side // size, across]
            if index != TRANSPARENT:
                for channel in range(3):
                    image[channel, row, column] = palette[index, channel]


@compiled_compact
def draw_bar(
    image: Any, top: int, left: int, height: int, width: int, share: float, full: Any, empty: Any
) -> None:
    """Draw a bar, filled from the left by `share` 0..1."""
    fill_box(image, top, left, height, width, empty)
    fill_box(image, top, left, height, int(width * min(1.0, max(0.0, share)) + 0.5), full)


@compiled_compact
def draw_glyph(image: Any, glyph: int, top: int, left: int, scale: int, colour: Any) -> None:
    """Draw a digit (or PLUS) with `scale` pixels per dot."""
    for row in range(GLYPH_ROWS):
        for column in range(GLYPH_COLUMNS):
            if GLYPHS[glyph, row, column]:
                fill_box(image, top + row * scale, left + column * scale, scale, scale, colour)


@compiled_compact
def draw_number(
    image: Any, number: int, top: int, left: int, scale: int, colour: Any, plus: bool
) -> None:
    """Draw a whole number of 0 or more, left-aligned; `plus` puts a plus sign before it."""
    step = (GLYPH_COLUMNS + 1) * scale
    if plus:
        draw_glyph(image, PLUS, top, left, scale, colour)
        left += step
    divisor = 1
    while number // divisor >= 10:
        divisor *= 10
    while divisor > 0:
        draw_glyph(image, number // divisor % 10, top, left, scale, colour)
        left += step
        divisor //= 10


@compiled_compact
def num_digits(number: int) -> int:
    """Digits of a whole number of 0 or more."""
    digits = 1
    while number >= 10:
        number //= 10
        digits += 1
    return digits


@compiled_compact
def fill_gray_cell(
    image: Any, header: int, row: int, column: int, rows: int, columns: int, level: int
) -> None:
    """Fill a board cell of a gray image [h, w] below `header` rows: at least one pixel."""
    height, width = image.shape[0] - header, image.shape[1]
    top = header + row * height // rows
    bottom = max(top + 1, header + (row + 1) * height // rows)
    left = column * width // columns
    right = max(left + 1, (column + 1) * width // columns)
    image[top:bottom, left:right] = level


# --- for boards of any tile size ---------------------------------------------------------------


@compiled_compact
def draw_smooth(
    image: Any,
    sprite: Any,
    palette: Any,
    top: int,
    left: int,
    size: int,
    flip: bool,
    first_row: int,
) -> None:
    """`draw_sprite` with area averaging: sharp at multiples of the sprite's side, soft between.

    Rows of the sprite above `first_row` are left out.
    """
    side = sprite.shape[0]
    whole = side * side
    for y in range(max(0, -top), min(size, image.shape[1] - top)):
        for x in range(max(0, -left), min(size, image.shape[2] - left)):
            red, green, blue, covered = 0, 0, 0, 0
            for row in range(y * side // size, ((y + 1) * side - 1) // size + 1):
                if row < first_row:
                    continue
                high = min((row + 1) * size, (y + 1) * side) - max(row * size, y * side)
                for column in range(x * side // size, ((x + 1) * side - 1) // size + 1):
                    index = sprite[row, side - 1 - column if flip else column]
                    if index == TRANSPARENT:
                        continue
                    end = min((column + 1) * size, (x + 1) * side)
                    area = high * (end - max(column * size, x * side))
                    red += area * int(palette[index, 0])
                    green += area * int(palette[index, 1])
                    blue += area * int(palette[index, 2])
                    covered += area
            if covered > 0:
                free = whole - covered
                for channel, total in enumerate((red, green, blue)):
                    below = int(image[channel, top + y, left + x])
                    image[channel, top + y, left + x] = (total + free * below) // whole


@compiled_compact
def shade_box(
    image: Any, top: int, left: int, height: int, width: int, colour: Any, percent: int
) -> None:
    """Blend a colour over a box; `percent` 100 replaces what was there."""
    bottom, right = min(top + height, image.shape[1]), min(left + width, image.shape[2])
    for channel in range(3):
        added = percent * int(colour[channel])
        for y in range(max(0, top), bottom):
            for x in range(max(0, left), right):
                image[channel, y, x] = ((100 - percent) * int(image[channel, y, x]) + added) // 100


@compiled_compact
def draw_corners(
    image: Any, top: int, left: int, size: int, arm: int, line: int, colour: Any
) -> None:
    """Draw the four corners of a square frame, with arms of `arm` pixels, `line` thick."""
    for corner in range(4):
        y = top if corner < 2 else top + size - line
        x = left if corner % 2 == 0 else left + size - line
        arm_top = top if corner < 2 else top + size - arm
        arm_left = left if corner % 2 == 0 else left + size - arm
        fill_box(image, y, arm_left, line, arm, colour)
        fill_box(image, arm_top, x, arm, line, colour)


@compiled_compact
def draw_line(
    image: Any, y: float, x: float, y_end: float, x_end: float, line: int, colour: Any
) -> None:
    """Draw a straight line, `line` pixels thick."""
    steps = int(max(abs(y_end - y), abs(x_end - x))) + 1
    half = line // 2
    for step in range(steps + 1):
        row = int(y + (y_end - y) * step / steps) - half
        column = int(x + (x_end - x) * step / steps) - half
        fill_box(image, row, column, line, line, colour)
