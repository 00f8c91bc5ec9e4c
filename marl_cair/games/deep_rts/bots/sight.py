"""Reads planes for the scripted players of Deep RTS: units and ground by cell, counts, stores."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled, compiled_compact
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.bots.doctrines import Doctrine
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.scenarios import Scenario
from marl_cair.games.deep_rts.views import planes as p

NO_CELL = -1
FAR = 1_000_000  # more than any distance or price of a way
NO_SIDE, MINE, ALLY, FOE = range(4)
GUARD_STEPS = 6  # from the target: soldiers that defend it
MOB_STEPS = 4  # from home: enemy peasants that raid
SOLDIER_WORTH = 2  # raiding peasants that a soldier at home fights off

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
    NUM_DEFENDERS,  # of them, on the own ground
    NUM_FOE_SOLDIERS,
    NUM_GUARDS,  # of them, near the target
    NUM_RAIDERS,  # of them, on the own ground
    NUM_MOB,  # the enemy's peasants beside a home they attack, less those the defenders beat
    NUM_PEOPLE,  # peasants on the board
    SAVED_FOR,  # the building or upgrade that gold is saved for, or NO_KIND
    FREE_SMITHY,  # a cell of an own smithy that forges nothing, or NO_CELL
) = range(NUM_FACTS := 16)


class Sight(NamedTuple):
    """One player's view, read from its planes; overwritten for each row of a batch. N cells."""

    rules: rb.Rules  # public numbers of the scenario
    doctrine: Doctrine
    rivals: int  # enemies of a player, at least 1
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
    level: NDArray[np.int64]  # [upgrades] own
    facts: NDArray[np.int64]  # [NUM_FACTS]


def make_sight(scenario: Scenario, doctrine: Doctrine) -> Sight:
    """Room for one player's view of a board, with the rules and its doctrine."""
    cells, teams = scenario.rows * scenario.columns, scenario.teams or range(scenario.num_players)
    sizes = (*[cells] * 4, *[t.NUM_KINDS] * 3, *[t.NUM_RESOURCES] * 3, t.NUM_UPGRADES, NUM_FACTS)
    rivals = max(1, sum(team != teams[0] for team in teams))
    return Sight(rb.make_rules(scenario), doctrine, rivals, *(np.zeros(n, np.int64) for n in sizes))


# --- reading -----------------------------------------------------------------------------------


