"""The constants of a scenario, as the arrays by kind that the compiled rules read."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.deep_line_wars.scenarios import Scenario
from marl_cair.games.deep_line_wars.tables import PRESETS
from marl_cair.games.game_package import fill_record

SPATIAL, CLASSIC = range(2)

# Terrain levels from the own spawn column to the enemy's.
OWN_SPAWN, OWN_HALF, CENTRE, ENEMY_HALF, ENEMY_SPAWN = 50, 100, 150, 200, 250


class Rules(NamedTuple):
    """The constants of a scenario, handed to the kernels so that none is compiled in.

    Names and units are those of `Preset` and `Scenario`.
    """

    unit_health: NDArray[np.int16]  # [unit kinds]
    unit_armour: NDArray[np.int16]
    unit_speed: NDArray[np.int16]
    unit_cost_gold: NDArray[np.int32]
    unit_income_gold: NDArray[np.int32]
    unit_bounty_gold: NDArray[np.int32]
    tower_damage_min: NDArray[np.int16]  # [tower kinds]
    tower_damage_max: NDArray[np.int16]
    tower_penetration: NDArray[np.int16]
    tower_attack_speed: NDArray[np.int16]
    tower_range_tiles: NDArray[np.int16]
    tower_cost_gold: NDArray[np.int32]
    tower_cost_lumber: NDArray[np.int32]
    flight_ticks: NDArray[np.int8]  # [rows apart, columns apart]
    terrain: NDArray[np.uint8]  # [rows * columns] levels of the own view, row by row
    start_health: int
    start_gold: int
    start_lumber: int
    start_income_gold: int
    income_interval_ticks: int
    lumber_per_interval: int
    rows: int
    columns: int
    build_columns: int
    action_space: int
    ticks_per_step: int
    max_ticks: int
    shaping: float  # 0 sparse, 1 shaped
    shaping_discount: float


def make_rules(scenario: Scenario) -> Rules:
    """The numbers of `scenario` as arrays by kind."""
    preset = PRESETS[scenario.preset]
    return fill_record(
        Rules,
        scenario,
        preset,
        flight_ticks=_flight_table(max(preset.tower_range_tiles), preset.projectile_tiles_per_tick),
        terrain=_terrain_levels(scenario),
        action_space=CLASSIC if scenario.actions == "classic" else SPATIAL,
        shaping=scenario.reward == "shaped",
    )


def _flight_table(max_range: int, tiles_per_tick: int) -> NDArray[np.int8]:
    """Ticks a projectile flies by rows and columns apart; all 0 where shots hit at once."""
    apart = np.arange(max_range + 1)
    distance = np.hypot(apart[:, None], apart[None, :])
    if tiles_per_tick == 0:
        return np.zeros(distance.shape, np.int8)
    return np.ceil(distance / tiles_per_tick).astype(np.int8)


def _terrain_levels(scenario: Scenario) -> NDArray[np.uint8]:
    """The level of every cell, the same along a column."""
    half = scenario.build_columns
    centre = scenario.columns - 2 * half - 2
    levels = [OWN_SPAWN, *[OWN_HALF] * half, *[CENTRE] * centre]
    levels += [*[ENEMY_HALF] * half, ENEMY_SPAWN]
    return np.tile(np.array(levels, np.uint8), scenario.rows)
