"""How the scripted players of Deep RTS run their economy: train, build and gather.

A job names a unit and an action of it; where that unit is not under the cursor, the player selects
it first. NOOP stands for nothing to do.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled, compiled_compact
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.bots import purchases
from marl_cair.games.deep_rts.bots.sight import (
    FAR,
    FOOD_MADE,
    FOOD_USED,
    FREE_SMITHY,
    HOME,
    MINE,
    NO_CELL,
    NUM_PEOPLE,
    SAVED_FOR,
    SELECTED_CELL,
    distance,
    is_ground,
    is_idle,
    is_out,
    shows,
)
from marl_cair.games.deep_rts.bots.sites import best_site, nearest_person
from marl_cair.games.deep_rts.orders.orders import (
    FIRST_CELL,
    FIRST_PRODUCT,
    GO_THERE,
    NOOP,
    SELECT_THERE,
)
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.views.planes import CARRIES, SELECTED, TIME_LEFT

BARE_WORKERS = 6  # peasants that are replaced even where the enemy has more soldiers
GOLD_WEIGHT = 100  # of gathering; the doctrine's lumber_weight stands against it
WORTH_OF_A_WORKER = 40  # units of a resource that it will have brought in before long
SKEWED_STORE = 80  # units
FULL_STORE = 400  # units of which no more is needed
SKEW = 2  # a store this many times the other, by weight, moves a worker
STONE_LEVELS = 4  # of the time left, in one of which a worker is moved to the stone


# --- orders --------------------------------------------------------------------------------------


@compiled
def cell_action(known: Any, order: int, cell: int) -> int:
    """Go there, advance there or select there."""
    return int(FIRST_CELL + order * known.rules.rows * known.rules.columns + cell)


@compiled
def give_order(planes: Any, mask: Any, known: Any, cell: int, action: int) -> int:
    """The action where the unit on `cell` is under the cursor, else select it; NOOP if illegal."""
    if not shows(planes, known, SELECTED, cell):
        action = cell_action(known, SELECT_THERE, cell)
    return action if mask[action] else NOOP


# --- training ------------------------------------------------------------------------------------


@compiled
def wants_worker(known: Any, sight: Any) -> bool:
    """True for another peasant: the first ones at any price, no more of them in need."""
    workers, doctrine = purchases.num_workers(sight), known.doctrine
    if purchases.is_outnumbered(known, sight):
        return bool(workers < min(doctrine.workers_first, BARE_WORKERS))
    if workers < doctrine.workers_first:
        return purchases.can_afford(known, sight, t.PEASANT)
    return workers < doctrine.workers and purchases.can_spare(known, sight, t.PEASANT)


@compiled
def train(planes: Any, mask: Any, known: Any, sight: Any) -> int:
    """Peasants up to the doctrine's number, soldiers always."""
    food = sight.facts[FOOD_MADE] - sight.facts[FOOD_USED]
    if food <= 0:
        return NOOP
    for cell in range(known.rules.rows * known.rules.columns):
        if sight.side[cell] != MINE or not is_idle(planes, known, cell):
            continue
        product = t.NO_KIND
        if sight.kind[cell] == t.TOWN_HALL and wants_worker(known, sight):
            product = t.PEASANT
        elif sight.kind[cell] == t.BARRACKS:
            product = purchases.choose_soldier(known, sight)
        if product != t.NO_KIND and food >= known.rules.kinds[product, rb.KIND_FOOD_CONSUMED]:
            action = give_order(planes, mask, known, cell, FIRST_PRODUCT + product)
            if action != NOOP:
                return action
    return NOOP


# --- building ------------------------------------------------------------------------------------


@compiled
def build(planes: Any, mask: Any, known: Any, sight: Any) -> int:
    """Forge what is saved for, or have the nearest peasant go to the best site and build there."""
    kind = sight.facts[SAVED_FOR]
    if kind == t.NO_KIND or not purchases.can_afford(known, sight, kind):
        return NOOP
    if kind >= t.FIRST_UPGRADE:
        return give_order(planes, mask, known, sight.facts[FREE_SMITHY], FIRST_PRODUCT + kind)
    if sight.facts[NUM_PEOPLE] == 0:
        return NOOP
    site = best_site(known, sight, kind)
    if site == NO_CELL:
        return NOOP
    person = nearest_person(known, sight, site)
    if person == site:
        return give_order(planes, mask, known, person, FIRST_PRODUCT + kind)
    return give_order(planes, mask, known, person, cell_action(known, GO_THERE, site))


# --- gathering -----------------------------------------------------------------------------------


@compiled
def is_short(known: Any, sight: Any, resource: int) -> bool:
    """True where a purchase waits for this resource alone, and too little is on its way."""
    coming = sight.store[resource] + known.rules.carry_capacity * sight.carriers[resource]
    if resource != t.STONE:
        other = t.GOLD + t.LUMBER - resource
        if sight.store[other] < sight.saved[other]:
            return False
    return bool(coming < sight.saved[resource])


