"""Sprites of Flappy Bird as arrays, and their averages for the small grey pictures.

`birds.png` holds a bird in seven poses. `scenery.png` holds the sky; right of it, one period of the
ground below and, above, two rows of pixels: across the body of a pipe and across its end.

A grey picture of S x S dots is the area mean of the luminance of the whole picture, of 512 x 288
pixels. Both axes are cut into S cells: along an axis of n pixels, cell c is n units long and pixel
x is S units, so that all overlaps are whole numbers:

    pixels   |--x = 0--|--x = 1--|--x = 2--| ...     S units each
    cells    |-----c = 0-----|-----c = 1-----| ...   n units each

Birds always stand in the same columns, pipes and ground in columns that repeat. They are averaged
along their rows here, once. The other axis is averaged for each picture.
"""

from __future__ import annotations

from functools import cache
from math import gcd
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.drawing import cut_cells, read_atlas, read_colours
from marl_cair.games.flappy_bird import tables as t

Pixels = NDArray[np.uint8]

# Of seats 0..7: yellow, vermilion, blue, bluish green, reddish purple, orange, sky blue, and grey
# in place of black, on which the outline would not show. Colour-blind people can separate them
# (Okabe and Ito 2008).
BIRD_COLOURS = read_colours("f0e442 d55e00 0072b2 009e73 cc79a7 e69f00 56b4e9 6e6e76")

PUSHING_POSE, CRASHED_POSE = 0, 6  # cells of birds.png; those between are by speed
# By velocity in whole pixels per tick, from FLAP_VELOCITY (-8) to MAX_FALL (10).
POSE_OF_SPEED: NDArray[np.int8] = np.repeat(np.array([1, 2, 3, 4, 5], np.int8), [4, 4, 4, 4, 3])
# The canvas of a turned bird, and its corner beside the upper left corner of the bird.
CANVAS = 44
CANVAS_LEFT = t.BIRD_X + t.BIRD_WIDTH // 2 - CANVAS // 2
CANVAS_UP = CANVAS // 2 - t.BIRD_HEIGHT // 2  # pixels above the bird's upper edge

CAP_HEIGHT = 24  # pixels of the broad end of a pipe
CAP_LINE = 2  # of its dark edges
BODY_INSET = 2  # by which a pipe is narrower than its end, on each side
GROUND_PERIOD = 24  # pixels after which the ground repeats
BODY, CAP, LINE = range(3)  # parts of a pipe: the tube, its broad end, the end's dark edges


class GrayArt(NamedTuple):
    """Averages for grey pictures of S x S dots; weights along a row in units, 288 a cell."""

    sky: NDArray[np.uint8]  # [S, S]
    ground: NDArray[np.uint8]  # [24 phases, rows from ground_row on, S]
    ground_row: int  # the first row that shows ground
    ground_units: int  # of that row's 512
    period: int  # pixels after which the columns of pipes repeat
    period_columns: int
    pipe_cover: NDArray[np.int32]  # [period, 3 parts, columns] units that the pipe covers
    pipe_light: NDArray[np.int32]  # [period, 3 parts, columns] units times luminance
    bird_column: int  # the first that a bird's canvas touches
    bird_cover: NDArray[np.int32]  # [poses, 44 canvas rows, columns]
    bird_light: NDArray[np.int32]  # [8 seats, poses, 44 canvas rows, columns]


class Art(NamedTuple):
    """What pictures are painted with."""

    sky: NDArray[np.uint8]  # [3, 512, 288]
    ground: NDArray[np.uint8]  # [3, 108, 312]
    pipe: NDArray[np.uint8]  # [2, 52, 3] colours across the body and the end
    outline: NDArray[np.uint8]  # [3]
    bird: NDArray[np.uint8]  # [poses, 44, 44] palette indices
    palette: NDArray[np.uint8]  # [8 seats, 9, 3]
    gray_84: GrayArt
    gray_80: GrayArt


def luminance(image: NDArray[Any]) -> NDArray[np.int64]:
    """Rec. 601 luma of RGB along the last axis, 0..255 in whole numbers."""
    weighted = image.astype(np.int64) @ np.array([299, 587, 114])
    luma: NDArray[np.int64] = (weighted + 500) // 1000
    return luma


def overlaps(num_cells: int, num_pixels: int) -> NDArray[np.int64]:
    """Units of each pixel in each cell, int64 [cells, pixels]; a row's sum is `num_pixels`."""
    cells, pixels = np.arange(num_cells)[:, None], np.arange(num_pixels)[None, :]
    first = np.maximum(cells * num_pixels, pixels * num_cells)
    last = np.minimum((cells + 1) * num_pixels, (pixels + 1) * num_cells)
    units: NDArray[np.int64] = np.maximum(0, last - first)
    return units


