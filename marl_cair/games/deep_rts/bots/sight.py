"""Reads planes into what scripted players of Deep RTS need: who stands where, stores, sites."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled, compiled_compact
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.bots.doctrines import Doctrine
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.scenarios import Scenario
from marl_cair.games.deep_rts.views.planes import (
    CARRIES,
    FIRST_KIND,
    FIRST_TILE,
    FIRST_UNIFORM,
    FIRST_UPGRADE_PLANE,
    FOOD_LIMIT,
    FOOD_STEP,
    HAS_ORDER,
    IS_FIGHTING,
    IS_RISING,
    IS_WORKING,
    LOG_STEP,
    OWN,
    OWN_FOOD,
    SELECTED,
    UPGRADE_STEP,
    VISIBLE,
)
from marl_cair.games.game import GameSpec

NO_CELL = -1
FAR = 1_000_000  # more than any distance or price of a way
NO_SIDE, MINE, ALLY, FOE = range(4)
GUARD_STEPS = 6  # from the target: soldiers that defend it

# Facts of a position.
(
    FOOD_USED,
    FOOD_MADE,
    SELECTED_CELL,
    HOME,  # centre of the own hall, else where the own units are
    TARGET,  # the enemy's building or unit nearest to home, else where its base should be
    THREAT,  # the enemy's unit that walks nearest to home on the own side, or NO_CELL
    NUM_SOLDIERS,
    NUM_OUT,  # of them, nearer to the target than to home
    NUM_FOE_SOLDIERS,
    NUM_GUARDS,  # of them, near the target
    NUM_RAIDERS,  # of them, on the own ground
    NUM_PEOPLE,  # peasants on the board
    SAVED_FOR,  # the building or upgrade that gold is saved for, or NO_KIND
    FREE_SMITHY,  # a cell of an own smithy that forges nothing, or NO_CELL
) = range(14)
NUM_FACTS = 14


class Knowledge(NamedTuple):
    """The public numbers of a scenario, and the doctrine."""

    rules: rb.Rules
    groups: NDArray[np.int16]  # [actions] kind of each action
    doctrine: Doctrine
    rivals: int  # enemies of a player


class Sight(NamedTuple):
    """What a player reads off the planes; overwritten for each row of a batch. N cells."""

    side: NDArray[np.int64]  # [N] NO_SIDE, MINE, ALLY or FOE
    kind: NDArray[np.int64]  # [N] of the unit there, or NO_KIND
    ground: NDArray[np.int64]  # [N] kind of tile
    people: NDArray[np.int64]  # [N] cells of the own peasants
    own: NDArray[np.int64]  # [kinds] finished
    rising: NDArray[np.int64]  # [kinds] own sites
    foes: NDArray[np.int64]  # [kinds] in sight
    store: NDArray[np.int64]  # [resources] to 3 %
    carriers: NDArray[np.int64]  # [resources] own peasants that carry it
    saved: NDArray[np.int64]  # [resources] put by for a building or upgrade
    level: NDArray[np.int64]  # [upgrades] known
    facts: NDArray[np.int64]  # [NUM_FACTS]


def make_knowledge(scenario: Scenario, spec: GameSpec, doctrine: Doctrine) -> Knowledge:
    """The tables of a scenario."""
    teams = scenario.teams or tuple(range(scenario.num_players))
    rivals = sum(team != teams[0] for team in teams)
    return Knowledge(rb.make_rules(scenario), spec.action_groups, doctrine, max(1, rivals))


def make_sight(scenario: Scenario) -> Sight:
    """Room for what is seen of a board."""
    cells = scenario.rows * scenario.columns

    def room(size: int) -> NDArray[np.int64]:
        return np.zeros(size, np.int64)

    return Sight(
        side=room(cells),
        kind=room(cells),
        ground=room(cells),
        people=room(cells),
        own=room(t.NUM_KINDS),
        rising=room(t.NUM_KINDS),
        foes=room(t.NUM_KINDS),
        store=room(t.NUM_RESOURCES),
        carriers=room(t.NUM_RESOURCES),
        saved=room(t.NUM_RESOURCES),
        level=room(t.NUM_UPGRADES),
        facts=room(NUM_FACTS),
    )


# --- reading -----------------------------------------------------------------------------------


@compiled
def shows(planes: Any, known: Any, plane: int, cell: int) -> bool:
    """True where a plane is not 0."""
    columns = known.rules.columns
    return bool(planes[plane, cell // columns, cell % columns] > 0)


@compiled
def stored(level: int) -> int:
    """The store that shows as `level`, to 3 %: the inverse of `observation.log_level`."""
    return int(2.0 ** (level / LOG_STEP) - 0.5)


@compiled
def distance(known: Any, first: int, second: int) -> int:
    """Steps between two cells of an empty board."""
    columns = known.rules.columns
    rows_apart = abs(first // columns - second // columns)
    return int(max(rows_apart, abs(first % columns - second % columns)))


@compiled
def read_ground(planes: Any, known: Any, sight: Any, cell: int) -> None:
    """The tile of a cell."""
    sight.ground[cell] = t.GRASS
    for tile in range(1, t.NUM_TILE_KINDS):
        if shows(planes, known, FIRST_TILE + tile - 1, cell):
            sight.ground[cell] = tile
            return


@compiled
def read_unit(planes: Any, known: Any, sight: Any, cell: int) -> None:
    """Who stands on a cell."""
    sight.side[cell] = NO_SIDE
    sight.kind[cell] = t.NO_KIND
    for side in range(3):
        if shows(planes, known, OWN + side, cell):
            sight.side[cell] = MINE + side
            break
    if sight.side[cell] == NO_SIDE:
        return
    for kind in range(t.NUM_KINDS):
        if shows(planes, known, FIRST_KIND + kind, cell):
            sight.kind[cell] = kind
            break


@compiled
def count_unit(planes: Any, known: Any, sight: Any, cell: int) -> None:
    """Add the cell to the counts of its kind; an own peasant to the people."""
    kind, side = sight.kind[cell], sight.side[cell]
    if side == FOE:
        sight.foes[kind] += 1
    if side != MINE:
        return
    if shows(planes, known, SELECTED, cell):
        sight.facts[SELECTED_CELL] = cell
    if shows(planes, known, IS_RISING, cell):
        sight.rising[kind] += 1
        return
    sight.own[kind] += 1
    if kind == t.SMITHY and not shows(planes, known, IS_WORKING, cell):
        sight.facts[FREE_SMITHY] = cell
    if kind == t.PEASANT:
        sight.people[sight.facts[NUM_PEOPLE]] = cell
        sight.facts[NUM_PEOPLE] += 1
        for resource in range(t.OIL):
            if shows(planes, known, CARRIES + resource, cell):
                sight.carriers[resource] += 1


@compiled
def cells_of(known: Any, kind: int) -> int:
    """How many cells a unit covers."""
    side = 2 * known.rules.kinds[kind, rb.KIND_HALF_SIZE] + 1
    return int(side * side)


@compiled
def clear(sight: Any) -> None:
    """Forget the last row."""
    for kind in range(t.NUM_KINDS):
        sight.own[kind] = 0
        sight.rising[kind] = 0
        sight.foes[kind] = 0
    for resource in range(t.NUM_RESOURCES):
        sight.carriers[resource] = 0
        sight.saved[resource] = 0
    for fact in range(NUM_FACTS):
        sight.facts[fact] = 0
    sight.facts[SELECTED_CELL] = NO_CELL
    sight.facts[FREE_SMITHY] = NO_CELL


@compiled
def read_sight(planes: Any, known: Any, sight: Any) -> None:
    """Read one player's planes."""
    clear(sight)
    for cell in range(known.rules.rows * known.rules.columns):
        read_ground(planes, known, sight, cell)
        read_unit(planes, known, sight, cell)
        if sight.side[cell] != NO_SIDE:
            count_unit(planes, known, sight, cell)
    for kind in range(t.NUM_KINDS):
        cells = cells_of(known, kind)
        sight.own[kind] //= cells
        sight.rising[kind] //= cells
        sight.foes[kind] //= cells
    for resource in range(t.NUM_RESOURCES):
        sight.store[resource] = stored(int(planes[FIRST_UNIFORM + resource, 0, 0]))
    for upgrade in range(t.NUM_UPGRADES):
        sight.level[upgrade] = int(planes[FIRST_UPGRADE_PLANE + upgrade, 0, 0]) // UPGRADE_STEP
    sight.facts[FOOD_USED] = int(planes[OWN_FOOD, 0, 0]) // FOOD_STEP
    sight.facts[FOOD_MADE] = int(planes[FOOD_LIMIT, 0, 0]) // FOOD_STEP
    for kind in range(t.PEASANT + 1, t.NUM_MOBILE_KINDS):
        sight.facts[NUM_SOLDIERS] += sight.own[kind]
        sight.facts[NUM_FOE_SOLDIERS] += sight.foes[kind]
    find_places(planes, known, sight)
    count_soldiers(known, sight)


