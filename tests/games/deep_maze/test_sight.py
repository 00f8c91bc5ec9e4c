"""Fog: what a seat has not seen is in none of its representations; sight follows its steps."""

import numpy as np
import pytest

from marl_cair.games.compiled import is_compiling
from marl_cair.games.deep_maze.observation import ID_UNKNOWN
from marl_cair.games.deep_maze.rendering import PANEL_LEFT
from marl_cair.games.deep_maze.state import GOAL, IN_SIGHT, OPEN, WALL
from tests.games.deep_maze.table import Table

pytestmark = pytest.mark.plain_python

STEPS = (("down", 1, 0), ("up", -1, 0), ("left", 0, -1), ("right", 0, 1))
SQUARE = {"visibility": "square"}
LINES = {"visibility": "line_of_sight"}
SEEN = ("planes", "classic", "flat", "vector", "gray", "image")


def wander(table, num_moves, seed=0):
    """Random moves of the first seat."""
    rng = np.random.default_rng(seed)
    for _ in range(num_moves):
        actions = rng.integers(5, size=(1, table.engine.num_players))
        table.engine.step(actions)
        yield


def known_cells(table, player=0):
    return table.see("classic", player)[0] != ID_UNKNOWN


@pytest.mark.parametrize("vision", [1, 3, 20])
def test_a_square_is_the_same_on_all_sides_and_cut_at_the_edges(vision):
    table = Table("15x15-square", vision=vision, remembers=False)
    rows, columns = np.indices((15, 15))
    for _ in wander(table, 40):
        row, column = table.place()
        expected = (abs(rows - row) <= vision) & (abs(columns - column) <= vision)
        expected[row, column] = True
        np.testing.assert_array_equal(known_cells(table), expected)


def define_lines(table, vision):
    """The definition of a line of sight, written again."""
    walls = table.walls() == WALL
    rows, columns = walls.shape
    seen = np.zeros(walls.shape, bool)
    ways = [table.place()]
    for _, down, right in STEPS:
        row, column = table.place()
        for _ in range(vision):
            row, column = row + down, column + right
            if not (0 <= row < rows and 0 <= column < columns) or walls[row, column]:
                break
            ways.append((row, column))
    for row, column in ways:
        top, left = max(0, row - 1), max(0, column - 1)
        beside = np.zeros(walls.shape, bool)
        beside[top : row + 2, left : column + 2] = True
        seen |= beside & walls
        seen[row, column] = True
    return seen


@pytest.mark.parametrize("scenario", ["9x9-line_of_sight", "15x15-line_of_sight"])
@pytest.mark.parametrize("vision", [1, 3])
def test_lines_of_sight_are_those_of_their_definition_after_any_moves(scenario, vision):
    table = Table(scenario, vision=vision, remembers=False, generator="growth")
    for _ in wander(table, 60):
        np.testing.assert_array_equal(known_cells(table), define_lines(table, vision))


def test_the_cells_beside_a_seat_are_always_known_so_the_mask_shows_nothing_new():
    for options in (SQUARE, LINES):
        table = Table("9x9-loops", vision=1, remembers=False, **options)
        for _ in wander(table, 40):
            row, column = table.place()
            known = known_cells(table)
            for name, down, right in STEPS:
                beside = row + down, column + right
                assert known[beside]
                assert (name in table.mask()) == (table.walls()[beside] == OPEN)


def test_what_was_in_sight_stays_known_but_not_in_sight():
    table = Table("15x15-square")
    seen = np.zeros((15, 15), bool)
    for _ in wander(table, 60):
        sight = table.world.sight[0].reshape(15, 15)
        seen |= sight & IN_SIGHT > 0
        np.testing.assert_array_equal(known_cells(table), seen)
        planes = table.see("planes")
        np.testing.assert_array_equal(planes[7] > 0, sight & IN_SIGHT > 0)
        np.testing.assert_array_equal(planes[8] > 0, seen)


def test_a_preview_shows_all_for_its_moves_noops_included_and_is_not_remembered():
    waiting = Table("15x15-timed_square")
    table, plain = Table("15x15-timed_square"), Table("15x15-square")
    for move in range(8):
        assert known_cells(waiting).all() == (move < 5)
        waiting.move("noop")
        np.testing.assert_array_equal(known_cells(table).all(), move < 5)
        if move >= 5:
            for name in ("classic", "gray"):
                np.testing.assert_array_equal(table.see(name), plain.see(name))
            boards = [one.see("image")[..., :PANEL_LEFT] for one in (table, plain)]
            np.testing.assert_array_equal(*boards)
        action = np.array([[move % 5]])
        table.engine.step(action)
        plain.engine.step(action)


def change_unseen(table, player=0):
    """Other walls, another goal and others elsewhere, where the seat has not looked."""
    world = table.world
    unknown = world.sight[player] == 0
    world.walls[unknown] ^= 1
    if unknown[world.clock[GOAL]]:
        free = np.flatnonzero(unknown)
        world.clock[GOAL] = free[-1] if world.clock[GOAL] != free[-1] else free[0]
    out_of_sight = np.flatnonzero(world.sight[player] & IN_SIGHT == 0)
    for other in range(table.engine.num_players):
        if other != player and world.cell[other] in out_of_sight:
            world.cell[other] = out_of_sight[0]
    return int(unknown.sum())


@pytest.mark.parametrize("scenario", ["9x9-square", "15x15-line_of_sight", "15x15-race-3p-square"])
@pytest.mark.parametrize("remembers", [True, False])
def test_no_representation_and_no_mask_depends_on_what_was_not_seen(scenario, remembers):
    table = Table(scenario, remembers=remembers, vision=2)
    for _ in wander(table, 12 if is_compiling() else 6):
        pass
    assert not table.engine.terminated[0]
    before = {name: table.see(name) for name in SEEN}
    mask, picture = table.mask(), table.engine.render(0, 0)
    assert change_unseen(table) > 0
    for name, seen in before.items():
        np.testing.assert_array_equal(table.see(name), seen, err_msg=name)
    assert table.mask() == mask
    np.testing.assert_array_equal(table.engine.render(0, 0), picture)
    assert (table.engine.render(0) != picture).any()


def test_others_are_seen_only_where_one_looks_now():
    table = Table("15x15-race-2p-square", vision=2)
    world = table.world
    open_cells = np.flatnonzero(world.walls == OPEN)
    here = world.sight[0] & IN_SIGHT > 0
    near = next(cell for cell in open_cells if here[cell] and cell != world.cell[0])
    far = next(cell for cell in open_cells if not here[cell])
    for cell, expected in ((near, True), (far, False)):
        world.cell[1] = cell
        assert (table.see("planes")[5].sum() > 0) == expected
        assert (table.see("classic") == 5).any() == expected
        assert (table.see("vector")[13] == 1.0) == expected
