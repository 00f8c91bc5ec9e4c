"""State of Deep Maze: struct of arrays, first axis B worlds; a cell is row * columns + column."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import make_world_at
from marl_cair.games.deep_maze.scenarios import Scenario

RUNNING, TERMINATED, TRUNCATED = range(3)  # of PHASE
OPEN, WALL = range(2)  # of walls
NO_WAY = -1  # the distance of a wall
IN_SIGHT, KNOWN = 1, 2  # bits of sight
MAZE_WORD, PLACE_WORD = range(2)  # of random: what draws mazes, and what draws starts and goals

# Columns of `clock`. MAZE counts the mazes of a sequence; MAZE_START is the tick at which the maze
# of now was entered, EARLIER_OPTIMAL the optimal moves of the mazes before it.
TICK, PHASE, WINNER, GOAL, MAZE, MAZE_START, EARLIER_OPTIMAL = range(7)
NUM_CLOCK = 7


class World(NamedTuple):
    """B worlds (arrays [B, ...]), or one world (the same fields without B).

    P players, N cells of the board, V cells of which sight is kept (N under fog, else 1).
    """

    clock: NDArray[np.int32]  # [B, 7] see above; ticks are moves
    random: NDArray[np.uint64]  # [B, 2] generator words
    walls: NDArray[np.uint8]  # [B, N] OPEN or WALL
    distance: NDArray[np.int16]  # [B, N] moves to the goal, NO_WAY for walls
    order: NDArray[np.int16]  # [B, N] open cells from the goal outwards, then zeros
    cell: NDArray[np.int16]  # [B, P] where each seat stands
    came_from: NDArray[np.int16]  # [B, P] the cell before that; the same before the first move
    optimal: NDArray[np.int32]  # [B, P] moves from the seat's start in this maze to the goal
    potential: NDArray[np.float64]  # [B, P] of the reward `distance`, else 0
    is_caught: NDArray[np.uint8]  # [B, P] 1: the hunter has caught the seat
    illegal: NDArray[np.int32]  # [B, P] illegal actions since reset
    sight: NDArray[np.uint8]  # [B, P, V] bits IN_SIGHT and KNOWN; only under fog


def allocate(scenario: Scenario, num_worlds: int) -> World:
    """Zeroed arrays for `num_worlds` worlds; play starts with `rules.reset`."""
    cells, players = scenario.num_cells, scenario.num_players

    def zeros(dtype: type, *shape: int) -> NDArray[Any]:
        return np.zeros((num_worlds, *shape), dtype)

    return World(
        clock=zeros(np.int32, NUM_CLOCK),
        random=zeros(np.uint64, 2),
        walls=zeros(np.uint8, cells),
        distance=zeros(np.int16, cells),
        order=zeros(np.int16, cells),
        cell=zeros(np.int16, players),
        came_from=zeros(np.int16, players),
        optimal=zeros(np.int32, players),
        potential=zeros(np.float64, players),
        is_caught=zeros(np.uint8, players),
        illegal=zeros(np.int32, players),
        sight=zeros(np.uint8, players, scenario.num_views),
    )


world_at = make_world_at(World)
