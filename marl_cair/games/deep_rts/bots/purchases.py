"""Chooses the next purchase of a scripted player of Deep RTS: buildings, upgrades, soldiers."""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.bots import sight
from marl_cair.games.deep_rts.bots.sites import has_pool
from marl_cair.games.deep_rts.rules import rulebook as rb

RICH = 2  # prices of a barracks, in gold, from which another is built
ENOUGH_SOLDIERS = 7  # before the smithy
BUT_GOLD = t.GOLD + 1  # the first resource but gold, which always comes


@compiled
def price(seen: Any, product: int, resource: int) -> int:
    """Of a product in a resource."""
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


# --- which soldier -------------------------------------------------------------------------------


@compiled
def share_of(seen: Any, kind: int) -> int:
    """How much of a kind the army should have: the doctrine's share, and the answer to a kind.

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
