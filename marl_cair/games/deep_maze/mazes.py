"""The generators of mazes: walls of one world, drawn from its word MAZE_WORD.

Ways and walls lie on a lattice of every second row and column. A board with an even number of rows
(or columns) has one more row (or column) of wall at its end.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_maze.state import MAZE_WORD, NO_WAY, OPEN, WALL
from marl_cair.games.deep_maze.tables import COLUMN_STEP, NUM_MOVES, ROW_STEP
from marl_cair.games.randomness import draw_below

REACHED = 2  # in walls while a maze is made: a lattice cell beside the ways, not yet one of them
OUTSIDE = -1
_STEPS = tuple(zip(ROW_STEP, COLUMN_STEP, strict=True))


@compiled
def state_at(world: Any, rules: Any, row: int, column: int) -> int:
    """OPEN, WALL or REACHED of a cell; OUTSIDE the board where there is none."""
    if 0 <= row < rules.rows and 0 <= column < rules.columns:
        return int(world.walls[row * rules.columns + column])
    return OUTSIDE


@compiled
def count_open(world: Any, rules: Any, row: int, column: int) -> int:
    """Open ones among the nearest lattice cells of a lattice cell."""
    num_open = 0
    for step in _STEPS:
        is_open = state_at(world, rules, row + 2 * step[0], column + 2 * step[1]) == OPEN
        num_open += int(is_open)
    return num_open


@compiled
def open_lattice_cell(world: Any, rules: Any, row: int, column: int, num_reached: int) -> int:
    """Make a lattice cell part of the ways; returns how many cells beside them are in `order`."""
    world.walls[row * rules.columns + column] = OPEN
    for step in _STEPS:
        next_row, next_column = row + 2 * step[0], column + 2 * step[1]
        if state_at(world, rules, next_row, next_column) == WALL:
            cell = next_row * rules.columns + next_column
            world.walls[cell] = REACHED
            world.order[num_reached] = cell
            num_reached += 1
    return num_reached


@compiled
def grow_ways(world: Any, rules: Any) -> None:
    """Randomised Prim (1957), from the first corner: a random lattice cell beside the ways is
    joined to a random one of its neighbours among them, until all are.
    """
    world.walls[:] = WALL
    num_reached = open_lattice_cell(world, rules, 0, 0, 0)
    while num_reached > 0:
        place = draw_below(world.random, MAZE_WORD, num_reached)
        cell = int(world.order[place])
        num_reached -= 1
        world.order[place] = world.order[num_reached]
        row, column = cell // rules.columns, cell % rules.columns
        chosen = draw_below(world.random, MAZE_WORD, count_open(world, rules, row, column))
        for step in _STEPS:
            if state_at(world, rules, row + 2 * step[0], column + 2 * step[1]) == OPEN:
                if chosen == 0:
                    between = (row + step[0]) * rules.columns + column + step[1]
                    world.walls[between] = OPEN
                chosen -= 1
        num_reached = open_lattice_cell(world, rules, row, column, num_reached)


@compiled
def close_border(world: Any, rules: Any, last_row: int, last_column: int) -> None:
    """Walls around an open board, and all that lies beyond an odd number of rows or columns."""
    world.walls[:] = OPEN
    for column in range(rules.columns):
        world.walls[column] = WALL
        for row in range(last_row, rules.rows):
            world.walls[row * rules.columns + column] = WALL
    for row in range(rules.rows):
        world.walls[row * rules.columns] = WALL
        for column in range(last_column, rules.columns):
            world.walls[row * rules.columns + column] = WALL


@compiled
def grow_walls(world: Any, rules: Any) -> None:
    """Walls begin at random lattice points and grow by two cells at each step, at random.

    A wall that grows never touches another, so that every open cell can be reached; walls that
    begin away from all others make loops.
    """
    last_row, last_column = (rules.rows - 1) // 2 * 2, (rules.columns - 1) // 2 * 2
    close_border(world, rules, last_row, last_column)
    for _ in range(rules.growth_seeds):
        row = 2 * draw_below(world.random, MAZE_WORD, last_row // 2 + 1)
        column = 2 * draw_below(world.random, MAZE_WORD, last_column // 2 + 1)
        world.walls[row * rules.columns + column] = WALL
        for _ in range(rules.growth_steps):
            if count_open(world, rules, row, column) == 0:
                break
            step = _STEPS[draw_below(world.random, MAZE_WORD, NUM_MOVES)]
            if state_at(world, rules, row + 2 * step[0], column + 2 * step[1]) == OPEN:
                world.walls[(row + step[0]) * rules.columns + column + step[1]] = WALL
                row, column = row + 2 * step[0], column + 2 * step[1]
                world.walls[row * rules.columns + column] = WALL


@compiled
def measure_distances(world: Any, rules: Any, goal: int) -> int:
    """Moves from every open cell to the goal, breadth first; returns how many cells are open."""
    world.distance[:] = NO_WAY
    world.order[:] = 0
    world.distance[goal] = 0
    world.order[0] = goal
    num_open = 1
    place = 0
    while place < num_open:
        cell = world.order[place]
        place += 1
        further = world.distance[cell] + 1
        for move in range(NUM_MOVES):
            beside = rules.neighbours[cell, move]
            if world.walls[beside] == WALL or world.distance[beside] >= 0:
                continue
            world.distance[beside] = further
            world.order[num_open] = beside
            num_open += 1
    return num_open