# --- places --------------------------------------------------------------------------------------


@compiled
def find_places(planes: Any, known: Any, sight: Any) -> None:
    """Home, target and threat."""
    columns = known.rules.columns
    home, anywhere = NO_CELL, 0
    for cell in range(known.rules.rows * columns):
        if sight.side[cell] == MINE:
            anywhere = cell
            if sight.kind[cell] == t.TOWN_HALL and home == NO_CELL:
                half = known.rules.kinds[t.TOWN_HALL, rb.KIND_HALF_SIZE]
                home = cell + half * columns + half
    sight.facts[HOME] = anywhere if home == NO_CELL else home
    target = nearest_foe(known, sight, sight.facts[HOME], 0)
    if target == NO_CELL:
        target = guess_base(planes, known, sight.facts[HOME])
    sight.facts[TARGET] = target
    threat = nearest_foe(known, sight, sight.facts[HOME], t.NUM_MOBILE_KINDS)
    if threat != NO_CELL and distance(known, threat, sight.facts[HOME]) > home_radius(known, sight):
        threat = NO_CELL
    sight.facts[THREAT] = threat


@compiled
def count_soldiers(known: Any, sight: Any) -> None:
    """Enemy soldiers near the target and on the own ground, own ones on the enemy's."""
    home, target, radius = sight.facts[HOME], sight.facts[TARGET], home_radius(known, sight)
    for cell in range(known.rules.rows * known.rules.columns):
        if not t.PEASANT < sight.kind[cell] < t.NUM_MOBILE_KINDS:
            continue
        if sight.side[cell] == FOE:
            sight.facts[NUM_GUARDS] += int(distance(known, cell, target) <= GUARD_STEPS)
            sight.facts[NUM_RAIDERS] += int(distance(known, cell, home) <= radius)
        elif sight.side[cell] == MINE:
            sight.facts[NUM_OUT] += int(is_out(known, sight, cell))


