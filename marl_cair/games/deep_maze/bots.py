"""Scripted players of Deep Maze. They see what an agent sees: planes and action mask."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
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
from marl_cair.games.deep_maze.rulebook import make_rules
from marl_cair.games.deep_maze.scenarios import Scenario
from marl_cair.games.deep_maze.tables import DOWN, LEFT, NOOP, NUM_MOVES, RIGHT, UP
from marl_cair.games.game import Agent, GameSpec
from marl_cair.games.scripted import ScriptedPlayer

PLANS = ("wall_follower", "oracle")
WALL_FOLLOWER, ORACLE = range(len(PLANS))
NO_CELL = -1
NOT_REACHED = -1
UNKNOWN = -1  # in place of a plane: cells that are neither known walls nor known to be open
_RIGHT_OF = (LEFT, RIGHT, UP, DOWN)  # of each heading, for a player that walks so
_BACK_OF = (UP, DOWN, RIGHT, LEFT)


class Search(NamedTuple):
    """The board of a scenario, and scratch arrays that are overwritten at each step."""

    neighbours: NDArray[np.int16]  # [N, actions] see `Rules`
    queue: NDArray[np.int32]  # [N]
    moves: NDArray[np.int32]  # [N] to the targets of a search, or NOT_REACHED
    rival_moves: NDArray[np.int32]  # [N] the same to the rivals


@compiled
def first_of(planes: Any, plane: int) -> int:
    """The first cell that is marked in a plane, or NO_CELL."""
    for cell in range(planes.shape[1]):
        if planes[plane, cell] != 0:
            return cell
    return NO_CELL


@compiled
def measure_moves(planes: Any, plane: int, search: Any, moves: Any) -> bool:
    """Write the moves from every cell to the nearest one that is marked in a plane (or UNKNOWN),
    breadth first, as if unknown cells were open; False where none is marked.
    """
    moves[:] = NOT_REACHED
    num_queued, place = 0, 0
    for cell in range(planes.shape[1]):
        is_target = planes[WALLS, cell] == 0 and planes[OPEN_CELLS, cell] == 0
        if plane != UNKNOWN:
            is_target = planes[plane, cell] != 0
        if is_target:
            moves[cell] = 0
            search.queue[num_queued] = cell
            num_queued += 1
    while place < num_queued:
        cell = int(search.queue[place])
        place += 1
        for move in range(NUM_MOVES):
            beside = int(search.neighbours[cell, move])
            if planes[WALLS, beside] == 0 and moves[beside] == NOT_REACHED:
                moves[beside] = moves[cell] + 1
                search.queue[num_queued] = beside
                num_queued += 1
    return num_queued > 0


@compiled
def step_nearer(planes: Any, cell: int, search: Any, moves: Any) -> int:
    """The first move that brings the player nearer to the targets, or the no-op."""
    for move in range(NUM_MOVES):
        beside = int(search.neighbours[cell, move])
        is_reached = planes[WALLS, beside] == 0 and moves[beside] != NOT_REACHED
        if is_reached and moves[beside] < moves[cell]:
            return move
    return NOOP


@compiled
def step_away(planes: Any, cell: int, search: Any) -> int:
    """The move after which the rivals have the longest way; to stay, if none is better."""
    best, longest = NOOP, int(search.rival_moves[cell])
    for move in range(NUM_MOVES):
        beside = int(search.neighbours[cell, move])
        if planes[WALLS, beside] == 0 and search.rival_moves[beside] > longest:
            best, longest = move, int(search.rival_moves[beside])
    return best


@compiled
def hunter_is_nearer(planes: Any, cell: int, moves: Any) -> bool:
    """Whether a rival in sight is no further from the goal than the player."""
    for other in range(planes.shape[1]):
        if planes[RIVALS, other] != 0 and moves[other] <= moves[cell]:
            return True
    return False


@compiled
def plan_oracle(planes: Any, cell: int, search: Any) -> int:
    """The shortest way to the goal; until the goal has been seen, to the nearest unknown cell.

    A hunter goes for the nearest of the others in sight. A hunted player runs away while a hunter
    in sight is no further from the goal.
    """
    moves, rival_moves = search.moves, search.rival_moves
    sees_rivals = measure_moves(planes, RIVALS, search, rival_moves)
    if planes[ROLE, cell] == HUNTER_LEVEL and sees_rivals:
        return step_nearer(planes, cell, search, rival_moves)
    if not measure_moves(planes, GOALS, search, moves):
        measure_moves(planes, UNKNOWN, search, moves)
    is_hunted = planes[ROLE, cell] == HUNTED_LEVEL
    if is_hunted and sees_rivals and hunter_is_nearer(planes, cell, moves):
        return step_away(planes, cell, search)
    return step_nearer(planes, cell, search, moves)


@compiled
def plan_wall_follower(planes: Any, cell: int, search: Any) -> int:
    """The right hand on the wall: right, else straight on, else left, else back."""
    came_from = first_of(planes, CAME_FROM)
    heading = DOWN
    for move in range(NUM_MOVES):
        if came_from != NO_CELL and search.neighbours[came_from, move] == cell:
            heading = move
    right, back = _RIGHT_OF[heading], _BACK_OF[heading]
    for move in (right, heading, _BACK_OF[right], back):
        beside = int(search.neighbours[cell, move])
        if beside != cell and planes[OPEN_CELLS, beside] != 0:
            return move
    return NOOP


@compiled
def decide_all(plan: int, search: Any, planes: Any, mask: Any, random: Any, out: Any) -> None:
    """The action of a plan for each of N rows: planes [N, C, H, W], mask [N, A], out [N].

    An illegal action becomes the no-op.
    """
    flat = planes.reshape((planes.shape[0], planes.shape[1], planes.shape[2] * planes.shape[3]))
    for index in range(planes.shape[0]):
        cell = first_of(flat[index], SELF)
        if plan == WALL_FOLLOWER:
            action = plan_wall_follower(flat[index], cell, search)
        else:
            action = plan_oracle(flat[index], cell, search)
        out[index] = action if mask[index, action] else NOOP


def make_bot(name: str, scenario: Scenario, spec: GameSpec) -> ScriptedPlayer:
    """The bot of one of PLANS for a scenario and its spec."""
    queues = (np.zeros(scenario.num_cells, np.int32) for _ in range(3))
    search = Search(make_rules(scenario).neighbours, *queues)
    return ScriptedPlayer(name, partial(decide_all, PLANS.index(name), search))


BOTS: dict[str, Callable[[Scenario, GameSpec], Agent]] = {
    "random": lambda scenario, spec: ScriptedPlayer.by_kind(spec),
    **{name: partial(make_bot, name) for name in PLANS},
}
