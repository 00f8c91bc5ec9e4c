"""Scripted players of Deep Line Wars. They see what an agent sees: planes and action mask.

Each plan is a function of one player's planes: it has no memory.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_line_wars.bot_sight import (
    COUNTER_WEIGHTS,
    NO_CELL,
    RUSHER_WEIGHTS,
    Knowledge,
    can_pay_tower,
    can_pay_unit,
    first_free,
    is_free,
    level,
    make_knowledge,
    make_sight,
    order_tower,
    order_unit,
    pass_turn,
    read_sight,
    read_units,
)
from marl_cair.games.deep_line_wars.observation import (
    ENEMY_HEALTH,
    FULL,
    OWN_GOLD,
    OWN_HEALTH,
    OWN_LUMBER,
    TIME_LEFT,
    TIME_TO_INCOME,
)
from marl_cair.games.deep_line_wars.scenarios import Scenario
from marl_cair.games.deep_line_wars.tables import NUM_TOWER_KINDS, NUM_UNIT_KINDS
from marl_cair.games.game import Agent, GameSpec
from marl_cair.games.scripted import ScriptedPlayer

PLANS = ("rusher", "turtle", "economist", "zigzag", "counter")
RUSHER, TURTLE, ECONOMIST, ZIGZAG, COUNTER = range(len(PLANS))
NO_KIND = -1
ZIGZAG_BATCH = 5
ZIGZAG_TOWERS_PER_TIER = 2
ECONOMIST_LEAKS = 3.0

BUSY = 0.6  # share of the time in which a tower has a target while a stream passes
STREAM_TICKS = 100.0


@compiled
def plan_turtle(planes: Any, known: Any, sight: Any) -> int:
    """Towers first, of the kind that fits the enemy's units; then the dearest unit."""
    read_units(planes, known, sight)
    tower = best_tower(known, sight)
    if level(planes, OWN_LUMBER) >= known.rules.tower_cost_lumber[tower]:
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
    read_sight(planes, known, sight)
    tower = best_tower(known, sight)
    if expected_leaks(known, sight) > ECONOMIST_LEAKS and can_pay_tower(planes, known, tower):
        return order_tower(planes, known, tower, first_free(planes, known, known.order[tower]))
    chosen = NO_KIND
    best = 0.0
    budget = gold_per_step(planes, known)
    for kind in range(NUM_UNIT_KINDS):
        price = known.rules.unit_cost_gold[kind] + budget
        value = known.rules.unit_income_gold[kind] / price
        if value > best and can_pay_unit(planes, known, kind):
            chosen, best = kind, value
    return pass_turn(known) if chosen == NO_KIND else order_unit(known, chosen)


@compiled
def plan_zigzag(planes: Any, known: Any, sight: Any) -> int:
    """The original's HardCode1 without its memory.

    A tower along a zig-zag where five units are on their way, a dearer unit after two towers.
    """
    read_sight(planes, known, sight)
    towers = int(sight.own_towers.sum())
    if sight.own_units.sum() >= ZIGZAG_BATCH - 0.5:
        for kind in range(NUM_TOWER_KINDS):
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
            return int(cell)
    return first_free(planes, known, known.order[0])


@compiled
def plan_by_worth(planes: Any, known: Any, sight: Any) -> int:
    """Buy the unit or tower worth most for its price, by the weights of `counter` or `rusher`."""
    read_sight(planes, known, sight)
    unit, worth_of_unit = best_unit(planes, known, sight)
    tower, worth_of_tower = best_defence(planes, known, sight)
    if tower != NO_KIND and worth_of_tower > worth_of_unit:
        return order_tower(planes, known, tower, best_cell(planes, known, sight, tower))
    return pass_turn(known) if unit == NO_KIND else order_unit(known, unit)


@compiled
def gold_per_step(planes: Any, known: Any) -> float:
    """The gold in hand spread over the steps until the next income."""
    ticks = level(planes, TIME_TO_INCOME) * known.rules.income_interval_ticks / FULL
    steps = max(1.0, ticks / known.rules.ticks_per_step)
    return float(level(planes, OWN_GOLD) / steps)


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
        worth *= 1 + 2 * known.rules.tower_range_tiles[tower]
        lumber = known.weights.lumber_price * known.rules.tower_cost_lumber[tower]
        price = known.rules.tower_cost_gold[tower] + lumber
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
def survival(known: Any, sight: Any, cover: Any, unit: int, row: int) -> float:
    """Health share with which one unit alone would pass the towers along a row."""
    damage = 0.0
    for tower in range(NUM_TOWER_KINDS):
        damage += cover[tower, row] * known.walk[unit] * known.blows[tower, unit]
    return float(max(0.0, 1.0 - damage / known.rules.unit_health[unit]))


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
    """Chance that a unit bought now reaches the enemy's base, past its towers as they stand: alone,
    or in a stream with the units on the board and all that the gold buys, by health.
    """
    alone = 0.0
    for row in range(known.rules.rows):
        if survival(known, sight, sight.enemy_cover, unit, row) > 0.0:
            alone += 1.0
    alone /= known.rules.rows
    bought = min(10.0, level(planes, OWN_GOLD) / known.rules.unit_cost_gold[unit])
    needed = 0.0
    for kind in range(NUM_UNIT_KINDS):
        power = 1e-9
        for tower in range(NUM_TOWER_KINDS):
            power += sight.enemy_towers[tower] * known.blows[tower, kind]
        count = sight.own_units[kind] + (bought if kind == unit else 0.0)
        needed += count * known.rules.unit_health[kind] / power
    together = max(0.0, 1.0 - BUSY * STREAM_TICKS / max(needed, 1e-9))
    return float(max(alone, together))


