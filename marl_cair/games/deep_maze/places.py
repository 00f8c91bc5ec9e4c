"""Where a game starts and where its goal is, drawn from the world's word PLACE_WORD."""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_maze import rulebook as rb
from marl_cair.games.deep_maze import state as s
from marl_cair.games.deep_maze.mazes import grow_walls, grow_ways, measure_distances
from marl_cair.games.randomness import draw_below, mix


@compiled
def draw_open_cell(world: Any) -> int:
    """Any open cell, each as likely."""
    num_open = 0
    for cell in range(world.walls.shape[0]):
        num_open += int(world.walls[cell] == s.OPEN)
    nth = draw_below(world.random, s.PLACE_WORD, num_open)
    for cell in range(world.walls.shape[0]):
        if world.walls[cell] == s.OPEN:
            if nth == 0:
                return cell
            nth -= 1
    return 0


@compiled
def nearest_open_cell(world: Any, rules: Any, row: int, column: int) -> int:
    """The open cell with the fewest rows and columns to a corner; the first of several."""
    best, least = 0, rules.rows + rules.columns
    for cell in range(world.walls.shape[0]):
        apart = abs(cell // rules.columns - row) + abs(cell % rules.columns - column)
        if world.walls[cell] == s.OPEN and apart < least:
            best, least = cell, apart
    return best


@compiled
def end_of_ring(world: Any, num_open: int, first: int) -> int:
    """The place in `order` behind the cells that are as far from the goal as the one at `first`."""
    last = first
    while last < num_open and (
        world.distance[world.order[last]] == world.distance[world.order[first]]
    ):
        last += 1
    return last


@compiled
def find_ring(world: Any, num_open: int, place: int, least: int, num_cells: int) -> int:
    """The first place in `order` of a ring (cells equally far from the goal) of so many cells.

    It is at least `least` moves from the goal: the ring of the cell at `place`, or else the next
    one outwards, and from the outermost on to the innermost. 0, where the goal is, if none fits.
    """
    first = place
    while world.distance[world.order[first - 1]] == world.distance[world.order[place]]:
        first -= 1
    for _ in range(num_open):
        last = end_of_ring(world, num_open, first)
        if last - first >= num_cells and world.distance[world.order[first]] >= least:
            return first
        first = last if last < num_open else 1
    return 0


@compiled
def deal_ring(world: Any, rules: Any, first: int, last: int) -> None:
    """Draw a cell of its own for each seat from the places first..last - 1 of `order`.

    Where they are fewer, the last seats share one.
    """
    for player in range(rules.num_players):
        place = min(first + player, last - 1)
        other = place + draw_below(world.random, s.PLACE_WORD, last - place)
        chosen = world.order[other]
        world.order[other] = world.order[place]
        world.order[place] = chosen
        world.cell[player] = chosen


@compiled
def place_players(world: Any, rules: Any, num_open: int) -> None:
    """Draw starts that are equally far from the goal, a cell for each seat.

    Several seats start at least a quarter of the board's rows and columns from the goal, if there
    are such cells. Where no distance has enough cells for all, the seats of a race share one, and
    the hunted seats of a chase share a cell as far from the goal as the hunter's and not beside it.
    Where there is none, they start half way and the hunter on the furthest cell. Unless
    `starts_apart`, they start beside the goal and the hunter on the furthest cell.
    """
    place = 1 + draw_below(world.random, s.PLACE_WORD, num_open - 1)
    if rules.num_players > 1:
        least = (rules.rows + rules.columns) // 4
        nearest = 1 + rules.starts_apart
        first = find_ring(world, num_open, place, least, rules.num_players)
        if first == 0:
            first = find_ring(world, num_open, place, nearest, rules.num_players)
        if first == 0 and rules.starts_apart:
            first = find_ring(world, num_open, place, least, 2)
        if first == 0 and rules.starts_apart:
            first = find_ring(world, num_open, place, nearest, 2)
        if first > 0:
            deal_ring(world, rules, first, end_of_ring(world, num_open, first))
            return
    if rules.contest == rb.CHASE:
        place = max(1, num_open // 2) if rules.starts_apart else 1
    for player in range(rules.num_players):
        world.cell[player] = world.order[place]
    if rules.contest == rb.CHASE:
        world.cell[rb.HUNTER] = world.order[num_open - 1]


@compiled
def potential(world: Any, rules: Any, player: int) -> float:
    """Of the reward `distance`: mazes still to come, and the way in this one as a share of the
    board's rows and columns; negative.
    """
    if rules.reward != rb.DISTANCE:
        return 0.0
    moves = float(world.distance[world.cell[player]])
    return float(
        -moves / (rules.rows + rules.columns) - (rules.num_mazes - 1 - int(world.clock[s.MAZE]))
    )


@compiled
def enter_maze(world: Any, rules: Any) -> None:
    """Make the maze of number `clock[MAZE]`, choose its goal and put all seats to their starts."""
    maze = int(world.clock[s.MAZE])
    if rules.mode != rb.STOCHASTIC:
        world.random[s.MAZE_WORD] = mix(rules.fixed_seed[0] + np.uint64(maze + 1))
    kept = world.random[s.PLACE_WORD]
    if rules.mode == rb.FULL_DETERMINISTIC:
        world.random[s.PLACE_WORD] = mix(world.random[s.MAZE_WORD])
    if rules.generator == rb.PRIM:
        grow_ways(world, rules)
    else:
        grow_walls(world, rules)
    if rules.in_corners:
        goal = nearest_open_cell(world, rules, rules.rows - 1, rules.columns - 1)
    else:
        goal = draw_open_cell(world)
    num_open = measure_distances(world, rules, goal)
    if rules.in_corners:
        for player in range(rules.num_players):
            world.cell[player] = nearest_open_cell(world, rules, 0, 0)
    else:
        place_players(world, rules, num_open)
    if rules.mode == rb.FULL_DETERMINISTIC:
        world.random[s.PLACE_WORD] = kept
    world.clock[s.GOAL] = goal
    if maze > 0:
        world.clock[s.EARLIER_OPTIMAL] += world.optimal[0]
    world.clock[s.MAZE_START] = world.clock[s.TICK]
    for player in range(rules.num_players):
        world.came_from[player] = world.cell[player]
        world.optimal[player] = world.distance[world.cell[player]]
        world.potential[player] = potential(world, rules, player)
