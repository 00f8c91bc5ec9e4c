"""Chooses actions of the scripted players of Deep RTS from one player's planes and mask.

A plan takes the first job that can be done: train, build, gather, fight, scout. A job names a unit
and an action of it; where that unit is not under the cursor, the player selects it first. NOOP
stands for nothing to do.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled, compiled_compact
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.bots import purchases, sight
from marl_cair.games.deep_rts.orders.orders import (
    ADVANCE_THERE,
    FIRST_CELL,
    FIRST_PRODUCT,
    GO_THERE,
    NOOP,
    SELECT_THERE,
)
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.views import planes as p

BARE_WORKERS = 6  # peasants that are replaced even where the enemy has more soldiers
GOLD_WEIGHT = 100  # of gathering; the doctrine's lumber_weight stands against it
WORTH_OF_A_WORKER = 40  # units of a resource that it will have brought in before long
SKEWED_STORE = 80  # units
FULL_STORE = 400  # units of which no more is needed
SKEW = 2  # a store this many times the other, by weight, moves a worker
STONE_LEVELS = 4  # of the time left, in one of which a worker is moved to the stone
CHASE_STEPS = 4  # to the enemy, of soldiers that are out without an attack
SPARE_FIGHTERS = 3  # peasants more than those that raid
MILITIA_STEPS = 4  # to an enemy, of peasants that are called
MILITIA_BIAS = 3  # half steps against peasants that walk, and for the selected one
SCOUT_LEVELS = 4  # of the time left, in one of which a scout is sent
SCOUT_WORKERS = 5  # peasants from which one can be spared
LATE = 50  # level of the time left at which all attack


@compiled
def plan_by_doctrine(planes: Any, mask: Any, seen: Any) -> int:
    """The first job that can be done: train, build, then soldiers and peasants by turns."""
    sight.read_sight(planes, seen)
    purchases.choose_purchase(seen)
    action = train(planes, mask, seen)
    if action == NOOP:
        action = call_militia(planes, mask, seen)
    if action == NOOP:
        action = build(planes, mask, seen)
    soldiers_first = int(planes[p.TIME_LEFT, 0, 0]) % 2
    if action == NOOP and soldiers_first == 1:
        action = command(planes, mask, seen)
    if action == NOOP:
        action = gather(planes, mask, seen)
    if action == NOOP and soldiers_first == 0:
        action = command(planes, mask, seen)
    if action == NOOP:
        action = move_worker(planes, mask, seen)
    if action == NOOP:
        action = scout(planes, mask, seen)
    return action


# --- economy -----------------------------------------------------------------------------------


@compiled
def cell_action(seen: Any, order: int, cell: int) -> int:
    """Go there, advance there or select there."""
    return int(FIRST_CELL + order * seen.rules.rows * seen.rules.columns + cell)


@compiled
def give_order(planes: Any, mask: Any, seen: Any, cell: int, action: int) -> int:
    """The action where the unit on `cell` is under the cursor, else select it; NOOP if illegal."""
    if not sight.shows(planes, seen, p.SELECTED, cell):
        action = cell_action(seen, SELECT_THERE, cell)
    return action if mask[action] else NOOP


@compiled
def send(planes: Any, mask: Any, seen: Any, unit: int, order: int, goal: int) -> int:
    """`give_order` to the unit on cell `unit`, of a kind of order for cell `goal`."""
    return give_order(planes, mask, seen, unit, cell_action(seen, order, goal))


@compiled
def wants_worker(seen: Any) -> bool:
    """True for another peasant: the first ones at any price, no more of them in need."""
    workers, doctrine = purchases.num_workers(seen), seen.doctrine
    mob = seen.facts[sight.NUM_MOB]
    if mob > 0 and workers < mob + SPARE_FIGHTERS:
        return purchases.can_afford(seen, t.PEASANT)
    if purchases.is_outnumbered(seen):
        return bool(workers < min(doctrine.workers_first, BARE_WORKERS))
    if workers < doctrine.workers_first:
        return purchases.can_afford(seen, t.PEASANT)
    return workers < doctrine.workers and purchases.can_spare(seen, t.PEASANT, t.GOLD)


@compiled
def train(planes: Any, mask: Any, seen: Any) -> int:
    """Peasants up to the doctrine's number, soldiers always."""
    food = seen.facts[sight.FOOD_MADE] - seen.facts[sight.FOOD_USED]
    if food <= 0:
        return NOOP
    for cell in range(seen.rules.rows * seen.rules.columns):
        if seen.side[cell] != sight.MINE or not sight.is_idle(planes, seen, cell):
            continue
        product = t.NO_KIND
        if seen.kind[cell] == t.TOWN_HALL and wants_worker(seen):
            product = t.PEASANT
        elif seen.kind[cell] == t.BARRACKS:
            product = purchases.choose_soldier(seen)
        if product != t.NO_KIND and food >= seen.rules.kinds[product, rb.KIND_FOOD_CONSUMED]:
            action = give_order(planes, mask, seen, cell, FIRST_PRODUCT + product)
            if action != NOOP:
                return action
    return NOOP


