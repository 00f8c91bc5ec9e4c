"""Reads planes into what scripted players need to know, and numbers their actions."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_line_wars import tables as t
from marl_cair.games.deep_line_wars.observation import (
    CURSOR,
    ENEMY_TOWERS,
    ENEMY_UNITS,
    OWN_GOLD,
    OWN_LUMBER,
    OWN_TOWERS,
    OWN_UNITS,
    UNIT_LEVEL,
)
from marl_cair.games.deep_line_wars.orders import (
    CLASSIC_NOOP,
    CURSOR_DOWN,
    CURSOR_LEFT,
    CURSOR_RIGHT,
    CURSOR_UP,
    FIRST_CLASSIC_TOWER,
    FIRST_CLASSIC_UNIT,
    FIRST_SPATIAL_TOWER,
    FIRST_SPATIAL_UNIT,
    SPATIAL_NOOP,
)
from marl_cair.games.deep_line_wars.rulebook import CLASSIC, Rules, make_rules
from marl_cair.games.deep_line_wars.scenarios import Scenario

NO_CELL = -1
PASSED_COLUMN = 2  # an enemy unit this near to the own base is beyond help


class Weights(NamedTuple):
    """What a plan values. The defaults are those of `counter`.

    Found by tournaments against the other players, in which each candidate was also tried with
    small changes, so that it is no outlier.
    """

    defence_price: float = 22.0  # gold per own health and interval
    lumber_price: float = 8.0  # gold
    slot_price: float = 0.7  # share of the gold per step that an order costs beside its price
    horizon: float = 4.5  # intervals over which income and towers count
    pace: float = 5.0  # intervals that a game is expected to last on for each 10 health
    health_price: float = 12.0  # gold per health of the enemy
    finish_health: float = 7.0  # health of either side at which it is worth twice as much


COUNTER_WEIGHTS = Weights()
RUSHER_WEIGHTS = Weights(defence_price=40.0, horizon=2.0, health_price=30.0)


class Knowledge(NamedTuple):
    """The public numbers of a scenario in the form that plans compute with.

    Cells run row by row over rows x build columns, as the tower actions do.
    """

    rules: Rules
    chords: NDArray[np.float64]  # [tower kinds, cells, rows] columns of a row in a tower's range
    order: NDArray[np.int64]  # [tower kinds, cells] cells that cover the board best, best first
    blows: NDArray[np.float64]  # [tower kinds, unit kinds] hit points per tick
    walk: NDArray[np.float64]  # [unit kinds] ticks per column
    weights: Weights


class Sight(NamedTuple):
    """What a player reads off the planes; the arrays are overwritten for each row of a batch."""

    own_cover: NDArray[np.float64]  # [tower kinds, rows] columns in range, summed over towers
    enemy_cover: NDArray[np.float64]  # [tower kinds, rows]
    own_towers: NDArray[np.float64]  # [tower kinds]
    enemy_towers: NDArray[np.float64]  # [tower kinds]
    own_units: NDArray[np.float64]  # [unit kinds] by health, in units of the table's
    threats: NDArray[np.float64]  # [unit kinds, rows] enemy units still to be stopped, likewise
    worth: NDArray[np.float64]  # [rows] scratch


def chord_table(rows: int, build_columns: int, columns: int, reach: int) -> NDArray[np.float64]:
    """Columns of each row that a tower of range `reach` covers, [cells, rows]."""
    tower_row = np.repeat(np.arange(rows), build_columns)
    tower_column = np.tile(np.arange(1, build_columns + 1), rows)
    along = tower_row[:, None, None] - np.arange(rows)[None, :, None]
    across = tower_column[:, None, None] - np.arange(1, columns)[None, None, :]
    covered: NDArray[np.float64] = (along**2 + across**2 <= reach**2).sum(2).astype(np.float64)
    return covered


def placement_order(chords: NDArray[np.float64]) -> NDArray[np.int64]:
    """All cells, best first: each next tower most helps the rows that are covered least."""
    covered = np.zeros(chords.shape[1])
    free = np.ones(len(chords), np.bool_)
    order = np.zeros(len(chords), np.int64)
    for place in range(len(chords)):
        gain = (np.sqrt(covered + chords) - np.sqrt(covered)).sum(1)
        order[place] = np.argmax(np.where(free, gain, -1.0))
        free[order[place]] = False
        covered += chords[order[place]]
    return order


def blow_table(rules: Rules) -> NDArray[np.float64]:
    """Hit points per tick that a tower takes off a unit, less waste, [tower kinds, unit kinds]."""
    blows = np.zeros((t.NUM_TOWER_KINDS, t.NUM_UNIT_KINDS))
    for tower in range(t.NUM_TOWER_KINDS):
        rolls = np.arange(rules.tower_damage_min[tower], rules.tower_damage_max[tower] + 1)
        for unit in range(t.NUM_UNIT_KINDS):
            blunted = max(0, int(rules.unit_armour[unit]) - int(rules.tower_penetration[tower]))
            mean = np.maximum(t.MIN_HIT_DAMAGE, rolls - blunted).mean()
            shots = np.ceil(rules.unit_health[unit] / mean)
            per_shot = rules.unit_health[unit] / shots
            blows[tower, unit] = per_shot * rules.tower_attack_speed[tower] / t.CHARGE_PER_SHOT
    return blows


def make_knowledge(scenario: Scenario, weights: Weights = COUNTER_WEIGHTS) -> Knowledge:
    """The tables of a scenario."""
    rules = make_rules(scenario)
    board = (scenario.rows, scenario.build_columns, scenario.columns)
    chords = np.stack([chord_table(*board, int(reach)) for reach in rules.tower_range_tiles])
    return Knowledge(
        rules=rules,
        chords=chords,
        order=np.stack([placement_order(table) for table in chords]),
        blows=blow_table(rules),
        walk=t.PROGRESS_PER_TILE / rules.unit_speed.astype(np.float64),
        weights=weights,
    )


def make_sight(scenario: Scenario) -> Sight:
    """Empty arrays for `read_sight`."""
    towers, units, rows = t.NUM_TOWER_KINDS, t.NUM_UNIT_KINDS, scenario.rows
    shapes = (*[(towers, rows)] * 2, *[(towers,)] * 2, (units,), (units, rows), (rows,))
    return Sight(*(np.zeros(shape) for shape in shapes))


@compiled
def read_towers(planes: Any, known: Any, sight: Any) -> None:
    """Count the towers of both sides and add up what they cover."""
    rules = known.rules
    sight.own_cover[:] = 0.0
    sight.enemy_cover[:] = 0.0
    for kind in range(t.NUM_TOWER_KINDS):
        own, enemy = 0.0, 0.0
        for row in range(rules.rows):
            for column in range(1, rules.build_columns + 1):
                cell = row * rules.build_columns + column - 1
                if planes[OWN_TOWERS + kind, row, column] != 0:
                    own += 1.0
                    for other in range(rules.rows):
                        sight.own_cover[kind, other] += known.chords[kind, cell, other]
                if planes[ENEMY_TOWERS + kind, row, rules.columns - 1 - column] != 0:
                    enemy += 1.0
                    for other in range(rules.rows):
                        sight.enemy_cover[kind, other] += known.chords[kind, cell, other]
        sight.own_towers[kind] = own
        sight.enemy_towers[kind] = enemy


@compiled
def read_units(planes: Any, known: Any, sight: Any) -> None:
    """Add up the health of own units, and of enemy units that towers may still stop."""
    rules = known.rules
    for kind in range(t.NUM_UNIT_KINDS):
        own = 0
        for row in range(rules.rows):
            coming = 0
            for column in range(rules.columns):
                own += int(planes[OWN_UNITS + kind, row, column])
                if column > PASSED_COLUMN:
                    coming += int(planes[ENEMY_UNITS + kind, row, column])
            sight.threats[kind, row] = coming / UNIT_LEVEL
        sight.own_units[kind] = own / UNIT_LEVEL


@compiled
def read_sight(planes: Any, known: Any, sight: Any) -> None:
    """Read one player's planes [C, H, W] into `sight`."""
    read_towers(planes, known, sight)
    read_units(planes, known, sight)


