"""Chooses purchases of scripted players of Deep RTS: buildings and sites, upgrades, soldiers."""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled, compiled_compact
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.bots import sight
from marl_cair.games.deep_rts.rules import rulebook as rb

RICH = 2  # prices of a barracks, in gold, from which another is built
ENOUGH_SOLDIERS = 7  # before the smithy
BUT_GOLD = t.GOLD + 1  # the first resource but gold, which always comes
CLEARANCE = 1  # cells between a building and the hall or a resource, so that workers pass
LOYALTY = 5  # half steps by which the selected peasant is preferred as a builder
FARM_REACH = 2
EXPANSION_STEPS = 4  # from home to the gold that a second hall is built for, more than this


@compiled
def price(seen: Any, product: int, resource: int) -> int:
    """The price of a product in a resource."""
    return int(seen.rules.product[product, rb.PRODUCT_COST + resource])


@compiled
def can_afford(seen: Any, product: int) -> bool:
    """True where the stores hold the price."""
    if seen.rules.product[product, rb.PRODUCT_IS_ENABLED] == 0:
        return False
    for resource in range(t.NUM_RESOURCES):
        if seen.store[resource] < price(seen, product, resource):
            return False
    return True


@compiled
def can_spare(seen: Any, product: int, first: int) -> bool:
    """True where the price, from resource `first` on, leaves what is saved for a building."""
    if seen.rules.product[product, rb.PRODUCT_IS_ENABLED] == 0:
        return False
    for resource in range(first, t.NUM_RESOURCES):
        cost = price(seen, product, resource)
        if cost > 0 and seen.store[resource] < cost + seen.saved[resource]:
            return False
    return True


@compiled
def num_with_sites(seen: Any, kind: int) -> int:
    """Own units of a kind, those under construction included."""
    return int(seen.own[kind] + seen.rising[kind])


@compiled
def num_workers(seen: Any) -> int:
    """Own peasants, those inside a site included."""
    workers = seen.own[t.PEASANT]
    for kind in range(t.NUM_MOBILE_KINDS, seen.rising.shape[0]):
        workers += seen.rising[kind]
    return int(workers)


@compiled
def is_outnumbered(seen: Any) -> bool:
    """True where an enemy, or the raiders, have more soldiers than the player."""
    soldiers = seen.facts[sight.NUM_SOLDIERS]
    return bool(
        seen.facts[sight.NUM_FOE_SOLDIERS] > seen.rivals * soldiers
        or seen.facts[sight.NUM_RAIDERS] > soldiers
    )


@compiled
def food_to_come(seen: Any) -> int:
    """Food that the own buildings make, sites included."""
    made = int(seen.facts[sight.FOOD_MADE])
    for kind in (t.TOWN_HALL, t.FARM):
        made += int(seen.rising[kind]) * int(seen.rules.kinds[kind, rb.KIND_FOOD_PRODUCED])
    return made


@compiled
def wanted_building(seen: Any) -> int:
    """The next building, or NO_KIND."""
    doctrine = seen.doctrine
    if num_with_sites(seen, t.TOWN_HALL) == 0:  # without one, no more gold comes
        return t.TOWN_HALL if can_afford(seen, t.TOWN_HALL) else t.NO_KIND
    made, workers = food_to_come(seen), num_workers(seen)
    barracks = num_with_sites(seen, t.BARRACKS)
    is_threatened = seen.facts[sight.NUM_RAIDERS] > 0 or (
        doctrine.answers > 0 and seen.facts[sight.NUM_FOE_SOLDIERS] > 0
    )
    needs_barracks = barracks == 0 and (is_threatened or workers >= doctrine.workers_first)
    free = made - seen.facts[sight.FOOD_USED]
    is_hungry = free < doctrine.free_food and made < seen.rules.food_limit
    if is_hungry and (free <= 0 or not needs_barracks):
        return t.FARM
    if needs_barracks:
        return t.BARRACKS
    if workers >= doctrine.workers_first and not is_outnumbered(seen):
        luxury = wanted_luxury(seen)
        if luxury != t.NO_KIND:
            return luxury
    is_rich = seen.store[t.GOLD] >= RICH * price(seen, t.BARRACKS, t.GOLD)
    return t.BARRACKS if is_rich and 0 < barracks < doctrine.barracks else t.NO_KIND


