"""The values that a state of Deep Maze may hold."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.checks import state as checks
from marl_cair.games.checks.state import Range, StateLimits
from marl_cair.games.deep_maze import state as s
from marl_cair.games.deep_maze.rulebook import HUNTER, Rules, make_rules
from marl_cair.games.deep_maze.scenarios import Scenario
from marl_cair.games.deep_maze.tables import NUM_MOVES
from marl_cair.games.game import NO_WINNER

_CLOCK_NAMES = ("TICK", "PHASE", "WINNER", "GOAL", "MAZE", "MAZE_START", "EARLIER_OPTIMAL")


def state_limits(scenario: Scenario) -> StateLimits:
    """What the worlds of `scenario` may hold."""
    rules = make_rules(scenario)
    cells, players, mazes = scenario.num_cells, scenario.num_players, scenario.num_mazes
    last_cell, last_tick = cells - 1, scenario.max_ticks
    last_clock = (
        last_tick,
        s.TRUNCATED,
        players - 1,
        last_cell,
        mazes - 1,
        last_tick,
        mazes * cells,
    )
    # Of the reward `distance`: the way in this maze, and the mazes to come.
    lowest = -(last_cell / (scenario.rows + scenario.columns) + mazes - 1)

    ranges = {
        "clock": Range((0, s.RUNNING, NO_WINNER, 0, 0, 0, 0), last_clock, _CLOCK_NAMES),
        "random": Range(*checks.ANY_WORD),
        "walls": Range(s.OPEN, s.WALL),
        "distance": Range(s.NO_WAY, last_cell),
        "order": Range(0, last_cell),
        "cell": Range(0, last_cell),
        "came_from": Range(0, last_cell),
        "optimal": Range(0, last_cell),
        "potential": Range(lowest if scenario.reward == "distance" else 0.0, 0.0),
        "is_caught": Range(0, [int(scenario.is_chase and n != HUNTER) for n in range(players)]),
        "illegal": Range(0, checks.MOST_COUNTED),
        "sight": Range(0, 0 if scenario.visibility == "full" else s.IN_SIGHT | s.KNOWN),
    }
    return StateLimits(ranges, partial(_list_conditions, rules=rules))


def _list_conditions(worlds: s.World, rules: Rules) -> Iterator[checks.Condition]:
    yield checks.has_time(
        worlds.clock[:, s.TICK], worlds.clock[:, s.PHASE] == s.RUNNING, rules.max_ticks
    )
    at_seats = np.take_along_axis(worlds.walls, worlds.cell.astype(np.intp), axis=1)
    yield "all seats stand on open cells", (at_seats == s.OPEN).all(axis=1)
    yield (
        "distance counts the moves from each open cell to the goal",
        _are_distances(worlds.walls, worlds.distance, worlds.clock[:, s.GOAL], rules),
    )


def _are_distances(
    walls: NDArray[np.uint8], distance: NDArray[np.int16], goal: NDArray[np.int32], rules: Rules
) -> NDArray[np.bool_]:
    """Whether distance [N, cells] is that of the shortest ways to goal [N]; bool [N].

    0 at the goal, and one more than at the nearest neighbour on all other open cells, is only true
    of them: from each cell, ways of that many moves lead down to the only 0.
    """
    far = np.where(distance == s.NO_WAY, np.iinfo(np.int16).max - 1, distance)
    nearest = far[:, rules.neighbours[:, :NUM_MOVES]].min(axis=2)
    is_goal = np.arange(walls.shape[1]) == goal[:, None]
    expected = np.where(is_goal, 0, nearest + 1)
    is_way = (walls == s.OPEN) & (distance == expected)
    is_wall = (walls == s.WALL) & (distance == s.NO_WAY)
    holds: NDArray[np.bool_] = (is_way | is_wall).all(axis=1)
    return holds
