"""How the scripted players of Deep RTS run their economy: what to buy, train, build and gather.

A job names a unit and an action of it; where that unit is not under the cursor, the player selects
it first. NOOP stands for nothing to do.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled, compiled_compact
from marl_cair.games.deep_rts.bot_sight import (
    FAR,
    FOOD_MADE,
    FOOD_USED,
    HOME,
    MINE,
    NO_CELL,
    NUM_FOE_SOLDIERS,
    NUM_PEOPLE,
    NUM_SOLDIERS,
    SAVED_FOR,
    SELECTED_CELL,
    distance,
    is_clear,
    is_ground,
    is_idle,
    keeps_ways_open,
    shows,
)
from marl_cair.games.deep_rts.orders import (
    FIRST_CELL,
    FIRST_PRODUCT,
    GO_THERE,
    NOOP,
    SELECT_THERE,
)
from marl_cair.games.deep_rts.planes import CARRIES, SELECTED
from marl_cair.games.deep_rts.rulebook import (
    KIND_FOOD_CONSUMED,
    KIND_FOOD_PRODUCED,
    KIND_HALF_SIZE,
    PRODUCT_COST,
    PRODUCT_IS_ENABLED,
    TILE_RESOURCE,
)
from marl_cair.games.deep_rts.tables import (
    ARCHER,
    BARRACKS,
    CAVALRY,
    FARM,
    FOOTMAN,
    GOLD,
    LUMBER,
    NO_KIND,
    NUM_MOBILE_KINDS,
    NUM_RESOURCES,
    PEASANT,
    TOWN_HALL,
)

BARE_WORKERS = 6  # peasants that are replaced even where the enemy has more soldiers
RICH = 2  # prices of a barracks in store from which another is built
GOLD_WEIGHT = 100  # of gathering; the doctrine's lumber_weight stands against it
WORTH_OF_A_WORKER = 40  # units of a resource that it will have brought in before long
LOYALTY = 5  # half steps by which the selected peasant is preferred as a builder
SKEWED_STORE = 100  # units
SKEW = 4  # a store this many times the other, by weight, moves a worker
EXPANSION_STEPS = 4  # from home to the gold that a second hall is built for, more than this


# --- orders --------------------------------------------------------------------------------------


@compiled
def cell_action(known: Any, order: int, cell: int) -> int:
    """Go there, advance there or select there."""
    return int(FIRST_CELL + order * known.rules.rows * known.rules.columns + cell)


@compiled
def tell(planes: Any, mask: Any, known: Any, cell: int, action: int) -> int:
    """The action where the unit on `cell` is under the cursor, else select it; NOOP if illegal."""
    if not shows(planes, known, SELECTED, cell):
        action = cell_action(known, SELECT_THERE, cell)
    return action if mask[action] else NOOP


# --- what to buy ---------------------------------------------------------------------------------


@compiled
def price(known: Any, product: int, resource: int) -> int:
    """Of a product in a resource."""
    return int(known.rules.product[product, PRODUCT_COST + resource])


@compiled
def can_afford(known: Any, sight: Any, product: int, times: int) -> bool:
    """True where the stores hold the price so many times."""
    if known.rules.product[product, PRODUCT_IS_ENABLED] == 0:
        return False
    for resource in range(NUM_RESOURCES):
        if sight.store[resource] < times * price(known, product, resource):
            return False
    return True


@compiled
def can_spare(known: Any, sight: Any, product: int) -> bool:
    """True where the price can be paid and what is saved for a building stays."""
    for resource in range(NUM_RESOURCES):
        cost = price(known, product, resource)
        if cost > 0 and sight.store[resource] < cost + sight.saved[resource]:
            return False
    return can_afford(known, sight, product, 1)


@compiled
def num_with_sites(sight: Any, kind: int) -> int:
    """Own units of a kind, those under construction too."""
    return int(sight.own[kind] + sight.rising[kind])


@compiled
def num_workers(sight: Any) -> int:
    """Own peasants, those inside a site too."""
    workers = sight.own[PEASANT]
    for kind in range(NUM_MOBILE_KINDS, sight.rising.shape[0]):
        workers += sight.rising[kind]
    return int(workers)


@compiled
def is_outnumbered(sight: Any) -> bool:
    """True where the enemy shows more soldiers than the player has."""
    return bool(sight.facts[NUM_FOE_SOLDIERS] > sight.facts[NUM_SOLDIERS])


@compiled
def wanted_building(known: Any, sight: Any) -> int:
    """The next building, or NO_KIND."""
    doctrine = known.doctrine
    if num_with_sites(sight, TOWN_HALL) == 0:
        return TOWN_HALL
    made = sight.facts[FOOD_MADE] + sight.rising[FARM] * int(
        known.rules.kinds[FARM, KIND_FOOD_PRODUCED]
    )
    made += sight.rising[TOWN_HALL] * int(known.rules.kinds[TOWN_HALL, KIND_FOOD_PRODUCED])
    workers, barracks = num_workers(sight), num_with_sites(sight, BARRACKS)
    is_threatened = sight.facts[NUM_FOE_SOLDIERS] > 0
    needs_barracks = barracks == 0 and (is_threatened or workers >= doctrine.workers_first)
    free = made - sight.facts[FOOD_USED]
    is_hungry = free < doctrine.free_food and made < known.rules.food_limit
    if is_hungry and (free <= 0 or not needs_barracks):
        return FARM
    if needs_barracks:
        return BARRACKS
    is_settled = workers >= doctrine.workers_first and not is_outnumbered(sight)
    if is_settled and num_with_sites(sight, TOWN_HALL) < doctrine.halls:
        return TOWN_HALL
    if 0 < barracks < doctrine.barracks and can_afford(known, sight, BARRACKS, RICH):
        return BARRACKS
    return NO_KIND


@compiled
def choose_building(known: Any, sight: Any) -> None:
    """Set what is saved for, and put its price by."""
    kind = wanted_building(known, sight)
    sight.facts[SAVED_FOR] = kind
    if kind != NO_KIND:
        for resource in range(NUM_RESOURCES):
            sight.saved[resource] = price(known, kind, resource)


# --- training ------------------------------------------------------------------------------------


@compiled
def wants_worker(known: Any, sight: Any) -> bool:
    """True for another peasant: the first ones at any price, no more of them in need."""
    workers, doctrine = num_workers(sight), known.doctrine
    if is_outnumbered(sight):
        return bool(workers < min(doctrine.workers_first, BARE_WORKERS))
    if workers < doctrine.workers_first:
        return can_afford(known, sight, PEASANT, 1)
    return workers < doctrine.workers and can_spare(known, sight, PEASANT)


@compiled
def train(planes: Any, mask: Any, known: Any, sight: Any) -> int:
    """Peasants up to the doctrine's number, soldiers always."""
    food = sight.facts[FOOD_MADE] - sight.facts[FOOD_USED]
    if food <= 0:
        return NOOP
    for cell in range(known.rules.rows * known.rules.columns):
        if sight.side[cell] != MINE or not is_idle(planes, known, cell):
            continue
        product = NO_KIND
        if sight.kind[cell] == TOWN_HALL and wants_worker(known, sight):
            product = PEASANT
        elif sight.kind[cell] == BARRACKS:
            product = choose_soldier(known, sight)
        if product != NO_KIND and food >= known.rules.kinds[product, KIND_FOOD_CONSUMED]:
            action = tell(planes, mask, known, cell, FIRST_PRODUCT + product)
            if action != NOOP:
                return action
    return NOOP


