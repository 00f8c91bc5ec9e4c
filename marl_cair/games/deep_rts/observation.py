"""What each player of Deep RTS sees, from its own side: a seat's view is turned or mirrored so that
every base lies where the first seat's lies. Under fog only what is in sight, and remembered ground.

Hidden from an agent: others' stores, orders, queues and selections, and the random word.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts.board import remembered_tile, sees
from marl_cair.games.deep_rts.roster import food_limit
from marl_cair.games.deep_rts.rulebook import (
    KIND_HALF_SIZE,
    KIND_HEALTH,
    NO_FEATURE,
    SEAT_FRAME,
    TILE_AMOUNT,
)
from marl_cair.games.deep_rts.state import (
    AMOUNT,
    CURSOR,
    FIGHTING,
    FOOD_USED,
    GATHERING,
    MAP_INDEX,
    NEVER,
    NO_ORDER,
    NUM_UNITS,
    OCCUPANT,
    PUMPING,
    REPAIRING,
    RESOURCES,
    RISING,
    TICK,
    TILE,
    TRAINING,
    UNIT_CARRY,
    UNIT_CARRY_KIND,
    UNIT_CELL,
    UNIT_HEALTH,
    UNIT_KIND,
    UNIT_ORDER,
    UNIT_SINCE,
    UNIT_STATE,
    UNKNOWN,
    UPGRADES,
    WALKING,
    world_at,
)
from marl_cair.games.deep_rts.tables import (
    GRASS,
    NUM_KINDS,
    NUM_RESOURCES,
    NUM_TILE_KINDS,
    NUM_UPGRADES,
    RESOURCE_NAMES,
    STONE,
    TILE_NAMES,
    UNIT_NAMES,
    UPGRADE_NAMES,
)

FULL = 255
UNIFORM_NAMES = (
    *(f"own {name}" for name in RESOURCE_NAMES),
    "own food used",
    "own food limit",
    *(f"own {name}" for name in UPGRADE_NAMES),
    "time left",
)
PLANE_NAMES = (
    *TILE_NAMES[1:],
    "resource left",
    *UNIT_NAMES,
    "own",
    "ally",
    "enemy",
    "health",
    "walking",
    "working",
    "fighting",
    "progress",
    "under construction",
    "own with an order",
    "own carrying gold",
    "own carrying lumber",
    "own carrying stone",
    "selected",
    "visible",
    "explored",
    *UNIFORM_NAMES,
)
FIRST_TILE = 0  # minus grass, which has no plane
RESOURCE_LEFT = NUM_TILE_KINDS - 1
FIRST_KIND = RESOURCE_LEFT + 1
OWN = FIRST_KIND + NUM_KINDS
(
    OWN,
    ALLY,
    ENEMY,
    HEALTH,
    IS_WALKING,
    IS_WORKING,
    IS_FIGHTING,
    PROGRESS,
    IS_RISING,
    HAS_ORDER,
    CARRIES,
) = range(OWN, OWN + 11)
SELECTED = CARRIES + 3
VISIBLE = SELECTED + 1
EXPLORED = VISIBLE + 1
FIRST_UNIFORM = EXPLORED + 1
OWN_FOOD = FIRST_UNIFORM + NUM_RESOURCES
FOOD_LIMIT = OWN_FOOD + 1
FIRST_UPGRADE_PLANE = FOOD_LIMIT + 1
TIME_LEFT = FIRST_UPGRADE_PLANE + NUM_UPGRADES

LOG_STEP = 12.0  # levels that a doubling of a store is worth: 2**20 fits
FOOD_STEP = 5  # levels for one food, of at most 50
UPGRADE_STEP = 100


@compiled
def log_level(amount: int) -> int:
    """A store of 0..10**6 on a scale that tells small amounts apart, 0..239."""
    return int(LOG_STEP * np.log2(1.0 + amount) + 0.5)


@compiled
def side_of(rules: Any, player: int, owner: int) -> int:
    """0 own, 1 ally, 2 enemy."""
    if owner == player:
        return 0
    return 1 if rules.team[owner] == rules.team[player] else 2


@compiled
def progress_level(world: Any, unit: int) -> int:
    """How much of the unit's activity is done, 0..255."""
    since, due = int(world.units[unit, UNIT_SINCE]), int(world.due[unit])
    if due == NEVER or due <= since:
        return 0
    return int(min(FULL, FULL * (int(world.clock[TICK]) - since) // (due - since)))


@compiled
def activity_plane(world: Any, unit: int) -> int:
    """The plane that shows what a unit is doing, 0 for none."""
    state = world.units[unit, UNIT_STATE]
    if state == WALKING:
        return IS_WALKING
    if state == FIGHTING:
        return IS_FIGHTING
    if state in (GATHERING, REPAIRING, TRAINING, PUMPING):
        return IS_WORKING
    return 0


@compiled
def see_tile(
    world: Any, rules: Any, cell: int, tile: int, row: int, column: int, is_seen: bool, out: Any
) -> None:
    """The plane of a tile, and how much is left in it where that is in sight."""
    out[FIRST_TILE + tile - 1, row, column] = FULL
    if is_seen and rules.tiles[tile, TILE_AMOUNT] > 0:
        left = max(0, int(world.board[AMOUNT, cell]))
        out[RESOURCE_LEFT, row, column] = min(FULL, int(left * rules.level_per_unit[tile]))


@compiled
def see_ground(world: Any, rules: Any, frame: int, out: Any) -> None:
    """Terrain and resources where everything is in sight."""
    index = world.clock[MAP_INDEX]
    for place in range(rules.features.shape[1]):
        cell = int(rules.features[index, place])
        if cell == NO_FEATURE:
            return
        tile = int(world.board[TILE, cell])
        if tile != GRASS:
            row = int(rules.own_place[frame, cell, 0])
            column = int(rules.own_place[frame, cell, 1])
            see_tile(world, rules, cell, tile, row, column, True, out)


@compiled
def see_through_fog(world: Any, rules: Any, player: int, frame: int, out: Any) -> None:
    """What is in sight of the ground, and what is remembered of it."""
    for row in range(rules.rows):
        for column in range(rules.columns):
            cell = int(rules.world_cell[frame, row * rules.columns + column])
            is_seen = sees(world, rules, player, cell)
            tile = int(world.board[TILE, cell])
            if not is_seen:
                tile = remembered_tile(world, rules, player, cell)
            out[VISIBLE, row, column] = FULL * int(is_seen)
            out[EXPLORED, row, column] = FULL * int(tile != UNKNOWN)
            if not (tile == GRASS or tile == UNKNOWN):  # noqa: PLR1714, SIM109  # faster
                see_tile(world, rules, cell, tile, row, column, is_seen, out)


@compiled
def carried_level(world: Any, rules: Any, unit: int) -> int:
    """How full the hands of a worker are, 0..255; only what has a plane counts."""
    if world.units[unit, UNIT_CARRY] <= 0 or world.units[unit, UNIT_CARRY_KIND] > STONE:
        return 0
    share = FULL * int(world.units[unit, UNIT_CARRY]) // max(1, int(rules.carry_capacity))
    return int(min(FULL, share))


@compiled
def see_unit(
    world: Any, rules: Any, player: int, unit: int, side: int, frame: int, out: Any
) -> None:
    """One unit, on each cell that it covers and that is in sight."""
    kind, centre = int(world.units[unit, UNIT_KIND]), int(world.units[unit, UNIT_CELL])
    health = FULL * int(world.units[unit, UNIT_HEALTH]) // int(rules.kinds[kind, KIND_HEALTH])
    activity = activity_plane(world, unit)
    is_rising = world.units[unit, UNIT_STATE] == RISING
    progress = progress_level(world, unit) if side == 0 or is_rising else 0
    carries = carried_level(world, rules, unit)
    half = int(rules.kinds[kind, KIND_HALF_SIZE])
    for rows in range(-half, half + 1):
        for columns in range(-half, half + 1):
            cell = centre + rows * rules.stride + columns
            if rules.fog != 0 and not sees(world, rules, player, cell):
                continue
            row = int(rules.own_place[frame, cell, 0])
            column = int(rules.own_place[frame, cell, 1])
            out[FIRST_KIND + kind, row, column] = FULL
            out[OWN + side, row, column] = FULL
            out[HEALTH, row, column] = max(1, health)
            if activity > 0:
                out[activity, row, column] = FULL
            if is_rising:
                out[IS_RISING, row, column] = FULL
            out[PROGRESS, row, column] = progress
            if side == 0:
                out[HAS_ORDER, row, column] = FULL * int(world.units[unit, UNIT_ORDER] != NO_ORDER)
                out[SELECTED, row, column] = FULL * int(world.players[player, CURSOR] == unit)
                if carries > 0:
                    out[CARRIES + world.units[unit, UNIT_CARRY_KIND], row, column] = carries


@compiled
def see_units(world: Any, rules: Any, player: int, frame: int, out: Any) -> None:
    """Everybody on the board that is in sight."""
    for owner in range(rules.num_players):
        side = side_of(rules, player, owner)
        for place in range(world.players[owner, NUM_UNITS]):
            unit = int(world.roster[owner, place])
            if world.board[OCCUPANT, world.units[unit, UNIT_CELL]] == unit:  # not inside a site
                see_unit(world, rules, player, unit, side, frame, out)


@compiled
def see_planes(world: Any, rules: Any, player: int, out: Any) -> None:
    """All planes of one seat: out uint8 [C, H, W]."""
    out[:FIRST_UNIFORM] = 0
    frame = int(rules.seats[world.clock[MAP_INDEX], player, SEAT_FRAME])
    if rules.fog == 0:
        out[VISIBLE:FIRST_UNIFORM] = FULL
        see_ground(world, rules, frame, out)
    else:
        see_through_fog(world, rules, player, frame, out)
    see_units(world, rules, player, frame, out)
    for resource in range(NUM_RESOURCES):
        out[FIRST_UNIFORM + resource] = log_level(int(world.players[player, RESOURCES + resource]))
    out[OWN_FOOD] = min(FULL, FOOD_STEP * int(world.players[player, FOOD_USED]))
    out[FOOD_LIMIT] = min(FULL, FOOD_STEP * food_limit(world, rules, player))
    for upgrade in range(NUM_UPGRADES):
        level = UPGRADE_STEP * int(world.players[player, UPGRADES + upgrade])
        out[FIRST_UPGRADE_PLANE + upgrade] = min(FULL, level)
    out[TIME_LEFT] = FULL * (rules.max_ticks - int(world.clock[TICK])) // rules.max_ticks


# --- slices of worlds ------------------------------------------------------------------------


@compiled
def observe_planes(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write every seat's planes: out uint8 [B, P, C, H, W]."""
    for index in range(first, last):
        world = world_at(worlds, index)
        for player in range(rules.num_players):
            see_planes(world, rules, player, out[index, player])
