"""Orders: what each action means, when it is legal, and what it does to the player's own things."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_line_wars.rulebook import CLASSIC, SPATIAL
from marl_cair.games.deep_line_wars.state import NO_TARGET, NO_TOWER, unit_slot
from marl_cair.games.deep_line_wars.tables import NUM_TOWER_KINDS, NUM_UNIT_KINDS
from marl_cair.games.randomness import draw_below

# Spatial actions: no-op, one per unit kind, then per tower kind one per cell, row by row.
SPATIAL_NOOP = 0
FIRST_SPATIAL_UNIT = 1
FIRST_SPATIAL_TOWER = FIRST_SPATIAL_UNIT + NUM_UNIT_KINDS
# Classic actions, in the thesis's order.
CURSOR_UP, CURSOR_DOWN, CURSOR_RIGHT, CURSOR_LEFT, FIRST_CLASSIC_UNIT = range(5)
# Rows and columns of up, down, right, left.
CURSOR_STEPS: NDArray[np.int64] = np.array([(-1, 0), (1, 0), (0, 1), (0, -1)], np.int64)
FIRST_CLASSIC_TOWER = FIRST_CLASSIC_UNIT + NUM_UNIT_KINDS
NUM_CLASSIC_TOWERS = 4  # the original lists a fourth tower that does not exist: never legal
CLASSIC_NOOP = FIRST_CLASSIC_TOWER + NUM_CLASSIC_TOWERS

ORDER_NONE, ORDER_ILLEGAL, ORDER_UNIT, ORDER_TOWER, ORDER_CURSOR = range(5)


@compiled
def can_buy_unit(world: Any, rules: Any, player: int, kind: int) -> bool:
    """The gold suffices (the slots always do: see Scenario.unit_capacity)."""
    affordable = world.gold[player] >= rules.unit_cost_gold[kind]
    return bool(affordable and world.num_units[player] < world.unit_kind.shape[1])


@compiled
def can_afford_tower(world: Any, rules: Any, player: int, kind: int) -> bool:
    """Gold and lumber suffice."""
    enough_gold = world.gold[player] >= rules.tower_cost_gold[kind]
    return bool(enough_gold and world.lumber[player] >= rules.tower_cost_lumber[kind])


@compiled
def can_build_at(world: Any, rules: Any, player: int, row: int, column: int) -> bool:
    """The cell lies in the own half, off the spawn column, and is free."""
    if column < 1 or column > rules.build_columns:
        return False
    return bool(world.tower_at[player, row, column - 1] == NO_TOWER)


@compiled
def can_move_cursor(world: Any, rules: Any, player: int, action: int) -> bool:
    """The cursor stays on the board and off the two spawn columns."""
    row, column = world.cursor[player, 0], world.cursor[player, 1]
    if action == CURSOR_UP:
        return bool(row > 0)
    if action == CURSOR_DOWN:
        return bool(row < rules.rows - 1)
    if action == CURSOR_RIGHT:
        return bool(column < rules.columns - 2)
    return bool(column > 1)


@compiled
def read_order(world: Any, rules: Any, player: int, action: int) -> tuple[int, int, int, int]:
    """What an action means: (order, kind or action, row, column); no-op costs nothing."""
    if rules.action_space == SPATIAL:
        if action == SPATIAL_NOOP:
            return ORDER_NONE, 0, 0, 0
        if action < FIRST_SPATIAL_TOWER:
            return ORDER_UNIT, action - FIRST_SPATIAL_UNIT, 0, 0
        cell = action - FIRST_SPATIAL_TOWER
        per_kind = rules.rows * rules.build_columns
        kind = cell // per_kind
        cell -= kind * per_kind
        row = cell // rules.build_columns
        return ORDER_TOWER, kind, row, 1 + cell - row * rules.build_columns
    if action == CLASSIC_NOOP:
        return ORDER_NONE, 0, 0, 0
    if action < FIRST_CLASSIC_UNIT:
        return ORDER_CURSOR, action, 0, 0
    if action < FIRST_CLASSIC_TOWER:
        return ORDER_UNIT, action - FIRST_CLASSIC_UNIT, 0, 0
    kind = action - FIRST_CLASSIC_TOWER
    if kind >= NUM_TOWER_KINDS:
        return ORDER_ILLEGAL, 0, 0, 0
    return ORDER_TOWER, kind, int(world.cursor[player, 0]), int(world.cursor[player, 1])


@compiled
def is_legal(world: Any, rules: Any, player: int, action: int) -> bool:
    """Whether the action would change what it says it does; the no-op always may."""
    order, kind, row, column = read_order(world, rules, player, action)
    if order == ORDER_NONE:
        return True
    if order == ORDER_UNIT:
        return can_buy_unit(world, rules, player, kind)
    if order == ORDER_TOWER:
        affordable = can_afford_tower(world, rules, player, kind)
        return affordable and can_build_at(world, rules, player, row, column)
    if order == ORDER_CURSOR:
        return can_move_cursor(world, rules, player, kind)
    return False


@compiled
def buy_unit(world: Any, rules: Any, player: int, kind: int) -> None:
    """Pay, raise the income, and put the unit on a random cell of the own spawn column."""
    slot = unit_slot(world, player, world.num_units[player])
    world.num_units[player] += 1
    world.gold[player] -= rules.unit_cost_gold[kind]
    world.income[player] += rules.unit_income_gold[kind]
    world.unit_kind[player, slot] = kind
    world.unit_health[player, slot] = rules.unit_health[kind]
    world.unit_row[player, slot] = draw_below(world.random, player, rules.rows)
    world.unit_column[player, slot] = 0
    world.unit_progress[player, slot] = 0


@compiled
def build_tower(world: Any, rules: Any, player: int, kind: int, row: int, column: int) -> None:
    """Pay and place; a new tower is charged and may fire in its first tick."""
    slot = world.num_towers[player]
    world.num_towers[player] += 1
    world.gold[player] -= rules.tower_cost_gold[kind]
    world.lumber[player] -= rules.tower_cost_lumber[kind]
    world.tower_kind[player, slot] = kind
    world.tower_row[player, slot] = row
    world.tower_column[player, slot] = column
    world.tower_ready[player, slot] = world.tick[0]
    world.tower_spare[player, slot] = 0
    world.shot_target[player, slot] = NO_TARGET
    world.shot_ticks[player, slot] = 0
    world.shot_flight_ticks[player, slot] = 0
    world.tower_at[player, row, column - 1] = kind


@compiled
def obey(world: Any, rules: Any, player: int, action: int) -> None:
    """Carry out a player's action, which touches only its own things, or count it as illegal."""
    if not is_legal(world, rules, player, action):
        world.illegal[player] += 1
        return
    order, kind, row, column = read_order(world, rules, player, action)
    if order == ORDER_UNIT:
        buy_unit(world, rules, player, kind)
    elif order == ORDER_TOWER:
        build_tower(world, rules, player, kind, row, column)
    elif order == ORDER_CURSOR:
        world.cursor[player, 0] += CURSOR_STEPS[kind, 0]
        world.cursor[player, 1] += CURSOR_STEPS[kind, 1]


@compiled
def list_legal_actions(world: Any, rules: Any, player: int, legal: Any) -> None:
    """Write the mask of one player; equal to asking `is_legal` of each action, but faster."""
    if rules.action_space == CLASSIC:
        for action in range(legal.shape[0]):
            legal[action] = is_legal(world, rules, player, action)
        return
    legal[SPATIAL_NOOP] = True
    for kind in range(NUM_UNIT_KINDS):
        legal[FIRST_SPATIAL_UNIT + kind] = can_buy_unit(world, rules, player, kind)
    cells = rules.rows * rules.build_columns
    tower_at = world.tower_at[player].reshape(cells)
    for kind in range(NUM_TOWER_KINDS):
        first = FIRST_SPATIAL_TOWER + kind * cells
        if can_afford_tower(world, rules, player, kind):
            for cell in range(cells):
                legal[first + cell] = tower_at[cell] == NO_TOWER
        else:
            legal[first : first + cells] = False
