"""Walking: all units that are due claim the cell that they want; then the claims are settled.

A claim is decided by what is equal for mirror images: straight steps before diagonal ones before
units that leave a building, then more health, then a number drawn for the serial number. Only
mirror images, of equal serial numbers, tie: then none moves.
"""

from typing import Any

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import board
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.dice import precedence_of
from marl_cair.games.deep_rts.rules.paths import STEP_BITS, forget_path
from marl_cair.games.deep_rts.rules.roster import enter_state

MAX_BLOCKED = 100
LONGEST_WAIT_TICKS = 32
_CLASS_WEIGHT = 100_000  # above any health


@compiled
def begin_step(world: Any, rules: Any, unit: int, direction: int) -> None:
    """Start the next step of the path; the unit stands there when the ticks are over."""
    world.path[unit] = world.path[unit] >> STEP_BITS
    world.units[unit, s.UNIT_PATH_STEPS] -= 1
    there = world.units[unit, s.UNIT_CELL] + rules.offset[direction]
    percent = rules.tiles[world.board[s.TILE, there], rb.WALK_PERCENT]
    ticks = rules.kinds[world.units[unit, s.UNIT_KIND], rb.KIND_WALK_TICKS] * percent // 100
    world.units[unit, s.UNIT_FACING] = direction
    enter_state(world, unit, s.WALKING, world.clock[s.TICK] + max(1, ticks))


@compiled
def wait_blocked(world: Any, unit: int) -> None:
    """Wait, longer after each failed plan."""
    if world.units[unit, s.UNIT_BLOCKED] < MAX_BLOCKED:
        world.units[unit, s.UNIT_BLOCKED] += 1
    ticks = min(LONGEST_WAIT_TICKS, 1 << min(5, int(world.units[unit, s.UNIT_BLOCKED])))
    enter_state(world, unit, s.WAITING, world.clock[s.TICK] + ticks)


@compiled_copy
def strength(world: Any, unit: int) -> int:
    """The priority of a claim."""
    rank = 0
    if world.units[unit, s.UNIT_STATE] == s.WALKING:
        rank = 2 if world.units[unit, s.UNIT_FACING] <= board.LAST_STRAIGHT else 1
    return int(rank * _CLASS_WEIGHT + int(world.units[unit, s.UNIT_HEALTH]))


@compiled
def claim(world: Any, unit: int, cell: int) -> None:
    """Claim a cell. The layer CLAIM holds the best unit so far + 1, negative after a tie."""
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
    """True where the unit gets the cell that it claims."""
    cell = world.units[unit, s.UNIT_EXIT]
    return bool(cell > s.NO_GOAL and world.board[s.CLAIM, cell] == unit + 1)


@compiled
def claim_step(world: Any, rules: Any, unit: int) -> None:
    """Claim the cell ahead of a walker; two units of one player that face each other swap cells."""
    if world.units[unit, s.UNIT_EXIT] != s.NO_GOAL:
        return  # it swaps cells with a unit that acted before it
    direction, cell = int(world.units[unit, s.UNIT_FACING]), int(world.units[unit, s.UNIT_CELL])
    there = int(cell + rules.offset[direction])
    if board.cuts_corner(world, rules, cell, direction):
        return  # something was built there during the step
    if board.is_free(world, rules, there):
        claim(world, unit, there)
    elif can_swap(world, rules, unit, there):
        other = int(world.board[s.OCCUPANT, there])
        if world.units[other, s.UNIT_EXIT] == s.NO_GOAL:
            swap_cells(world, unit, other)


@compiled
def can_swap(world: Any, rules: Any, unit: int, there: int) -> bool:
    """True where another unit of the owner walks from `there` to the cell of `unit`."""
    other = int(world.board[s.OCCUPANT, there])
    if other == s.NO_UNIT or board.owner_of(rules, other) != board.owner_of(rules, unit):
        return False
    ahead = there + rules.offset[world.units[other, s.UNIT_FACING]]
    is_facing = ahead == world.units[unit, s.UNIT_CELL]
    return bool(is_facing and world.units[other, s.UNIT_STATE] == s.WALKING)


@compiled
def swap_cells(world: Any, unit: int, other: int) -> None:
    """Both get the other's cell, which no third unit can claim; the other's step ends now."""
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
def settle_step(world: Any, rules: Any, unit: int) -> None:
    """Move a walker to the cell that it claimed, or block it."""
    if wins_claim(world, unit):
        cell, there = int(world.units[unit, s.UNIT_CELL]), int(world.units[unit, s.UNIT_EXIT])
        board.count_unit(world, rules, unit, -1)
        if world.board[s.OCCUPANT, cell] == unit:  # else a unit that swapped is there already
            world.board[s.OCCUPANT, cell] = s.NO_UNIT
        world.board[s.OCCUPANT, there] = unit
        world.units[unit, s.UNIT_CELL] = there
        world.units[unit, s.UNIT_BLOCKED] = 0
        board.count_unit(world, rules, unit, 1)
    else:
        forget_path(world, unit)
        blocked = int(world.units[unit, s.UNIT_BLOCKED])
        world.units[unit, s.UNIT_BLOCKED] = min(MAX_BLOCKED, blocked + 1)
    world.units[unit, s.UNIT_STATE] = s.WAITING


@compiled
def exit_cell(world: Any, rules: Any, frame: int, centre: int, place: int) -> int:
    """The `place`-th nearest cell around `centre`; NO_GOAL where no unit can step out."""
    rows = int(rules.exits[frame, place, rb.EXIT_ROW])
    columns = int(rules.exits[frame, place, rb.EXIT_COLUMN])
    row, column = int(rules.cells[centre, rb.CELL_ROW]), int(rules.cells[centre, rb.CELL_COLUMN])
    if not 0 <= row + rows < rules.rows or not 0 <= column + columns < rules.columns:
        return s.NO_GOAL
    cell = int(centre + rows * rules.stride + columns)
    is_safe = board.tile_value(world, rules, cell, rb.TILE_DAMAGE) == 0
    return cell if is_safe and board.is_free(world, rules, cell) else s.NO_GOAL


@compiled
def claim_exit(world: Any, rules: Any, building: int) -> None:
    """Claim the nearest free cell around a building for the unit that is ready to leave it."""
    is_training = world.units[building, s.UNIT_STATE] == s.TRAINING
    if is_training and world.units[building, s.UNIT_QUEUE + 0] >= t.FIRST_UPGRADE:
        return
    frame = board.frame_of(world, rules, board.owner_of(rules, building))
    centre = int(world.units[building, s.UNIT_CELL])
    for place in range(rules.exits.shape[1]):
        cell = exit_cell(world, rules, frame, centre, place)
        if cell != s.NO_GOAL:
            claim(world, building, cell)
            return


@compiled
def clear_claims(world: Any) -> None:
    """Clear the claims of the acting units."""
    for place in range(world.clock[s.NUM_ACTING]):
        unit = world.acting[place]
        if world.units[unit, s.UNIT_EXIT] > s.NO_GOAL:
            world.board[s.CLAIM, world.units[unit, s.UNIT_EXIT]] = 0
            world.units[unit, s.UNIT_EXIT] = s.NO_GOAL