@compiled
def share_of(known: Any, kind: int) -> int:
    """How much of a kind of soldier the army should have."""
    doctrine = known.doctrine
    if kind == FOOTMAN:
        return int(doctrine.footmen)
    return int(doctrine.archers if kind == ARCHER else doctrine.cavalry)


@compiled
def choose_soldier(known: Any, sight: Any) -> int:
    """Of the kinds that can be paid, the one that the army lacks most; NO_KIND for none."""
    chosen, best = NO_KIND, FAR
    for kind in range(FOOTMAN, CAVALRY + 1):
        share = share_of(known, kind)
        if share > 0 and can_spare(known, sight, kind):
            have = 1000 * (sight.own[kind] + 1) // share
            if have < best:
                chosen, best = kind, have
    return chosen


# --- building ------------------------------------------------------------------------------------


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
def site_price(known: Any, sight: Any, kind: int, cell: int) -> int:
    """How far a site lies from where it should be: home, or for a second hall fresh gold."""
    home = sight.facts[HOME]
    if kind != TOWN_HALL or sight.own[TOWN_HALL] == 0:
        return 2 * distance(known, cell, home)
    best = FAR
    for tile in range(known.rules.rows * known.rules.columns):
        if known.rules.tiles[sight.ground[tile], TILE_RESOURCE] == GOLD:
            from_home = distance(known, tile, home)
            if from_home > EXPANSION_STEPS:
                best = min(best, 4 * distance(known, tile, cell) + 2 * from_home)
    return 2 * distance(known, cell, home) if best == FAR else best


