"""What the scripted players of Deep RTS buy next: buildings, upgrades, soldiers."""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.bots.sight import (
    FAR,
    FOOD_MADE,
    FOOD_USED,
    FREE_SMITHY,
    NO_CELL,
    NUM_FOE_SOLDIERS,
    NUM_RAIDERS,
    NUM_SOLDIERS,
    SAVED_FOR,
)
from marl_cair.games.deep_rts.bots.sites import has_pool, has_tile
from marl_cair.games.deep_rts.rules import rulebook as rb

RICH = 2  # prices of a barracks, in gold, from which another is built
ENOUGH_SOLDIERS = 7  # before the smithy


@compiled
def price(known: Any, product: int, resource: int) -> int:
    """Of a product in a resource."""
    return int(known.rules.product[product, rb.PRODUCT_COST + resource])


@compiled
def can_afford(known: Any, sight: Any, product: int) -> bool:
    """True where the stores hold the price."""
    if known.rules.product[product, rb.PRODUCT_IS_ENABLED] == 0:
        return False
    for resource in range(t.NUM_RESOURCES):
        if sight.store[resource] < price(known, product, resource):
            return False
    return True


@compiled
def can_spare(known: Any, sight: Any, product: int) -> bool:
    """True where the price can be paid and what is saved for a building stays."""
    for resource in range(t.NUM_RESOURCES):
        cost = price(known, product, resource)
        if cost > 0 and sight.store[resource] < cost + sight.saved[resource]:
            return False
    return can_afford(known, sight, product)


@compiled
def num_with_sites(sight: Any, kind: int) -> int:
    """Own units of a kind, those under construction too."""
    return int(sight.own[kind] + sight.rising[kind])


@compiled
def num_workers(sight: Any) -> int:
    """Own peasants, those inside a site too."""
    workers = sight.own[t.PEASANT]
    for kind in range(t.NUM_MOBILE_KINDS, sight.rising.shape[0]):
        workers += sight.rising[kind]
    return int(workers)


@compiled
def is_outnumbered(known: Any, sight: Any) -> bool:
    """True where an enemy, or those who came, have more soldiers than the player."""
    soldiers = sight.facts[NUM_SOLDIERS]
    return bool(
        sight.facts[NUM_FOE_SOLDIERS] > known.rivals * soldiers
        or sight.facts[NUM_RAIDERS] > soldiers
    )


@compiled
def food_to_come(known: Any, sight: Any) -> int:
    """What the own buildings feed, sites too."""
    made = int(sight.facts[FOOD_MADE])
    for kind in (t.TOWN_HALL, t.FARM):
        made += int(sight.rising[kind]) * int(known.rules.kinds[kind, rb.KIND_FOOD_PRODUCED])
    return made


@compiled
def wanted_building(known: Any, sight: Any) -> int:
    """The next building, or NO_KIND."""
    doctrine = known.doctrine
    if num_with_sites(sight, t.TOWN_HALL) == 0:  # without one, no more gold comes
        return t.TOWN_HALL if can_afford(known, sight, t.TOWN_HALL) else t.NO_KIND
    made, workers = food_to_come(known, sight), num_workers(sight)
    barracks = num_with_sites(sight, t.BARRACKS)
    is_threatened = sight.facts[NUM_RAIDERS] > 0 or (
        doctrine.answers > 0 and sight.facts[NUM_FOE_SOLDIERS] > 0
    )
    needs_barracks = barracks == 0 and (is_threatened or workers >= doctrine.workers_first)
    free = made - sight.facts[FOOD_USED]
    is_hungry = free < doctrine.free_food and made < known.rules.food_limit
    if is_hungry and (free <= 0 or not needs_barracks):
        return t.FARM
    if needs_barracks:
        return t.BARRACKS
    if workers >= doctrine.workers_first and not is_outnumbered(known, sight):
        luxury = wanted_luxury(known, sight)
        if luxury != t.NO_KIND:
            return luxury
    is_rich = sight.store[t.GOLD] >= RICH * price(known, t.BARRACKS, t.GOLD)
    return t.BARRACKS if is_rich and 0 < barracks < doctrine.barracks else t.NO_KIND


