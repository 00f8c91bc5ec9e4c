"""Walking. All who are due name the cell that they want; then the claims are settled at once.

A claim is decided by what a mirrored game decides the same way: straight steps before diagonal
ones before units that leave a building, then more health, then a lot drawn for the serial number.
Only mirror images, of equal serials, stand off: then nobody moves.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts.rules.board import (
    LAST_STRAIGHT,
    cuts_corner,
    is_free,
    look,
    owner_of,
    sight_of,
)
from marl_cair.games.deep_rts.rules.dice import precedence_of
from marl_cair.games.deep_rts.rules.paths import forget_path
from marl_cair.games.deep_rts.rules.roster import enter_state
from marl_cair.games.deep_rts.rules.rulebook import (
    CELL_COLUMN,
    CELL_ROW,
    EXIT_COLUMN,
    EXIT_ROW,
    KIND_HALF_SIZE,
    KIND_WALK_TICKS,
    SEAT_FRAME,
    TILE_DAMAGE,
    WALK_PERCENT,
)
from marl_cair.games.deep_rts.state import (
    CLAIM,
    MAP_INDEX,
    NO_GOAL,
    NO_UNIT,
    NUM_ACTING,
    NUM_BURNING,
    OCCUPANT,
    TICK,
    TILE,
    UNIT_BLOCKED,
    UNIT_CELL,
    UNIT_EXIT,
    UNIT_FACING,
    UNIT_HEALTH,
    UNIT_KIND,
    UNIT_SERIAL,
    UNIT_STATE,
    WAITING,
    WALKING,
)

MAX_BLOCKED = 100
LONGEST_WAIT_TICKS = 32
_CLASS_WEIGHT = 100_000  # above any health


@compiled
def begin_step(world: Any, rules: Any, unit: int, direction: int) -> None:
    """Set out for the neighbouring cell; the unit stands there when the ticks are over."""
    there = world.units[unit, UNIT_CELL] + rules.offset[direction]
    ticks = (
        rules.kinds[world.units[unit, UNIT_KIND], KIND_WALK_TICKS]
        * rules.tiles[world.board[TILE, there], WALK_PERCENT]
        // 100
    )
    world.units[unit, UNIT_FACING] = direction
    enter_state(world, unit, WALKING, world.clock[TICK] + max(1, ticks))


@compiled
def get_stuck(world: Any, unit: int) -> None:
    """Wait longer after each vain plan."""
    if world.units[unit, UNIT_BLOCKED] < MAX_BLOCKED:
        world.units[unit, UNIT_BLOCKED] += 1
    ticks = min(LONGEST_WAIT_TICKS, 1 << min(5, int(world.units[unit, UNIT_BLOCKED])))
    enter_state(world, unit, WAITING, world.clock[TICK] + ticks)


# --- claims ------------------------------------------------------------------------------------


@compiled_copy
def strength(world: Any, unit: int) -> int:
    """What decides between claims."""
    rank = 0
    if world.units[unit, UNIT_STATE] == WALKING:
        rank = 2 if world.units[unit, UNIT_FACING] <= LAST_STRAIGHT else 1
    return int(rank * _CLASS_WEIGHT + int(world.units[unit, UNIT_HEALTH]))


@compiled
def claim(world: Any, rules: Any, unit: int, cell: int) -> None:
    """Name the cell that the unit wants. `world.claim` holds the best so far + 1, negative where
    equals of different players want it.
    """
    world.units[unit, UNIT_EXIT] = cell
    held = int(world.board[CLAIM, cell])
    if held == 0:
        world.board[CLAIM, cell] = unit + 1
        return
    rival = abs(held) - 1
    own, other = strength(world, unit), strength(world, rival)
    if own == other:
        own = precedence_of(world, int(world.units[unit, UNIT_SERIAL]))
        other = precedence_of(world, int(world.units[rival, UNIT_SERIAL]))
    if own > other:
        world.board[CLAIM, cell] = unit + 1
    elif own == other:
        world.board[CLAIM, cell] = -abs(held)


@compiled
def wins_claim(world: Any, unit: int) -> bool:
    """True where the unit gets the cell that it wants."""
    cell = world.units[unit, UNIT_EXIT]
    return bool(cell > NO_GOAL and world.board[CLAIM, cell] == unit + 1)


@compiled
def claim_step(world: Any, rules: Any, unit: int) -> None:
    """A walker names the cell before it; two of one player that meet change places."""
    if world.units[unit, UNIT_EXIT] != NO_GOAL:
        return  # it changes places with one that acted before it
    direction = int(world.units[unit, UNIT_FACING])
    cell = int(world.units[unit, UNIT_CELL])
    there = int(cell + rules.offset[direction])
    if cuts_corner(world, rules, cell, direction):
        return  # something was built there since it set out
    if is_free(world, rules, there):
        claim(world, rules, unit, there)
        return
    if is_fellow_coming(world, rules, unit, there):
        other = int(world.board[OCCUPANT, there])
        if world.units[other, UNIT_EXIT] == NO_GOAL:
            change_places(world, unit, other)


@compiled
def is_fellow_coming(world: Any, rules: Any, unit: int, there: int) -> bool:
    """True where another unit of the owner walks from `there` to where `unit` stands."""
    other = int(world.board[OCCUPANT, there])
    if other == NO_UNIT or owner_of(rules, other) != owner_of(rules, unit):
        return False
    is_facing = (
        there + rules.offset[world.units[other, UNIT_FACING]] == world.units[unit, UNIT_CELL]
    )
    return bool(is_facing and world.units[other, UNIT_STATE] == WALKING)


@compiled
def change_places(world: Any, unit: int, other: int) -> None:
    """Both get the other's cell, which nobody else can claim; the other's step ends now."""
    for one, cell in ((unit, world.units[other, UNIT_CELL]), (other, world.units[unit, UNIT_CELL])):
        world.units[one, UNIT_EXIT] = cell
        world.board[CLAIM, cell] = one + 1
    if world.due[other] > world.clock[TICK]:
        world.due[other] = world.clock[TICK]
        world.acting[world.clock[NUM_ACTING]] = other
        world.clock[NUM_ACTING] += 1


@compiled
def move_unit(world: Any, rules: Any, unit: int, there: int) -> None:
    """The unit stands at `there` now, and sees from there."""
    cell = int(world.units[unit, UNIT_CELL])
    if world.board[OCCUPANT, cell] == unit:
        world.board[OCCUPANT, cell] = NO_UNIT
    world.board[OCCUPANT, there] = unit
    world.units[unit, UNIT_CELL] = there
    world.units[unit, UNIT_BLOCKED] = 0
    world.clock[NUM_BURNING] -= int(rules.tiles[world.board[TILE, cell], TILE_DAMAGE] > 0)
    world.clock[NUM_BURNING] += int(rules.tiles[world.board[TILE, there], TILE_DAMAGE] > 0)
    if rules.fog != 0:
        player, sight = owner_of(rules, unit), sight_of(rules, world.units[unit, UNIT_KIND])
        for centre, change in ((there, 1), (cell, -1)):
            look(world, rules, player, centre, sight, change)


@compiled
def settle_step(world: Any, rules: Any, unit: int) -> None:
    """A walker gets its cell, or is blocked."""
    if wins_claim(world, unit):
        move_unit(world, rules, unit, int(world.units[unit, UNIT_EXIT]))
    else:
        # The step that it could not take is planned anew.
        forget_path(world, unit)
        world.units[unit, UNIT_BLOCKED] = min(MAX_BLOCKED, int(world.units[unit, UNIT_BLOCKED]) + 1)
    world.units[unit, UNIT_STATE] = WAITING


@compiled
def claim_exit(world: Any, rules: Any, building: int) -> None:
    """Who leaves a building wants the nearest free ground around it."""
    centre = int(world.units[building, UNIT_CELL])
    half = int(rules.kinds[world.units[building, UNIT_KIND], KIND_HALF_SIZE])
    frame = rules.seats[world.clock[MAP_INDEX], owner_of(rules, building), SEAT_FRAME]
    row, column = int(rules.cells[centre, CELL_ROW]), int(rules.cells[centre, CELL_COLUMN])
    for place in range(rules.exits.shape[1]):
        rows = int(rules.exits[frame, place, EXIT_ROW])
        columns = int(rules.exits[frame, place, EXIT_COLUMN])
        if max(abs(rows), abs(columns)) <= half:
            continue
        if not 0 <= row + rows < rules.rows or not 0 <= column + columns < rules.columns:
            continue
        cell = centre + rows * rules.stride + columns
        if is_free(world, rules, cell) and rules.tiles[world.board[TILE, cell], TILE_DAMAGE] == 0:
            claim(world, rules, building, cell)
            return


@compiled
def clear_claims(world: Any) -> None:
    """Wipe the claims of the acting units."""
    for place in range(world.clock[NUM_ACTING]):
        unit = world.acting[place]
        if world.units[unit, UNIT_EXIT] > NO_GOAL:
            world.board[CLAIM, world.units[unit, UNIT_EXIT]] = 0
            world.units[unit, UNIT_EXIT] = NO_GOAL