@compiled
def lacking_resource(known: Any, sight: Any) -> int:
    """What a purchase waits for, else gold or lumber, the shorter by the doctrine's weights."""
    for resource in (t.STONE, t.LUMBER, t.GOLD):
        if is_short(known, sight, resource):
            return resource
    gold = sight.store[t.GOLD] + WORTH_OF_A_WORKER * sight.carriers[t.GOLD]
    lumber = sight.store[t.LUMBER] + WORTH_OF_A_WORKER * sight.carriers[t.LUMBER]
    return t.LUMBER if lumber * GOLD_WEIGHT < gold * known.doctrine.lumber_weight else t.GOLD


@compiled
def has_access(known: Any, sight: Any, tile: int) -> bool:
    """True where a unit can stand beside a tile."""
    row, column = tile // known.rules.columns, tile % known.rules.columns
    for there_row in range(row - 1, row + 2):
        for there_column in range(column - 1, column + 2):
            if is_ground(known, sight, there_row, there_column):
                return True
    return False


@compiled_compact
def nearest_tile(known: Any, sight: Any, resource: int, worker: int) -> int:
    """The tile of a resource with the shortest way from a worker and on to the hall."""
    best, best_price = NO_CELL, FAR
    for tile in range(known.rules.rows * known.rules.columns):
        if known.rules.tiles[sight.ground[tile], rb.TILE_RESOURCE] != resource:
            continue
        cost = distance(known, tile, worker) + 2 * distance(known, tile, sight.facts[HOME])
        for place in range(sight.facts[NUM_PEOPLE]):
            cost += int(distance(known, tile, sight.people[place]) <= 1)
        if cost < best_price and has_access(known, sight, tile):
            best, best_price = tile, cost
    return best


@compiled
def send_to_harvest(
    planes: Any, mask: Any, known: Any, sight: Any, worker: int, resource: int
) -> int:
    """To the nearest tile of a resource, else of gold or lumber."""
    tile = nearest_tile(known, sight, resource, worker)
    if tile == NO_CELL:
        tile = nearest_tile(known, sight, t.LUMBER if resource == t.GOLD else t.GOLD, worker)
    if tile == NO_CELL:
        return NOOP
    return give_order(planes, mask, known, worker, cell_action(known, GO_THERE, tile))


@compiled
def is_scout(known: Any, sight: Any, cell: int) -> bool:
    """True for a peasant that looks at the enemy: nearer to it than to home, where all is dark."""
    if known.doctrine.scouts == 0 or known.rules.fog == 0:
        return False
    return is_out(known, sight, cell)


@compiled
def gather(planes: Any, mask: Any, known: Any, sight: Any) -> int:
    """Send idle peasants to what is lacking, the selected one first."""
    worker = NO_CELL
    for place in range(sight.facts[NUM_PEOPLE]):
        cell = sight.people[place]
        if not is_idle(planes, known, cell) or is_scout(known, sight, cell):
            continue
        if worker == NO_CELL or cell == sight.facts[SELECTED_CELL]:
            worker = cell
    if worker == NO_CELL:
        return NOOP
    return send_to_harvest(planes, mask, known, sight, worker, lacking_resource(known, sight))


@compiled
def is_skewed(known: Any, sight: Any, lacking: int, other: int) -> bool:
    """True where one of gold and lumber is far larger than the other, by the doctrine's weights."""
    weight = known.doctrine.lumber_weight
    have = sight.store[lacking] * (weight if lacking == t.GOLD else GOLD_WEIGHT)
    spare = sight.store[other] * (GOLD_WEIGHT if lacking == t.GOLD else weight)
    if sight.store[other] < SKEWED_STORE or spare < SKEW * have:
        return False
    if sight.store[other] >= FULL_STORE:
        return True
    at_lacking = sight.carriers[lacking] * (weight if lacking == t.GOLD else GOLD_WEIGHT)
    at_other = sight.carriers[other] * (GOLD_WEIGHT if lacking == t.GOLD else weight)
    return bool(at_lacking < at_other)


@compiled
def resource_to_leave(planes: Any, known: Any, sight: Any, lacking: int) -> int:
    """Whose worker is moved to what is lacking; NO_RESOURCE for nobody's."""
    if lacking == t.STONE:
        if int(planes[TIME_LEFT, 0, 0]) % STONE_LEVELS > 0:
            return t.NO_RESOURCE  # who was sent before is still on the way
        return t.GOLD if sight.carriers[t.GOLD] >= sight.carriers[t.LUMBER] else t.LUMBER
    if sight.carriers[t.STONE] > 0:
        return t.STONE
    other = t.GOLD + t.LUMBER - lacking
    if is_short(known, sight, lacking) or is_skewed(known, sight, lacking, other):
        return other
    return t.NO_RESOURCE


@compiled
def move_worker(planes: Any, mask: Any, known: Any, sight: Any) -> int:
    """Where one store is far larger than the other, move a worker; it brings its load in first."""
    lacking = lacking_resource(known, sight)
    left = resource_to_leave(planes, known, sight, lacking)
    if left == t.NO_RESOURCE:
        return NOOP
    worker, selected = NO_CELL, sight.facts[SELECTED_CELL]
    for place in range(sight.facts[NUM_PEOPLE]):
        cell = sight.people[place]
        if (worker == NO_CELL or cell == selected) and shows(planes, known, CARRIES + left, cell):
            worker = cell
    if worker == NO_CELL:
        return NOOP
    return send_to_harvest(planes, mask, known, sight, worker, lacking)
