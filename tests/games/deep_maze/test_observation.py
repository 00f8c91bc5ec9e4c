"""Each representation shows the board as the README says."""

import hashlib

import numpy as np
import pytest

from marl_cair.games.deep_maze.observation import PLANE_NAMES, VECTOR_NAMES
from tests.games.cases import Luck, choose_actions
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


def numbers(table, player=0):
    return dict(zip(VECTOR_NAMES, table.see("vector", player).tolist(), strict=True))


def highest(table):
    shown = table.engine.spec.representations["vector"]
    return dict(zip(VECTOR_NAMES, shown.high, strict=True))


def test_planes_show_the_board():
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


def test_uniform_planes_hold_role_and_time():
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


def test_rivals_and_mates_have_planes_of_their_own():
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


WAYS = [f"free cells {way}" for way in ("down", "up", "left", "right")]


def test_the_vector_holds_places_and_free_cells():
    seen = numbers(Table(board=ROOM, max_ticks=50))
    assert [seen[f"own {axis}"] for axis in ("row", "column")] == [2, 2]
    assert [seen[f"goal {name}"] for name in ("known", "row", "column")] == [1, 4, 4]
    assert [seen[way] for way in WAYS] == [0, 2, 2, 2]
    assert seen["moves left"] == 50
    seen = numbers(Table("15x15-chase-3p", board=CHASE), player=1)
    assert seen["self hunts"] == 0
    kinds = ("in sight", "row", "column", "is a rival")
    assert [seen[f"other 1: {name}"] for name in kinds] == [1, 3, 3, 0]
    assert [seen[f"other 2: {name}"] for name in kinds] == [1, 1, 1, 1]


def test_each_number_of_the_vector_has_its_own_bounds():
    table = Table("25x25-race-2p", rows=9, columns=30, max_ticks=70)
    assert table.engine.spec.representations["vector"].low == (0.0,) * len(VECTOR_NAMES)
    high = highest(table)
    assert (high["own row"], high["own column"], high["goal known"]) == (8, 29, 1)
    assert (high["goal row"], high["goal column"]) == (8, 29)
    assert [high[way] for way in WAYS] == [8, 8, 29, 29]
    assert (high["self hunts"], high["moves left"]) == (1, 70)
    assert (high["mazes left"], high["preview moves left"]) == (1, 1)  # always 0 here
    for other in (1, 2, 3):
        bounds = [high[f"other {other}: {name}"] for name in ("in sight", "row", "column")]
        assert bounds == [1, 8, 29]
    assert highest(Table("9x9-sequence"))["mazes left"] == 2
    assert highest(Table("9x9-timed_square"))["preview moves left"] == 5


def test_a_straight_way_has_as_many_free_cells_as_its_bound():
    row = "0........G"
    table = Table(board="\n".join([row, *["." * 10] * 4]))
    seen, high = numbers(table), highest(table)
    assert (seen[WAYS[0]], seen[WAYS[3]]) == (high[WAYS[0]], high[WAYS[3]])


# --- the hunter --------------------------------------------------------------------------------

FACE_TO_FACE = """
#######
#0...1#
#.....#
#....G#
#######
"""
SEEN = ("planes", "classic", "flat", "image", "gray", "vector")


@pytest.mark.parametrize("name", SEEN)
@pytest.mark.parametrize("pixels", [0, 3])
@pytest.mark.parametrize("scenario", ["15x15-chase-2p", "15x15-chase-2p-line_of_sight"])
def test_hunter_and_hunted_see_different_things_in_one_place(scenario, pixels, name):
    """Each stands where the other stood, in sight of each other or (of two cells) not."""
    options = {"cell_pixels": pixels} | ({"vision": 2} if "sight" in scenario else {})
    exchanged = FACE_TO_FACE.translate(str.maketrans("01", "10"))
    hunter, hunted = (
        Table(scenario, board=board, **options) for board in (FACE_TO_FACE, exchanged)
    )
    for table in (hunter, hunted):
        table.move("noop", "noop")  # looks around
    assert hunter.place(0) == hunted.place(1)
    assert not np.array_equal(hunter.see(name, 0), hunted.see(name, 1))


def test_the_hunter_has_an_id_of_its_own():
    table = Table("15x15-chase-3p", board=CHASE)
    ids = [table.see("classic", seat)[0][[1, 1, 3], [1, 3, 3]].tolist() for seat in range(3)]
    assert ids == [[7, 5, 5], [7, 2, 6], [7, 6, 2]]
    for name in ("classic", "flat"):
        assert table.engine.spec.representations[name].high == 7
        assert Table("15x15-race-3p").engine.spec.representations[name].high == 6


@pytest.mark.parametrize(
    ("scenario", "digest"),
    [
        ("9x9-stochastic", "fe2cc639461caa8d"),
        ("9x9-sequence", "20cf9a60075cff0a"),
        ("9x9-timed_square", "f3789dc26f32fd93"),
        ("15x15-race-2p", "14acb8489ef893ae"),
        ("15x15-race-4p-square", "b5241aa0d646fb5e"),
    ],
)
def test_without_a_hunter_observations_are_those_of_version_1(scenario, digest):
    """The digests are from before hunters had an id of their own."""
    table, found = Table(scenario, seed=11, cell_pixels=2), hashlib.sha256()
    for numbers in Luck.draw(12, 1, table.engine.num_players).numbers:
        for name in ("planes", "classic", "flat", "vector", "gray", "image"):
            found.update(table.engine.observe(name).tobytes())
        table.engine.step(choose_actions(table.engine, numbers))
    assert found.hexdigest()[:16] == digest


def test_a_player_on_another_shows_itself():
    table = Table("15x15-race-2p", board="#####\n#01.#\n#..G#\n#...#\n#####")
    table.move("right", "noop")
    for player in range(2):
        assert table.see("classic", player)[0, 1, 2] == 2
        assert plane(table, "rivals", player)[1, 2] == 255


def test_the_spec_names_what_never_changes():
    def static(scenario):
        return Table(scenario).engine.spec.static_planes

    names = ["wall", "open", "goal", "in sight", "explored"]
    assert [PLANE_NAMES[plane] for plane in static("9x9-stochastic")] == names
    assert static("9x9-square") == static("9x9-sequence") == ()
