"""State of Deep Maze: struct of arrays, first axis B worlds; a cell is row * columns + column."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.deep_maze.scenarios import Scenario
from marl_cair.games.game_package import allocate_world
from marl_cair.games.loops import make_world_at

RUNNING, TERMINATED, TRUNCATED = range(3)  # of PHASE
OPEN, WALL = range(2)  # of walls
NO_WAY = -1  # the distance of a wall
IN_SIGHT, KNOWN = 1, 2  # bits of sight
MAZE_WORD, PLACE_WORD = range(2)  # of random: what draws mazes, and what draws starts and goals

# Columns of `clock`. MAZE counts the mazes of a sequence; MAZE_START is the tick at which the maze
# in play was entered, EARLIER_OPTIMAL the optimal moves of the mazes before it.
TICK, PHASE, WINNER, GOAL, MAZE, MAZE_START, EARLIER_OPTIMAL = range(7)


class World(NamedTuple):
    """B worlds (arrays [B, ...]), or one world (the same fields without B).

    P players, N cells of the board, V cells of which sight is kept (N under fog, else 1).
    """

    clock: Annotated[NDArray[np.int32], "7"]  # see above; ticks are moves
    random: Annotated[NDArray[np.uint64], "2"]  # generator words
    walls: Annotated[NDArray[np.uint8], "N"]  # OPEN or WALL
    distance: Annotated[NDArray[np.int16], "N"]  # moves to the goal, NO_WAY for walls
    order: Annotated[NDArray[np.int16], "N"]  # open cells from the goal outwards, then zeros
    cell: Annotated[NDArray[np.int16], "P"]  # where each seat stands
    came_from: Annotated[NDArray[np.int16], "P"]  # the cell before; the same before the first move
    optimal: Annotated[
        NDArray[np.int32], "P"
    ]  # moves from the seat's start in this maze to the goal
    potential: Annotated[NDArray[np.float64], "P"]  # of the reward `distance`, else 0
    is_caught: Annotated[NDArray[np.uint8], "P"]  # 1: the hunter has caught the seat
    illegal: Annotated[NDArray[np.int32], "P"]  # illegal actions since reset
    sight: Annotated[NDArray[np.uint8], "P V"]  # bits IN_SIGHT and KNOWN; only under fog


def allocate(scenario: Scenario, num_worlds: int) -> World:
    """Zeroed arrays for `num_worlds` worlds; play starts with `rules.reset`."""
    sizes = {"N": scenario.num_cells, "P": scenario.num_players, "V": scenario.num_views}
    return allocate_world(World, num_worlds, **sizes)


world_at = make_world_at(World)