@compiled
def build(planes: Any, mask: Any, seen: Any) -> int:
    """Forge what is saved for, or have the nearest peasant go to the best site and build there."""
    kind = seen.facts[sight.SAVED_FOR]
    if kind == t.NO_KIND or not purchases.can_afford(seen, kind):
        return NOOP
    if kind >= t.FIRST_UPGRADE:
        return give_order(planes, mask, seen, seen.facts[sight.FREE_SMITHY], FIRST_PRODUCT + kind)
    if seen.facts[sight.NUM_PEOPLE] == 0:
        return NOOP
    site = purchases.best_site(seen, kind)
    if site == sight.NO_CELL:
        return NOOP
    person = purchases.nearest_person(seen, site)
    if person == site:
        return give_order(planes, mask, seen, person, FIRST_PRODUCT + kind)
    return send(planes, mask, seen, person, GO_THERE, site)


@compiled
def is_short(seen: Any, resource: int) -> bool:
    """True where a purchase waits for this resource alone, and too little is on its way."""
    coming = seen.store[resource] + seen.rules.carry_capacity * seen.carriers[resource]
    if resource != t.STONE:
        other = t.GOLD + t.LUMBER - resource
        if seen.store[other] < seen.saved[other]:
            return False
    return bool(coming < seen.saved[resource])


@compiled
def lacking_resource(seen: Any) -> int:
    """The resource that a purchase waits for, else gold or lumber by the doctrine's weights."""
    for resource in (t.STONE, t.LUMBER, t.GOLD):
        if is_short(seen, resource):
            return resource
    gold = seen.store[t.GOLD] + WORTH_OF_A_WORKER * seen.carriers[t.GOLD]
    lumber = seen.store[t.LUMBER] + WORTH_OF_A_WORKER * seen.carriers[t.LUMBER]
    return t.LUMBER if lumber * GOLD_WEIGHT < gold * seen.doctrine.lumber_weight else t.GOLD


@compiled
def has_access(seen: Any, tile: int) -> bool:
    """True where a unit can stand beside a tile."""
    row, column = tile // seen.rules.columns, tile % seen.rules.columns
    for there_row in range(row - 1, row + 2):
        for there_column in range(column - 1, column + 2):
            if sight.is_ground(seen, there_row, there_column):
                return True
    return False


@compiled_compact
def nearest_tile(seen: Any, resource: int, worker: int) -> int:
    """The tile of a resource with the shortest way from a worker and on to the hall."""
    best, best_price = sight.NO_CELL, sight.FAR
    for tile in range(seen.rules.rows * seen.rules.columns):
        if seen.rules.tiles[seen.ground[tile], rb.TILE_RESOURCE] != resource:
            continue
        cost = 2 * sight.distance(seen, tile, seen.facts[sight.HOME])
        cost += sight.distance(seen, tile, worker)
        for place in range(seen.facts[sight.NUM_PEOPLE]):
            cost += int(sight.distance(seen, tile, seen.people[place]) <= 1)
        if cost < best_price and has_access(seen, tile):
            best, best_price = tile, cost
    return best


@compiled
def send_to_harvest(planes: Any, mask: Any, seen: Any, worker: int, resource: int) -> int:
    """To the nearest tile of a resource, else of gold or lumber."""
    tile = nearest_tile(seen, resource, worker)
    if tile == sight.NO_CELL:
        tile = nearest_tile(seen, t.LUMBER if resource == t.GOLD else t.GOLD, worker)
    if tile == sight.NO_CELL:
        return NOOP
    return send(planes, mask, seen, worker, GO_THERE, tile)


@compiled
def is_scout(seen: Any, cell: int) -> bool:
    """True for a peasant nearer to the enemy than to home, in the fog."""
    if seen.doctrine.scouts == 0 or seen.rules.fog == 0:
        return False
    return sight.is_out(seen, cell)


