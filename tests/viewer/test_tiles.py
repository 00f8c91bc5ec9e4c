"""Packed pictures hold every pixel of all pictures, and each tile once."""

import io
import struct
import zlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from marl_cair.viewer import tiles
from marl_cair.viewer.tiles import ATLAS_COLUMNS, NEW, OTHER, TILE, TilePacker


def pack(images):
    packer = TilePacker()
    for image in images:
        packer.add(image)
    return packer.pack()


def split(content):
    parts = []
    while content:
        (size,) = struct.unpack_from("<I", content)
        parts.append(content[4 : 4 + size])
        content = content[4 + size :]
    return parts


def unpack(packed):
    """The pictures again, as viewer/src/pictures.ts does it."""
    gaps, codes, others = split(zlib.decompress(packed.changes))
    count = len(others) // 3
    atlas = np.asarray(Image.open(io.BytesIO(packed.atlas)).convert("RGB"))
    columns = -(-(packed.left + packed.width) // TILE)
    rows = -(-(packed.top + packed.height) // TILE)
    board = np.zeros((rows * TILE, columns * TILE, 3), np.uint8)
    shown = [[] for _ in range(rows * columns)]
    at = code_at = new = other = 0
    place, found = -1, []
    while at < len(gaps):
        gap = gaps[at]
        at += 1
        if gap == 0:
            place = -1
            inside = board[packed.top :, packed.left :][: packed.height, : packed.width]
            found.append(inside.copy())
            continue
        if gap == 255:
            gap = gaps[at] + 256 * gaps[at + 1]
            at += 2
        place += gap
        code, before = codes[code_at], shown[place]
        code_at += 1
        if code == NEW:
            tile, new = new, new + 1
        elif code == OTHER:
            tile = sum(others[other + count * byte] << 8 * byte for byte in range(3))
            other += 1
        else:
            tile = before.pop(code)
        before.insert(0, tile)
        del before[OTHER:]
        y, x = (TILE * part for part in divmod(tile, ATLAS_COLUMNS))
        row, column = (TILE * part for part in divmod(place, columns))
        board[row : row + TILE, column : column + TILE] = atlas[y : y + TILE, x : x + TILE]
    return found


@given(
    st.integers(1, 40),
    st.integers(1, 40),
    st.integers(1, 9),
    st.integers(1, 4),
    st.integers(0, 1000),
)
def test_pictures_are_unpacked_to_the_same_pixels(height, width, count, colours, seed):
    random = np.random.default_rng(seed)
    palette = random.integers(0, 256, (colours, 3), np.uint8)
    images = [palette[random.integers(0, colours, (height, width))]]
    for _ in range(count):  # changes of a few pixels, and what was there before
        image = images[random.integers(len(images))].copy()
        image[random.integers(height), random.integers(width)] = palette[0]
        images.append(image)
    packed = pack(images)
    assert (packed.width, packed.height) == (width, height)
    np.testing.assert_array_equal(unpack(packed), images)


def test_wide_gaps_and_old_tiles_are_unpacked():
    """More tiles than a byte counts lie between two changes, and a place shows over 255 tiles."""
    base = np.zeros((8, 8 * 300, 3), np.uint8)
    images = []
    for value in [*range(1, 256), *range(1, 256), 0, 3]:
        image = base.copy()
        image[0, -1] = value
        image[0, 0, 1] = value // 200
        images.append(image)
    np.testing.assert_array_equal(unpack(pack(images)), images)


def test_a_tile_that_repeats_is_stored_once():
    image = np.zeros((64, 64, 3), np.uint8)
    image[8:16, 8:16] = image[40:48, 24:32] = (9, 8, 7)
    packed = pack([image] * 5)
    assert packed.num_tiles == 2
    assert (packed.left, packed.top) == (0, 0)


@pytest.mark.parametrize(("left", "top"), [(0, 0), (3, 6)])
def test_tiles_lie_as_the_cells_of_the_board(left, top):
    random = np.random.default_rng(0)
    cells = random.integers(0, 256, (3, TILE, TILE, 3), np.uint8)
    board = cells[random.integers(0, 3, (9, 9))].swapaxes(1, 2).reshape(9 * TILE, 9 * TILE, 3)
    image = board[top:, left:]
    packed = pack([image])
    assert (packed.left, packed.top) == (left, top)


def test_too_many_tiles_have_no_atlas(monkeypatch):
    monkeypatch.setattr(tiles, "MOST_TILES", 1)
    packed = pack([np.arange(16 * 16 * 3, dtype=np.uint8).reshape(16, 16, 3)])
    assert packed.num_tiles > 1
    assert packed.atlas == b""