@compiled
def wanted_luxury(seen: Any) -> int:
    """A purchase that pays off late: another hall, a well where oil is used, smithy, upgrades."""
    doctrine = seen.doctrine
    if num_with_sites(seen, t.TOWN_HALL) < doctrine.halls:
        return t.TOWN_HALL
    if seen.own[t.BARRACKS] == 0:
        return t.NO_KIND
    uses_oil = num_with_sites(seen, t.SMITHY) > 0 or share_of(seen, t.CAVALRY) > 0
    if uses_oil and num_with_sites(seen, t.OIL_WELL) < doctrine.wells and has_pool(seen):
        return t.OIL_WELL
    if num_with_sites(seen, t.SMITHY) == 0:
        return t.SMITHY if wants_smithy(seen) else t.NO_KIND
    return wanted_upgrade(seen)


@compiled
def wants_smithy(seen: Any) -> bool:
    """True where there are soldiers to equip, and stone to build with."""
    if seen.doctrine.upgrades == 0 or seen.rules.product[t.SMITHY, rb.PRODUCT_IS_ENABLED] == 0:
        return False
    if seen.facts[sight.NUM_SOLDIERS] < ENOUGH_SOLDIERS:
        return False
    if price(seen, t.SMITHY, t.STONE) <= seen.store[t.STONE]:
        return True
    for cell in range(seen.rules.rows * seen.rules.columns):
        if seen.ground[cell] == t.STONE_TILE:
            return True
    return False


@compiled
def wanted_upgrade(seen: Any) -> int:
    """The upgrade of the lowest level for which gold alone may be missing, or NO_KIND."""
    chosen, lowest = t.NO_KIND, seen.doctrine.upgrades
    if seen.facts[sight.FREE_SMITHY] == sight.NO_CELL:
        return t.NO_KIND
    for product in range(t.FIRST_UPGRADE, t.NUM_PRODUCTS):
        level = int(seen.level[product - t.FIRST_UPGRADE])
        if level < lowest and can_spare(seen, product, BUT_GOLD):
            chosen, lowest = product, level
    return chosen


@compiled
def choose_purchase(seen: Any) -> None:
    """Set the product that is saved for, and put its price by."""
    product = wanted_building(seen)
    seen.facts[sight.SAVED_FOR] = product
    if product != t.NO_KIND:
        for resource in range(t.NUM_RESOURCES):
            seen.saved[resource] = price(seen, product, resource)


@compiled
def share_of(seen: Any, kind: int) -> int:
    """The share of a kind in the army: the doctrine's, and the answer to the enemies in sight.

    Archers shoot footmen, footmen stop cavalry, cavalry rides archers down.
    """
    doctrine = seen.doctrine
    if kind == t.FOOTMAN:
        return int(doctrine.footmen + doctrine.answers * seen.foes[t.CAVALRY])
    if kind == t.ARCHER:
        return int(doctrine.archers + doctrine.answers * seen.foes[t.FOOTMAN])
    return int(doctrine.cavalry + doctrine.answers * seen.foes[t.ARCHER])


@compiled
def choose_soldier(seen: Any) -> int:
    """The kind that the army lacks most; NO_KIND for none, or while gold is awaited in peace."""
    chosen, best = t.NO_KIND, sight.FAR
    is_pressed = is_outnumbered(seen)
    for kind in range(t.FOOTMAN, t.CAVALRY + 1):
        share = share_of(seen, kind)
        if share <= 0 or not can_spare(seen, kind, BUT_GOLD):
            continue
        if is_pressed and not can_spare(seen, kind, t.GOLD):
            continue
        have = 1000 * (int(seen.own[kind]) + 1) // share
        if have < best:
            chosen, best = kind, have
    if chosen == t.NO_KIND or not can_spare(seen, chosen, t.GOLD):
        return t.NO_KIND
    return chosen


# --- sites -------------------------------------------------------------------------------------


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
    """Distance of a site from home, or for a second hall from new gold, in half steps."""
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
def best_site(seen: Any, kind: int) -> int:
    """The site near home and near a peasant, NO_CELL for none."""
    half = int(seen.rules.kinds[kind, rb.KIND_HALF_SIZE])
    best, best_price = sight.NO_CELL, sight.FAR
    for cell in range(seen.rules.rows * seen.rules.columns):
        if kind == t.OIL_WELL:
            is_site = is_beside_pool(seen, cell)
        else:
            is_site = is_clear(seen, cell, half) and keeps_ways_open(seen, cell, half)
        if not is_site:
            continue
        person = nearest_person(seen, cell)
        cost = site_price(seen, kind, cell) + 2 * sight.distance(seen, person, cell)
        if cost < best_price:
            best, best_price = cell, cost
    return best