@compiled
def gather(planes: Any, mask: Any, seen: Any) -> int:
    """Send idle peasants to what is lacking, the selected one first."""
    worker = sight.NO_CELL
    for place in range(seen.facts[sight.NUM_PEOPLE]):
        cell = seen.people[place]
        if not sight.is_idle(planes, seen, cell) or is_scout(seen, cell):
            continue
        if worker == sight.NO_CELL or cell == seen.facts[sight.SELECTED_CELL]:
            worker = cell
    if worker == sight.NO_CELL:
        return NOOP
    return send_to_harvest(planes, mask, seen, worker, lacking_resource(seen))


@compiled
def is_skewed(seen: Any, lacking: int, other: int) -> bool:
    """True where one of gold and lumber is far larger than the other, by the doctrine's weights."""
    weight, other_weight = seen.doctrine.lumber_weight, GOLD_WEIGHT
    if lacking != t.GOLD:
        weight, other_weight = other_weight, weight
    spare = seen.store[other] * other_weight
    if seen.store[other] < SKEWED_STORE or spare < SKEW * seen.store[lacking] * weight:
        return False
    if seen.store[other] >= FULL_STORE:
        return True
    return bool(seen.carriers[lacking] * weight < seen.carriers[other] * other_weight)


@compiled
def resource_to_leave(planes: Any, seen: Any, lacking: int) -> int:
    """The resource from which a worker moves to the lacking one, or NO_RESOURCE."""
    if lacking == t.STONE:
        if int(planes[p.TIME_LEFT, 0, 0]) % STONE_LEVELS > 0:
            return t.NO_RESOURCE  # the last one is still on the way
        return t.GOLD if seen.carriers[t.GOLD] >= seen.carriers[t.LUMBER] else t.LUMBER
    if seen.carriers[t.STONE] > 0:
        return t.STONE
    other = t.GOLD + t.LUMBER - lacking
    if is_short(seen, lacking) or is_skewed(seen, lacking, other):
        return other
    return t.NO_RESOURCE


@compiled
def move_worker(planes: Any, mask: Any, seen: Any) -> int:
    """Move a worker to the lacking resource; it delivers its load first."""
    lacking = lacking_resource(seen)
    left = resource_to_leave(planes, seen, lacking)
    if left == t.NO_RESOURCE:
        return NOOP
    worker, selected = sight.NO_CELL, seen.facts[sight.SELECTED_CELL]
    for place in range(seen.facts[sight.NUM_PEOPLE]):
        cell = seen.people[place]
        is_next = worker == sight.NO_CELL or cell == selected
        if is_next and sight.shows(planes, seen, p.CARRIES + left, cell):
            worker = cell
    if worker == sight.NO_CELL:
        return NOOP
    return send_to_harvest(planes, mask, seen, worker, lacking)


# --- fighting and scouting ---------------------------------------------------------------------


@compiled
def sets_out(planes: Any, seen: Any) -> bool:
    """True where the soldiers at home, or those out, are enough, or where no more will come."""
    soldiers, guards = seen.facts[sight.NUM_SOLDIERS], seen.facts[sight.NUM_GUARDS]
    trains = purchases.num_with_sites(seen, t.BARRACKS) + purchases.num_workers(seen) > 0
    price = purchases.price(seen, t.FOOTMAN, t.GOLD)
    has_gold = seen.carriers[t.GOLD] > 0 or seen.store[t.GOLD] >= price
    if int(planes[p.TIME_LEFT, 0, 0]) < LATE or not (trains and has_gold):
        return True
    if 100 * soldiers < seen.doctrine.caution * guards:
        return False
    out = seen.facts[sight.NUM_OUT]
    return bool(max(out, soldiers - out) >= seen.doctrine.attack_size)


@compiled
def way_home(seen: Any) -> int:
    """The free cell nearest to home, NO_CELL for none."""
    best, best_distance = sight.NO_CELL, sight.FAR
    for cell in range(seen.rules.rows * seen.rules.columns):
        row, column = cell // seen.rules.columns, cell % seen.rules.columns
        steps = sight.distance(seen, cell, seen.facts[sight.HOME])
        is_free = seen.kind[cell] == t.NO_KIND and sight.is_ground(seen, row, column)
        if is_free and steps < best_distance:
            best, best_distance = cell, steps
    return best


@compiled
def goal_of_soldier(seen: Any, cell: int, is_attack: bool) -> int:
    """The goal of an idle soldier: nearest enemy, threat, target, home; NO_CELL to stay."""
    target, threat = seen.facts[sight.TARGET], seen.facts[sight.THREAT]
    if sight.is_out(seen, cell):
        foe = sight.nearest_foe(seen, cell, 0)
        if is_attack or (foe != sight.NO_CELL and sight.distance(seen, cell, foe) <= CHASE_STEPS):
            return int(target if foe == sight.NO_CELL else foe)
        return way_home(seen)
    if threat != sight.NO_CELL:
        return int(threat)
    return int(target) if is_attack else sight.NO_CELL


