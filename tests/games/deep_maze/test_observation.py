"""Each representation tells the board as its page says."""

import numpy as np
import pytest

from marl_cair.games.deep_maze.observation import PLANE_NAMES, VECTOR_NAMES
from tests.games.deep_maze.table import Table

pytestmark = pytest.mark.plain_python

ROOM = """
.....
##...
..0..
..#..
....G
"""
CHASE = """
#######
#0.1..#
#.....#
#..2..#
#....G#
#######
"""


def plane(table, name, player=0):
    return table.see("planes", player)[PLANE_NAMES.index(name)]


def cells(marked):
    return [tuple(place) for place in np.argwhere(marked).tolist()]


def test_planes_tell_the_board():
    table = Table(board=ROOM)
    np.testing.assert_array_equal(plane(table, "wall"), 255 * table.walls())
    np.testing.assert_array_equal(plane(table, "open"), 255 * (1 - table.walls()))
    assert cells(plane(table, "self")) == [(2, 2)]
    assert cells(plane(table, "goal")) == [(4, 4)]
    assert cells(plane(table, "where self came from")) == []
    for name in ("in sight", "explored"):
        assert (plane(table, name) == 255).all()
    table.move("right")
    assert cells(plane(table, "self")) == [(2, 3)]
    assert cells(plane(table, "where self came from")) == [(2, 2)]
    table.move("noop")
    assert cells(plane(table, "where self came from")) == [(2, 2)]


def test_uniform_planes_tell_role_and_time():
    table = Table("15x15-chase-3p", board=CHASE, max_ticks=10)
    assert [plane(table, "role", seat)[0, 0] for seat in range(3)] == [255, 128, 128]
    assert (plane(Table(board=ROOM), "role") == 0).all()
    levels = []
    for _ in range(4):
        levels.append(int(plane(table, "time left")[0, 0]))
        table.move("noop", "noop", "noop")
    assert levels == [255, 255 * 9 // 10, 255 * 8 // 10, 255 * 7 // 10]
    sequence = Table("9x9-sequence")
    assert (plane(sequence, "mazes left") == 255 * 2 // 3).all()
    timed = Table("9x9-timed_square")
    timed.move("noop")
    assert (plane(timed, "preview left") == 255 * 4 // 5).all()


def test_planes_tell_rivals_from_mates():
    table = Table("15x15-chase-3p", board=CHASE)
    assert cells(plane(table, "rivals", 0)) == [(1, 3), (3, 3)]
    assert cells(plane(table, "mates", 0)) == []
    assert cells(plane(table, "rivals", 1)) == [(1, 1)]
    assert cells(plane(table, "mates", 1)) == [(3, 3)]


def test_classic_holds_the_originals_ids_and_flat_the_same():
    table = Table(board=ROOM)
    expected = [[0, 0, 0, 0, 0], [1, 1, 0, 0, 0], [0, 0, 2, 0, 0], [0, 0, 1, 0, 0], [0, 0, 0, 0, 3]]
    np.testing.assert_array_equal(table.see("classic"), [expected])
    np.testing.assert_array_equal(table.see("flat"), np.ravel(expected))


def test_the_vector_tells_places_and_free_cells():
    table = Table(board=ROOM, max_ticks=50)
    told = dict(zip(VECTOR_NAMES, table.see("vector").tolist(), strict=True))
    assert (told["own row"], told["own column"]) == (2, 2)
    assert (told["goal known"], told["goal row"], told["goal column"]) == (1, 4, 4)
    assert [told[f"free cells {way}"] for way in ("down", "up", "left", "right")] == [0, 2, 2, 2]
    assert told["moves left"] == 50
    chase = Table("15x15-chase-3p", board=CHASE)
    told = dict(zip(VECTOR_NAMES, chase.see("vector", 1).tolist(), strict=True))
    assert told["self hunts"] == 0
    other_2 = [told[f"other 1: {name}"] for name in ("in sight", "row", "column", "is a rival")]
    other_0 = [told[f"other 2: {name}"] for name in ("in sight", "row", "column", "is a rival")]
    assert other_2 == [1, 3, 3, 0]
    assert other_0 == [1, 1, 1, 1]


def test_a_player_on_another_shows_itself():
    table = Table("15x15-race-2p", board="#####\n#01.#\n#..G#\n#...#\n#####")
    table.move("right", "noop")
    for player in range(2):
        assert table.see("classic", player)[0, 1, 2] == 2
        assert plane(table, "rivals", player)[1, 2] == 255


def test_the_spec_names_what_never_changes():
    def static(scenario):
        return Table(scenario).engine.spec.static_planes

    assert [PLANE_NAMES[p] for p in static("9x9-stochastic")] == [
        "wall",
        "open",
        "goal",
        "in sight",
        "explored",
    ]
    assert static("9x9-square") == static("9x9-sequence") == ()