@compiled
def health_points(planes: Any, known: Any, plane: int) -> float:
    """Health of the player that `plane` shows, at least 1."""
    return float(max(1.0, level(planes, plane) * known.rules.start_health / FULL))


@compiled
def intervals_to_come(planes: Any, known: Any) -> float:
    """For how many more incomes the game will last, as far as it pays to plan."""
    rules, weights = known.rules, known.weights
    ticks_left = level(planes, TIME_LEFT) * rules.max_ticks / FULL
    own_health = health_points(planes, known, OWN_HEALTH)
    health = min(own_health, health_points(planes, known, ENEMY_HEALTH))
    intervals = max(0.0, ticks_left / rules.income_interval_ticks - 1.5)
    return float(min(intervals, weights.horizon, weights.pace * health / 10.0))


@compiled
def best_unit(planes: Any, known: Any, sight: Any) -> tuple[int, float]:
    """The kind worth most for its price, and that worth: income to come, and health taken."""
    rules, weights = known.rules, known.weights
    intervals = intervals_to_come(planes, known)
    enemy_health = health_points(planes, known, ENEMY_HEALTH)
    health_price = weights.health_price * (1.0 + weights.finish_health / enemy_health)
    slot = weights.slot_price * gold_per_step(planes, known)
    chosen = NO_KIND
    best = 0.0
    for unit in range(NUM_UNIT_KINDS):
        worth = rules.unit_income_gold[unit] * intervals
        worth += health_price * arrival_share(planes, known, sight, unit)
        worth /= rules.unit_cost_gold[unit] + slot
        if worth > best and can_pay_unit(planes, known, unit):
            chosen, best = unit, worth
    return chosen, best


@compiled
def kills_per_interval(known: Any, sight: Any, tower: int) -> float:
    """Units like those now coming that one more tower would kill in an interval."""
    rules = known.rules
    width = 1.0 + 2.0 * rules.tower_range_tiles[tower]
    busy = 0.0  # ticks in which a target is in range
    kills = 0.0
    for unit in range(NUM_UNIT_KINDS):
        count = sight.threats[unit].sum()
        ticks = count * known.walk[unit] * width * min(1.0, width / rules.rows)
        busy += ticks
        kills += ticks * known.blows[tower, unit] / rules.unit_health[unit]
    return kills * min(1.0, STREAM_TICKS / max(busy, 1.0))


@compiled
def best_defence(planes: Any, known: Any, sight: Any) -> tuple[int, float]:
    """The tower worth most for its price, and that worth: the arrivals it spares, in health."""
    rules, weights = known.rules, known.weights
    leaks = expected_leaks(known, sight)
    own_health = health_points(planes, known, OWN_HEALTH)
    price_of_health = weights.defence_price * (1.0 + weights.finish_health / own_health)
    price_of_health *= intervals_to_come(planes, known)
    slot = weights.slot_price * gold_per_step(planes, known)
    chosen = NO_KIND
    best = 0.0
    for tower in range(NUM_TOWER_KINDS):
        worth = price_of_health * min(leaks, kills_per_interval(known, sight, tower))
        lumber = weights.lumber_price * rules.tower_cost_lumber[tower]
        worth /= rules.tower_cost_gold[tower] + lumber + slot
        if worth > best and can_pay_tower(planes, known, tower):
            chosen, best = tower, worth
    return chosen, best


@compiled
def decide_all(
    plan: int, known: Any, sight: Any, planes: Any, mask: Any, random: Any, out: Any
) -> None:
    """The action of a plan for each of N rows: planes [N, C, H, W], mask [N, A], out [N].

    An illegal action becomes the no-op.
    """
    for index in range(planes.shape[0]):
        if plan == TURTLE:
            action = plan_turtle(planes[index], known, sight)
        elif plan == ECONOMIST:
            action = plan_economist(planes[index], known, sight)
        elif plan == ZIGZAG:
            action = plan_zigzag(planes[index], known, sight)
        else:
            action = plan_by_worth(planes[index], known, sight)
        out[index] = action if mask[index, action] else pass_turn(known)


def make_bot(
    name: str, scenario: Scenario, spec: GameSpec, known: Knowledge | None = None
) -> ScriptedPlayer:
    """The bot of one of PLANS for a scenario and its spec.

    `known` is what it takes the numbers of the game to be; None reads them from the scenario.
    """
    plan = PLANS.index(name)
    weights = RUSHER_WEIGHTS if plan == RUSHER else COUNTER_WEIGHTS
    known = known or make_knowledge(scenario, weights)
    return ScriptedPlayer(name, partial(decide_all, plan, known, make_sight(scenario)))


BOTS: dict[str, Callable[[Scenario, GameSpec], Agent]] = {
    "random": lambda scenario, spec: ScriptedPlayer.by_kind(spec),
    **{name: partial(make_bot, name) for name in PLANS},
}