@compiled
def wanted_luxury(known: Any, sight: Any) -> int:
    """What pays off late: another hall, a well for who uses oil, a smithy and its upgrades."""
    doctrine = known.doctrine
    if num_with_sites(sight, t.TOWN_HALL) < doctrine.halls:
        return t.TOWN_HALL
    if sight.own[t.BARRACKS] == 0:
        return t.NO_KIND
    uses_oil = num_with_sites(sight, t.SMITHY) > 0 or share_of(known, sight, t.CAVALRY) > 0
    if (
        uses_oil
        and num_with_sites(sight, t.OIL_WELL) < doctrine.wells
        and can_have_well(known, sight)
    ):
        return t.OIL_WELL
    if num_with_sites(sight, t.SMITHY) == 0:
        return t.SMITHY if wants_smithy(known, sight) else t.NO_KIND
    return wanted_upgrade(known, sight)


@compiled
def wants_smithy(known: Any, sight: Any) -> bool:
    """True for who has soldiers to equip, and stone to build of."""
    if known.doctrine.upgrades == 0 or known.rules.product[t.SMITHY, rb.PRODUCT_IS_ENABLED] == 0:
        return False
    if sight.facts[NUM_SOLDIERS] < ENOUGH_SOLDIERS:
        return False
    missing = price(known, t.SMITHY, t.STONE) - sight.store[t.STONE]
    return bool(missing <= 0 or has_tile(known, sight, t.STONE_TILE))


@compiled
def wanted_upgrade(known: Any, sight: Any) -> int:
    """The upgrade of the lowest level for which gold alone may be missing, or NO_KIND."""
    chosen, lowest = t.NO_KIND, known.doctrine.upgrades
    if sight.facts[FREE_SMITHY] == NO_CELL:
        return t.NO_KIND
    for product in range(t.FIRST_UPGRADE, t.NUM_PRODUCTS):
        level = int(sight.level[product - t.FIRST_UPGRADE])
        if level < lowest and has_all_but_gold(known, sight, product):
            chosen, lowest = product, level
    return chosen


@compiled
def can_have_well(known: Any, sight: Any) -> bool:
    """True where the rules have wells, and a pool is near."""
    return bool(
        known.rules.product[t.OIL_WELL, rb.PRODUCT_IS_ENABLED] != 0 and has_pool(known, sight)
    )


@compiled
def choose_purchase(known: Any, sight: Any) -> None:
    """Set what is saved for, and put its price by."""
    product = wanted_building(known, sight)
    sight.facts[SAVED_FOR] = product
    if product != t.NO_KIND:
        for resource in range(t.NUM_RESOURCES):
            sight.saved[resource] = price(known, product, resource)


# --- which soldier -------------------------------------------------------------------------------


@compiled
def share_of(known: Any, sight: Any, kind: int) -> int:
    """How much of a kind the army should have: the doctrine's share, and the answer to a kind.

    Archers shoot footmen, footmen stop cavalry, cavalry rides archers down.
    """
    doctrine = known.doctrine
    if kind == t.FOOTMAN:
        return int(doctrine.footmen + doctrine.answers * sight.foes[t.CAVALRY])
    if kind == t.ARCHER:
        return int(doctrine.archers + doctrine.answers * sight.foes[t.FOOTMAN])
    return int(doctrine.cavalry + doctrine.answers * sight.foes[t.ARCHER])


@compiled
def has_all_but_gold(known: Any, sight: Any, product: int) -> bool:
    """True where gold, which always comes, is all that may be missing."""
    if known.rules.product[product, rb.PRODUCT_IS_ENABLED] == 0:
        return False
    for resource in range(t.GOLD + 1, t.NUM_RESOURCES):
        cost = price(known, product, resource)
        if cost > 0 and sight.store[resource] < cost + sight.saved[resource]:
            return False
    return True


@compiled
def choose_soldier(known: Any, sight: Any) -> int:
    """The kind that the army lacks most; NO_KIND for none, or while gold is awaited in peace."""
    chosen, best = t.NO_KIND, FAR
    is_pressed = is_outnumbered(known, sight)
    for kind in range(t.FOOTMAN, t.CAVALRY + 1):
        share = share_of(known, sight, kind)
        if share <= 0 or not has_all_but_gold(known, sight, kind):
            continue
        if is_pressed and not can_spare(known, sight, kind):
            continue
        have = 1000 * (int(sight.own[kind]) + 1) // share
        if have < best:
            chosen, best = kind, have
    if chosen == t.NO_KIND or not can_spare(known, sight, chosen):
        return t.NO_KIND
    return chosen
