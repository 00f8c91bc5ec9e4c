"""The plans of the scripted players of Deep RTS: each a function of one player's planes and mask.

A plan goes through jobs in the order of their weight and takes the first that can be done.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.bots import economy, purchases, sight
from marl_cair.games.deep_rts.bots.sites import nearest_person
from marl_cair.games.deep_rts.orders import orders
from marl_cair.games.deep_rts.views.planes import IS_FIGHTING, TIME_LEFT

CHASE_STEPS = 4  # to the enemy, of soldiers that are out without an attack
MILITIA_STEPS = 4  # to the threat, of peasants that are called
SCOUT_LEVELS = 4  # of the time left, in one of which a scout is sent
SCOUT_WORKERS = 5  # peasants from which one can be spared
LATE = 50  # level of the time left at which all attack


@compiled
def plan_by_doctrine(planes: Any, mask: Any, seen: Any) -> int:
    """The first job that can be done: train, build, then soldiers and peasants by turns."""
    sight.read_sight(planes, seen)
    purchases.choose_purchase(seen)
    action = economy.train(planes, mask, seen)
    if action == orders.NOOP:
        action = call_militia(planes, mask, seen)
    if action == orders.NOOP:
        action = economy.build(planes, mask, seen)
    soldiers_first = int(planes[TIME_LEFT, 0, 0]) % 2
    if action == orders.NOOP and soldiers_first == 1:
        action = command(planes, mask, seen)
    if action == orders.NOOP:
        action = economy.gather(planes, mask, seen)
    if action == orders.NOOP and soldiers_first == 0:
        action = command(planes, mask, seen)
    if action == orders.NOOP:
        action = economy.move_worker(planes, mask, seen)
    if action == orders.NOOP:
        action = scout(planes, mask, seen)
    return action


# --- fighting ------------------------------------------------------------------------------------


@compiled
def can_grow(seen: Any) -> bool:
    """True while more soldiers will come: there are barracks, and gold in store or on its way."""
    if purchases.num_with_sites(seen, t.BARRACKS) == 0 and purchases.num_workers(seen) == 0:
        return False
    return bool(
        seen.carriers[t.GOLD] > 0 or seen.store[t.GOLD] >= purchases.price(seen, t.FOOTMAN, t.GOLD)
    )


@compiled
def sets_out(planes: Any, seen: Any) -> bool:
    """True where the soldiers at home, or those out, are enough, or where waiting brings none."""
    soldiers, guards = seen.facts[sight.NUM_SOLDIERS], seen.facts[sight.NUM_GUARDS]
    if int(planes[TIME_LEFT, 0, 0]) < LATE or not can_grow(seen):
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
    """Where an idle soldier advances to: next enemy, threat, target, home; NO_CELL to stay."""
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
        return orders.NOOP
    return economy.send(planes, mask, seen, chosen, orders.ADVANCE_THERE, chosen_goal)


@compiled
def call_militia(planes: Any, mask: Any, seen: Any) -> int:
    """Peasants near the threat fight where raiders outnumber the own soldiers at home."""
    threat = seen.facts[sight.THREAT]
    if threat == sight.NO_CELL or seen.doctrine.militia == 0 or seen.facts[sight.NUM_PEOPLE] == 0:
        return orders.NOOP
    if seen.facts[sight.NUM_DEFENDERS] >= seen.facts[sight.NUM_RAIDERS]:
        return orders.NOOP
    called = 0
    chosen, best = sight.NO_CELL, MILITIA_STEPS + 1
    for place in range(seen.facts[sight.NUM_PEOPLE]):
        cell = seen.people[place]
        if sight.shows(planes, seen, IS_FIGHTING, cell):
            called += 1
            continue
        steps = sight.distance(seen, cell, threat)
        if cell == seen.facts[sight.SELECTED_CELL] and steps <= MILITIA_STEPS:
            steps = 0
        if steps < best:
            chosen, best = cell, steps
    if chosen == sight.NO_CELL or called >= seen.doctrine.militia:
        return orders.NOOP
    return economy.send(planes, mask, seen, chosen, orders.GO_THERE, threat)


# --- scouting ------------------------------------------------------------------------------------


@compiled
def scout(planes: Any, mask: Any, seen: Any) -> int:
    """Now and then, where no unit sees the enemy, send the peasant that is nearest to it.

    It stays the nearest while it walks, so that no second one is sent.
    """
    if seen.doctrine.scouts == 0 or seen.rules.fog == 0:
        return orders.NOOP
    is_time = int(planes[TIME_LEFT, 0, 0]) % SCOUT_LEVELS == 0
    if not is_time or purchases.num_workers(seen) < SCOUT_WORKERS:
        return orders.NOOP
    for cell in range(seen.rules.rows * seen.rules.columns):
        is_walker = seen.side[cell] == sight.MINE and seen.kind[cell] < t.NUM_MOBILE_KINDS
        if is_walker and economy.is_scout(seen, cell):
            return orders.NOOP
    target = seen.facts[sight.TARGET]
    person = nearest_person(seen, target)
    return economy.send(planes, mask, seen, person, orders.GO_THERE, target)