@compiled
def level(planes: Any, plane: int) -> int:
    """The value of a uniform plane."""
    return int(planes[plane, 0, 0])


@compiled
def can_pay_unit(planes: Any, known: Any, kind: int) -> bool:
    """Whether the gold suffices."""
    return bool(level(planes, OWN_GOLD) >= known.rules.unit_cost_gold[kind])


@compiled
def can_pay_tower(planes: Any, known: Any, kind: int) -> bool:
    """Whether gold and lumber suffice."""
    has_gold = level(planes, OWN_GOLD) >= known.rules.tower_cost_gold[kind]
    return bool(has_gold and level(planes, OWN_LUMBER) >= known.rules.tower_cost_lumber[kind])


@compiled
def is_free(planes: Any, known: Any, cell: int) -> bool:
    """Whether no own tower stands in the cell."""
    row = cell // known.rules.build_columns
    column = 1 + cell - row * known.rules.build_columns
    taken = 0
    for kind in range(t.NUM_TOWER_KINDS):
        taken += int(planes[OWN_TOWERS + kind, row, column])
    return taken == 0


@compiled
def first_free(planes: Any, known: Any, order: Any) -> int:
    """The first free cell of `order`, or NO_CELL."""
    for place in range(order.shape[0]):
        if is_free(planes, known, order[place]):
            return int(order[place])
    return NO_CELL


@compiled
def pass_turn(known: Any) -> int:
    """The no-op."""
    return CLASSIC_NOOP if known.rules.action_space == CLASSIC else SPATIAL_NOOP


@compiled
def order_unit(known: Any, kind: int) -> int:
    """Buy a unit."""
    first = FIRST_CLASSIC_UNIT if known.rules.action_space == CLASSIC else FIRST_SPATIAL_UNIT
    return first + kind


@compiled
def order_tower(planes: Any, known: Any, kind: int, cell: int) -> int:
    """Build at the cell; with the classic actions first walk the cursor there."""
    rules = known.rules
    if cell == NO_CELL:
        return pass_turn(known)
    if rules.action_space != CLASSIC:
        return int(FIRST_SPATIAL_TOWER + kind * rules.rows * rules.build_columns + cell)
    row = cell // rules.build_columns
    column = 1 + cell - row * rules.build_columns
    for cursor_row in range(rules.rows):
        for cursor_column in range(rules.columns):
            if planes[CURSOR, cursor_row, cursor_column] != 0:
                if cursor_row != row:
                    return CURSOR_UP if cursor_row > row else CURSOR_DOWN
                if cursor_column != column:
                    return CURSOR_LEFT if cursor_column > column else CURSOR_RIGHT
    return FIRST_CLASSIC_TOWER + kind