@compiled
def shows(planes: Any, seen: Any, plane: int, cell: int) -> bool:
    """True where a plane is not 0."""
    columns = seen.rules.columns
    return bool(planes[plane, cell // columns, cell % columns] > 0)


@compiled
def stored(level: int) -> int:
    """The store that shows as `level`, to 3 %: the inverse of `observation.log_level`."""
    return int(2.0 ** (level / p.LOG_STEP) - 0.5)


@compiled
def distance(seen: Any, first: int, second: int) -> int:
    """Steps between two cells of an empty board."""
    columns = seen.rules.columns
    rows_apart = abs(first // columns - second // columns)
    return int(max(rows_apart, abs(first % columns - second % columns)))


@compiled
def read_cell(planes: Any, seen: Any, cell: int) -> None:
    """The tile of a cell, the unit on it and its side."""
    seen.ground[cell], seen.side[cell], seen.kind[cell] = t.GRASS, NO_SIDE, t.NO_KIND
    for tile in range(1, t.NUM_TILE_KINDS):
        if shows(planes, seen, p.FIRST_TILE + tile - 1, cell):
            seen.ground[cell] = tile
            break
    for side in range(3):
        if shows(planes, seen, p.OWN + side, cell):
            seen.side[cell] = MINE + side
            break
    if seen.side[cell] == NO_SIDE:
        return
    for kind in range(t.NUM_KINDS):
        if shows(planes, seen, p.FIRST_KIND + kind, cell):
            seen.kind[cell] = kind
            break


@compiled
def count_unit(planes: Any, seen: Any, cell: int) -> None:
    """Add the cell to the counts of its kind; an own peasant to the people."""
    kind, side = seen.kind[cell], seen.side[cell]
    if side == FOE:
        seen.foes[kind] += 1
    if side != MINE:
        return
    if shows(planes, seen, p.SELECTED, cell):
        seen.facts[SELECTED_CELL] = cell
    if shows(planes, seen, p.IS_RISING, cell):
        seen.rising[kind] += 1
        return
    seen.own[kind] += 1
    if kind == t.SMITHY and not shows(planes, seen, p.IS_WORKING, cell):
        seen.facts[FREE_SMITHY] = cell
    if kind == t.PEASANT:
        seen.people[seen.facts[NUM_PEOPLE]] = cell
        seen.facts[NUM_PEOPLE] += 1
        for resource in range(t.OIL):
            if shows(planes, seen, p.CARRIES + resource, cell):
                seen.carriers[resource] += 1


@compiled
def read_sight(planes: Any, seen: Any) -> None:
    """Read one player's planes."""
    for counts in (seen.own, seen.rising, seen.foes, seen.carriers, seen.saved, seen.facts):
        counts[:] = 0
    seen.facts[SELECTED_CELL] = NO_CELL
    seen.facts[FREE_SMITHY] = NO_CELL
    for cell in range(seen.rules.rows * seen.rules.columns):
        read_cell(planes, seen, cell)
        if seen.side[cell] != NO_SIDE:
            count_unit(planes, seen, cell)
    for kind in range(t.NUM_KINDS):
        cells = (2 * int(seen.rules.kinds[kind, rb.KIND_HALF_SIZE]) + 1) ** 2  # that a unit covers
        seen.own[kind] //= cells
        seen.rising[kind] //= cells
        seen.foes[kind] //= cells
    for resource in range(t.NUM_RESOURCES):
        seen.store[resource] = stored(int(planes[p.FIRST_UNIFORM + resource, 0, 0]))
    for upgrade in range(t.NUM_UPGRADES):
        seen.level[upgrade] = int(planes[p.FIRST_UPGRADE_PLANE + upgrade, 0, 0]) // p.UPGRADE_STEP
    seen.facts[FOOD_USED] = int(planes[p.OWN_FOOD, 0, 0]) // p.FOOD_STEP
    seen.facts[FOOD_MADE] = int(planes[p.FOOD_LIMIT, 0, 0]) // p.FOOD_STEP
    for kind in range(t.PEASANT + 1, t.NUM_MOBILE_KINDS):
        seen.facts[NUM_SOLDIERS] += seen.own[kind]
        seen.facts[NUM_FOE_SOLDIERS] += seen.foes[kind]
    find_places(planes, seen)
    count_fighters(planes, seen)


# --- places --------------------------------------------------------------------------------------


@compiled
def find_places(planes: Any, seen: Any) -> None:
    """Home, target and threat."""
    columns = seen.rules.columns
    home, anywhere = NO_CELL, 0
    for cell in range(seen.rules.rows * columns):
        if seen.side[cell] == MINE:
            anywhere = cell
            if seen.kind[cell] == t.TOWN_HALL and home == NO_CELL:
                half = seen.rules.kinds[t.TOWN_HALL, rb.KIND_HALF_SIZE]
                home = cell + half * columns + half
    seen.facts[HOME] = anywhere if home == NO_CELL else home
    target = nearest_foe(seen, seen.facts[HOME], 0)
    if target == NO_CELL:
        target = guess_base(planes, seen, seen.facts[HOME])
    seen.facts[TARGET] = target
    threat = nearest_foe(seen, seen.facts[HOME], t.NUM_MOBILE_KINDS)
    if threat != NO_CELL and distance(seen, threat, seen.facts[HOME]) > home_radius(seen):
        threat = NO_CELL
    seen.facts[THREAT] = threat


@compiled
def count_fighters(planes: Any, seen: Any) -> None:
    """Enemies near the target and on the own ground, own soldiers there and on the enemy's."""
    home, target, radius = seen.facts[HOME], seen.facts[TARGET], home_radius(seen)
    fights = False
    for cell in range(seen.rules.rows * seen.rules.columns):
        steps = distance(seen, cell, home)
        if seen.kind[cell] == t.PEASANT and seen.side[cell] == FOE and steps <= MOB_STEPS:
            seen.facts[NUM_MOB] += 1
            fights = fights or shows(planes, seen, p.IS_FIGHTING, cell)
        if not t.PEASANT < seen.kind[cell] < t.NUM_MOBILE_KINDS:
            continue
        if seen.side[cell] == FOE:
            seen.facts[NUM_GUARDS] += int(distance(seen, cell, target) <= GUARD_STEPS)
            seen.facts[NUM_RAIDERS] += int(steps <= radius)
        elif seen.side[cell] == MINE:
            seen.facts[NUM_OUT] += int(is_out(seen, cell))
            seen.facts[NUM_DEFENDERS] += int(steps <= radius)
    mob = seen.facts[NUM_MOB] - SOLDIER_WORTH * seen.facts[NUM_DEFENDERS]
    seen.facts[NUM_MOB] = max(0, mob) if fights else 0  # else they scout, or live beside


@compiled
def is_out(seen: Any, cell: int) -> bool:
    """True nearer to the target than to home."""
    to_target = distance(seen, cell, seen.facts[TARGET])
    return bool(to_target < distance(seen, cell, seen.facts[HOME]))


@compiled
def home_radius(seen: Any) -> int:
    """Steps from home to the end of the own ground: half the way to the enemy's base."""
    size = seen.rules.rows * seen.rules.columns
    mirrored = size - 1 - seen.facts[HOME]
    return max(4, (distance(seen, mirrored, seen.facts[HOME]) + 1) // 2 + 1)


@compiled_compact
def nearest_foe(seen: Any, origin: int, below: int) -> int:
    """The cell of the enemy nearest to `origin`, NO_CELL for none; of kinds < `below` unless 0."""
    best, best_distance = NO_CELL, FAR
    for cell in range(seen.rules.rows * seen.rules.columns):
        if seen.side[cell] == FOE and (below == 0 or seen.kind[cell] < below):
            steps = distance(seen, cell, origin)
            if steps < best_distance:
                best, best_distance = cell, steps
    return best


@compiled
def guess_base(planes: Any, seen: Any, home: int) -> int:
    """Guess the cell of an unseen enemy: home mirrored in three ways, else any cell not visible."""
    rows, columns = seen.rules.rows, seen.rules.columns
    row, column = home // columns, home % columns
    opposite = rows * columns - 1 - home
    beside, below = (row + 1) * columns - 1 - column, (rows - 1 - row) * columns + column
    for cell in (opposite, beside, below):
        if not shows(planes, seen, p.VISIBLE, cell):
            return int(cell)
    for cell in range(rows * columns - 1, -1, -1):
        if not shows(planes, seen, p.VISIBLE, cell):
            return int(cell)
    return int(opposite)


@compiled
def is_ground(seen: Any, row: int, column: int) -> bool:
    """True on the board where one can walk and no building stands."""
    if row < 0 or column < 0 or row >= seen.rules.rows or column >= seen.rules.columns:
        return False
    cell = row * seen.rules.columns + column
    if seen.kind[cell] >= t.NUM_MOBILE_KINDS:
        return False
    return bool(seen.rules.tiles[seen.ground[cell], rb.WALK_PERCENT] > 0)


@compiled
def is_idle(planes: Any, seen: Any, cell: int) -> bool:
    """True for a unit without an order, or a building that makes nothing."""
    for plane in (p.HAS_ORDER, p.IS_WORKING, p.IS_FIGHTING, p.IS_RISING):
        if shows(planes, seen, plane, cell):
            return False
    return True
