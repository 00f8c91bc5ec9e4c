"""Moves, walls, the goal and what they pay, on boards that are laid by hand."""

import numpy as np
import pytest

from marl_cair.games.game import NO_WINNER
from tests.games.deep_maze.table import Table

pytestmark = pytest.mark.plain_python

ROOM = """
.....
.....
..0..
.....
....G
"""
LANE = """
#####
#0.G#
#####
#####
#####
"""
FORK = """
1.#.#
#.#.#
#0.G#
#.#.#
#.#..
"""


@pytest.mark.parametrize(
    ("move", "place"),
    [("down", (3, 2)), ("up", (1, 2)), ("left", (2, 1)), ("right", (2, 3)), ("noop", (2, 2))],
)
def test_a_move_leads_one_cell_its_way(move, place):
    table = Table(board=ROOM)
    assert table.move(move) == pytest.approx([-0.01])
    assert table.place() == place
    assert table.engine.illegal_actions.tolist() == [[0]]


def test_a_move_into_a_wall_or_off_the_board_is_counted_and_does_nothing():
    table = Table(board=LANE)
    for move in ("up", "down", "left"):
        assert table.move(move) == pytest.approx([-0.01])
    assert table.place() == (1, 1)
    assert table.engine.illegal_actions.tolist() == [[3]]
    corner = Table(board=ROOM)
    corner.walk("up up left left up left")
    assert corner.place() == (0, 0)
    assert corner.engine.illegal_actions.tolist() == [[2]]


def test_the_mask_holds_the_moves_that_lead_somewhere_and_the_noop():
    table = Table(board=LANE)
    assert table.mask() == ["right", "noop"]
    table.move("right")
    assert table.mask() == ["left", "right", "noop"]
    table.move("right")
    assert table.mask() == ["noop"]  # the game is over


def test_without_masked_walls_every_move_is_legal_and_none_is_counted():
    table = Table(board=LANE, mask_walls=False)
    assert table.mask() == ["down", "up", "left", "right", "noop"]
    table.move("up")
    assert table.place() == (1, 1)
    assert table.engine.illegal_actions.tolist() == [[0]]


def test_legal_moves_move_and_illegal_ones_do_not():
    """Fuzz: on any maze the mask is exact."""
    rng = np.random.default_rng(0)
    for seed in range(5):
        table = Table("9x9-loops", seed=seed)
        for _ in range(40):
            legal = table.engine.action_mask()[0, 0]
            action = int(rng.integers(4))
            before, counted = table.place(), int(table.engine.illegal_actions[0, 0])
            table.engine.step(np.array([[action]]))
            assert (table.place() != before) == legal[action]
            assert table.engine.illegal_actions[0, 0] - counted == (not legal[action])
            if table.engine.terminated[0]:
                break


def test_the_goal_ends_the_game_and_is_won_also_in_the_last_tick():
    table = Table(board=LANE, max_ticks=2)
    assert table.move("right") == pytest.approx([-0.01])
    assert not table.engine.terminated[0]
    assert table.move("right") == [1.0]
    assert table.ending() == (True, False, 0)
    assert table.move("left") == [0.0]
    assert table.place() == (1, 3)


def test_the_time_limit_truncates():
    table = Table(board=ROOM, max_ticks=3)
    assert table.walk("noop noop noop") == pytest.approx([-0.01] * 3)
    assert table.ending() == (False, True, NO_WINNER)


def test_infos_hold_the_optimal_count_and_the_moves_made():
    table = Table(board=ROOM)
    table.walk("left noop right")
    info = {name: int(counts[0, 0]) for name, counts in table.engine.info().items()}
    assert info == {"optimal_steps": 4, "step_count": 3, "extra_steps": 0}
    table.walk("noop noop")
    assert table.engine.info()["extra_steps"].tolist() == [[1]]


def test_classic_charges_each_move_and_beyond_optimal_those_too_many():
    """Four moves are optimal; moves into walls and rests are moves."""
    assert Table(board=ROOM).walk("down right noop down right") == pytest.approx([-0.01] * 4 + [1])
    table = Table(board=ROOM, reward="beyond_optimal")
    assert table.walk("left noop right down") == [0.0] * 4
    assert table.walk("down right right") == [-1.0] * 3
    assert table.engine.terminated[0]