@compiled
def best_site(known: Any, sight: Any, kind: int) -> int:
    """The site near home and near a peasant, NO_CELL for none."""
    half = int(known.rules.kinds[kind, KIND_HALF_SIZE])
    best, best_price = NO_CELL, FAR
    for cell in range(known.rules.rows * known.rules.columns):
        if not is_clear(known, sight, cell, half) or not keeps_ways_open(known, sight, cell, half):
            continue
        person = nearest_person(known, sight, cell)
        cost = site_price(known, sight, kind, cell) + 2 * distance(known, person, cell)
        if cost < best_price:
            best, best_price = cell, cost
    return best


@compiled
def build(planes: Any, mask: Any, known: Any, sight: Any) -> int:
    """Have the nearest peasant walk to the best site, and build where it stands."""
    kind = sight.facts[SAVED_FOR]
    if kind == NO_KIND or sight.facts[NUM_PEOPLE] == 0 or not can_afford(known, sight, kind, 1):
        return NOOP
    site = best_site(known, sight, kind)
    if site == NO_CELL:
        return NOOP
    person = nearest_person(known, sight, site)
    if person == site:
        return tell(planes, mask, known, person, FIRST_PRODUCT + kind)
    return tell(planes, mask, known, person, cell_action(known, GO_THERE, site))


# --- gathering -----------------------------------------------------------------------------------


@compiled
def is_short(known: Any, sight: Any, resource: int) -> bool:
    """True where a building waits for this resource alone, and too little is on its way."""
    other = GOLD + LUMBER - resource
    coming = sight.store[resource] + known.rules.carry_capacity * sight.carriers[resource]
    return bool(coming < sight.saved[resource] and sight.store[other] >= sight.saved[other])


@compiled
def lacking_resource(known: Any, sight: Any) -> int:
    """Gold or lumber: what a building waits for, else the shorter by the doctrine's weights."""
    if is_short(known, sight, LUMBER):
        return LUMBER
    if is_short(known, sight, GOLD):
        return GOLD
    gold = sight.store[GOLD] + WORTH_OF_A_WORKER * sight.carriers[GOLD]
    lumber = sight.store[LUMBER] + WORTH_OF_A_WORKER * sight.carriers[LUMBER]
    return LUMBER if lumber * GOLD_WEIGHT < gold * known.doctrine.lumber_weight else GOLD


@compiled
def has_access(known: Any, sight: Any, tile: int) -> bool:
    """True where somebody can stand beside a tile."""
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
        if known.rules.tiles[sight.ground[tile], TILE_RESOURCE] != resource:
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
    """To the nearest tile of a resource, else of the other."""
    tile = nearest_tile(known, sight, resource, worker)
    if tile == NO_CELL:
        tile = nearest_tile(known, sight, GOLD + LUMBER - resource, worker)
    if tile == NO_CELL:
        return NOOP
    return tell(planes, mask, known, worker, cell_action(known, GO_THERE, tile))


@compiled
def gather(planes: Any, mask: Any, known: Any, sight: Any) -> int:
    """Send idle peasants to what is lacking, the selected one first."""
    worker = NO_CELL
    for place in range(sight.facts[NUM_PEOPLE]):
        cell = sight.people[place]
        if is_idle(planes, known, cell) and (
            worker == NO_CELL or cell == sight.facts[SELECTED_CELL]
        ):
            worker = cell
    if worker == NO_CELL:
        return NOOP
    return send_to_harvest(planes, mask, known, sight, worker, lacking_resource(known, sight))


@compiled
def move_worker(planes: Any, mask: Any, known: Any, sight: Any) -> int:
    """Where one store is far larger than the other, move a worker; it brings its load in first."""
    lacking = lacking_resource(known, sight)
    other = GOLD + LUMBER - lacking
    if not is_short(known, sight, lacking):
        weight = known.doctrine.lumber_weight
        have = sight.store[lacking] * (weight if lacking == GOLD else GOLD_WEIGHT)
        spare = sight.store[other] * (GOLD_WEIGHT if lacking == GOLD else weight)
        if sight.store[other] < SKEWED_STORE or spare < SKEW * have:
            return NOOP
        if sight.carriers[lacking] >= sight.carriers[other]:
            return NOOP
    worker, selected = NO_CELL, sight.facts[SELECTED_CELL]
    for place in range(sight.facts[NUM_PEOPLE]):
        cell = sight.people[place]
        if (worker == NO_CELL or cell == selected) and shows(planes, known, CARRIES + other, cell):
            worker = cell
    if worker == NO_CELL:
        return NOOP
    return send_to_harvest(planes, mask, known, sight, worker, lacking)
