"""The cursor: the unit of each player that its next order is for."""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t


@compiled_copy
def is_selectable(world: Any, unit: int) -> bool:
    """False for a builder inside its site."""
    return bool(world.units[unit, s.UNIT_STATE] != s.INSIDE)


@compiled
def place_in_roster(world: Any, player: int, unit: int) -> int:
    """The unit's place, -1 for none."""
    for place in range(world.players[player, s.NUM_UNITS]):
        if world.roster[player, place] == unit:
            return place
    return -1


@compiled
def step_cursor(world: Any, player: int, step: int) -> None:
    """Select the next (1) or previous (-1) unit, the first or last if none is selected."""
    count = int(world.players[player, s.NUM_UNITS])
    place = place_in_roster(world, player, world.players[player, s.CURSOR])
    if place < 0 and step < 0:
        place = 0
    for _ in range(count):
        place = (place + step) % count
        if is_selectable(world, world.roster[player, place]):
            world.players[player, s.CURSOR] = world.roster[player, place]
            return
    world.players[player, s.CURSOR] = s.NO_UNIT


@compiled_copy
def waits_for_order(world: Any, unit: int) -> bool:
    """True for units that walk and have nothing to do."""
    if world.units[unit, s.UNIT_KIND] < t.NUM_MOBILE_KINDS:
        return bool(world.units[unit, s.UNIT_ORDER] == s.NO_ORDER and is_selectable(world, unit))
    return False


@compiled
def pass_cursor(world: Any, player: int) -> None:
    """After an order: to the next unit that waits for one, else to the next unit."""
    count = int(world.players[player, s.NUM_UNITS])
    start = place_in_roster(world, player, world.players[player, s.CURSOR])
    for step in range(1, count + 1):
        unit = world.roster[player, (start + step) % count]
        if waits_for_order(world, unit):
            world.players[player, s.CURSOR] = unit
            return
    step_cursor(world, player, 1)


@compiled
def num_others(world: Any, player: int) -> int:
    """Units that the cursor could go to."""
    count = 0
    for place in range(world.players[player, s.NUM_UNITS]):
        unit = world.roster[player, place]
        if unit != world.players[player, s.CURSOR] and is_selectable(world, unit):
            count += 1
    return count
