"""What each seat sees under fog: cells in sight now, and cells that it has seen in this maze.

Kept in the state, a byte for each seat and cell, so that everything that a seat observes (planes,
ids, numbers, pictures) asks the same place. A preview, in which all is seen, is not remembered.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_maze.rulebook import FULL_SIGHT, SQUARE
from marl_cair.games.deep_maze.state import IN_SIGHT, KNOWN, OPEN, TICK, WALL
from marl_cair.games.deep_maze.tables import NUM_MOVES


@compiled
def sees_all(world: Any, rules: Any) -> bool:
    """Whether nothing is hidden: there is no fog, or the preview still lasts."""
    return bool(rules.visibility == FULL_SIGHT or world.clock[TICK] < rules.preview_moves)


@compiled
def knows(world: Any, rules: Any, player: int, cell: int) -> bool:
    """Whether the seat knows if a cell is a wall: in sight, or remembered."""
    return bool(sees_all(world, rules) or world.sight[player, cell] != 0)


@compiled
def sees(world: Any, rules: Any, player: int, cell: int) -> bool:
    """Whether the seat sees the players in a cell now."""
    return bool(sees_all(world, rules) or world.sight[player, cell] & IN_SIGHT != 0)


@compiled
def forget_sight(world: Any, rules: Any, player: int, centre: int) -> None:
    """Nothing around `centre`, where the seat looked around before, is in sight any longer."""
    reach = rules.vision + 1  # a line of sight shows the walls beside its last cell
    row, column = centre // rules.columns, centre % rules.columns
    left = max(0, column - reach)
    right = min(rules.columns - 1, column + reach)
    for y in range(max(0, row - reach), min(rules.rows - 1, row + reach) + 1):
        for cell in range(y * rules.columns + left, y * rules.columns + right + 1):
            world.sight[player, cell] &= KNOWN


@compiled
def see_square(world: Any, rules: Any, player: int, centre: int, bits: int) -> None:
    """All cells at most `vision` rows and columns away, whatever stands between."""
    row, column = centre // rules.columns, centre % rules.columns
    left = max(0, column - rules.vision)
    right = min(rules.columns - 1, column + rules.vision)
    for y in range(max(0, row - rules.vision), min(rules.rows - 1, row + rules.vision) + 1):
        for cell in range(y * rules.columns + left, y * rules.columns + right + 1):
            world.sight[player, cell] = bits


@compiled
def see_walls_beside(world: Any, rules: Any, player: int, centre: int, bits: int) -> None:
    """The walls among the eight cells around an open cell, and the cell itself."""
    row, column = centre // rules.columns, centre % rules.columns
    for y in range(max(0, row - 1), min(rules.rows - 1, row + 1) + 1):
        for x in range(max(0, column - 1), min(rules.columns - 1, column + 1) + 1):
            cell = y * rules.columns + x
            if world.walls[cell] == WALL or cell == centre:
                world.sight[player, cell] = bits


@compiled
def see_lines(world: Any, rules: Any, player: int, centre: int, bits: int) -> None:
    """The straight ways from `centre`, up to `vision` cells or a wall, and the walls beside."""
    see_walls_beside(world, rules, player, centre, bits)
    for move in range(NUM_MOVES):
        cell = centre
        for _ in range(rules.vision):
            ahead = int(rules.neighbours[cell, move])
            if ahead == cell or world.walls[ahead] != OPEN:
                break
            see_walls_beside(world, rules, player, ahead, bits)
            cell = ahead


@compiled
def update_sight(world: Any, rules: Any, player: int, centre_before: int) -> None:
    """Renew what is in sight of a seat that stood at `centre_before` when it looked last."""
    centre = int(world.cell[player])
    forget_sight(world, rules, player, centre_before)
    bits = IN_SIGHT | KNOWN if rules.remembers else IN_SIGHT
    if rules.visibility == SQUARE:
        see_square(world, rules, player, centre, bits)
    else:
        see_lines(world, rules, player, centre, bits)


@compiled
def open_eyes(world: Any, rules: Any) -> None:
    """All seats look around a maze that they have just entered."""
    world.sight[:] = 0
    if rules.visibility == FULL_SIGHT:
        return
    for player in range(rules.num_players):
        update_sight(world, rules, player, int(world.cell[player]))