@compiled
def is_out(known: Any, sight: Any, cell: int) -> bool:
    """True nearer to the target than to home."""
    to_target = distance(known, cell, sight.facts[TARGET])
    return bool(to_target < distance(known, cell, sight.facts[HOME]))


@compiled
def home_radius(known: Any, sight: Any) -> int:
    """How far from home the own ground reaches: half the way to the enemy's base."""
    size = known.rules.rows * known.rules.columns
    mirrored = size - 1 - sight.facts[HOME]
    return max(4, (distance(known, mirrored, sight.facts[HOME]) + 1) // 2 + 1)


@compiled_compact
def nearest_foe(known: Any, sight: Any, origin: int, below: int) -> int:
    """The cell of the enemy nearest to `origin`, NO_CELL for none; of kinds < `below` unless 0."""
    best, best_distance = NO_CELL, FAR
    for cell in range(known.rules.rows * known.rules.columns):
        if sight.side[cell] == FOE and (below == 0 or sight.kind[cell] < below):
            steps = distance(known, cell, origin)
            if steps < best_distance:
                best, best_distance = cell, steps
    return best


@compiled
def guess_base(planes: Any, known: Any, home: int) -> int:
    """Where an unseen enemy may be: home mirrored in three ways, else any cell in the dark."""
    rows, columns = known.rules.rows, known.rules.columns
    size = rows * columns
    row, column = home // columns, home % columns
    opposite = size - 1 - home
    if not shows(planes, known, VISIBLE, opposite):
        return int(opposite)
    for cell in (row * columns + columns - 1 - column, (rows - 1 - row) * columns + column):
        if not shows(planes, known, VISIBLE, cell):
            return int(cell)
    for cell in range(size - 1, -1, -1):
        if not shows(planes, known, VISIBLE, cell):
            return int(cell)
    return int(opposite)


@compiled
def is_ground(known: Any, sight: Any, row: int, column: int) -> bool:
    """True on the board where one can walk and no building stands."""
    if row < 0 or column < 0 or row >= known.rules.rows or column >= known.rules.columns:
        return False
    cell = row * known.rules.columns + column
    if sight.kind[cell] >= t.NUM_MOBILE_KINDS:
        return False
    return bool(known.rules.tiles[sight.ground[cell], rb.WALK_PERCENT] > 0)


@compiled
def is_idle(planes: Any, known: Any, cell: int) -> bool:
    """True for a unit without an order, or a building that makes nothing."""
    return not (
        shows(planes, known, HAS_ORDER, cell)
        or shows(planes, known, IS_WORKING, cell)
        or shows(planes, known, IS_FIGHTING, cell)
        or shows(planes, known, IS_RISING, cell)
    )
