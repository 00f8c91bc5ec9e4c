"""Chases: the hunter catches players that it meets; the goal and the time limit save them."""

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.compiled import is_compiling
from marl_cair.games.deep_maze.mazes import measure_distances
from marl_cair.games.deep_maze.places import place_players
from marl_cair.games.deep_maze.state import GOAL
from marl_cair.games.game import NO_WINNER
from tests.games.deep_maze.table import Table, plain

pytestmark = pytest.mark.plain_python

LANE = """
#######
#0.1.G#
#######
#######
#######
"""
SNAKE = """
0.123..
######.
.......
.######
G######
"""
HALL = """
#######
#0.1..#
#.....#
#..2..#
#....G#
#######
"""


def test_the_hunter_catches_a_player_on_its_cell():
    table = Table("15x15-chase-2p", board=LANE)
    table.move("right", "noop")
    assert table.move("right", "noop") == [1.0, -1.0]
    assert table.ending() == (True, False, 0)


def test_the_hunter_catches_a_player_that_changes_places_with_it_and_none_that_steps_away():
    table = Table("15x15-chase-2p", board=LANE.replace("0.1", ".01"))
    assert table.move("right", "left") == [1.0, -1.0]
    assert table.engine.winner[0] == 0
    table = Table("15x15-chase-2p", board=LANE.replace("0.1", ".01"))
    assert table.move("right", "right") == pytest.approx([-0.01, 0.0])
    assert not table.engine.terminated[0]


def test_one_at_the_goal_saves_all():
    table = Table("15x15-chase-2p", board=LANE)
    table.move("right", "right")
    assert table.move("right", "right") == [-1.0, 1.0]
    assert table.ending() == (True, False, 1)


def test_caught_on_the_goal_is_a_draw():
    table = Table("15x15-chase-2p", board=LANE.replace("0.1.G", "..1G0"))
    assert table.move("left", "right") == [0.0, 0.0]
    assert table.ending() == (True, False, NO_WINNER)


def test_the_hunter_must_catch_all_and_a_caught_player_cannot_act():
    table = Table("15x15-chase-3p", board=HALL)
    table.move("right", "noop", "noop")
    assert table.move("right", "noop", "noop") == pytest.approx([-0.01, 0.0, 0.0])
    assert table.world.is_caught.tolist() == [0, 1, 0]
    assert not table.engine.eliminated.any()
    assert table.mask(1) == ["noop"]
    table.move("down", "left", "noop")
    assert table.place(1) == (1, 3)
    assert table.engine.illegal_actions.tolist() == [[0, 1, 0]]
    assert table.move("down", "noop", "noop") == [1.0, -1.0, -1.0]
    assert table.engine.winner[0] == 0


def test_a_caught_player_wins_with_the_others():
    table = Table("15x15-chase-3p", board=HALL)
    table.move("right", "noop", "right")
    table.move("right", "noop", "right")
    assert table.move("noop", "noop", "down") == [-1.0, 1.0, 1.0]
    assert table.engine.winner[0] == 1


def test_time_saves_free_players():
    table = Table("15x15-chase-2p", board=LANE, max_ticks=2)
    table.move("noop", "noop")
    assert table.move("noop", "noop") == [-1.0, 1.0]
    assert table.ending() == (True, False, 1)


def test_the_hunter_starts_as_far_from_the_goal_as_the_others():
    for players in (2, 3, 4):
        for seed in range(10):
            table = Table(f"15x15-chase-{players}p", seed=seed)
            assert len(set(table.world.optimal.tolist())) == 1
            assert len(set(table.world.cell.tolist())) == players


@pytest.mark.parametrize("size", [5, 7])
def test_where_no_distance_has_room_for_all_the_hunted_share_a_cell_as_far_as_the_hunters(size):
    num_shared = 0
    for seed in range(60):
        options = {"generator": "prim", "density": 1.0, "complexity": 1.0}
        table = Table("15x15-chase-4p", seed=seed, rows=size, columns=size, **options)
        hunter, *hunted = table.world.cell.tolist()
        assert hunter not in hunted
        assert table.world.optimal.min() > 1
        num_at = np.bincount(table.world.distance[table.world.distance > 1])
        if num_at.max() > 1:
            assert len(set(table.world.optimal.tolist())) == 1
        num_shared += num_at.max() in (2, 3)
    assert num_shared > 10


@pytest.mark.skipif(not is_compiling(), reason="plain Python takes a minute for so many mazes")
def test_the_named_chases_keep_the_starts_of_version_1():
    """Of these mazes one has no four cells that are equally far from the goal."""
    engine = make_engine("deep_maze", "15x15-chase-4p", num_worlds=1_000)
    engine.reset(np.arange(8_000, 9_000, dtype=np.uint64))
    optimal = engine._worlds.optimal
    assert np.flatnonzero(optimal.min(axis=1) < optimal.max(axis=1)).tolist() == [183]
    assert optimal[183].tolist() == [42, 1, 1, 1]


@pytest.mark.slow
def test_in_a_single_way_the_hunted_start_between_the_goal_and_the_hunter():
    """Such a maze is seldom drawn: the start is drawn again in one that is laid."""
    table = Table("15x15-chase-4p", board=SNAKE, generator="prim", density=1.0, complexity=1.0)
    world, rules = table.world, table.engine._rules
    num_open = plain(measure_distances)(world, rules, int(world.clock[GOAL]))
    with np.errstate(over="ignore"):
        plain(place_players)(world, rules, num_open)
    assert world.distance[world.cell].tolist() == [16, 8, 8, 8]


def test_those_who_are_hunted_are_a_team():
    spec = Table("15x15-chase-4p").engine.spec
    assert spec.teams == (0, 1, 1, 1)
    assert spec.num_teams == 2
    assert Table("15x15-race-4p").engine.spec.num_teams == 4


def test_a_caught_one_is_gone_from_the_board():
    table = Table("15x15-chase-3p", board=HALL)
    table.move("right", "noop", "noop")
    assert (table.see("classic", 0) == 5).sum() == 2
    assert (table.see("classic", 2) == 6).sum() == 1
    table.move("right", "noop", "noop")
    table.move("down", "noop", "noop")
    assert (table.see("classic", 0) == 5).sum() == 1
    assert (table.see("classic", 2) == 6).sum() == 0
