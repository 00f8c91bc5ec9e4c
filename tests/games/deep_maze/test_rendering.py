"""Pictures: their sizes and colours, and that each thing is where it belongs."""

import numpy as np
import pytest

from marl_cair.games.deep_maze import rendering
from tests.games.deep_maze.table import Table

ROOM = """
.....
##...
..0..
..#..
....G
"""


@pytest.mark.slow
def test_the_picture_has_one_size_on_every_board():
    for scenario in ("7x7-stochastic", "55x55-stochastic"):
        table = Table(scenario)
        picture = table.engine.render(0)
        assert picture.shape == (480, 640, 3)
        assert picture.dtype == np.uint8
        assert table.see("image").shape == (3, 480, 640)
    oblong = Table(rows=9, columns=30)
    assert len(np.unique(oblong.engine.render(0).reshape(-1, 3), axis=0)) > 10


def test_at_cell_scale_the_colours_are_the_originals():
    table = Table(board=ROOM, cell_pixels=4)
    image = table.see("image")
    assert image.shape == (3, 20, 20)
    for place, colour in (
        ((0, 0), (255, 255, 255)),
        ((1, 0), (0, 0, 0)),
        ((2, 2), (0, 255, 0)),
        ((4, 4), (255, 0, 0)),
    ):
        rows, columns = slice(4 * place[0], 4 * place[0] + 4), slice(4 * place[1], 4 * place[1] + 4)
        assert (image[:, rows, columns].transpose(1, 2, 0) == colour).all()
    foggy = Table("9x9-square", vision=1, cell_pixels=1)
    unknown = foggy.see("classic")[0] == 4
    assert unknown.any()
    assert (foggy.see("image")[:, unknown] == 105).all()


@pytest.mark.parametrize("size", [9, 84, 100])
def test_the_gray_picture_shows_every_thing_in_its_place(size):
    table = Table(rows=size, columns=size, visibility="full")
    gray = table.see("gray")[0]
    assert gray.shape == (84, 84)
    row, column = table.place()
    assert gray[4 + row * 80 // size, column * 84 // size] == rendering.GRAY_SELF
    assert (gray[4:] == rendering.GRAY_GOAL).any()
    assert (gray[:3] == rendering.GRAY_OPEN).all()


def test_a_seat_sees_itself_in_green_and_the_goal_in_red_and_the_spectator_the_way():
    table = Table(board=ROOM)
    picture, seen = table.engine.render(0), table.engine.render(0, 0)

    def count(image, colour):
        return int((image == colour).all(-1).sum())

    for image in (picture, seen):
        assert count(image, rendering.PLAYER_COLOURS[0]) > 500
        assert count(image, rendering.GOAL_RED) > 2_000
    assert count(picture[:, :470], rendering.PATH) > 100
    assert count(seen[:, :470], rendering.PATH) == 0
    np.testing.assert_array_equal(seen, table.see("image").transpose(1, 2, 0))


def test_a_move_changes_the_picture_only_at_its_cells_and_in_the_panel():
    table = Table(board=ROOM, max_ticks=300)
    before = table.engine.render(0, 0)
    table.move("up")
    changed = (before != table.engine.render(0, 0)).any(-1)[:, :470]
    rows, columns = np.nonzero(changed)
    side = rendering.BOARD_SIDE / 5
    start = rendering.MARGIN + rendering.FRAME
    assert start + side <= rows.min() <= rows.max() < start + 3 * side
    assert start + 2 * side <= columns.min() <= columns.max() < start + 3 * side


def test_the_hunter_has_a_colour_of_its_own_in_large_and_small_pictures():
    board = "#####\n#0.1#\n#...#\n#..G#\n#####"
    table = Table("15x15-chase-2p", board=board, cell_pixels=1)
    for seat in range(2):
        assert (table.see("image", seat)[:, 1, 1] == rendering.CELL_HUNTER).all()
        assert table.see("gray", seat)[0, 4 + 80 * 3 // 10, 84 * 3 // 10] == rendering.GRAY_HUNTER
    colours = {tuple(colour) for colour in rendering.ROLE_COLOURS.tolist()}
    assert len(colours) == len(set(rendering.ROLE_GRAYS.tolist())) == 4
    red = rendering.PLAYER_COLOURS[rendering.HUNTER_COLOUR]
    assert (table.engine.render(0) == red).all(-1).sum() > 100
    assert not (Table("15x15-race-2p").engine.render(0) == red).all(-1).any()
