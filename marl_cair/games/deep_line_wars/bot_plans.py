"""The plans of the scripted players, each a function of one player's planes: no memory."""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_line_wars.bot_sight import (
    NO_CELL,
    can_pay_tower,
    can_pay_unit,
    first_free,
    is_free,
    look,
    look_at_units,
    order_tower,
    order_unit,
    pass_turn,
)
from marl_cair.games.deep_line_wars.observation import (
    ENEMY_HEALTH,
    FULL,
    OWN_GOLD,
    OWN_HEALTH,
    OWN_INCOME,
    OWN_LUMBER,
    TIME_LEFT,
    TIME_TO_INCOME,
)
from marl_cair.games.deep_line_wars.tables import NUM_TOWER_KINDS, NUM_UNIT_KINDS
from marl_cair.games.randomness import draw_below

NO_KIND = -1
RUSH_RESERVE = 1  # the rusher goes up a tier when it could pay so many of it at once
ZIGZAG_BATCH = 5
ZIGZAG_TOWERS_PER_TIER = 2
ECONOMIST_LEAKS = 3.0

# The weights of `counter`, found by tournament (benchmarks/balance.py --bots).
LEAKS_ALLOWED = 0.06  # of the own health, among the enemy units now on the board
BUSY = 0.6  # share of the time in which a tower has a target while a stream passes
STREAM_TICKS = 100.0
LUMBER_PRICE = 4.0  # gold
SLOT_PRICE = 0.5  # share of the gold per decision that an order costs beside its price
HORIZON = 7.0  # intervals over which income counts
HEALTH_PRICE = 12.0  # gold per health of the enemy


@compiled
def plan_random(mask: Any, known: Any, random: Any) -> int:
    """Uniform over the kinds of action that are legal, then over the legal actions of the kind.

    Actions of a kind stand together, so a kind ends where the group number changes.
    """
    num_kinds = 0
    previous = -1
    for action in range(mask.shape[0]):
        if mask[action] and known.groups[action] != previous:
            num_kinds += 1
            previous = known.groups[action]
    kind = draw_below(random, 0, num_kinds)
    previous = -1
    chosen = 0
    count = 0
    for action in range(mask.shape[0]):
        if not mask[action]:
            continue
        if known.groups[action] != previous:
            kind -= 1
            previous = known.groups[action]
        if kind == -1:
            if count == 0:
                chosen = action
            count += 1
    nth = draw_below(random, 0, count)
    for action in range(chosen, mask.shape[0]):
        if mask[action]:
            if nth == 0:
                return action
            nth -= 1
    return chosen


@compiled
def plan_rusher(planes: Any, known: Any) -> int:
    """Units only, the cheapest; a dearer kind once the gold pays several of it."""
    gold = int(planes[OWN_GOLD, 0, 0])
    chosen = NO_KIND
    for kind in range(NUM_UNIT_KINDS):
        cost = known.rules.unit_cost[kind]
        if gold >= cost and (kind == 0 or gold >= min(FULL, RUSH_RESERVE * cost)):
            chosen = kind
    return pass_turn(known) if chosen == NO_KIND else order_unit(known, chosen)


@compiled
def plan_turtle(planes: Any, known: Any, sight: Any) -> int:
    """Towers first, of the kind that fits the enemy's units; the rest is saved for the dearest
    unit."""
    look_at_units(planes, known, sight)
    tower = best_tower(known, sight)
    if int(planes[OWN_LUMBER, 0, 0]) >= known.rules.tower_lumber[tower]:
        if not can_pay_tower(planes, known, tower):
            return pass_turn(known)
        cell = first_free(planes, known, known.order[tower])
        if cell != NO_CELL:
            return order_tower(planes, known, tower, cell)
    if can_pay_unit(planes, known, NUM_UNIT_KINDS - 1):
        return order_unit(known, NUM_UNIT_KINDS - 1)
    return pass_turn(known)


