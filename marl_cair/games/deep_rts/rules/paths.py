"""Paths with the fewest steps over ground, around standing units, never past a solid corner.

A straight walk is tried first: on open ground it is a shortest path and reads only its own cells.
Else the board is searched breadth first from the unit, in the order of its owner's own directions,
so that mirrored units take mirrored paths.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts.rules import board
from marl_cair.games.deep_rts.rules import rulebook as rb

NOWHERE = -1
ON_THE_SPOT = 1  # reach (see `board.reach_of`) of a walk onto the cell itself
NEXT_TO = 4  # reach of the eight cells around
NOT_FOR_RESOURCE = -1
ANY_RESOURCE = 100  # whatever can be gathered by hand

STEP_BITS = np.uint64(3)
_STEP_MASK = np.uint64(7)
_WORD_MASK = np.uint64(2**63 - 1)
LAST_SEARCH = 32_000
# The lowest of the directions in a set of bits, by the set.
LOWEST_BIT: NDArray[np.int8] = np.array(
    [(bits & -bits).bit_length() - 1 for bits in range(1 << rb.NUM_DIRECTIONS)], np.int8
)


@compiled_copy
def next_direction(world: Any, unit: int) -> int:
    """The next step of a unit's path."""
    return int(world.path[unit] & _STEP_MASK)


@compiled_copy
def forget_path(world: Any, unit: int) -> None:
    """The unit must plan again."""
    world.path[unit] = np.uint64(0)
    world.units[unit, s.UNIT_PATH_STEPS] = 0


@compiled
def may_enter(world: Any, rules: Any, unit: int, cell: int, goal: int, reach: int) -> bool:
    """True where a path may lead; onto lava only if it is the goal itself."""
    if board.is_passable(world, rules, unit, cell):
        return True
    return cell == goal and reach == ON_THE_SPOT and not board.is_solid(world, rules, cell)


@compiled
def plan_straight(world: Any, rules: Any, unit: int, goal: int, half: int, reach: int) -> bool:
    """Plan a walk in a straight line until within `reach` of the box; False where it is blocked."""
    cell = int(world.units[unit, s.UNIT_CELL])
    word = np.uint64(0)
    steps = 0
    while board.box_distance(rules, cell, goal, half) >= reach:
        aim = nearest_of_box(rules, cell, goal, half)
        direction = board.direction_between(rules, cell, aim)
        if board.cuts_corner(world, rules, cell, direction):
            return False
        cell = int(cell + rules.offset[direction])
        if not may_enter(world, rules, unit, cell, goal, reach):
            return False
        if steps < s.PATH_STEPS:
            word |= np.uint64(direction) << (STEP_BITS * np.uint64(steps))
        steps += 1
    world.path[unit] = word
    world.units[unit, s.UNIT_PATH_STEPS] = min(steps, s.PATH_STEPS)
    return True


@compiled
def nearest_of_box(rules: Any, cell: int, goal: int, half: int) -> int:
    """The cell of the square around `goal` that is nearest to `cell`."""
    rows, columns = board.steps_between(rules, goal, cell)
    rows, columns = min(half, max(-half, rows)), min(half, max(-half, columns))
    return int(goal + rows * rules.stride + columns)


@compiled
def begin_search(world: Any) -> int:
    """Start a search; returns its number, which marks the cells that it reaches."""
    if world.clock[s.NUM_SEARCHES] >= LAST_SEARCH:
        world.clock[s.NUM_SEARCHES] = 0
        world.board[s.REACHED, :] = 0
    world.clock[s.NUM_SEARCHES] += 1
    return int(world.clock[s.NUM_SEARCHES])


@compiled
def trace_back(world: Any, rules: Any, unit: int, cell: int) -> None:
    """Write the first steps of the path on which the search reached `cell`."""
    start = int(world.units[unit, s.UNIT_CELL])
    word = np.uint64(0)
    steps = 0
    while cell != start:
        direction = int(world.board[s.CAME, cell])
        word = ((word << STEP_BITS) & _WORD_MASK) | np.uint64(direction)
        cell = int(cell - rules.offset[direction])
        steps += 1
    world.path[unit] = word
    world.units[unit, s.UNIT_PATH_STEPS] = min(steps, s.PATH_STEPS)


@compiled
def resource_beside(world: Any, rules: Any, frame: int, cell: int, resource: int) -> int:
    """The first neighbouring tile, in own directions, with `resource` to gather; or NOWHERE."""
    for own in range(rb.NUM_DIRECTIONS):
        beside = int(cell + rules.offset[rules.own_direction[frame, own]])
        if board.can_gather(world, rules, beside):
            is_same = board.tile_value(world, rules, beside, rb.TILE_RESOURCE) == resource
            if is_same or resource == ANY_RESOURCE:
                return beside
    return NOWHERE


@compiled
def unreached_around(world: Any, rules: Any, frame: int, cell: int, number: int) -> int:
    """Bits of the own directions in which the search has not been yet.

    Most lead back; reading all eight first costs less than eight unpredictable branches.
    """
    directions = 0
    for own in range(rb.NUM_DIRECTIONS):
        beyond = cell + rules.own_offset[frame, own]
        directions |= int(world.board[s.REACHED, beyond] != number) << own
    return directions


@compiled
def search(
    world: Any, rules: Any, unit: int, goal: int, half: int, reach: int, resource: int
) -> int:
    """Search breadth first until within `reach` of the box, or beside `resource` if one is given.

    Writes the path and returns the cell where it ends: the reachable cell that is nearest to the
    goal; NOWHERE if no step brings the unit nearer, or if no resource can be reached.
    """
    frame = board.frame_of(world, rules, board.owner_of(rules, unit))
    number = begin_search(world)
    start = int(world.units[unit, s.UNIT_CELL])
    world.board[s.REACHED, start] = number
    world.board[s.FRONTIER, 0] = start
    best, best_distance = start, board.box_distance(rules, start, goal, half)
    head, tail = 0, 1
    while head < tail:
        cell = int(world.board[s.FRONTIER, head])
        head += 1
        ahead = unreached_around(world, rules, frame, cell, number)
        while ahead != 0:
            own = int(LOWEST_BIT[ahead])
            ahead &= ahead - 1
            direction = int(rules.own_direction[frame, own])
            beyond = int(cell + rules.own_offset[frame, own])
            if not may_enter(world, rules, unit, beyond, goal, reach):
                world.board[s.REACHED, beyond] = number
                continue
            if board.cuts_corner(world, rules, cell, direction):
                continue
            world.board[s.REACHED, beyond] = number
            world.board[s.CAME, beyond] = direction
            world.board[s.FRONTIER, tail] = beyond
            tail += 1
            if resource != NOT_FOR_RESOURCE:
                if resource_beside(world, rules, frame, beyond, resource) != NOWHERE:
                    trace_back(world, rules, unit, beyond)
                    return beyond
                continue
            distance = board.box_distance(rules, beyond, goal, half)
            if distance < reach:
                trace_back(world, rules, unit, beyond)
                return beyond
            if distance < best_distance:
                best, best_distance = beyond, distance
    if resource != NOT_FOR_RESOURCE or best == start:
        forget_path(world, unit)
        return NOWHERE
    trace_back(world, rules, unit, best)
    return best
