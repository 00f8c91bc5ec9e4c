"""What each player of Deep Maze sees. Under fog every representation asks the same sight.

Hidden from an agent: cells that it has not seen, players that are not in sight, a goal that it
has not seen, and the random words. A caught player is removed from the board.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_maze.rulebook import CHASE, HUNTER
from marl_cair.games.deep_maze.sight import knows, sees, sees_all
from marl_cair.games.deep_maze.state import GOAL, IN_SIGHT, MAZE, OPEN, TICK, WALL, world_at
from marl_cair.games.deep_maze.tables import ACTION_NAMES, MAX_PLAYERS, NUM_MOVES
from marl_cair.games.loops import loop_over_seats

FULL = 255
HUNTER_LEVEL, HUNTED_LEVEL = 255, 128  # of the plane `role`, which is 0 but in a chase
PLANE_NAMES = (
    *("wall", "open", "self", "where self came from", "mates", "rivals", "goal"),
    *("in sight", "explored"),
    *("role", "mazes left", "preview left", "time left"),
)
WALLS, OPEN_CELLS, SELF, CAME_FROM, MATES, RIVALS, GOALS, VISIBLE, EXPLORED = range(9)
ROLE, MAZES_LEFT, PREVIEW_LEFT, TIME_LEFT = range(9, 13)
NUM_UNIFORM = len(PLANE_NAMES) - ROLE

# The original's ids, and after them those of what it did not have.
ID_OPEN, ID_WALL, ID_SELF, ID_GOAL, ID_UNKNOWN, ID_RIVAL, ID_MATE, ID_HUNTER = range(8)
AS_SELF, AS_MATE, AS_RIVAL, AS_HUNTER = range(4)
ROLE_IDS: NDArray[np.uint8] = np.array([ID_SELF, ID_MATE, ID_RIVAL, ID_HUNTER], np.uint8)

_NUMBERS_OF_OTHER = ("in sight", "row", "column", "is a rival")
VECTOR_NAMES = (
    *("own row", "own column", "goal known", "goal row", "goal column"),
    *(f"free cells {name}" for name in ACTION_NAMES[:NUM_MOVES]),
    *("self hunts", "mazes left", "preview moves left", "moves left"),
    *(f"other {i}: {name}" for i in range(1, MAX_PLAYERS) for name in _NUMBERS_OF_OTHER),
)
_FIRST_FREE = VECTOR_NAMES.index("free cells down")
_FIRST_OTHER = VECTOR_NAMES.index("other 1: in sight")
_NUM_OF_OTHER = len(_NUMBERS_OF_OTHER)


@compiled
def is_hunter(rules: Any, player: int) -> bool:
    """Whether a seat hunts the others."""
    return bool(rules.contest == CHASE and player == HUNTER)


@compiled
def is_mate(rules: Any, player: int, other: int) -> bool:
    """Whether two seats win together: the hunted players of a chase."""
    return bool(rules.contest == CHASE and HUNTER not in (player, other))


@compiled
def role_of(rules: Any, player: int, other: int) -> int:
    """What `other` is to `player`; the hunter is one to itself too, so that it knows its role."""
    if is_hunter(rules, other):
        return AS_HUNTER
    if other == player:
        return AS_SELF
    return AS_MATE if is_mate(rules, player, other) else AS_RIVAL


@compiled
def sees_player(world: Any, rules: Any, player: int, other: int) -> bool:
    """Whether another seat is on the board and in sight."""
    return bool(world.is_caught[other] == 0 and sees(world, rules, player, int(world.cell[other])))


@compiled
def preview_left(world: Any, rules: Any) -> int:
    """Moves for which all is still seen."""
    return int(max(0, rules.preview_moves - world.clock[TICK]))


@compiled
def time_left(world: Any, rules: Any) -> int:
    """Moves until the time limit."""
    return int(max(0, rules.max_ticks - world.clock[TICK]))


@compiled
def see_board(world: Any, rules: Any, player: int, flat: Any) -> None:
    """Write walls, open cells and sight: flat uint8 [C, N]."""
    cells = world.walls.shape[0]
    if sees_all(world, rules):
        for cell in range(cells):
            wall = world.walls[cell]
            flat[WALLS, cell] = np.uint8(FULL) * wall
            flat[OPEN_CELLS, cell] = np.uint8(FULL) * (wall ^ np.uint8(WALL))
        flat[VISIBLE] = FULL
    else:
        for cell in range(cells):
            wall, bits = world.walls[cell], world.sight[player, cell]
            is_known = np.uint8(bits != 0)
            flat[WALLS, cell] = np.uint8(FULL) * (wall & is_known)
            flat[OPEN_CELLS, cell] = np.uint8(FULL) * ((wall ^ np.uint8(WALL)) & is_known)
            flat[VISIBLE, cell] = np.uint8(FULL) * (bits & np.uint8(IN_SIGHT))
    if world.sight.shape[1] < cells:
        flat[EXPLORED] = FULL
    else:
        for cell in range(cells):
            flat[EXPLORED, cell] = np.uint8(FULL) * np.uint8(world.sight[player, cell] != 0)


@compiled
def see_planes(world: Any, rules: Any, player: int, out: Any) -> None:
    """Write the planes of PLANE_NAMES."""
    flat = out.reshape((len(PLANE_NAMES), world.walls.shape[0]))
    see_board(world, rules, player, flat)
    flat[SELF : GOALS + 1] = 0
    cell, came_from = int(world.cell[player]), int(world.came_from[player])
    flat[SELF, cell] = FULL
    if came_from != cell:
        flat[CAME_FROM, came_from] = FULL
    for other in range(rules.num_players):
        if other != player and sees_player(world, rules, player, other):
            plane = MATES if is_mate(rules, player, other) else RIVALS
            flat[plane, world.cell[other]] = FULL
    goal = int(world.clock[GOAL])
    if knows(world, rules, player, goal):
        flat[GOALS, goal] = FULL
    if rules.contest == CHASE:
        flat[ROLE] = HUNTER_LEVEL if is_hunter(rules, player) else HUNTED_LEVEL
    else:
        flat[ROLE] = 0
    to_come = rules.num_mazes - 1 - int(world.clock[MAZE])
    flat[MAZES_LEFT] = FULL * to_come // rules.num_mazes
    flat[PREVIEW_LEFT] = FULL * preview_left(world, rules) // max(1, rules.preview_moves)
    flat[TIME_LEFT] = FULL * time_left(world, rules) // rules.max_ticks


@compiled
def see_ids(world: Any, rules: Any, player: int, flat: Any) -> None:
    """Write the id of each cell: flat uint8 [N]. Of several on one cell: self, others, the goal."""
    cells = world.walls.shape[0]
    if sees_all(world, rules):
        for cell in range(cells):
            flat[cell] = world.walls[cell]
    else:
        for cell in range(cells):
            known = world.sight[player, cell] != 0
            flat[cell] = world.walls[cell] if known else np.uint8(ID_UNKNOWN)
    goal = int(world.clock[GOAL])
    if knows(world, rules, player, goal):
        flat[goal] = ID_GOAL
    for other in range(rules.num_players):
        if other != player and sees_player(world, rules, player, other):
            flat[world.cell[other]] = ROLE_IDS[role_of(rules, player, other)]
    flat[world.cell[player]] = ROLE_IDS[role_of(rules, player, player)]


@compiled
def see_classic(world: Any, rules: Any, player: int, out: Any) -> None:
    """Write the ids as uint8 [1, H, W]."""
    see_ids(world, rules, player, out.reshape(world.walls.shape[0]))


@compiled
def free_cells(world: Any, rules: Any, player: int, move: int) -> int:
    """How many known open cells lie straight ahead."""
    cell = int(world.cell[player])
    count = 0
    while True:
        ahead = int(rules.neighbours[cell, move])
        if ahead == cell or world.walls[ahead] != OPEN or not knows(world, rules, player, ahead):
            return count
        cell = ahead
        count += 1


@compiled
def see_vector(world: Any, rules: Any, player: int, out: Any) -> None:
    """Write the numbers of VECTOR_NAMES; 0 stands for what is not known."""
    out[:] = 0.0
    cell = int(world.cell[player])
    out[0] = cell // rules.columns
    out[1] = cell % rules.columns
    goal = int(world.clock[GOAL])
    if knows(world, rules, player, goal):
        out[2] = 1.0
        out[3] = goal // rules.columns
        out[4] = goal % rules.columns
    for move in range(NUM_MOVES):
        out[_FIRST_FREE + move] = free_cells(world, rules, player, move)
    index = _FIRST_FREE + NUM_MOVES
    out[index] = 1.0 if is_hunter(rules, player) else 0.0
    out[index + 1] = rules.num_mazes - 1 - int(world.clock[MAZE])
    out[index + 2] = preview_left(world, rules)
    out[index + 3] = time_left(world, rules)
    for step in range(1, rules.num_players):
        other = (player + step) % rules.num_players
        if not sees_player(world, rules, player, other):
            continue
        index = _FIRST_OTHER + (step - 1) * _NUM_OF_OTHER
        out[index] = 1.0
        out[index + 1] = int(world.cell[other]) // rules.columns
        out[index + 2] = int(world.cell[other]) % rules.columns
        out[index + 3] = 0.0 if is_mate(rules, player, other) else 1.0


observe_planes = loop_over_seats(see_planes, world_at)  # out uint8 [B, P, C, H, W]
observe_classic = loop_over_seats(see_classic, world_at)  # out uint8 [B, P, 1, H, W]
observe_flat = loop_over_seats(see_ids, world_at)  # out uint8 [B, P, N]
observe_vector = loop_over_seats(see_vector, world_at)  # out float32 [B, P, V]
