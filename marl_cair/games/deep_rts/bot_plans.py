"""The plans of the scripted players of Deep RTS: each a function of one player's planes and mask.

A plan goes through jobs in the order of their weight and takes the first that can be done.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts.bot_economy import (
    build,
    cell_action,
    choose_building,
    gather,
    move_worker,
    num_with_sites,
    num_workers,
    price,
    tell,
    train,
)
from marl_cair.games.deep_rts.bot_sight import (
    FOE,
    HOME,
    MINE,
    NO_CELL,
    NUM_FOE_SOLDIERS,
    NUM_PEOPLE,
    NUM_SOLDIERS,
    SELECTED_CELL,
    TARGET,
    THREAT,
    distance,
    home_radius,
    is_idle,
    look,
    nearest_foe,
    shows,
)
from marl_cair.games.deep_rts.orders import (
    ADVANCE_THERE,
    GO_THERE,
    NOOP,
)
from marl_cair.games.deep_rts.planes import IS_FIGHTING, TIME_LEFT
from marl_cair.games.deep_rts.tables import (
    BARRACKS,
    FOOTMAN,
    GOLD,
    NUM_MOBILE_KINDS,
    PEASANT,
)

MILITIA_STEPS = 4  # to the threat, of peasants that are called
LATE = 50  # level of the time left at which all attack


@compiled
def plan_by_doctrine(planes: Any, mask: Any, known: Any, sight: Any) -> int:
    """The first job that can be done: train, build, then soldiers and peasants by turns."""
    look(planes, known, sight)
    choose_building(known, sight)
    action = train(planes, mask, known, sight)
    if action == NOOP:
        action = call_militia(planes, mask, known, sight)
    if action == NOOP:
        action = build(planes, mask, known, sight)
    soldiers_first = int(planes[TIME_LEFT, 0, 0]) % 2
    if action == NOOP and soldiers_first == 1:
        action = command(planes, mask, known, sight)
    if action == NOOP:
        action = gather(planes, mask, known, sight)
    if action == NOOP and soldiers_first == 0:
        action = command(planes, mask, known, sight)
    if action == NOOP:
        action = move_worker(planes, mask, known, sight)
    return action


# --- fighting ------------------------------------------------------------------------------------


@compiled
def is_soldier_cell(sight: Any, cell: int) -> bool:
    """True on an own footman, archer or horseman."""
    return bool(
        sight.side[cell] == MINE
        and sight.kind[cell] != PEASANT
        and sight.kind[cell] < NUM_MOBILE_KINDS
    )


@compiled
def can_grow(known: Any, sight: Any) -> bool:
    """True while more soldiers will come: there are barracks, and gold in store or on its way."""
    if num_with_sites(sight, BARRACKS) == 0 and num_workers(sight) == 0:
        return False
    return bool(sight.carriers[GOLD] > 0 or sight.store[GOLD] >= price(known, FOOTMAN, GOLD))


@compiled
def sets_out(planes: Any, known: Any, sight: Any) -> bool:
    """True where the army is large enough to attack, or where waiting brings nothing."""
    soldiers, foes = sight.facts[NUM_SOLDIERS], sight.facts[NUM_FOE_SOLDIERS]
    if int(planes[TIME_LEFT, 0, 0]) < LATE or not can_grow(known, sight):
        return True
    if known.doctrine.adapts != 0:
        return bool(soldiers >= known.doctrine.attack_size and soldiers > foes)
    return bool(soldiers >= known.doctrine.attack_size)


@compiled
def goal_of_soldier(known: Any, sight: Any, cell: int, is_attack: bool) -> int:
    """Where an idle soldier advances to, or NO_CELL: to the threat, the target, the next enemy."""
    home, target, threat = sight.facts[HOME], sight.facts[TARGET], sight.facts[THREAT]
    is_out = distance(known, cell, target) < distance(known, cell, home)
    if is_out:
        foe = nearest_foe(known, sight, cell, 0)
        return target if foe == NO_CELL else foe
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
    return tell(planes, mask, known, chosen, cell_action(known, ADVANCE_THERE, chosen_goal))


@compiled
def num_near_home(known: Any, sight: Any, side: int) -> int:
    """Soldiers of a side on the own ground."""
    count = 0
    for cell in range(known.rules.rows * known.rules.columns):
        if sight.side[cell] == side and PEASANT < sight.kind[cell] < NUM_MOBILE_KINDS:
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
    return tell(planes, mask, known, chosen, cell_action(known, GO_THERE, threat))
