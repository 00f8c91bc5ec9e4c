"""Packs pictures of a game: each distinct tile once, and which tiles change from step to step.

A packed view has two parts. The atlas is a lossless WebP picture of all distinct tiles, in the
order in which they first appear, TILE pixels a side, ATLAS_COLUMNS in a row. The changes are
deflated: three byte strings, each after its length (u32, little-endian):

    gaps    for each picture the places of its changed tiles, counted row by row from 1: each as
            the difference to the one before (to 0), 1 byte, or 255 and u16; 0 ends the picture
    codes   for each changed tile one byte: NEW for the next tile of the atlas, n for the n-th last
            tile that this place has shown before the present one, OTHER for another tile
    others  these other tiles, by number: all low bytes, then all middle bytes, then all high bytes

viewer/src/pictures.ts unpacks it.
"""

from __future__ import annotations

import io
import struct
import zlib
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

TILE = 8  # pixels; 16 take a quarter more bytes in Deep RTS, as many in Deep Line Wars
ATLAS_COLUMNS = 128
MOST_TILES = ATLAS_COLUMNS * (16_383 // TILE)  # that a WebP picture holds
NEW, OTHER = 0, 255
_LONG_GAP = 255


class PackedView(NamedTuple):
    """Pictures [N] of equal size, packed."""

    width: int  # pixels
    height: int
    left: int  # pixels of the first column of tiles that are not in the pictures
    top: int
    num_tiles: int
    atlas: bytes
    changes: bytes

    @property
    def num_bytes(self) -> int:
        return len(self.atlas) + len(self.changes)


class TilePacker:
    """Packs one picture after another."""

    def __init__(self) -> None:
        self._number_of: dict[bytes, int] = {}  # of each distinct tile
        self._gaps, self._codes = bytearray(), bytearray()
        self._others: list[int] = []
        self._shown: list[list[int]] = []  # tiles that each place has shown, the newest first
        self._last: NDArray[np.uint32] | None = None
        self._box = (0, 0, 0, 0)  # width, height, left, top

    def add(self, picture: NDArray[np.uint8]) -> None:
        """Pack the next picture, uint8 [height, width, 3]; all have the same size."""
        if self._last is None:
            self._box = (picture.shape[1], picture.shape[0], *_find_offset(picture))
        pixels = _pad(picture, *self._box[2:])
        rows, columns = pixels.shape[0] // TILE, pixels.shape[1] // TILE
        if self._last is None:
            changed = np.ones((rows, columns), np.bool_)
            self._shown = [[] for _ in range(rows * columns)]
        else:  # eight pixels at once
            differs = (pixels != self._last).view(np.uint64) != 0
            changed = differs.reshape(rows, TILE, columns).any(1)
        tiles = _cut(pixels)[changed]
        places = np.flatnonzero(changed).tolist()
        self._write_gaps(places)
        for place, tile in zip(places, tiles, strict=True):
            self._write_tile(self._shown[place], tile.tobytes())
        self._last = pixels

    def _write_gaps(self, places: list[int]) -> None:
        before = -1
        for place in places:
            gap, before = place - before, place
            self._gaps += bytes([gap]) if gap < _LONG_GAP else struct.pack("<BH", _LONG_GAP, gap)
        self._gaps.append(0)

    def _write_tile(self, shown: list[int], content: bytes) -> None:
        number = self._number_of.get(content)
        if number is None:
            number = self._number_of[content] = len(self._number_of)
            self._codes.append(NEW)
        elif number in shown:
            self._codes.append(shown.index(number))
            shown.remove(number)
        else:
            self._codes.append(OTHER)
            self._others.append(number)
        shown.insert(0, number)
        del shown[OTHER:]

    def pack(self) -> PackedView:
        """All pictures so far, of which there is at least one; without atlas if it would have more
        than MOST_TILES tiles.
        """
        num_tiles = len(self._number_of)
        others = np.array(self._others, "<u4").view(np.uint8).reshape(-1, 4)[:, :3]
        strings = self._gaps, self._codes, others.T.tobytes()
        whole = b"".join(struct.pack("<I", len(part)) + part for part in strings)
        atlas = _draw_atlas(b"".join(self._number_of)) if num_tiles <= MOST_TILES else b""
        return PackedView(*self._box, num_tiles, atlas, zlib.compress(whole, 9))


def _find_offset(picture: NDArray[np.uint8]) -> tuple[int, int]:
    """The left and top with which the picture has the fewest distinct tiles: then tiles lie as the
    cells of the board.
    """

    def count(left: int, top: int) -> int:
        tiles = _cut(_pad(picture, left, top)).reshape(-1, TILE, TILE)
        return len({tile.tobytes() for tile in tiles})

    left = min(range(TILE), key=lambda left: count(left, 0))
    return left, min(range(TILE), key=lambda top: count(left, top))


def _pad(picture: NDArray[np.uint8], left: int, top: int) -> NDArray[np.uint32]:
    """A picture as one number for each pixel, with whole tiles."""
    height, width = picture.shape[:2]
    rows, columns = -(-(top + height) // TILE), -(-(left + width) // TILE)
    padded = np.zeros((rows * TILE, columns * TILE, 4), np.uint8)
    padded[top : top + height, left : left + width, :3] = picture
    pixels: NDArray[np.uint32] = padded.view(np.uint32)[..., 0]
    return pixels


def _cut(pixels: NDArray[np.uint32]) -> NDArray[np.uint32]:
    """The tiles [rows, columns, TILE, TILE] of a padded picture."""
    rows, columns = pixels.shape[0] // TILE, pixels.shape[1] // TILE
    return pixels.reshape(rows, TILE, columns, TILE).swapaxes(1, 2)


def _draw_atlas(tiles: bytes) -> bytes:
    from PIL import Image

    given = np.frombuffer(tiles, np.uint8).reshape(-1, TILE, TILE, 4)[..., :3]
    rows = -(-len(given) // ATLAS_COLUMNS)
    columns = min(len(given), ATLAS_COLUMNS)
    cells = np.zeros((rows * columns, TILE, TILE, 3), np.uint8)
    cells[: len(given)] = given
    cells = cells.reshape(rows, columns, TILE, TILE, 3).swapaxes(1, 2)
    file = io.BytesIO()
    picture = Image.fromarray(cells.reshape(rows * TILE, columns * TILE, 3))
    picture.save(file, "WEBP", lossless=True, quality=75, method=4)
    return file.getvalue()
