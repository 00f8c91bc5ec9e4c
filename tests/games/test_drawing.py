"""Boxes, discs, bars and digits land on exactly the pixels that they name."""

import numpy as np
import pytest
from PIL import Image

from marl_cair.games.drawing import (
    cut_cells,
    draw_bar,
    draw_number,
    draw_sprite,
    fill_box,
    fill_disc,
    read_atlas,
)

WHITE = np.array((255, 255, 255), np.uint8)
RED = np.array((255, 0, 0), np.uint8)


def blank(height=12, width=20):
    return np.zeros((3, height, width), np.uint8)


@pytest.mark.slow
def test_a_box_is_cut_at_the_edges():
    image = blank()
    fill_box(image, -2, 17, 5, 9, WHITE)
    assert image.any(0).sum() == 3 * 3
    assert image[:, :3, 17:].all()


@pytest.mark.slow
def test_a_disc_of_radius_one_is_a_cross():
    image = blank()
    fill_disc(image, 5, 5, 1, WHITE)
    assert sorted(zip(*np.nonzero(image[0]), strict=True)) == [
        (4, 5),
        (5, 4),
        (5, 5),
        (5, 6),
        (6, 5),
    ]


@pytest.mark.slow
def test_a_bar_is_filled_by_its_share():
    image = blank()
    draw_bar(image, 0, 0, 1, 10, 0.3, WHITE, RED)
    assert image[1, 0, :10].tolist() == [255] * 3 + [0] * 7
    assert image[0, 0, :10].tolist() == [255] * 10


@pytest.mark.slow
def test_numbers_read_from_left_to_right():
    image = blank()
    draw_number(image, 17, 0, 0, 1, WHITE, False)
    rows = ["".join("#" if pixel else "." for pixel in row[:7]) for row in image[0, :5]]
    assert rows == [".#..###", "##....#", ".#...#.", ".#...#.", "###..#."]


def test_a_sprite_is_scaled_and_flipped():
    image = blank()
    palette = np.array([(0, 0, 0), (255, 0, 0)], np.uint8)
    draw_sprite(image, np.array([[1, 0], [0, 0]], np.uint8), palette, 0, 0, 4, True)
    assert np.nonzero(image[0])[1].tolist() == [2, 3, 2, 3]


def test_an_atlas_gives_palette_indices_and_colours(tmp_path):
    path = tmp_path / "atlas.png"
    image = Image.fromarray(np.arange(8, dtype=np.uint8).reshape(2, 4) % 3)
    image.putpalette([0, 0, 0, 255, 0, 0, 0, 0, 255])
    image.save(path, transparency=0)
    indices, palette = read_atlas(path)
    assert indices.tolist() == [[0, 1, 2, 0], [1, 2, 0, 1]]
    assert palette.tolist() == [[0, 0, 0], [255, 0, 0], [0, 0, 255]]
    assert cut_cells(indices, 2).tolist() == [[[[0, 1], [1, 2]], [[2, 0], [0, 1]]]]
    image.convert("RGB").save(path)
    with pytest.raises(ValueError, match="mode RGB"):
        read_atlas(path)
