"""Packs the appearance of a unit in the planes into one word: equal words are drawn alike.

A word holds all that any seat sees of a unit, except its owner, which follows from its slot. 0 is a
unit that does not stand on the board.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.board import owner_of
from marl_cair.games.deep_rts.views import planes

NOT_SHOWN = 0
# First bits of a word's parts; bit 0 is set in all words of units on the board.
CELL_BIT, KIND_BIT, HEALTH_BIT, ACTIVITY_BIT, RISING_BIT = 1, 16, 20, 28, 30
ORDER_BIT, SELECTED_BIT, CARRY_BIT, CARRY_KIND_BIT, PROGRESS_BIT = 31, 32, 33, 41, 43
# [state] -> 1 walks, 2 works, 3 fights, in the order of their planes; 0 has no plane.
_ACTIVITY = np.zeros(s.PUMPING + 1, np.int64)
_ACTIVITY[s.WALKING], _ACTIVITY[s.FIGHTING] = 1, 3
_ACTIVITY[[s.GATHERING, s.REPAIRING, s.TRAINING, s.PUMPING]] = 2
CELL_MASK, KIND_MASK, LEVEL_MASK, PAIR_MASK = 0x7FFF, 0xF, 0xFF, 0x3
ALL_BUT_PROGRESS = (1 << PROGRESS_BIT) - 1


@compiled_copy
def side_of(rules: Any, player: int, owner: int) -> int:
    """0 own, 1 ally, 2 enemy."""
    return 0 if owner == player else (1 if rules.team[owner] == rules.team[player] else 2)


@compiled
def progress_level(world: Any, unit: int) -> int:
    """Progress of the unit's activity, 0..255."""
    since, due = int(world.units[unit, s.UNIT_SINCE]), int(world.due[unit])
    if due == s.NEVER or due <= since:
        return 0
    return int(min(planes.FULL, planes.FULL * (int(world.clock[s.TICK]) - since) // (due - since)))


@compiled
def carried_level(world: Any, rules: Any, unit: int) -> int:
    """Load of a worker, 0..255; only resources with a plane count."""
    carry = int(world.units[unit, s.UNIT_CARRY])
    if carry <= 0 or world.units[unit, s.UNIT_CARRY_KIND] > t.STONE:
        return 0
    return int(min(planes.FULL, planes.FULL * carry // max(1, int(rules.carry_capacity))))


@compiled
def pack_appearance(world: Any, rules: Any, unit: int) -> int:
    """The word of a unit as it is now."""
    cell = int(world.units[unit, s.UNIT_CELL])
    if world.board[s.OCCUPANT, cell] != unit:
        return NOT_SHOWN  # inside a site
    kind, state = int(world.units[unit, s.UNIT_KIND]), int(world.units[unit, s.UNIT_STATE])
    health = planes.FULL * int(world.units[unit, s.UNIT_HEALTH])
    health //= int(rules.kinds[kind, rb.KIND_HEALTH])
    carried = carried_level(world, rules, unit)
    word = 1 | cell << CELL_BIT | kind << KIND_BIT | max(1, health) << HEALTH_BIT
    word |= _ACTIVITY[state] << ACTIVITY_BIT | int(state == s.RISING) << RISING_BIT
    word |= int(world.units[unit, s.UNIT_ORDER] != s.NO_ORDER) << ORDER_BIT
    is_selected = world.players[owner_of(rules, unit), s.CURSOR] == unit
    word |= int(is_selected) << SELECTED_BIT
    if carried > 0:
        word |= carried << CARRY_BIT
        word |= int(world.units[unit, s.UNIT_CARRY_KIND]) << CARRY_KIND_BIT
    return int(word | progress_level(world, unit) << PROGRESS_BIT)


@compiled
def mark_progress(word: int, side: int, row: int, column: int, is_shown: int, out: Any) -> None:
    """The plane of progress at one cell: of own units, and of all sites."""
    if side == 0 or word >> RISING_BIT & 1:
        out[planes.PROGRESS, row, column] = (word >> PROGRESS_BIT & LEVEL_MASK) * is_shown


@compiled
def mark(word: int, side: int, row: int, column: int, is_shown: int, out: Any) -> None:
    """Write the planes of a unit at one cell that it covers, or (is_shown 0) wipe them."""
    out[planes.FIRST_KIND + (word >> KIND_BIT & KIND_MASK), row, column] = planes.FULL * is_shown
    out[planes.OWN + side, row, column] = planes.FULL * is_shown
    out[planes.HEALTH, row, column] = (word >> HEALTH_BIT & LEVEL_MASK) * is_shown
    activity = word >> ACTIVITY_BIT & PAIR_MASK
    if activity != 0:
        out[planes.IS_WALKING - 1 + activity, row, column] = planes.FULL * is_shown
    if word >> RISING_BIT & 1:
        out[planes.IS_RISING, row, column] = planes.FULL * is_shown
    mark_progress(word, side, row, column, is_shown, out)
    if side != 0:
        return
    if word >> ORDER_BIT & 1:
        out[planes.HAS_ORDER, row, column] = planes.FULL * is_shown
    if word >> SELECTED_BIT & 1:
        out[planes.SELECTED, row, column] = planes.FULL * is_shown
    carried = word >> CARRY_BIT & LEVEL_MASK
    if carried != 0:
        out[planes.CARRIES + (word >> CARRY_KIND_BIT & PAIR_MASK), row, column] = carried * is_shown
