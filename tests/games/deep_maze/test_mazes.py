"""Mazes: every open cell can be reached, a perfect one has no loops, and ways are the shortest."""

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.deep_maze.state import GOAL, MAZE, OPEN
from marl_cair.games.randomness import episode_seeds
from tests.games.deep_maze.table import Table, reached_from

pytestmark = pytest.mark.plain_python
BOARDS = [(5, 5), (6, 8), (7, 7), (9, 12), (15, 15)]
NUM_SEEDS = 4


def mazes(rows, columns, **options):
    for seed in range(NUM_SEEDS):
        yield Table(seed=seed, rows=rows, columns=columns, **options)


def num_loops(walls):
    """Independent loops of the ways: connections - cells + 1."""
    is_open = walls == OPEN
    across = (is_open[:, 1:] & is_open[:, :-1]).sum()
    down = (is_open[1:] & is_open[:-1]).sum()
    return int(across + down - is_open.sum() + 1)


@pytest.mark.parametrize(("rows", "columns"), BOARDS)
def test_a_perfect_maze_has_one_way_between_any_two_cells(rows, columns):
    for table in mazes(rows, columns, generator="prim"):
        is_open = table.walls() == OPEN
        lattice = is_open[::2, ::2][: (rows + 1) // 2, : (columns + 1) // 2]
        assert lattice.all()
        assert is_open.sum() == 2 * lattice.size - 1
        assert (reached_from(is_open, (0, 0))[is_open] >= 0).all()
        assert num_loops(table.walls()) == 0


@pytest.mark.parametrize("density", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("complexity", [0.0, 0.05, 1.0])
@pytest.mark.parametrize(("rows", "columns"), BOARDS)
def test_walls_that_grow_leave_every_open_cell_in_reach(rows, columns, density, complexity):
    options = {"generator": "growth", "density": density, "complexity": complexity}
    for table in mazes(rows, columns, **options):
        walls = table.walls()
        is_open = walls == OPEN
        assert not is_open[[0, -1]].any()
        assert not is_open[:, [0, -1]].any()
        assert (reached_from(is_open, (1, 1))[is_open] >= 0).all()
        if density == 0.0:
            loops_down, loops_across = rows - 3 - (rows % 2 == 0), columns - 3 - (columns % 2 == 0)
            assert num_loops(walls) == loops_down * loops_across


def test_density_and_complexity_make_more_walls_and_these_make_loops():
    def share_of_walls(**options):
        tables = mazes(21, 21, generator="growth", **options)
        return np.mean([table.walls().mean() for table in tables])

    assert share_of_walls(density=0.2) < share_of_walls(density=1.0)
    assert share_of_walls(complexity=0.02) < share_of_walls(complexity=1.0)
    assert all(num_loops(table.walls()) for table in mazes(25, 25, generator="growth"))


@pytest.mark.parametrize("scenario", ["9x9-stochastic", "9x9-loops", "15x15-race-4p"])
def test_the_distances_are_those_of_the_shortest_ways(scenario):
    for seed in range(NUM_SEEDS):
        table = Table(scenario, seed=seed)
        columns = table.engine.scenario.columns
        goal = divmod(int(table.world.clock[GOAL]), columns)
        expected = reached_from(table.walls() == OPEN, goal)
        np.testing.assert_array_equal(table.world.distance, expected.ravel())
        starts = table.world.distance[table.world.cell]
        np.testing.assert_array_equal(table.engine.info()["optimal_steps"][0], starts)
        assert (starts > 0).all()


def test_starts_and_goals_are_open_cells_drawn_evenly():
    """On the 31 open cells of one maze: no pair of cells is a start and a goal more than chance."""
    engine = make_engine("deep_maze", "7x7-deterministic", 930)
    engine.reset(episode_seeds(0, np.arange(930), np.zeros(930, np.int64)))
    worlds = engine._worlds
    open_cells = np.flatnonzero(worlds.walls[0] == OPEN)
    assert len(open_cells) == 31
    for drawn in (worlds.cell[:, 0], worlds.clock[:, GOAL]):
        counts = np.array([(drawn == cell).sum() for cell in open_cells])
        assert counts.sum() == 930
        # Chi-squared of 30 degrees of freedom: above 59.7 once in a thousand draws.
        assert ((counts - 30.0) ** 2 / 30.0).sum() < 59.7
    assert (worlds.cell[:, 0] != worlds.clock[:, GOAL]).all()


@pytest.mark.parametrize(
    ("mode", "is_same"),
    [
        ("deterministic", (True, False, False)),
        ("full_deterministic", (True, True, True)),
        ("stochastic", (False, False, False)),
    ],
)
def test_a_mode_draws_walls_goal_and_start_again_or_not(mode, is_same):
    tables = [Table(f"9x9-{mode}", seed=seed) for seed in range(NUM_SEEDS)]
    drawn = [
        (one.world.walls.tobytes(), int(one.world.clock[GOAL]), int(one.world.cell[0]))
        for one in tables
    ]
    counts = [len(set(values)) for values in zip(*drawn, strict=True)]
    assert tuple(count == 1 for count in counts) == is_same
    assert (counts[0] == NUM_SEEDS) == (mode == "stochastic")


def test_another_maze_seed_is_another_maze():
    one, other = (Table("9x9-full_deterministic", maze_seed=seed) for seed in (1337, 1))
    assert (one.world.walls != other.world.walls).any()


def test_corners_are_the_open_cells_nearest_to_them():
    table = Table("9x9-stochastic", places="corners")
    assert table.place() == (0, 0)
    assert table.world.clock[GOAL] == 80
    walled = Table("9x9-loops", places="corners")
    assert walled.place() == (1, 1)
    assert walled.world.clock[GOAL] == 7 * 9 + 7


def solve(table):
    """Walk the shortest way of the maze in play."""
    world, rules = table.world, table.engine._rules
    maze = int(world.clock[MAZE])
    while world.clock[MAZE] == maze and not table.engine.terminated[0]:
        cell = int(world.cell[0])
        for move, beside in enumerate(rules.neighbours[cell]):
            if 0 <= world.distance[beside] < world.distance[cell]:
                table.engine.step(np.array([[move]]))
                break


def test_a_sequence_plays_its_mazes_one_after_another_and_the_same_in_each_game():
    ways = []
    for seed in range(2):
        table = Table("9x9-sequence", seed=seed)
        walls, optimal = [], 0
        for maze in range(3):
            assert table.world.clock[MAZE] == maze
            walls.append(table.world.walls.tobytes())
            optimal += int(table.world.optimal[0])
            info = table.engine.info()
            assert info["optimal_steps"].tolist() == [[optimal]]
            solve(table)
            assert table.engine.rewards[0, 0] == 1.0
            assert table.engine.terminated[0] == (maze == 2)
        assert len(set(walls)) == 3
        assert table.engine.info()["step_count"].tolist() == [[optimal]]
        ways.append(walls)
    assert ways[0] == ways[1]


@pytest.mark.parametrize(
    ("size", "mean", "least"), [(7, 12.2, 12), (9, 16.4, 16), (15, 29.1, 28), (25, 50.4, 48)]
)
def test_ways_from_corner_to_corner_are_as_long_as_the_originals(size, mean, least):
    """The original's means over 100 mazes of its randomised Prim; its generator, our way lengths.

    Their spread is about 2 moves, so means of 100 and of 300 mazes differ by less than 0.9.
    """
    engine = make_engine("deep_maze", f"{size}x{size}-stochastic", 300, places="corners")
    engine.reset(episode_seeds(0, np.arange(300), np.zeros(300, np.int64)))
    optimal = engine.info()["optimal_steps"][:, 0]
    assert optimal.min() == least
    assert abs(optimal.mean() - mean) < 0.9
