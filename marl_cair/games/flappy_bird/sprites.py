"""The pixel art of Flappy Bird, drawn by code: birds, pipes, ground and sky.

Birds are painted on a grid of 17 x 12 dots of two pixels, with three positions of the wing, and
turned by how they move; the rest is made of boxes, discs and waves.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.flappy_bird.tables import (
    BIRD_HEIGHT,
    BIRD_WIDTH,
    BIRD_X,
    GROUND_TOP,
    MAX_PLAYERS,
    PIPE_WIDTH,
    SCREEN_HEIGHT,
    SCREEN_WIDTH,
)

Pixels = NDArray[np.uint8]

# Of seats 0..7, after Okabe and Ito (2008), whose colours the colour-blind can tell apart.
BIRD_COLOURS = (
    (240, 228, 66),  # yellow
    (213, 94, 0),  # vermilion
    (0, 114, 178),  # blue
    (0, 158, 115),  # bluish green
    (204, 121, 167),  # reddish purple
    (230, 159, 0),  # orange
    (86, 180, 233),  # sky blue
    (110, 110, 118),  # grey in place of black, on which the outline would not show
)

# K outline, L light, B body, D shade, W white of the eye, E pupil, O and R bill.
_LETTERS = ".KLBDWEOR"
_BODY = (
    ".......KKKKK.....",
    ".....KKLLLLLKK...",
    "....KLLBBBBWWWK..",
    "KK.KLBBBBBWWEEWK.",
    "KDKLBBBBBBWWEEWKK",
    "KDDBBBBBBBBWWWKOO",
    ".KDBBBBBBBBBBKOOO",
    "..KBBBBBBBBBKRRRK",
    "..KDBBBBBBBBBKKK.",
    "...KDDBBBBBDDK...",
    "....KKDDDDDKK....",
    "......KKKKK......",
)
_CRASHED_EYE = (".......", ".EWEW..", ".WEWW..", ".EWEW..")
_WINGS = (  # up, level, down: (first row, rows)
    (2, ("..KKK..", ".KLLLK.", ".KLLLK.", "..KBBK.", "...KK..")),
    (5, (".KKKKK.", "KLLLLLK", "KLBBBK.", ".KKKK..")),
    (6, (".KKKK..", ".KBBBK.", "KLLLK..", "KLLK...", ".KK....")),
)
_WING_COLUMN = 2
_UP, _LEVEL, _DOWN = range(3)
_DOT = 2  # pixels

# The looks of a bird: its wing, and the degrees by which it is turned, nose up.
_LOOKS = ((_DOWN, 22), (_LEVEL, 18), (_UP, 8), (_LEVEL, 0), (_UP, -22), (_UP, -48), (_LEVEL, -30))
NUM_LOOKS = len(_LOOKS)
PUSHING_LOOK = 0
CRASHED_LOOK = NUM_LOOKS - 1
# By velocity in whole pixels per tick, from FLAP_VELOCITY (-8) to MAX_FALL (10).
LOOK_OF_SPEED: NDArray[np.int8] = np.repeat(np.array([1, 2, 3, 4, 5], np.int8), [4, 4, 4, 4, 3])
# The canvas of a turned bird, and its corner beside the upper left corner of the bird.
CANVAS = 44
CANVAS_LEFT = BIRD_X + BIRD_WIDTH // 2 - CANVAS // 2
CANVAS_UP = CANVAS // 2 - BIRD_HEIGHT // 2  # pixels above the bird's upper edge

CAP_HEIGHT = 24  # pixels of the broad end of a pipe
CAP_LINE = 2  # of its dark edges
BODY_INSET = 2  # by which a pipe is narrower than its end, on each side
GROUND_PERIOD = 24  # pixels after which the ground repeats
GROUND_HEIGHT = SCREEN_HEIGHT - GROUND_TOP

_OUTLINE = (46, 54, 62)
_PIPE_DARK, _PIPE_LIGHT = (38, 96, 62), (176, 226, 130)


def _read_dots(rows: tuple[str, ...]) -> NDArray[np.int64]:
    return np.array([[_LETTERS.index(letter) for letter in row] for row in rows])


def _paint_dots(wing: int, is_crashed: bool) -> NDArray[np.int64]:
    """Palette indices [12, 17] of a bird that looks straight ahead."""
    dots = _read_dots(_BODY)
    top, rows = _WINGS[wing]
    overlays = [(top, _WING_COLUMN, _read_dots(rows))]
    if is_crashed:
        overlays.append((1, 9, _read_dots(_CRASHED_EYE)))
    for row, column, overlay in overlays:
        height, width = overlay.shape
        place = dots[row : row + height, column : column + width]
        place[overlay > 0] = overlay[overlay > 0]
    return dots


def _turn(dots: NDArray[np.int64], degrees: float) -> NDArray[np.int64]:
    """The dots at two pixels each, turned around their middle on the canvas [44, 44]."""
    angle = np.deg2rad(degrees)
    offsets = np.arange(CANVAS) - (CANVAS - 1) / 2
    down, across = offsets[:, None], offsets[None, :]
    x = np.cos(angle) * across - np.sin(angle) * down + (BIRD_WIDTH - 1) / 2
    y = np.sin(angle) * across + np.cos(angle) * down + (BIRD_HEIGHT - 1) / 2
    rows, columns = (np.floor((value + 0.5) / _DOT).astype(int) for value in (y, x))
    inside = (rows >= 0) & (rows < dots.shape[0]) & (columns >= 0) & (columns < dots.shape[1])
    return np.where(inside, dots[rows.clip(0, 11), columns.clip(0, 16)], 0)


def bird_shapes() -> Pixels:
    """Palette indices uint8 [looks, 44, 44]; 0 is transparent."""
    turned = [
        _turn(_paint_dots(wing, look == CRASHED_LOOK), degrees)
        for look, (wing, degrees) in enumerate(_LOOKS)
    ]
    return np.array(turned, np.uint8)


def bird_palettes() -> Pixels:
    """RGB uint8 [8 seats, 9 letters, 3]."""
    palettes = np.zeros((MAX_PLAYERS, len(_LETTERS), 3), np.uint8)
    for seat, colour in enumerate(BIRD_COLOURS):
        body = np.array(colour, float)
        palettes[seat] = np.round(
            [
                (0, 0, 0),
                _OUTLINE,
                body + (255 - body) * 0.5,
                body,
                body * 0.72,
                (255, 255, 255),
                (20, 20, 28),
                (250, 150, 60),
                (222, 78, 48),
            ]
        )
    return palettes


def pipe_profiles() -> Pixels:
    """RGB across the pipe uint8 [2, 52, 3]: of its body (0 in the inset) and of its end."""
    profiles = np.zeros((2, PIPE_WIDTH, 3), np.uint8)
    dark, light = np.array(_PIPE_DARK, float), np.array(_PIPE_LIGHT, float)
    for part, inset in enumerate((BODY_INSET, 0)):
        width = PIPE_WIDTH - 2 * inset
        across = (np.arange(width) // _DOT * _DOT + 1) / width
        # Light from the left: a bright band near the edge, darker to the right, in a few steps.
        shine = np.clip(1.0 - np.abs(across - 0.24) / 0.75, 0, 1)
        steps = np.round(shine * 7) / 7
        colours = dark + (light - dark) * steps[:, None]
        colours[:CAP_LINE], colours[-CAP_LINE:] = _OUTLINE, _OUTLINE
        profiles[part, inset : inset + width] = np.round(colours)
    return profiles


def outline_colour() -> Pixels:
    """RGB uint8 [3] of outlines."""
    return np.array(_OUTLINE, np.uint8)


def sky() -> Pixels:
    """The picture behind the pipes, uint8 [3, 512, 288]: sky, clouds, hills and bushes."""
    rows = np.arange(SCREEN_HEIGHT)[:, None] // _DOT * _DOT
    columns = np.arange(SCREEN_WIDTH)[None, :] // _DOT * _DOT
    high, low = np.array((96, 170, 222), float), np.array((206, 236, 240), float)
    share = np.round(np.clip(rows / GROUND_TOP, 0, 1) * 24) / 24
    image = high + (low - high) * share[..., None] + 0.0 * columns[..., None]

    def paint(mask: NDArray[np.bool_], colour: tuple[int, int, int]) -> None:
        image[mask] = colour

    clouds = ((52, 96, 1.0), (196, 62, 0.8), (262, 168, 0.9), (112, 210, 0.7), (20, 268, 0.6))
    for offset, colour in ((6, (214, 234, 244)), (0, (246, 251, 253))):
        for x, y, size in clouds:
            for shift, radius in ((-26, 12), (-8, 19), (14, 15), (30, 9)):
                reach = radius * size
                centre = y + offset - reach * 0.5
                puff = (columns - x - shift * size) ** 2 + (rows - centre) ** 2 <= reach**2
                paint(puff & (rows <= y + offset), colour)
    waves = np.sin(columns / 41.0 + 0.6) * 16 + np.sin(columns / 17.0) * 6
    paint(rows > 346 - waves, (158, 206, 196))
    waves = np.sin(columns / 29.0 + 3.0) * 12 + np.sin(columns / 11.0 + 1.0) * 4
    paint(rows > 372 - waves, (122, 186, 150))
    bushes = np.abs(np.sin(columns / 13.0)) * 9 + np.abs(np.sin(columns / 7.0 + 1.0)) * 4
    paint(rows > 392 - bushes, (92, 160, 112))
    painted: Pixels = np.round(image).astype(np.uint8).transpose(2, 0, 1).copy()
    return painted


def ground() -> Pixels:
    """The ground, uint8 [3, 108, 288 + 24]: it repeats after 24 pixels, by which it scrolls."""
    rows = np.arange(GROUND_HEIGHT)[:, None] // _DOT * _DOT
    columns = np.arange(SCREEN_WIDTH + GROUND_PERIOD)[None, :] // _DOT * _DOT
    phase = columns % GROUND_PERIOD
    image = np.zeros((GROUND_HEIGHT, SCREEN_WIDTH + GROUND_PERIOD, 3))
    image[:] = (226, 206, 158)
    image[((rows * 5 + phase * 3) % GROUND_PERIOD < 2) & (rows % 14 == 6)] = (202, 178, 126)
    image[(rows < 22) & (rows >= 18) & (columns >= 0)] = (188, 160, 106)
    stripes = (phase + rows) % GROUND_PERIOD < GROUND_PERIOD // 2
    grass = (rows < 16) & (columns >= 0)
    image[grass] = (112, 184, 84)
    image[grass & stripes] = (150, 212, 104)
    image[(rows >= 16) & (rows < 18) & (columns >= 0)] = (84, 128, 70)
    image[(rows < _DOT) & (columns >= 0)] = _OUTLINE
    return np.round(image).astype(np.uint8).transpose(2, 0, 1).copy()
