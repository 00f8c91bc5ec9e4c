"""The values that a state of Deep Line Wars may hold, as high as the rules let them come."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from math import ceil

import numpy as np

from marl_cair.games.checks import state as checks
from marl_cair.games.checks.state import Range, StateLimits
from marl_cair.games.deep_line_wars import state as s
from marl_cair.games.deep_line_wars import tables as t
from marl_cair.games.deep_line_wars.rulebook import Rules, make_rules
from marl_cair.games.deep_line_wars.rules import MAX_STORE
from marl_cair.games.deep_line_wars.scenarios import Scenario


def state_limits(scenario: Scenario) -> StateLimits:
    """What the worlds of `scenario` may hold."""
    rules = make_rules(scenario)

    ranges = _economy_ranges(scenario) | _unit_ranges(scenario, rules)
    return StateLimits(
        ranges | _tower_ranges(scenario, rules), partial(_list_conditions, rules=rules)
    )


def _economy_ranges(scenario: Scenario) -> dict[str, Range]:
    preset = t.PRESETS[scenario.preset]
    _, gold, lumber, income = _highest_of_side(scenario)
    # All units of one walk may come through in one tick.
    least_health = 1 - scenario.unit_capacity
    return {
        "tick": Range(0, scenario.max_ticks),
        "phase": Range(s.RUNNING, s.TRUNCATED),
        "random": Range(*checks.ANY_WORD),
        "health": Range(least_health, preset.start_health),
        "gold": Range(0, gold),
        "lumber": Range(0, lumber),
        "income": Range(preset.start_income_gold, income),
        "cursor": Range((0, 1), (scenario.rows - 1, scenario.columns - 2), ("row", "column")),
        "illegal": Range(0, checks.MOST_COUNTED),
    }


def _unit_ranges(scenario: Scenario, rules: Rules) -> dict[str, Range]:
    slots = scenario.unit_capacity
    return {
        "first_unit": Range(0, slots - 1),
        "num_units": Range(0, slots),
        "unit_kind": Range(0, t.NUM_UNIT_KINDS - 1),
        "unit_health": Range(0, rules.unit_health.max()),
        "unit_row": Range(0, scenario.rows - 1),
        "unit_column": Range(0, scenario.columns - 1),
        "unit_progress": Range(0, t.PROGRESS_PER_TILE - 1),
    }


def _tower_ranges(scenario: Scenario, rules: Rules) -> dict[str, Range]:
    towers, longest = scenario.rows * scenario.build_columns, rules.flight_ticks.max()
    last_ready = scenario.max_ticks + t.CHARGE_PER_SHOT
    return {
        "num_towers": Range(0, towers),
        "tower_kind": Range(0, t.NUM_TOWER_KINDS - 1),
        "tower_row": Range(0, scenario.rows - 1),
        "tower_column": Range(0, scenario.build_columns),
        "tower_ready": Range(0, last_ready),
        "tower_spare": Range(0, rules.tower_attack_speed.max() - 1),
        "num_shots": Range(0, towers),
        "shot_target": Range(s.NO_TARGET, scenario.unit_capacity - 1),
        "shot_ticks": Range(0, longest),
        "shot_flight_ticks": Range(0, longest),
        "shot_damage": Range(0, rules.tower_damage_max.max()),
        "tower_at": Range(s.NO_TOWER, t.NUM_TOWER_KINDS - 1),
    }


def _list_conditions(worlds: s.World, rules: Rules) -> Iterator[checks.Condition]:
    phase, num_towers = worlds.phase[:, 0], worlds.num_towers
    yield checks.has_time(worlds.tick[:, 0], phase == s.RUNNING, rules.max_ticks)
    has_fallen = (worlds.health <= 0).any(axis=1)
    yield (
        "a player without health has lost, and only then the game is decided",
        has_fallen == (phase == s.TERMINATED),
    )
    is_gone = worlds.unit_health <= 0
    is_before = worlds.unit_column < rules.columns - 1
    yield "living units stand before the far column", (is_before | is_gone).all(axis=(1, 2))
    slots = worlds.unit_kind.shape[2]
    age = (np.arange(slots) - worlds.first_unit[:, :, None]) % slots
    is_in_ring = age < worlds.num_units[:, :, None]
    yield (
        "all living units are among the num_units from first_unit on",
        (is_in_ring | is_gone).all(axis=(1, 2)),
    )
    is_built = np.arange(worlds.tower_kind.shape[2]) < num_towers[:, :, None]
    num_taken = (worlds.tower_at != s.NO_TOWER).sum(axis=(2, 3))
    yield "num_towers counts the cells of tower_at", (num_towers == num_taken).all(axis=1)
    place = np.ogrid[: len(num_towers), : num_towers.shape[1], :1][:2]
    at = worlds.tower_at[(*place, worlds.tower_row, np.maximum(worlds.tower_column, 1) - 1)]
    stands = (at == worlds.tower_kind) & (worlds.tower_column >= 1)
    yield "tower_at holds each tower's kind at its cell", (stands | ~is_built).all(axis=(1, 2))
    flies = worlds.shot_target != s.NO_TARGET
    yield (
        "num_shots counts the towers with a target, which fly on for a tick at least",
        (worlds.num_shots == flies.sum(axis=2)).all(axis=1)
        & (is_built | ~flies).all(axis=(1, 2))
        & ((worlds.shot_ticks >= 1) | ~flies).all(axis=(1, 2)),
    )


def vector_high(scenario: Scenario) -> tuple[float, ...]:
    """The largest value of each entry of VECTOR_NAMES."""
    health, gold, lumber, income = _highest_of_side(scenario)
    side = (health, gold, max(1, lumber), income)
    ticks = (t.PRESETS[scenario.preset].income_interval_ticks, scenario.max_ticks)
    return tuple(float(value) for value in (*side, *side, *ticks))


def _highest_of_side(scenario: Scenario) -> tuple[int, int, int, int]:
    """Health, gold, lumber and income of a player, as high as the rules let them come."""
    preset = t.PRESETS[scenario.preset]
    num_payments = scenario.max_ticks // preset.income_interval_ticks
    _, income = _invest(scenario, num_payments + 1)  # after the last one too
    # An interval's purchases pay for themselves if enough payments follow.
    gain = _most_income_for_gold(preset)
    gold, _ = _invest(scenario, sum(left * gain > 1 for left in range(1, num_payments + 1)))
    lumber = preset.start_lumber + num_payments * preset.lumber_per_interval
    return preset.start_health, min(MAX_STORE, ceil(gold)), lumber, ceil(income)


def _most_income_for_gold(preset: t.Preset) -> float:
    pairs = zip(preset.unit_income_gold, preset.unit_cost_gold, strict=True)
    return max(income / cost for income, cost in pairs)


def _invest(scenario: Scenario, num_buying: int) -> tuple[float, float]:
    """Upper bounds of gold and income at the end of a game.

    They belong to a player that buys as much income as its gold and one unit a step allow in the
    first `num_buying` intervals, and nothing later, and that kills the dearest unit in every step.
    """
    preset = t.PRESETS[scenario.preset]
    gold, income = float(preset.start_gold), float(preset.start_income_gold)
    gain = _most_income_for_gold(preset)
    num_payments = scenario.max_ticks // preset.income_interval_ticks
    num_done = 0
    for interval in range(num_payments + 1):
        end = min(scenario.max_ticks, (interval + 1) * preset.income_interval_ticks)
        num_by_end = ceil(end / scenario.ticks_per_step)
        num_steps, num_done = num_by_end - num_done, num_by_end
        gold += num_steps * max(preset.unit_bounty_gold)
        if interval < num_buying:
            bought = min(gold * gain, num_steps * max(preset.unit_income_gold))
            gold -= bought / gain
            income += bought
        if interval < num_payments:
            gold += income
    return gold, income
