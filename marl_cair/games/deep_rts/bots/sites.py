"""Chooses building sites for scripted players of Deep RTS: ways stay open, wells beside pools."""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled, compiled_compact
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.bots import sight
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
def is_ring_free(seen: Any, cell: int, reach: int, place: int) -> bool:
    """True where a place of the ring around a cell can be walked."""
    columns = seen.rules.columns
    row = cell // columns + ring_row(place, reach)
    column = cell % columns + ring_row((place + 2 * reach) % (8 * reach), reach)
    return sight.is_ground(seen, row, column)


@compiled_compact
def keeps_ways_open(seen: Any, cell: int, half: int) -> bool:
    """True where the ring around a site has its barriers in one piece, of at most half of it."""
    reach = half + 1
    length = 8 * reach
    pieces, barriers = 0, 0
    was_free = is_ring_free(seen, cell, reach, length - 1)
    for place in range(length):
        is_free = is_ring_free(seen, cell, reach, place)
        pieces += int(was_free and not is_free)
        barriers += int(not is_free)
        was_free = is_free
    return pieces <= 1 and 2 * barriers <= length


@compiled_compact
def is_clear(seen: Any, cell: int, half: int) -> bool:
    """True where a site is free of all but peasants, and far from resources and the hall."""
    rows, columns = seen.rules.rows, seen.rules.columns
    row, column = cell // columns, cell % columns
    if row < half or column < half or row + half >= rows or column + half >= columns:
        return False
    reach = half + CLEARANCE
    for there_row in range(max(0, row - reach), min(rows, row + reach + 1)):
        for there_column in range(max(0, column - reach), min(columns, column + reach + 1)):
            there = there_row * columns + there_column
            if max(abs(there_row - row), abs(there_column - column)) <= half:
                if not sight.is_ground(seen, there_row, there_column):
                    return False
                if seen.kind[there] not in (t.NO_KIND, t.PEASANT) or seen.side[there] > sight.MINE:
                    return False
            elif seen.kind[there] == t.TOWN_HALL or seen.rules.tiles[
                seen.ground[there], rb.TILE_RESOURCE
            ] not in (t.NO_RESOURCE, t.OIL):
                return False
    return True


# --- where to build ------------------------------------------------------------------------------


@compiled
def nearest_person(seen: Any, cell: int) -> int:
    """The own peasant nearest to a cell, or NO_CELL; the selected one counts as nearer."""
    best, best_distance = sight.NO_CELL, sight.FAR
    for place in range(seen.facts[sight.NUM_PEOPLE]):
        steps = 2 * sight.distance(seen, seen.people[place], cell)
        if steps > 0 and seen.people[place] == seen.facts[sight.SELECTED_CELL]:
            steps = max(1, steps - LOYALTY)
        if steps < best_distance:
            best, best_distance = seen.people[place], steps
    return best


@compiled
def num_free_around(seen: Any, cell: int) -> int:
    """Open ground two steps from a cell: a farm in a corner leaves room for larger buildings."""
    free = 0
    for place in range(8 * FARM_REACH):
        free += int(is_ring_free(seen, cell, FARM_REACH, place))
    return free


@compiled
def site_price(seen: Any, kind: int, cell: int) -> int:
    """How far a site lies from where it should be: home, or for a second hall fresh gold."""
    home = seen.facts[sight.HOME]
    if kind == t.FARM:
        return 2 * sight.distance(seen, cell, home) + num_free_around(seen, cell)
    if kind != t.TOWN_HALL or seen.own[t.TOWN_HALL] == 0:
        return 2 * sight.distance(seen, cell, home)
    best = sight.FAR
    for tile in range(seen.rules.rows * seen.rules.columns):
        if seen.rules.tiles[seen.ground[tile], rb.TILE_RESOURCE] == t.GOLD:
            from_home = sight.distance(seen, tile, home)
            if from_home > EXPANSION_STEPS:
                best = min(best, 4 * sight.distance(seen, tile, cell) + 2 * from_home)
    return 2 * sight.distance(seen, cell, home) if best == sight.FAR else best


@compiled
def is_beside_pool(seen: Any, cell: int) -> bool:
    """True where a peasant can stand and build a well on oil of the own ground."""
    rows, columns = seen.rules.rows, seen.rules.columns
    row, column = cell // columns, cell % columns
    if not sight.is_ground(seen, row, column) or sight.is_out(seen, cell):
        return False
    for there_row in range(max(0, row - 1), min(rows, row + 2)):
        for there_column in range(max(0, column - 1), min(columns, column + 2)):
            there = there_row * columns + there_column
            if seen.ground[there] == t.OIL_TILE and seen.side[there] == sight.NO_SIDE:
                return True
    return False


@compiled
def has_pool(seen: Any) -> bool:
    """True where the rules have wells, and one can be built."""
    if seen.rules.product[t.OIL_WELL, rb.PRODUCT_IS_ENABLED] == 0:
        return False
    for cell in range(seen.rules.rows * seen.rules.columns):  # noqa: SIM110  # no generators
        if is_beside_pool(seen, cell):
            return True
    return False


@compiled
def can_build_at(seen: Any, kind: int, cell: int, half: int) -> bool:
    """True for a site that leaves the ways open; for a well, for the place of its builder."""
    if kind == t.OIL_WELL:
        return is_beside_pool(seen, cell)
    return is_clear(seen, cell, half) and keeps_ways_open(seen, cell, half)


@compiled
def best_site(seen: Any, kind: int) -> int:
    """The site near home and near a peasant, NO_CELL for none."""
    half = int(seen.rules.kinds[kind, rb.KIND_HALF_SIZE])
    best, best_price = sight.NO_CELL, sight.FAR
    for cell in range(seen.rules.rows * seen.rules.columns):
        if not can_build_at(seen, kind, cell, half):
            continue
        person = nearest_person(seen, cell)
        cost = site_price(seen, kind, cell) + 2 * sight.distance(seen, person, cell)
        if cost < best_price:
            best, best_price = cell, cost
    return best
