"""Draws an observation as a picture: images and heat maps as they are, planes side by side."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import Representation

GAP = 1  # cells between planes
_COLOURS = ("red", "green", "blue")
_FRAME = (58, 62, 74)
_LOW, _HIGH = np.array((13, 17, 27), np.float64), np.array((255, 214, 102), np.float64)


def list_shown(representations: dict[str, Representation]) -> list[str]:
    """Names of the representations that are pictures or boards, "" (the game itself) first."""
    return ["", *(name for name, one in representations.items() if len(one.shape) == 3)]


def draw_representation(kind: Representation, seen: NDArray[Any]) -> NDArray[np.uint8]:
    """The picture uint8 [h, w, 3] of one seat's observation [C, H, W]."""
    scaled = np.clip(seen.astype(np.float64) / np.max(kind.high), 0.0, 1.0)
    if len(seen) == 3 and all(
        name.startswith(colour) for name, colour in zip(kind.plane_names, _COLOURS, strict=True)
    ):
        return np.ascontiguousarray((255 * scaled).astype(np.uint8).transpose(1, 2, 0))
    if len(seen) == 1:
        gray = (255 * scaled[0]).astype(np.uint8)
        return np.ascontiguousarray(np.repeat(gray[:, :, None], 3, 2))
    return _tile_planes(scaled)


def count_across(shape: tuple[int, ...]) -> int:
    """Planes in a row of the picture of an observation [C, H, W]: about as wide as it is high."""
    num, rows, columns = shape
    return max(1, min(num, round(math.sqrt(num * rows / columns * 1.4))))


def _tile_planes(scaled: NDArray[np.float64]) -> NDArray[np.uint8]:
    num, rows, columns = scaled.shape
    across = count_across(scaled.shape)
    down = -(-num // across)
    picture = np.empty((down * (rows + GAP) + GAP, across * (columns + GAP) + GAP, 3), np.uint8)
    picture[:] = _FRAME
    for index, plane in enumerate(scaled):
        top = GAP + index // across * (rows + GAP)
        left = GAP + index % across * (columns + GAP)
        colours = _LOW + plane[:, :, None] * (_HIGH - _LOW)
        picture[top : top + rows, left : left + columns] = colours.astype(np.uint8)
    return picture