@compiled
def command(planes: Any, mask: Any, seen: Any) -> int:
    """Send idle soldiers, the selected one first."""
    is_attack = sets_out(planes, seen)
    chosen, chosen_goal = sight.NO_CELL, sight.NO_CELL
    for cell in range(seen.rules.rows * seen.rules.columns):
        is_soldier = t.PEASANT < seen.kind[cell] < t.NUM_MOBILE_KINDS
        if seen.side[cell] != sight.MINE or not is_soldier or not sight.is_idle(planes, seen, cell):
            continue
        if chosen != sight.NO_CELL and cell != seen.facts[sight.SELECTED_CELL]:
            continue
        goal = goal_of_soldier(seen, cell, is_attack)
        if goal not in (sight.NO_CELL, cell):
            chosen, chosen_goal = cell, goal
    if chosen == sight.NO_CELL:
        return NOOP
    return send(planes, mask, seen, chosen, ADVANCE_THERE, chosen_goal)


@compiled
def waits_for_people(planes: Any, seen: Any, at_home: int) -> bool:
    """True where raiders are as many as the peasants at home, and the hall trains more of these."""
    raiders = seen.facts[sight.NUM_RAIDERS] + seen.facts[sight.NUM_MOB]
    if seen.facts[sight.NUM_MOB] == 0 or at_home > raiders or seen.own[t.TOWN_HALL] == 0:
        return False
    if sight.shows(planes, seen, p.IS_WORKING, seen.facts[sight.HOME]):
        return True
    has_food = seen.facts[sight.FOOD_MADE] > seen.facts[sight.FOOD_USED]
    return has_food and (seen.carriers[t.GOLD] > 0 or purchases.can_afford(seen, t.PEASANT))


@compiled
def call_militia(planes: Any, mask: Any, seen: Any) -> int:
    """Peasants on the own ground and near an enemy fight where raiders outnumber the soldiers."""
    raiders = seen.facts[sight.NUM_RAIDERS] + seen.facts[sight.NUM_MOB]
    is_safe = seen.facts[sight.THREAT] == sight.NO_CELL
    if is_safe or seen.doctrine.militia == 0 or seen.facts[sight.NUM_DEFENDERS] >= raiders:
        return NOOP
    called, at_home = 0, 0
    chosen, goal, best = sight.NO_CELL, sight.NO_CELL, 2 * MILITIA_STEPS + 1
    for place in range(seen.facts[sight.NUM_PEOPLE]):
        cell = seen.people[place]
        if sight.distance(seen, cell, seen.facts[sight.HOME]) > sight.home_radius(seen):
            continue
        at_home += 1
        if sight.shows(planes, seen, p.IS_FIGHTING, cell):
            called += 1
            continue
        foe = sight.nearest_foe(seen, cell, t.NUM_MOBILE_KINDS)
        cost = 2 * sight.distance(seen, cell, foe)
        if sight.shows(planes, seen, p.IS_WALKING, cell):
            cost += MILITIA_BIAS  # it may be on its way already
        elif cell == seen.facts[sight.SELECTED_CELL]:
            cost -= MILITIA_BIAS
        if cost < best:
            chosen, goal, best = cell, foe, cost
    if chosen == sight.NO_CELL or called >= seen.doctrine.militia:
        return NOOP
    if waits_for_people(planes, seen, at_home):
        return NOOP
    return send(planes, mask, seen, chosen, GO_THERE, goal)


@compiled
def scout(planes: Any, mask: Any, seen: Any) -> int:
    """Now and then, where no unit sees the enemy, send the peasant that is nearest to it.

    It stays the nearest while it walks, so that no second one is sent.
    """
    if seen.doctrine.scouts == 0 or seen.rules.fog == 0:
        return NOOP
    is_time = int(planes[p.TIME_LEFT, 0, 0]) % SCOUT_LEVELS == 0
    if not is_time or purchases.num_workers(seen) < SCOUT_WORKERS:
        return NOOP
    for cell in range(seen.rules.rows * seen.rules.columns):
        is_walker = seen.side[cell] == sight.MINE and seen.kind[cell] < t.NUM_MOBILE_KINDS
        if is_walker and is_scout(seen, cell):
            return NOOP
    target = seen.facts[sight.TARGET]
    person = purchases.nearest_person(seen, target)
    return send(planes, mask, seen, person, GO_THERE, target)
