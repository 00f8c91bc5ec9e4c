"""Chases: who meets the hunter is caught, who is at the goal is safe, time saves the rest."""

import pytest

from marl_cair.games.game import NO_WINNER
from tests.games.deep_maze.table import Table

pytestmark = pytest.mark.plain_python

LANE = """
#######
#0.1.G#
#######
#######
#######
"""
HALL = """
#######
#0.1..#
#.....#
#..2..#
#....G#
#######
"""


def test_the_hunter_catches_whom_it_meets():
    table = Table("15x15-chase-2p", board=LANE)
    table.move("right", "noop")
    assert table.move("right", "noop") == [1.0, -1.0]
    assert table.engine.terminated[0]
    assert table.engine.winner[0] == 0


def test_the_hunter_catches_who_changes_places_with_it():
    table = Table("15x15-chase-2p", board=LANE.replace("0.1", ".01"))
    assert table.move("right", "left") == [1.0, -1.0]
    assert table.engine.winner[0] == 0


def test_who_steps_away_in_time_is_not_caught():
    table = Table("15x15-chase-2p", board=LANE.replace("0.1", ".01"))
    assert table.move("right", "right") == pytest.approx([-0.01, 0.0])
    assert not table.engine.terminated[0]


def test_one_at_the_goal_saves_all():
    table = Table("15x15-chase-2p", board=LANE)
    table.move("right", "right")
    assert table.move("right", "right") == [-1.0, 1.0]
    assert table.engine.terminated[0]
    assert table.engine.winner[0] == 1


def test_caught_on_the_goal_is_a_draw():
    table = Table("15x15-chase-2p", board=LANE.replace("0.1.G", "..1G0"))
    assert table.move("left", "right") == [0.0, 0.0]
    assert table.engine.terminated[0]
    assert table.engine.winner[0] == NO_WINNER


def test_the_hunter_must_catch_all_and_who_is_caught_only_looks_on():
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


def test_who_is_caught_wins_with_the_others():
    table = Table("15x15-chase-3p", board=HALL)
    table.move("right", "noop", "right")
    table.move("right", "noop", "right")
    assert table.move("noop", "noop", "down") == [-1.0, 1.0, 1.0]
    assert table.engine.winner[0] == 1


def test_time_saves_who_is_free():
    table = Table("15x15-chase-2p", board=LANE, max_ticks=2)
    table.move("noop", "noop")
    assert table.move("noop", "noop") == [-1.0, 1.0]
    assert table.engine.terminated[0]
    assert not table.engine.truncated[0]
    assert table.engine.winner[0] == 1


def test_the_hunter_starts_as_far_from_the_goal_as_the_others():
    for players in (2, 3, 4):
        for seed in range(10):
            table = Table(f"15x15-chase-{players}p", seed=seed)
            assert len(set(table.world.optimal.tolist())) == 1
            assert len(set(table.world.cell.tolist())) == players


def test_the_hunter_never_starts_among_the_others():
    """Where no distance has room for all, the others stand beside the goal."""
    for seed in range(40):
        options = {"generator": "prim", "density": 1.0, "complexity": 1.0, "rows": 5, "columns": 5}
        table = Table("15x15-chase-4p", seed=seed, **options)
        assert table.world.cell[0] not in table.world.cell[1:]


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
