"""Where the scripted players of Deep RTS build: sites that leave ways open, wells beside pools."""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled, compiled_compact
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.bots.sight import (
    FAR,
    HOME,
    MINE,
    NO_CELL,
    NO_SIDE,
    NUM_PEOPLE,
    SELECTED_CELL,
    distance,
    is_ground,
    is_out,
)
from marl_cair.games.deep_rts.rules import rulebook as rb

CLEARANCE = 1  # cells between a building and the hall or a resource, so that workers pass
LOYALTY = 5  # half steps by which the selected peasant is preferred as a builder
FARM_REACH = 2
EXPANSION_STEPS = 4  # from home to the gold that a second hall is built for, more than this


@compiled
def ring_row(place: int, reach: int) -> int:
    """Row of a place on the square ring `reach` cells around a centre, clockwise."""
    side, step = place // (2 * reach), place % (2 * reach)
    if side == 0:
        return -reach
    if side == 1:
        return step - reach
    return reach if side == 2 else reach - step


@compiled
def is_ring_free(known: Any, sight: Any, cell: int, reach: int, place: int) -> bool:
    """True where a place of the ring around a cell can be walked."""
    columns = known.rules.columns
    row = cell // columns + ring_row(place, reach)
    column = cell % columns + ring_row((place + 2 * reach) % (8 * reach), reach)
    return is_ground(known, sight, row, column)


@compiled_compact
def keeps_ways_open(known: Any, sight: Any, cell: int, half: int) -> bool:
    """True where the ring around a site has its barriers in one piece, of at most half of it."""
    reach = half + 1
    length = 8 * reach
    pieces, barriers = 0, 0
    was_free = is_ring_free(known, sight, cell, reach, length - 1)
    for place in range(length):
        is_free = is_ring_free(known, sight, cell, reach, place)
        pieces += int(was_free and not is_free)
        barriers += int(not is_free)
        was_free = is_free
    return pieces <= 1 and 2 * barriers <= length


@compiled_compact
def is_clear(known: Any, sight: Any, cell: int, half: int) -> bool:
    """True where a site is free of all but peasants, and far from resources and the hall."""
    rows, columns = known.rules.rows, known.rules.columns
    row, column = cell // columns, cell % columns
    if row < half or column < half or row + half >= rows or column + half >= columns:
        return False
    reach = half + CLEARANCE
    for there_row in range(max(0, row - reach), min(rows, row + reach + 1)):
        for there_column in range(max(0, column - reach), min(columns, column + reach + 1)):
            there = there_row * columns + there_column
            if max(abs(there_row - row), abs(there_column - column)) <= half:
                if not is_ground(known, sight, there_row, there_column):
                    return False
                if sight.kind[there] not in (t.NO_KIND, t.PEASANT) or sight.side[there] > MINE:
                    return False
            elif sight.kind[there] == t.TOWN_HALL or known.rules.tiles[
                sight.ground[there], rb.TILE_RESOURCE
            ] not in (t.NO_RESOURCE, t.OIL):
                return False
    return True


# --- where to build ------------------------------------------------------------------------------


@compiled
def nearest_person(known: Any, sight: Any, cell: int) -> int:
    """The own peasant nearest to a cell, or NO_CELL; the selected one counts as nearer."""
    best, best_distance = NO_CELL, FAR
    for place in range(sight.facts[NUM_PEOPLE]):
        steps = 2 * distance(known, sight.people[place], cell)
        if steps > 0 and sight.people[place] == sight.facts[SELECTED_CELL]:
            steps = max(1, steps - LOYALTY)
        if steps < best_distance:
            best, best_distance = sight.people[place], steps
    return best


@compiled
def num_free_around(known: Any, sight: Any, cell: int) -> int:
    """Open ground two steps from a cell: a farm in a corner leaves room for larger buildings."""
    free = 0
    for place in range(8 * FARM_REACH):
        free += int(is_ring_free(known, sight, cell, FARM_REACH, place))
    return free


@compiled
def site_price(known: Any, sight: Any, kind: int, cell: int) -> int:
    """How far a site lies from where it should be: home, or for a second hall fresh gold."""
    home = sight.facts[HOME]
    if kind == t.FARM:
        return 2 * distance(known, cell, home) + num_free_around(known, sight, cell)
    if kind != t.TOWN_HALL or sight.own[t.TOWN_HALL] == 0:
        return 2 * distance(known, cell, home)
    best = FAR
    for tile in range(known.rules.rows * known.rules.columns):
        if known.rules.tiles[sight.ground[tile], rb.TILE_RESOURCE] == t.GOLD:
            from_home = distance(known, tile, home)
            if from_home > EXPANSION_STEPS:
                best = min(best, 4 * distance(known, tile, cell) + 2 * from_home)
    return 2 * distance(known, cell, home) if best == FAR else best


@compiled
def is_beside_pool(known: Any, sight: Any, cell: int) -> bool:
    """True where a peasant can stand and build a well on oil of the own ground."""
    rows, columns = known.rules.rows, known.rules.columns
    row, column = cell // columns, cell % columns
    if not is_ground(known, sight, row, column):
        return False
    if is_out(known, sight, cell):
        return False
    for there_row in range(max(0, row - 1), min(rows, row + 2)):
        for there_column in range(max(0, column - 1), min(columns, column + 2)):
            there = there_row * columns + there_column
            if sight.ground[there] == t.OIL_TILE and sight.side[there] == NO_SIDE:
                return True
    return False


@compiled
def has_pool(known: Any, sight: Any) -> bool:
    """True where a well can be built."""
    for cell in range(known.rules.rows * known.rules.columns):
        if is_beside_pool(known, sight, cell):
            return True
    return False


@compiled
def has_tile(known: Any, sight: Any, tile: int) -> bool:
    """True where ground of this kind is known."""
    found = False
    for cell in range(known.rules.rows * known.rules.columns):
        found = found or sight.ground[cell] == tile
    return bool(found)


@compiled
def can_build_at(known: Any, sight: Any, kind: int, cell: int, half: int) -> bool:
    """True for a site that leaves the ways open; for a well, for the place of its builder."""
    if kind == t.OIL_WELL:
        return is_beside_pool(known, sight, cell)
    return is_clear(known, sight, cell, half) and keeps_ways_open(known, sight, cell, half)


@compiled
def best_site(known: Any, sight: Any, kind: int) -> int:
    """The site near home and near a peasant, NO_CELL for none."""
    half = int(known.rules.kinds[kind, rb.KIND_HALF_SIZE])
    best, best_price = NO_CELL, FAR
    for cell in range(known.rules.rows * known.rules.columns):
        if not can_build_at(known, sight, kind, cell, half):
            continue
        person = nearest_person(known, sight, cell)
        cost = site_price(known, sight, kind, cell) + 2 * distance(known, person, cell)
        if cost < best_price:
            best, best_price = cell, cost
    return best