def test_distance_pays_for_each_step_nearer_and_adds_up_to_a_constant():
    """Without discount the potential adds up to the way from the start, however one walks."""
    table = Table(board=ROOM, reward="distance", shaping_discount=1.0)
    nearer, further = table.walk("down up")
    assert nearer == pytest.approx(-0.01 + 0.1)
    assert further == pytest.approx(-0.01 - 0.1)
    rest = table.walk("down down right right")
    assert rest[-1] == pytest.approx(1.0 + 0.1)
    assert nearer + further + sum(rest) == pytest.approx(1.0 - 5 * 0.01 + 4 / 10)


def test_distance_follows_the_discount():
    table = Table(board=ROOM, reward="distance", shaping_discount=0.9)
    assert table.move("down") == pytest.approx([-0.01 - 0.9 * 0.3 + 0.4])
    assert table.move("noop") == pytest.approx([-0.01 - 0.9 * 0.3 + 0.3])


def test_distance_continues_through_a_sequence():
    """The discounted sum of the potential is minus that of the start, whatever mazes come."""
    gamma, totals = 0.97, {}
    for reward in ("classic", "distance"):
        table = Table("9x9-sequence", reward=reward, shaping_discount=gamma, max_ticks=60)
        rng, total, weight = np.random.default_rng(1), 0.0, 1.0
        start = float(table.world.potential[0])
        while not any(table.ending()[:2]):
            distance, cell = table.world.distance, int(table.world.cell[0])
            beside = table.engine._rules.neighbours[cell]
            nearer = [m for m, to in enumerate(beside) if 0 <= distance[to] < distance[cell]]
            table.engine.step(np.array([[nearer[0] if rng.random() < 0.9 else 4]]))
            total += weight * float(table.engine.rewards[0, 0])
            weight *= gamma
        totals[reward] = total
    end = float(table.world.potential[0])
    gained = totals["distance"] - totals["classic"]
    assert gained == pytest.approx(weight * end - start, abs=1e-5)


def test_the_first_at_the_goal_wins_the_race():
    table = Table("15x15-race-2p", board=FORK)
    assert table.move("right", "right") == pytest.approx([-0.01, -0.01])
    assert table.move("right", "down") == [1.0, -1.0]
    assert table.ending() == (True, False, 0)


def test_two_at_the_goal_at_once_draw():
    table = Table("15x15-race-3p", board="#####\n#0G1#\n#.2.#\n#...#\n#####")
    assert table.move("right", "left", "left") == [0.0, 0.0, 0.0]
    assert table.ending() == (True, False, NO_WINNER)


def test_racers_pass_through_each_other():
    table = Table("15x15-race-2p", board="#####\n#01.#\n#..G#\n#...#\n#####")
    table.move("right", "left")
    assert (table.place(0), table.place(1)) == ((1, 2), (1, 1))
    table.move("noop", "right")
    assert table.place(0) == table.place(1)


def test_racers_start_equally_far_from_the_goal_on_cells_of_their_own():
    for players in (2, 3, 4):
        for seed in range(10):
            table = Table(f"15x15-race-{players}p", seed=seed)
            assert len(set(table.world.optimal.tolist())) == 1
            assert len(set(table.world.cell.tolist())) == players
            assert table.world.optimal[0] >= 30 // 4


def test_racers_share_a_start_where_no_distance_has_room_for_all():
    """A perfect maze of 5x5 that is one way has one cell at each distance from its end."""
    shared = 0
    for seed in range(40):
        table = Table("15x15-race-4p", seed=seed, rows=5, columns=5)
        assert len(set(table.world.optimal.tolist())) == 1
        shared += len(set(table.world.cell.tolist())) == 1
    assert shared > 0
    assert Table("15x15-race-3p", places="corners").world.cell.tolist() == [0, 0, 0]


def test_the_seats_of_a_race_are_alike():
    """With the places of two seats exchanged and their moves too, all else is exchanged."""
    rng = np.random.default_rng(0)
    for seed in range(5):
        one, other = Table("15x15-race-2p", seed=seed), Table("15x15-race-2p", seed=seed)
        for field in ("cell", "came_from", "optimal", "potential"):
            values = getattr(other.world, field)
            values[:] = values[::-1].copy()
        for actions in rng.integers(5, size=(60, 2)):
            one.engine.step(actions[None])
            other.engine.step(actions[None, ::-1])
            np.testing.assert_array_equal(one.engine.rewards[0], other.engine.rewards[0, ::-1])
            for name in ("planes", "vector"):
                np.testing.assert_array_equal(one.see(name, 0), other.see(name, 1))
            assert one.mask(0) == other.mask(1)
