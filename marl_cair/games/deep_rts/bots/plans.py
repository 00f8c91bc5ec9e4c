"""The plans of the scripted players of Deep RTS: each a function of one player's planes and mask.

A plan goes through jobs in the order of their weight and takes the first that can be done.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.bots import economy
from marl_cair.games.deep_rts.bots.purchases import (
    choose_purchase,
    num_with_sites,
    num_workers,
    price,
)
from marl_cair.games.deep_rts.bots.sight import (
    FAR,
    FOE,
    HOME,
    MINE,
    NO_CELL,
    NUM_GUARDS,
    NUM_OUT,
    NUM_PEOPLE,
    NUM_SOLDIERS,
    SELECTED_CELL,
    TARGET,
    THREAT,
    distance,
    home_radius,
    is_ground,
    is_idle,
    is_out,
    nearest_foe,
    read_sight,
    shows,
)
from marl_cair.games.deep_rts.bots.sites import nearest_person
from marl_cair.games.deep_rts.orders.orders import ADVANCE_THERE, GO_THERE, NOOP
from marl_cair.games.deep_rts.views.planes import IS_FIGHTING, TIME_LEFT

CHASE_STEPS = 4  # to the enemy, of soldiers that are out without an attack
MILITIA_STEPS = 4  # to the threat, of peasants that are called
SCOUT_LEVELS = 4  # of the time left, in one of which a scout is sent
SCOUT_WORKERS = 5  # peasants from which one can be spared
LATE = 50  # level of the time left at which all attack


@compiled
def plan_by_doctrine(planes: Any, mask: Any, known: Any, sight: Any) -> int:
    """The first job that can be done: train, build, then soldiers and peasants by turns."""
    read_sight(planes, known, sight)
    choose_purchase(known, sight)
    action = economy.train(planes, mask, known, sight)
    if action == NOOP:
        action = call_militia(planes, mask, known, sight)
    if action == NOOP:
        action = economy.build(planes, mask, known, sight)
    soldiers_first = int(planes[TIME_LEFT, 0, 0]) % 2
    if action == NOOP and soldiers_first == 1:
        action = command(planes, mask, known, sight)
    if action == NOOP:
        action = economy.gather(planes, mask, known, sight)
    if action == NOOP and soldiers_first == 0:
        action = command(planes, mask, known, sight)
    if action == NOOP:
        action = economy.move_worker(planes, mask, known, sight)
    if action == NOOP:
        action = scout(planes, mask, known, sight)
    return action


# --- fighting ------------------------------------------------------------------------------------


@compiled
def is_soldier_cell(sight: Any, cell: int) -> bool:
    """True on an own footman, archer or horseman."""
    return bool(
        sight.side[cell] == MINE
        and sight.kind[cell] != t.PEASANT
        and sight.kind[cell] < t.NUM_MOBILE_KINDS
    )


@compiled
def can_grow(known: Any, sight: Any) -> bool:
    """True while more soldiers will come: there are barracks, and gold in store or on its way."""
    if num_with_sites(sight, t.BARRACKS) == 0 and num_workers(sight) == 0:
        return False
    return bool(
        sight.carriers[t.GOLD] > 0 or sight.store[t.GOLD] >= price(known, t.FOOTMAN, t.GOLD)
    )


@compiled
def sets_out(planes: Any, known: Any, sight: Any) -> bool:
    """True where those at home, or those out there, are enough, or where waiting brings nothing."""
    soldiers, guards = sight.facts[NUM_SOLDIERS], sight.facts[NUM_GUARDS]
    if int(planes[TIME_LEFT, 0, 0]) < LATE or not can_grow(known, sight):
        return True
    if 100 * soldiers < known.doctrine.caution * guards:
        return False
    out = sight.facts[NUM_OUT]
    return bool(max(out, soldiers - out) >= known.doctrine.attack_size)


@compiled
def way_home(known: Any, sight: Any) -> int:
    """The free cell nearest to home, NO_CELL for none."""
    best, best_distance = NO_CELL, FAR
    for cell in range(known.rules.rows * known.rules.columns):
        row, column = cell // known.rules.columns, cell % known.rules.columns
        steps = distance(known, cell, sight.facts[HOME])
        is_free = sight.kind[cell] == t.NO_KIND and is_ground(known, sight, row, column)
        if is_free and steps < best_distance:
            best, best_distance = cell, steps
    return best


@compiled
def goal_of_soldier(known: Any, sight: Any, cell: int, is_attack: bool) -> int:
    """Where an idle soldier advances to: next enemy, threat, target, home; NO_CELL to stay."""
    target, threat = sight.facts[TARGET], sight.facts[THREAT]
    if is_out(known, sight, cell):
        foe = nearest_foe(known, sight, cell, 0)
        if is_attack or (foe != NO_CELL and distance(known, cell, foe) <= CHASE_STEPS):
            return int(target if foe == NO_CELL else foe)
        return way_home(known, sight)
    if threat != NO_CELL:
        return int(threat)
    return int(target) if is_attack else NO_CELL


@compiled
def command(planes: Any, mask: Any, known: Any, sight: Any) -> int:
    """Send idle soldiers, the selected one first."""
    is_attack = sets_out(planes, known, sight)
    chosen, chosen_goal = NO_CELL, NO_CELL
    for cell in range(known.rules.rows * known.rules.columns):
        if not is_soldier_cell(sight, cell) or not is_idle(planes, known, cell):
            continue
        if chosen != NO_CELL and cell != sight.facts[SELECTED_CELL]:
            continue
        goal = goal_of_soldier(known, sight, cell, is_attack)
        if goal not in (NO_CELL, cell):
            chosen, chosen_goal = cell, goal
    if chosen == NO_CELL:
        return NOOP
    return economy.give_order(
        planes, mask, known, chosen, economy.cell_action(known, ADVANCE_THERE, chosen_goal)
    )


@compiled
def num_near_home(known: Any, sight: Any, side: int) -> int:
    """Soldiers of a side on the own ground."""
    count = 0
    for cell in range(known.rules.rows * known.rules.columns):
        if sight.side[cell] == side and t.PEASANT < sight.kind[cell] < t.NUM_MOBILE_KINDS:
            count += int(distance(known, cell, sight.facts[HOME]) <= home_radius(known, sight))
    return count


@compiled
def call_militia(planes: Any, mask: Any, known: Any, sight: Any) -> int:
    """Peasants near the threat fight where the enemy has more soldiers there than the player."""
    threat = sight.facts[THREAT]
    if threat == NO_CELL or known.doctrine.militia == 0 or sight.facts[NUM_PEOPLE] == 0:
        return NOOP
    if num_near_home(known, sight, MINE) >= num_near_home(known, sight, FOE):
        return NOOP
    called = 0
    chosen, best = NO_CELL, MILITIA_STEPS + 1
    for place in range(sight.facts[NUM_PEOPLE]):
        cell = sight.people[place]
        if shows(planes, known, IS_FIGHTING, cell):
            called += 1
            continue
        steps = distance(known, cell, threat)
        if cell == sight.facts[SELECTED_CELL] and steps <= MILITIA_STEPS:
            steps = 0
        if steps < best:
            chosen, best = cell, steps
    if chosen == NO_CELL or called >= known.doctrine.militia:
        return NOOP
    return economy.give_order(
        planes, mask, known, chosen, economy.cell_action(known, GO_THERE, threat)
    )


# --- scouting ------------------------------------------------------------------------------------


@compiled
def scout(planes: Any, mask: Any, known: Any, sight: Any) -> int:
    """Now and then, where no unit sees the enemy, send the peasant that is nearest to it.

    It stays the nearest while it walks, so that no second one is sent.
    """
    if known.doctrine.scouts == 0 or known.rules.fog == 0:
        return NOOP
    if int(planes[TIME_LEFT, 0, 0]) % SCOUT_LEVELS > 0 or num_workers(sight) < SCOUT_WORKERS:
        return NOOP
    for cell in range(known.rules.rows * known.rules.columns):
        is_walker = sight.side[cell] == MINE and sight.kind[cell] < t.NUM_MOBILE_KINDS
        if is_walker and economy.is_scout(known, sight, cell):
            return NOOP
    target = sight.facts[TARGET]
    return economy.give_order(
        planes,
        mask,
        known,
        nearest_person(known, sight, target),
        economy.cell_action(known, GO_THERE, target),
    )