def area_means(luma: NDArray[np.int64], side: int) -> Pixels:
    """A grey picture uint8 [side, side] of luminances [512, 288]: rounded area means."""
    total = t.SCREEN_HEIGHT * t.SCREEN_WIDTH
    sums = overlaps(side, t.SCREEN_HEIGHT) @ luma @ overlaps(side, t.SCREEN_WIDTH).T
    return ((sums + total // 2) // total).astype(np.uint8)


def _make_gray_art(side: int, art: dict[str, Pixels]) -> GrayArt:
    period = t.SCREEN_WIDTH // gcd(t.SCREEN_WIDTH, side)
    cover, light = _average_pipes(side, period, art["pipe"], art["outline"])
    ground_row = t.GROUND_TOP * side // t.SCREEN_HEIGHT
    bird_column = CANVAS_LEFT * side // t.SCREEN_WIDTH
    bird_cover, bird_light = _average_birds(side, bird_column, art["bird"], art["palette"])
    return GrayArt(
        sky=area_means(luminance(art["sky"].transpose(1, 2, 0)), side),
        ground=_average_ground(side, ground_row, art["ground"]),
        ground_row=ground_row,
        ground_units=(ground_row + 1) * t.SCREEN_HEIGHT - t.GROUND_TOP * side,
        period=period,
        period_columns=period * side // t.SCREEN_WIDTH,
        pipe_cover=cover,
        pipe_light=light,
        bird_column=bird_column,
        bird_cover=bird_cover,
        bird_light=bird_light,
    )


def _average_ground(side: int, first_row: int, ground: Pixels) -> Pixels:
    """The means of what each row shows of the ground, by how far it has scrolled."""
    down = overlaps(side, t.SCREEN_HEIGHT)[first_row:, t.GROUND_TOP :]
    across = overlaps(side, t.SCREEN_WIDTH)
    total = down.sum(1)[:, None] * t.SCREEN_WIDTH
    luma = luminance(ground.transpose(1, 2, 0))
    phases = []
    for phase in range(GROUND_PERIOD):
        sums = down @ luma[:, phase : phase + t.SCREEN_WIDTH] @ across.T
        phases.append((sums + total // 2) // total)
    return np.array(phases, np.uint8)


def _average_pipes(
    side: int, period: int, pipe: Pixels, outline: Pixels
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    num_columns = t.PIPE_WIDTH * side // t.SCREEN_WIDTH + 2
    opaque = np.ones((3, t.PIPE_WIDTH), np.int64)
    opaque[BODY, :BODY_INSET], opaque[BODY, -BODY_INSET:] = 0, 0
    luma = np.stack([*luminance(pipe), np.full(t.PIPE_WIDTH, luminance(outline[None])[0])])
    across = overlaps(side, t.SCREEN_WIDTH)
    cover = np.zeros((period, 3, num_columns), np.int32)
    light = np.zeros_like(cover)
    for phase in range(period):
        first = phase * side // t.SCREEN_WIDTH
        units = across[first : first + num_columns, phase : phase + t.PIPE_WIDTH]
        cover[phase] = opaque @ units.T
        light[phase] = (opaque * luma) @ units.T
    return cover, light


def _average_birds(
    side: int, first_column: int, bird: Pixels, palette: Pixels
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    last_column = -(-(CANVAS_LEFT + CANVAS) * side // t.SCREEN_WIDTH)
    units = overlaps(side, t.SCREEN_WIDTH)[
        first_column:last_column, CANVAS_LEFT : CANVAS_LEFT + CANVAS
    ]
    cover = (bird > 0).astype(np.int64) @ units.T
    luma = luminance(palette)  # [seats, palette rows]; row 0, transparent, is black
    light = luma[:, bird] @ units.T
    return cover.astype(np.int32), light.astype(np.int32)


def _make_bird_palettes(palette: Pixels) -> Pixels:
    """RGB uint8 [8 seats, 9 palette rows, 3]: rows 2 to 4 are the seat's light, plain and dark."""
    palettes = np.stack([palette] * len(BIRD_COLOURS))
    body = BIRD_COLOURS.astype(float)
    shades = body + (255 - body) * 0.5, body, body * 0.72
    palettes[:, 2:5] = np.round(np.stack(shades, 1))
    return palettes


@cache
def make_art() -> Art:
    """All art; the same arrays at every call: do not write to them."""
    folder = Path(__file__).parent
    birds, palette = read_atlas(folder / "birds.png")
    indices, colours = read_atlas(folder / "scenery.png")
    scenery = colours[indices]
    right = scenery[:, t.SCREEN_WIDTH :]
    ground = np.tile(
        right[t.GROUND_TOP :, :GROUND_PERIOD], (1, t.SCREEN_WIDTH // GROUND_PERIOD + 1, 1)
    )
    palettes = _make_bird_palettes(palette)
    art = {
        "sky": scenery[:, : t.SCREEN_WIDTH].transpose(2, 0, 1).copy(),
        "ground": ground.transpose(2, 0, 1).copy(),
        "pipe": right[:2].copy(),
        "outline": palettes[0, 1].copy(),
        "bird": cut_cells(birds, CANVAS)[0],
        "palette": palettes,
    }
    return Art(**art, gray_84=_make_gray_art(84, art), gray_80=_make_gray_art(80, art))
