"""What each player of Deep RTS sees, from its own side: a seat's view is turned or mirrored so that
every base lies where the first seat's lies. Under fog only what is in sight, and remembered ground.

Hidden from an agent: others' stores, orders, queues and selections, and the random word.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts.board import is_building, known_tile, owner_of, sees
from marl_cair.games.deep_rts.judging import score_of
from marl_cair.games.deep_rts.roster import food_limit
from marl_cair.games.deep_rts.rulebook import (
    KIND_ARMOUR,
    KIND_DAMAGE_MAX,
    KIND_DAMAGE_MIN,
    KIND_HALF_SIZE,
    KIND_HEALTH,
    KIND_PIERCING,
    SEAT_FRAME,
    TILE_AMOUNT,
)
from marl_cair.games.deep_rts.state import (
    AMOUNT,
    CURSOR,
    DAMAGE_DONE,
    DAMAGE_TAKEN,
    FIGHTING,
    FOOD_USED,
    GATHERED,
    GATHERING,
    MAP_INDEX,
    NEVER,
    NO_ORDER,
    NO_UNIT,
    NUM_OWNED,
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
    GOLD,
    GRASS,
    LUMBER,
    NO_RESOURCE,
    NUM_KINDS,
    NUM_MOBILE_KINDS,
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

VECTOR_NAMES = (
    *(f"own {name}" for name in RESOURCE_NAMES),
    *(f"gathered {name}" for name in RESOURCE_NAMES),
    "own food used",
    "own food limit",
    *(f"own {name}" for name in UPGRADE_NAMES),
    *(f"own {name}" for name in UNIT_NAMES),
    *(f"enemy {name} in sight" for name in UNIT_NAMES),
    "own damage done",
    "own damage taken",
    "own score",
    "ticks played",
    "ticks left",
)

CLASSIC_NAMES = (
    "tile",
    "owner",
    "building",
    "mobile",
    "kind",
    "health",
    "state",
    "carried",
    "attack",
    "armour",
)
CLASSIC_SELF, CLASSIC_ALLY, CLASSIC_ENEMY = 1, 2, 3


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
def see_ground(world: Any, rules: Any, player: int, frame: int, out: Any) -> None:
    """Terrain, what is left of resources, and the fog."""
    for row in range(rules.rows):
        for column in range(rules.columns):
            own = row * rules.columns + column
            cell = int(rules.world_cell[frame, own])
            tile = int(world.board[TILE, cell])
            is_seen = True
            if rules.fog != 0:
                is_seen = sees(world, rules, player, cell)
                tile = known_tile(world, rules, player, cell)
                out[VISIBLE, row, column] = FULL * int(is_seen)
                out[EXPLORED, row, column] = FULL * int(tile != UNKNOWN)
            if tile in (GRASS, UNKNOWN):
                continue
            out[FIRST_TILE + tile - 1, row, column] = FULL
            full = int(rules.tiles[tile, TILE_AMOUNT])
            if is_seen and full > 0:
                left = max(0, int(world.board[AMOUNT, cell]))
                out[RESOURCE_LEFT, row, column] = FULL * left // full


@compiled
def see_unit(
    world: Any, rules: Any, player: int, unit: int, row: int, column: int, out: Any
) -> None:
    """One cell of a unit."""
    kind = int(world.units[unit, UNIT_KIND])
    side = side_of(rules, player, owner_of(rules, unit))
    out[FIRST_KIND + kind, row, column] = FULL
    out[OWN + side, row, column] = FULL
    health = int(world.units[unit, UNIT_HEALTH])
    out[HEALTH, row, column] = max(1, FULL * health // int(rules.kinds[kind, KIND_HEALTH]))
    activity = activity_plane(world, unit)
    if activity > 0:
        out[activity, row, column] = FULL
    if world.units[unit, UNIT_STATE] == RISING:
        out[IS_RISING, row, column] = FULL
        out[PROGRESS, row, column] = progress_level(world, unit)
    if side != 0:
        return
    out[PROGRESS, row, column] = progress_level(world, unit)
    if world.units[unit, UNIT_ORDER] != NO_ORDER:
        out[HAS_ORDER, row, column] = FULL
    carried = int(world.units[unit, UNIT_CARRY_KIND])
    if world.units[unit, UNIT_CARRY] > 0 and carried in (GOLD, LUMBER, STONE):
        share = FULL * int(world.units[unit, UNIT_CARRY]) // max(1, int(rules.carry_capacity))
        out[CARRIES + carried, row, column] = min(FULL, share)
    if world.players[player, CURSOR] == unit:
        out[SELECTED, row, column] = FULL


@compiled
def see_units(world: Any, rules: Any, player: int, frame: int, out: Any) -> None:
    """Everybody on the board that is in sight, on each cell that it covers."""
    for owner in range(rules.num_players):
        for place in range(world.players[owner, NUM_UNITS]):
            unit = int(world.roster[owner, place])
            centre = int(world.units[unit, UNIT_CELL])
            if world.board[OCCUPANT, centre] != unit:
                continue  # inside a site
            half = int(rules.kinds[world.units[unit, UNIT_KIND], KIND_HALF_SIZE])
            for rows in range(-half, half + 1):
                for columns in range(-half, half + 1):
                    cell = centre + rows * rules.stride + columns
                    if rules.fog != 0 and not sees(world, rules, player, cell):
                        continue
                    own = int(rules.own_cell[frame, cell])
                    row, column = own // rules.columns, own % rules.columns
                    see_unit(world, rules, player, unit, row, column, out)


@compiled
def see_planes(world: Any, rules: Any, player: int, out: Any) -> None:
    """All planes of one seat: out uint8 [C, H, W]."""
    out[:FIRST_UNIFORM] = 0
    frame = int(rules.seats[world.clock[MAP_INDEX], player, SEAT_FRAME])
    if rules.fog == 0:
        out[VISIBLE:FIRST_UNIFORM] = FULL
    see_ground(world, rules, player, frame, out)
    see_units(world, rules, player, frame, out)
    for resource in range(NUM_RESOURCES):
        out[FIRST_UNIFORM + resource] = log_level(int(world.players[player, RESOURCES + resource]))
    out[OWN_FOOD] = min(FULL, FOOD_STEP * int(world.players[player, FOOD_USED]))
    out[FOOD_LIMIT] = min(FULL, FOOD_STEP * food_limit(world, rules, player))
    for upgrade in range(NUM_UPGRADES):
        level = UPGRADE_STEP * int(world.players[player, UPGRADES + upgrade])
        out[FIRST_UPGRADE_PLANE + upgrade] = min(FULL, level)
    out[TIME_LEFT] = FULL * (rules.max_ticks - int(world.clock[TICK])) // rules.max_ticks


@compiled
def see_vector(world: Any, rules: Any, player: int, out: Any) -> None:
    """The economy of one seat: out float32 [V]."""
    for resource in range(NUM_RESOURCES):
        out[resource] = world.players[player, RESOURCES + resource]
        out[NUM_RESOURCES + resource] = world.players[player, GATHERED + resource]
    index = 2 * NUM_RESOURCES
    out[index] = world.players[player, FOOD_USED]
    out[index + 1] = food_limit(world, rules, player)
    index += 2
    for upgrade in range(NUM_UPGRADES):
        out[index + upgrade] = world.players[player, UPGRADES + upgrade]
    index += NUM_UPGRADES
    for kind in range(NUM_KINDS):
        out[index + kind] = world.players[player, NUM_OWNED + kind]
        out[index + NUM_KINDS + kind] = 0.0
    for owner in range(rules.num_players):
        if rules.team[owner] == rules.team[player]:
            continue
        for place in range(world.players[owner, NUM_UNITS]):
            unit = int(world.roster[owner, place])
            cell = int(world.units[unit, UNIT_CELL])
            if world.board[OCCUPANT, cell] == unit and sees(world, rules, player, cell):
                out[index + NUM_KINDS + world.units[unit, UNIT_KIND]] += 1.0
    index += 2 * NUM_KINDS
    out[index] = world.players[player, DAMAGE_DONE]
    out[index + 1] = world.players[player, DAMAGE_TAKEN]
    out[index + 2] = score_of(world, player)
    out[index + 3] = world.clock[TICK]
    out[index + 4] = rules.max_ticks - world.clock[TICK]


@compiled
def see_classic(world: Any, rules: Any, player: int, out: Any) -> None:
    """The original's ten planes, of this tick: out uint8 [10, H, W]."""
    out[:] = 0
    frame = int(rules.seats[world.clock[MAP_INDEX], player, SEAT_FRAME])
    for row in range(rules.rows):
        for column in range(rules.columns):
            cell = int(rules.world_cell[frame, row * rules.columns + column])
            tile = known_tile(world, rules, player, cell)
            if tile != UNKNOWN:
                out[0, row, column] = tile + 1
            unit = int(world.board[OCCUPANT, cell])
            if unit == NO_UNIT or not sees(world, rules, player, cell):
                continue
            kind = int(world.units[unit, UNIT_KIND])
            out[1, row, column] = CLASSIC_SELF + side_of(rules, player, owner_of(rules, unit))
            out[2, row, column] = int(is_building(world, unit))
            out[3, row, column] = int(kind < NUM_MOBILE_KINDS)
            out[4, row, column] = kind + 1
            health = 100 * int(world.units[unit, UNIT_HEALTH])
            out[5, row, column] = health // int(rules.kinds[kind, KIND_HEALTH])
            out[6, row, column] = world.units[unit, UNIT_STATE] + 1
            if world.units[unit, UNIT_CARRY_KIND] != NO_RESOURCE:
                out[7, row, column] = min(FULL, int(world.units[unit, UNIT_CARRY]))
            attack = (
                rules.kinds[kind, KIND_DAMAGE_MIN]
                + rules.kinds[kind, KIND_DAMAGE_MAX]
                + rules.kinds[kind, KIND_PIERCING]
            )
            out[8, row, column] = min(FULL, int(attack))
            out[9, row, column] = min(FULL, int(rules.kinds[kind, KIND_ARMOUR]))


# --- slices of worlds ------------------------------------------------------------------------


@compiled
def observe_planes(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write every seat's planes: out uint8 [B, P, C, H, W]."""
    for index in range(first, last):
        world = world_at(worlds, index)
        for player in range(rules.num_players):
            see_planes(world, rules, player, out[index, player])


@compiled
def observe_classic(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write the original's layers: out uint8 [B, P, 10, H, W]."""
    for index in range(first, last):
        world = world_at(worlds, index)
        for player in range(rules.num_players):
            see_classic(world, rules, player, out[index, player])


@compiled
def observe_vector(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write the economy of every seat: out float32 [B, P, V]."""
    for index in range(first, last):
        world = world_at(worlds, index)
        for player in range(rules.num_players):
            see_vector(world, rules, player, out[index, player])
