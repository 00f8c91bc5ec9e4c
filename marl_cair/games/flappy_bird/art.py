"""The art as arrays that the compiled painters copy from; for small grey pictures, averaged before.

A grey picture of S x S dots is the area mean of the luminance of the whole picture, of 512 x 288
pixels. Both axes are cut into S cells: along an axis of n pixels, cell c is n units long and pixel
x is S units, so that all overlaps are whole numbers:

    pixels   |--x = 0--|--x = 1--|--x = 2--| ...     S units each
    cells    |-----c = 0-----|-----c = 1-----| ...   n units each

What always stands in the same columns (birds), or in columns that repeat (pipes, ground), is
averaged along its rows here, once; what is left to do for each picture is the other axis.
"""

from __future__ import annotations

from functools import cache
from math import gcd
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.flappy_bird import sprites
from marl_cair.games.flappy_bird.sprites import (
    BODY_INSET,
    CANVAS,
    CANVAS_LEFT,
    GROUND_PERIOD,
    Pixels,
)
from marl_cair.games.flappy_bird.tables import (
    GROUND_TOP,
    PIPE_WIDTH,
    SCREEN_HEIGHT,
    SCREEN_WIDTH,
)

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
    bird_cover: NDArray[np.int32]  # [looks, 44 canvas rows, columns]
    bird_light: NDArray[np.int32]  # [8 seats, looks, 44 canvas rows, columns]


class Art(NamedTuple):
    """What pictures are painted with."""

    sky: NDArray[np.uint8]  # [3, 512, 288]
    ground: NDArray[np.uint8]  # [3, 108, 312]
    pipe: NDArray[np.uint8]  # [2, 52, 3] colours across the body and the end
    outline: NDArray[np.uint8]  # [3]
    bird: NDArray[np.uint8]  # [looks, 44, 44] palette indices
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
    total = SCREEN_HEIGHT * SCREEN_WIDTH
    sums = overlaps(side, SCREEN_HEIGHT) @ luma @ overlaps(side, SCREEN_WIDTH).T
    return ((sums + total // 2) // total).astype(np.uint8)


def _make_gray_art(side: int, art: dict[str, Pixels]) -> GrayArt:
    period = SCREEN_WIDTH // gcd(SCREEN_WIDTH, side)
    cover, light = _average_pipes(side, period, art["pipe"], art["outline"])
    ground_row = GROUND_TOP * side // SCREEN_HEIGHT
    bird_column = CANVAS_LEFT * side // SCREEN_WIDTH
    bird_cover, bird_light = _average_birds(side, bird_column, art["bird"], art["palette"])
    return GrayArt(
        sky=area_means(luminance(art["sky"].transpose(1, 2, 0)), side),
        ground=_average_ground(side, ground_row, art["ground"]),
        ground_row=ground_row,
        ground_units=(ground_row + 1) * SCREEN_HEIGHT - GROUND_TOP * side,
        period=period,
        period_columns=period * side // SCREEN_WIDTH,
        pipe_cover=cover,
        pipe_light=light,
        bird_column=bird_column,
        bird_cover=bird_cover,
        bird_light=bird_light,
    )


def _average_ground(side: int, first_row: int, ground: Pixels) -> Pixels:
    """The means of what each row shows of the ground, by how far it has scrolled."""
    down = overlaps(side, SCREEN_HEIGHT)[first_row:, GROUND_TOP:]
    across = overlaps(side, SCREEN_WIDTH)
    total = down.sum(1)[:, None] * SCREEN_WIDTH
    luma = luminance(ground.transpose(1, 2, 0))
    phases = []
    for phase in range(GROUND_PERIOD):
        sums = down @ luma[:, phase : phase + SCREEN_WIDTH] @ across.T
        phases.append((sums + total // 2) // total)
    return np.array(phases, np.uint8)


def _average_pipes(
    side: int, period: int, pipe: Pixels, outline: Pixels
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    num_columns = PIPE_WIDTH * side // SCREEN_WIDTH + 2
    opaque = np.ones((3, PIPE_WIDTH), np.int64)
    opaque[BODY, :BODY_INSET], opaque[BODY, -BODY_INSET:] = 0, 0
    luma = np.stack([*luminance(pipe), np.full(PIPE_WIDTH, luminance(outline[None])[0])])
    across = overlaps(side, SCREEN_WIDTH)
    cover = np.zeros((period, 3, num_columns), np.int32)
    light = np.zeros_like(cover)
    for phase in range(period):
        first = phase * side // SCREEN_WIDTH
        units = across[first : first + num_columns, phase : phase + PIPE_WIDTH]
        cover[phase] = opaque @ units.T
        light[phase] = (opaque * luma) @ units.T
    return cover, light


def _average_birds(
    side: int, first_column: int, bird: Pixels, palette: Pixels
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    last_column = -(-(CANVAS_LEFT + CANVAS) * side // SCREEN_WIDTH)
    units = overlaps(side, SCREEN_WIDTH)[
        first_column:last_column, CANVAS_LEFT : CANVAS_LEFT + CANVAS
    ]
    cover = (bird > 0).astype(np.int64) @ units.T
    luma = luminance(palette)  # [seats, letters]; transparent dots are black
    light = luma[:, bird] @ units.T
    return cover.astype(np.int32), light.astype(np.int32)


@cache
def make_art() -> Art:
    """All art; the same arrays at every call, which nobody writes to."""
    art = {
        "sky": sprites.sky(),
        "ground": sprites.ground(),
        "pipe": sprites.pipe_profiles(),
        "outline": sprites.outline_colour(),
        "bird": sprites.bird_shapes(),
        "palette": sprites.bird_palettes(),
    }
    return Art(**art, gray_84=_make_gray_art(84, art), gray_80=_make_gray_art(80, art))
