"""The plans of the scripted players of Deep Maze, each for one position: flat planes [C, N]."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_maze.observation import (
    CAME_FROM,
    GOALS,
    HUNTED_LEVEL,
    HUNTER_LEVEL,
    OPEN_CELLS,
    RIVALS,
    ROLE,
    SELF,
    WALLS,
)
from marl_cair.games.deep_maze.scenarios import Scenario
from marl_cair.games.deep_maze.tables import (
    COLUMN_STEP,
    DOWN,
    LEFT,
    NOOP,
    NUM_MOVES,
    RIGHT,
    ROW_STEP,
    UP,
)

NO_CELL = -1
NOT_REACHED = -1
_RIGHT_OF = (LEFT, RIGHT, UP, DOWN)  # of each heading, as one who walks so turns
_BACK_OF = (UP, DOWN, RIGHT, LEFT)


class Scratch(NamedTuple):
    """What a plan writes while it thinks, [N] each: nothing of it outlasts a decision."""

    queue: NDArray[np.int32]
    moves: NDArray[np.int32]  # to the targets of a search, or NOT_REACHED
    rival_moves: NDArray[np.int32]  # the same to the rivals


def make_scratch(scenario: Scenario) -> Scratch:
    """Room for the searches on a board."""
    return Scratch(*(np.zeros(scenario.num_cells, np.int32) for _ in range(3)))


@compiled
def find_self(planes: Any) -> int:
    """The cell of the player."""
    return first_of(planes, SELF)


@compiled
def first_of(planes: Any, plane: int) -> int:
    """The first cell that is marked in a plane, or NO_CELL."""
    for cell in range(planes.shape[1]):
        if planes[plane, cell] != 0:
            return cell
    return NO_CELL


@compiled
def cell_beside(cell: int, move: int, columns: int, num_cells: int) -> int:
    """Where a move leads, or NO_CELL at the edge of the board."""
    row, column = cell // columns + ROW_STEP[move], cell % columns + COLUMN_STEP[move]
    if column < 0 or column >= columns or row < 0 or row >= num_cells // columns:
        return NO_CELL
    return row * columns + column


# --- searches ------------------------------------------------------------------------------------


@compiled
def add_target(cell: int, num_queued: int, queue: Any, moves: Any) -> int:
    """A cell from which a search begins; returns how many there are."""
    if moves[cell] == NOT_REACHED:
        moves[cell] = 0
        queue[num_queued] = cell
        num_queued += 1
    return num_queued


@compiled
def spread(planes: Any, columns: int, num_queued: int, queue: Any, moves: Any) -> None:
    """Moves from every cell to the nearest target, breadth first; what is unknown may be open."""
    num_cells = planes.shape[1]
    place = 0
    while place < num_queued:
        cell = int(queue[place])
        place += 1
        for move in range(NUM_MOVES):
            beside = cell_beside(cell, move, columns, num_cells)
            if beside == NO_CELL or planes[WALLS, beside] != 0 or moves[beside] != NOT_REACHED:
                continue
            moves[beside] = moves[cell] + 1
            queue[num_queued] = beside
            num_queued += 1


@compiled
def measure_to_plane(planes: Any, columns: int, plane: int, queue: Any, moves: Any) -> bool:
    """`spread` from all cells that are marked in a plane; False where none is."""
    moves[:] = NOT_REACHED
    num_queued = 0
    for cell in range(planes.shape[1]):
        if planes[plane, cell] != 0:
            num_queued = add_target(cell, num_queued, queue, moves)
    spread(planes, columns, num_queued, queue, moves)
    return num_queued > 0


@compiled
def measure_to_unknown(planes: Any, columns: int, queue: Any, moves: Any) -> None:
    """`spread` from all cells of which it is not known whether they are open."""
    moves[:] = NOT_REACHED
    num_queued = 0
    for cell in range(planes.shape[1]):
        if planes[WALLS, cell] == 0 and planes[OPEN_CELLS, cell] == 0:
            num_queued = add_target(cell, num_queued, queue, moves)
    spread(planes, columns, num_queued, queue, moves)


@compiled
def step_down(planes: Any, columns: int, cell: int, moves: Any) -> int:
    """The first move that brings the player nearer to the targets, or the no-op."""
    for move in range(NUM_MOVES):
        beside = cell_beside(cell, move, columns, planes.shape[1])
        if beside == NO_CELL or planes[WALLS, beside] != 0:
            continue
        if moves[beside] != NOT_REACHED and moves[beside] < moves[cell]:
            return move
    return NOOP


# --- plans ---------------------------------------------------------------------------------------


@compiled
def step_away(planes: Any, columns: int, cell: int, rival_moves: Any) -> int:
    """The move after which the rivals have the longest way; to stay, if none is better."""
    best, longest = NOOP, int(rival_moves[cell])
    for move in range(NUM_MOVES):
        beside = cell_beside(cell, move, columns, planes.shape[1])
        if beside == NO_CELL or planes[WALLS, beside] != 0:
            continue
        if rival_moves[beside] > longest:
            best, longest = move, int(rival_moves[beside])
    return best


@compiled
def hunter_is_nearer(planes: Any, cell: int, moves: Any) -> bool:
    """Whether a rival in sight is no further from the goal than the player."""
    for other in range(planes.shape[1]):
        if planes[RIVALS, other] != 0 and moves[other] <= moves[cell]:
            return True
    return False


@compiled
def plan_oracle(planes: Any, columns: int, cell: int, scratch: Any) -> int:
    """The shortest way to the goal; while that has not been seen, to what is unknown.

    Cells that are not known count as open. A hunter goes for the nearest of the others in sight.
    Who is hunted runs away while the hunter in sight is no further from the goal.
    """
    queue, moves, rival_moves = scratch.queue, scratch.moves, scratch.rival_moves
    sees_rivals = measure_to_plane(planes, columns, RIVALS, queue, rival_moves)
    if planes[ROLE, cell] == HUNTER_LEVEL and sees_rivals:
        return step_down(planes, columns, cell, rival_moves)
    if not measure_to_plane(planes, columns, GOALS, queue, moves):
        measure_to_unknown(planes, columns, queue, moves)
    is_hunted = planes[ROLE, cell] == HUNTED_LEVEL
    if is_hunted and sees_rivals and hunter_is_nearer(planes, cell, moves):
        return step_away(planes, columns, cell, rival_moves)
    return step_down(planes, columns, cell, moves)


@compiled
def is_passable(planes: Any, columns: int, cell: int, move: int) -> bool:
    """Whether a move leads to an open cell."""
    beside = cell_beside(cell, move, columns, planes.shape[1])
    return bool(beside != NO_CELL and planes[OPEN_CELLS, beside] != 0)


@compiled
def plan_wall_follower(planes: Any, columns: int, cell: int) -> int:
    """The right hand on the wall: right, else straight on, else left, else back."""
    came_from = first_of(planes, CAME_FROM)
    heading = DOWN
    for move in range(NUM_MOVES):
        if came_from != NO_CELL and cell_beside(came_from, move, columns, planes.shape[1]) == cell:
            heading = move
    right, back = _RIGHT_OF[heading], _BACK_OF[heading]
    if is_passable(planes, columns, cell, right):
        return right
    if is_passable(planes, columns, cell, heading):
        return heading
    if is_passable(planes, columns, cell, _BACK_OF[right]):
        return _BACK_OF[right]
    if is_passable(planes, columns, cell, back):
        return back
    return NOOP