@compiled
def plan_economist(planes: Any, known: Any, sight: Any) -> int:
    """The units that raise the income most; a tower when too many enemy units would arrive."""
    look(planes, known, sight)
    tower = best_tower(known, sight)
    if expected_leaks(known, sight) > ECONOMIST_LEAKS and can_pay_tower(planes, known, tower):
        return order_tower(planes, known, tower, first_free(planes, known, known.order[tower]))
    chosen = NO_KIND
    best = 0.0
    budget = gold_per_decision(planes, known)
    for kind in range(NUM_UNIT_KINDS):
        price = known.rules.unit_cost[kind] + budget
        value = known.rules.unit_income[kind] / price
        if value > best and can_pay_unit(planes, known, kind):
            chosen, best = kind, value
    return pass_turn(known) if chosen == NO_KIND else order_unit(known, chosen)


@compiled
def plan_zigzag(planes: Any, known: Any, sight: Any) -> int:
    """The original's HardCode1 without its memory: a tower along a zig-zag after each five units,
    a dearer unit after each ten."""
    look(planes, known, sight)
    towers = int(sight.own_towers.sum())
    if sight.own_units.sum() >= ZIGZAG_BATCH - 0.5:
        for kind in range(NUM_TOWER_KINDS - 1, -1, -1):
            if can_pay_tower(planes, known, kind):
                return order_tower(planes, known, kind, zigzag_cell(planes, known))
    tier = min(NUM_UNIT_KINDS - 1, towers // ZIGZAG_TOWERS_PER_TIER)
    for kind in range(tier, -1, -1):
        if can_pay_unit(planes, known, kind):
            return order_unit(known, kind)
    return pass_turn(known)


@compiled
def zigzag_cell(planes: Any, known: Any) -> int:
    """The next free cell: down columns 1 and 2 by turns, up columns 3 and 4, and so on."""
    rules = known.rules
    for place in range(rules.rows * (rules.build_columns // 2)):
        lane = place // rules.rows
        row = place - lane * rules.rows
        if lane % 2 == 1:
            row = rules.rows - 1 - row
        cell = row * rules.build_columns + 2 * lane + row % 2
        if is_free(planes, known, cell):
            return cell
    return first_free(planes, known, known.order[0])


@compiled
def plan_counter(planes: Any, known: Any, sight: Any) -> int:
    """Defend where more would arrive than the health allows, else buy the unit of most worth."""
    look(planes, known, sight)
    health = planes[OWN_HEALTH, 0, 0] * known.rules.start_health / FULL
    if expected_leaks(known, sight) > LEAKS_ALLOWED * health:
        tower = best_tower(known, sight)
        if int(planes[OWN_LUMBER, 0, 0]) >= known.rules.tower_lumber[tower]:
            if not can_pay_tower(planes, known, tower):
                return pass_turn(known)
            return order_tower(planes, known, tower, best_cell(planes, known, sight, tower))
    kind = best_unit(planes, known, sight)
    if kind == NO_KIND or not can_pay_unit(planes, known, kind):
        return pass_turn(known)
    return order_unit(known, kind)


# --- what the plans reckon with ----------------------------------------------------------------


@compiled
def gold_per_decision(planes: Any, known: Any) -> float:
    """The gold in hand spread over the decisions until the next income."""
    ticks = planes[TIME_TO_INCOME, 0, 0] * known.rules.interval_ticks / FULL
    decisions = max(1.0, ticks / known.rules.ticks_per_step)
    return int(planes[OWN_GOLD, 0, 0]) / decisions


@compiled
def best_tower(known: Any, sight: Any) -> int:
    """The kind that takes most health off the enemy's units for its price."""
    chosen = 0
    best = -1.0
    for tower in range(NUM_TOWER_KINDS):
        worth = 0.01 * known.blows[tower, 0]
        for unit in range(NUM_UNIT_KINDS):
            health = sight.threats[unit].sum() * known.rules.unit_health[unit]
            worth += health * known.blows[tower, unit]
        # The widest row a tower of this kind covers stands for the time that units are in range.
        worth *= 1 + 2 * known.rules.tower_range[tower]
        price = known.rules.tower_gold[tower] + LUMBER_PRICE * known.rules.tower_lumber[tower]
        if worth / price > best:
            chosen, best = tower, worth / price
    return chosen


@compiled
def best_cell(planes: Any, known: Any, sight: Any, tower: int) -> int:
    """The free cell whose tower most helps the rows in danger, by health and present cover."""
    rows = known.rules.rows
    for row in range(rows):
        danger = 20.0
        for unit in range(NUM_UNIT_KINDS):
            danger += sight.threats[unit, row] * known.rules.unit_health[unit]
        cover = 0.0
        for kind in range(NUM_TOWER_KINDS):
            cover += sight.own_cover[kind, row]
        sight.worth[row] = danger / (4.0 + cover)
    chosen = NO_CELL
    best = -1.0
    for cell in range(known.chords.shape[1]):
        worth = 0.0
        for row in range(rows):
            worth += known.chords[tower, cell, row] * sight.worth[row]
        if worth > best and is_free(planes, known, cell):
            chosen, best = cell, worth
    return chosen


@compiled
def stream_leak(known: Any, towers: Any, units: Any, extra: int, number: float) -> float:
    """Share of a stream that towers are too slow to stop: `units` [unit kinds] of full health and
    `number` more of kind `extra`, against `towers` [tower kinds]."""
    needed = 0.0
    for unit in range(NUM_UNIT_KINDS):
        power = 1e-9
        for tower in range(NUM_TOWER_KINDS):
            power += towers[tower] * known.blows[tower, unit]
        count = units[unit] + (number if unit == extra else 0.0)
        needed += count * known.rules.unit_health[unit] / power
    available = BUSY * STREAM_TICKS
    return max(0.0, 1.0 - available / max(needed, 1e-9))


@compiled
def survival(known: Any, sight: Any, cover: Any, unit: int, row: int) -> float:
    """Health share with which one unit alone would pass the towers along a row."""
    damage = 0.0
    for tower in range(NUM_TOWER_KINDS):
        damage += cover[tower, row] * known.walk[unit] * known.blows[tower, unit]
    return max(0.0, 1.0 - damage / (known.rules.unit_health[unit] * sight.growth[0]))


@compiled
def expected_leaks(known: Any, sight: Any) -> float:
    """How many of the enemy units on the board would arrive as things stand."""
    alone = 0.0
    total = 0.0
    needed = 1e-9
    for unit in range(NUM_UNIT_KINDS):
        power = 1e-9
        for tower in range(NUM_TOWER_KINDS):
            power += sight.own_towers[tower] * known.blows[tower, unit]
        count = 0.0
        for row in range(known.rules.rows):
            here = sight.threats[unit, row]
            if here > 0.0:
                count += here
                if survival(known, sight, sight.own_cover, unit, row) > 0.0:
                    alone += here
        total += count
        needed += count * known.rules.unit_health[unit] / power
    together = total * max(0.0, 1.0 - BUSY * STREAM_TICKS / needed)
    return max(alone, together)


@compiled
def arrival_share(planes: Any, known: Any, sight: Any, unit: int) -> float:
    """Chance that a unit bought now reaches the enemy's base, past its towers as they stand."""
    alone = 0.0
    for row in range(known.rules.rows):
        if survival(known, sight, sight.enemy_cover, unit, row) > 0.0:
            alone += 1.0
    alone /= known.rules.rows
    batch = int(planes[OWN_GOLD, 0, 0]) / known.rules.unit_cost[unit]
    number = min(10.0, batch) * sight.growth[0]
    together = stream_leak(known, sight.enemy_towers, sight.own_units, unit, number)
    return max(alone, together)


@compiled
def best_unit(planes: Any, known: Any, sight: Any) -> int:
    """The kind worth most for its price: income for the rest of the game, and health taken."""
    rules = known.rules
    ticks_left = planes[TIME_LEFT, 0, 0] * rules.max_ticks / FULL
    intervals = min(HORIZON, max(0.0, ticks_left / rules.interval_ticks - 1.5))
    enemy_health = max(1.0, planes[ENEMY_HEALTH, 0, 0] * rules.start_health / FULL)
    health_price = HEALTH_PRICE * (1.0 + 10.0 / enemy_health)
    slot = SLOT_PRICE * gold_per_decision(planes, known)
    chosen = NO_KIND
    best = 0.0
    for unit in range(NUM_UNIT_KINDS):
        worth = rules.unit_income[unit] * intervals
        worth += health_price * arrival_share(planes, known, sight, unit)
        worth /= rules.unit_cost[unit] + slot
        if worth > best and can_pay_unit(planes, known, unit):
            chosen, best = unit, worth
    return chosen
