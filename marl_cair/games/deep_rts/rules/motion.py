"""Walking. All who are due name the cell that they want; then the claims are settled at once.

A claim is decided by what a mirrored game decides the same way: straight steps before diagonal
ones before units that leave a building, then more health, then a lot drawn for the serial number.
Only mirror images, of equal serials, stand off: then none moves.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts.rules import board
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.dice import precedence_of
from marl_cair.games.deep_rts.rules.paths import forget_path
from marl_cair.games.deep_rts.rules.roster import enter_state

MAX_BLOCKED = 100
LONGEST_WAIT_TICKS = 32
_CLASS_WEIGHT = 100_000  # above any health


@compiled
def begin_step(world: Any, rules: Any, unit: int, direction: int) -> None:
    """Set out for the neighbouring cell; the unit stands there when the ticks are over."""
    there = world.units[unit, s.UNIT_CELL] + rules.offset[direction]
    ticks = (
        rules.kinds[world.units[unit, s.UNIT_KIND], rb.KIND_WALK_TICKS]
        * rules.tiles[world.board[s.TILE, there], rb.WALK_PERCENT]
        // 100
    )
    world.units[unit, s.UNIT_FACING] = direction
    enter_state(world, unit, s.WALKING, world.clock[s.TICK] + max(1, ticks))


@compiled
def get_stuck(world: Any, unit: int) -> None:
    """Wait longer after each vain plan."""
    if world.units[unit, s.UNIT_BLOCKED] < MAX_BLOCKED:
        world.units[unit, s.UNIT_BLOCKED] += 1
    ticks = min(LONGEST_WAIT_TICKS, 1 << min(5, int(world.units[unit, s.UNIT_BLOCKED])))
    enter_state(world, unit, s.WAITING, world.clock[s.TICK] + ticks)


# --- claims ------------------------------------------------------------------------------------


@compiled_copy
def strength(world: Any, unit: int) -> int:
    """What decides between claims."""
    rank = 0
    if world.units[unit, s.UNIT_STATE] == s.WALKING:
        rank = 2 if world.units[unit, s.UNIT_FACING] <= board.LAST_STRAIGHT else 1
    return int(rank * _CLASS_WEIGHT + int(world.units[unit, s.UNIT_HEALTH]))


@compiled
def claim(world: Any, rules: Any, unit: int, cell: int) -> None:
    """Name the cell that the unit wants. `world.claim` holds the best so far + 1, negative where
    equals of different players want it.
    """
    world.units[unit, s.UNIT_EXIT] = cell
    held = int(world.board[s.CLAIM, cell])
    if held == 0:
        world.board[s.CLAIM, cell] = unit + 1
        return
    rival = abs(held) - 1
    own, other = strength(world, unit), strength(world, rival)
    if own == other:
        own = precedence_of(world, int(world.units[unit, s.UNIT_SERIAL]))
        other = precedence_of(world, int(world.units[rival, s.UNIT_SERIAL]))
    if own > other:
        world.board[s.CLAIM, cell] = unit + 1
    elif own == other:
        world.board[s.CLAIM, cell] = -abs(held)


@compiled
def wins_claim(world: Any, unit: int) -> bool:
    """True where the unit gets the cell that it wants."""
    cell = world.units[unit, s.UNIT_EXIT]
    return bool(cell > s.NO_GOAL and world.board[s.CLAIM, cell] == unit + 1)


@compiled
def claim_step(world: Any, rules: Any, unit: int) -> None:
    """A walker names the cell before it; two of one player that meet change places."""
    if world.units[unit, s.UNIT_EXIT] != s.NO_GOAL:
        return  # it changes places with one that acted before it
    direction = int(world.units[unit, s.UNIT_FACING])
    cell = int(world.units[unit, s.UNIT_CELL])
    there = int(cell + rules.offset[direction])
    if board.cuts_corner(world, rules, cell, direction):
        return  # something was built there since it set out
    if board.is_free(world, rules, there):
        claim(world, rules, unit, there)
        return
    if is_fellow_coming(world, rules, unit, there):
        other = int(world.board[s.OCCUPANT, there])
        if world.units[other, s.UNIT_EXIT] == s.NO_GOAL:
            change_places(world, unit, other)


@compiled
def is_fellow_coming(world: Any, rules: Any, unit: int, there: int) -> bool:
    """True where another unit of the owner walks from `there` to where `unit` stands."""
    other = int(world.board[s.OCCUPANT, there])
    if other == s.NO_UNIT or board.owner_of(rules, other) != board.owner_of(rules, unit):
        return False
    is_facing = (
        there + rules.offset[world.units[other, s.UNIT_FACING]] == world.units[unit, s.UNIT_CELL]
    )
    return bool(is_facing and world.units[other, s.UNIT_STATE] == s.WALKING)


@compiled
def change_places(world: Any, unit: int, other: int) -> None:
    """Both get the other's cell, which no other unit can claim; the other's step ends now."""
    for one, cell in (
        (unit, world.units[other, s.UNIT_CELL]),
        (other, world.units[unit, s.UNIT_CELL]),
    ):
        world.units[one, s.UNIT_EXIT] = cell
        world.board[s.CLAIM, cell] = one + 1
    if world.due[other] > world.clock[s.TICK]:
        world.due[other] = world.clock[s.TICK]
        world.acting[world.clock[s.NUM_ACTING]] = other
        world.clock[s.NUM_ACTING] += 1


@compiled
def move_unit(world: Any, rules: Any, unit: int, there: int) -> None:
    """The unit stands at `there` now, and sees from there."""
    cell = int(world.units[unit, s.UNIT_CELL])
    if world.board[s.OCCUPANT, cell] == unit:
        world.board[s.OCCUPANT, cell] = s.NO_UNIT
    world.board[s.OCCUPANT, there] = unit
    world.units[unit, s.UNIT_CELL] = there
    world.units[unit, s.UNIT_BLOCKED] = 0
    world.clock[s.NUM_BURNING] -= int(rules.tiles[world.board[s.TILE, cell], rb.TILE_DAMAGE] > 0)
    world.clock[s.NUM_BURNING] += int(rules.tiles[world.board[s.TILE, there], rb.TILE_DAMAGE] > 0)
    if rules.fog != 0:
        player, sight = (
            board.owner_of(rules, unit),
            board.sight_of(rules, world.units[unit, s.UNIT_KIND]),
        )
        for centre, change in ((there, 1), (cell, -1)):
            board.change_sight(world, rules, player, centre, sight, change)


@compiled
def settle_step(world: Any, rules: Any, unit: int) -> None:
    """A walker gets its cell, or is blocked."""
    if wins_claim(world, unit):
        move_unit(world, rules, unit, int(world.units[unit, s.UNIT_EXIT]))
    else:
        # The step that it could not take is planned again.
        forget_path(world, unit)
        world.units[unit, s.UNIT_BLOCKED] = min(
            MAX_BLOCKED, int(world.units[unit, s.UNIT_BLOCKED]) + 1
        )
    world.units[unit, s.UNIT_STATE] = s.WAITING


@compiled
def claim_exit(world: Any, rules: Any, building: int) -> None:
    """Who leaves a building wants the nearest free ground around it."""
    centre = int(world.units[building, s.UNIT_CELL])
    half = int(rules.kinds[world.units[building, s.UNIT_KIND], rb.KIND_HALF_SIZE])
    frame = rules.seats[world.clock[s.MAP_INDEX], board.owner_of(rules, building), rb.SEAT_FRAME]
    row, column = int(rules.cells[centre, rb.CELL_ROW]), int(rules.cells[centre, rb.CELL_COLUMN])
    for place in range(rules.exits.shape[1]):
        rows = int(rules.exits[frame, place, rb.EXIT_ROW])
        columns = int(rules.exits[frame, place, rb.EXIT_COLUMN])
        if max(abs(rows), abs(columns)) <= half:
            continue
        if not 0 <= row + rows < rules.rows or not 0 <= column + columns < rules.columns:
            continue
        cell = centre + rows * rules.stride + columns
        if (
            board.is_free(world, rules, cell)
            and rules.tiles[world.board[s.TILE, cell], rb.TILE_DAMAGE] == 0
        ):
            claim(world, rules, building, cell)
            return


@compiled
def clear_claims(world: Any) -> None:
    """Wipe the claims of the acting units."""
    for place in range(world.clock[s.NUM_ACTING]):
        unit = world.acting[place]
        if world.units[unit, s.UNIT_EXIT] > s.NO_GOAL:
            world.board[s.CLAIM, world.units[unit, s.UNIT_EXIT]] = 0
            world.units[unit, s.UNIT_EXIT] = s.NO_GOAL
