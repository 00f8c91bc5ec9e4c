"""How a unit looks in the planes, packed into one word: equal words are drawn alike.

A word says all that any seat sees of a unit but whose it is, which its slot tells. 0 is a unit that
does not stand on the board.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts.rules.board import owner_of
from marl_cair.games.deep_rts.rules.rulebook import KIND_HALF_SIZE, KIND_HEALTH
from marl_cair.games.deep_rts.state import (
    CURSOR,
    FIGHTING,
    GATHERING,
    NEVER,
    NO_ORDER,
    OCCUPANT,
    PUMPING,
    REPAIRING,
    RISING,
    TICK,
    TRAINING,
    UNIT_CARRY,
    UNIT_CARRY_KIND,
    UNIT_CELL,
    UNIT_HEALTH,
    UNIT_KIND,
    UNIT_ORDER,
    UNIT_SINCE,
    UNIT_STATE,
    WALKING,
)
from marl_cair.games.deep_rts.tables import STONE
from marl_cair.games.deep_rts.views.planes import (
    CARRIES,
    FIRST_KIND,
    FULL,
    HAS_ORDER,
    HEALTH,
    IS_FIGHTING,
    IS_RISING,
    IS_WALKING,
    IS_WORKING,
    OWN,
    PROGRESS,
    SELECTED,
)

NOT_SHOWN = 0
# First bits of a word's parts; bit 0 is set in all words of units on the board.
CELL_BIT, KIND_BIT, HEALTH_BIT, ACTIVITY_BIT, RISING_BIT = 1, 16, 20, 28, 30
ORDER_BIT, SELECTED_BIT, CARRY_BIT, CARRY_KIND_BIT, PROGRESS_BIT = 31, 32, 33, 41, 43
CELL_MASK, KIND_MASK, LEVEL_MASK, PAIR_MASK = 0x7FFF, 0xF, 0xFF, 0x3


@compiled_copy
def side_of(rules: Any, player: int, owner: int) -> int:
    """0 own, 1 ally, 2 enemy."""
    return 0 if owner == player else (1 if rules.team[owner] == rules.team[player] else 2)


@compiled
def progress_level(world: Any, unit: int) -> int:
    """How much of the unit's activity is done, 0..255."""
    since, due = int(world.units[unit, UNIT_SINCE]), int(world.due[unit])
    if due == NEVER or due <= since:
        return 0
    return int(min(FULL, FULL * (int(world.clock[TICK]) - since) // (due - since)))


@compiled
def activity_of(state: int) -> int:
    """1 walks, 2 works, 3 fights, 0 nothing that has a plane."""
    if state == WALKING:
        return 1 + IS_WALKING - IS_WALKING
    if state in (GATHERING, REPAIRING, TRAINING, PUMPING):
        return 1 + IS_WORKING - IS_WALKING
    if state == FIGHTING:
        return 1 + IS_FIGHTING - IS_WALKING
    return 0


@compiled
def carried_level(world: Any, rules: Any, unit: int) -> int:
    """How full the hands of a worker are, 0..255; only what has a plane counts."""
    carry = int(world.units[unit, UNIT_CARRY])
    if carry <= 0 or world.units[unit, UNIT_CARRY_KIND] > STONE:
        return 0
    return int(min(FULL, FULL * carry // max(1, int(rules.carry_capacity))))


@compiled
def look_of(world: Any, rules: Any, unit: int) -> int:
    """The word of a unit as it is now."""
    cell = int(world.units[unit, UNIT_CELL])
    if world.board[OCCUPANT, cell] != unit:
        return NOT_SHOWN  # inside a site
    kind, state = int(world.units[unit, UNIT_KIND]), int(world.units[unit, UNIT_STATE])
    health = FULL * int(world.units[unit, UNIT_HEALTH]) // int(rules.kinds[kind, KIND_HEALTH])
    carried = carried_level(world, rules, unit)
    word = 1 | cell << CELL_BIT | kind << KIND_BIT | max(1, health) << HEALTH_BIT
    word |= activity_of(state) << ACTIVITY_BIT | int(state == RISING) << RISING_BIT
    word |= int(world.units[unit, UNIT_ORDER] != NO_ORDER) << ORDER_BIT
    is_selected = world.players[owner_of(rules, unit), CURSOR] == unit
    word |= int(is_selected) << SELECTED_BIT
    if carried > 0:
        word |= carried << CARRY_BIT
        word |= int(world.units[unit, UNIT_CARRY_KIND]) << CARRY_KIND_BIT
    return int(word | progress_level(world, unit) << PROGRESS_BIT)


@compiled_copy
def cell_in(word: int) -> int:
    """Where the unit stands, the centre of a building."""
    return int(word >> CELL_BIT & CELL_MASK)


@compiled_copy
def half_size_in(rules: Any, word: int) -> int:
    """Cells that the unit covers on each side of its centre."""
    return int(rules.kinds[word >> KIND_BIT & KIND_MASK, KIND_HALF_SIZE])


@compiled_copy
def differs_in_progress_alone(word: int, other: int) -> bool:
    """True where nothing else has changed."""
    return bool((word ^ other) >> PROGRESS_BIT << PROGRESS_BIT == word ^ other)


@compiled
def mark_progress(word: int, side: int, row: int, column: int, is_shown: int, out: Any) -> None:
    """The plane of progress at one cell: of own units, and of all sites."""
    if side == 0 or word >> RISING_BIT & 1:
        out[PROGRESS, row, column] = (word >> PROGRESS_BIT & LEVEL_MASK) * is_shown


@compiled
def mark(word: int, side: int, row: int, column: int, is_shown: int, out: Any) -> None:
    """Write the planes of a unit at one cell that it covers, or (is_shown 0) wipe them."""
    out[FIRST_KIND + (word >> KIND_BIT & KIND_MASK), row, column] = FULL * is_shown
    out[OWN + side, row, column] = FULL * is_shown
    out[HEALTH, row, column] = (word >> HEALTH_BIT & LEVEL_MASK) * is_shown
    activity = word >> ACTIVITY_BIT & PAIR_MASK
    if activity != 0:
        out[IS_WALKING - 1 + activity, row, column] = FULL * is_shown
    if word >> RISING_BIT & 1:
        out[IS_RISING, row, column] = FULL * is_shown
    mark_progress(word, side, row, column, is_shown, out)
    if side != 0:
        return
    if word >> ORDER_BIT & 1:
        out[HAS_ORDER, row, column] = FULL * is_shown
    if word >> SELECTED_BIT & 1:
        out[SELECTED, row, column] = FULL * is_shown
    carried = word >> CARRY_BIT & LEVEL_MASK
    if carried != 0:
        out[CARRIES + (word >> CARRY_KIND_BIT & PAIR_MASK), row, column] = carried * is_shown
