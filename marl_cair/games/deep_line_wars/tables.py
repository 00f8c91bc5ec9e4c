"""Unit and tower numbers of Deep Line Wars: one row per preset, one column per kind.

Sources: `2017` and `2018` are the numbers of the game that the thesis used (public code of
November 2017 and June 2018; both apply armour here as its name says, which that code did not);
`balanced` is ours, argued in this folder's README.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

UNIT_NAMES = ("militia", "footman", "grunt", "armoured_grunt")
TOWER_NAMES = ("basic", "fast", "faster")
NUM_UNIT_KINDS = len(UNIT_NAMES)
NUM_TOWER_KINDS = len(TOWER_NAMES)
MILITIA, FOOTMAN, GRUNT, ARMOURED_GRUNT = range(NUM_UNIT_KINDS)
BASIC, FAST, FASTER = range(NUM_TOWER_KINDS)

TICKS_PER_SECOND = 10
PROGRESS_PER_TILE = 100  # a unit of speed 1.0 gains 10 a tick: one tile in a second
MIN_HIT_DAMAGE = 1  # armour can blunt a hit, never make a unit invulnerable
CHARGE_PER_SHOT = 10  # a tower of attack speed 3 gains 3 a tick: three shots in a second


@dataclass(frozen=True)
class Preset:
    """All numbers of one version of the game. Tuples run over unit kinds or tower kinds."""

    #                              militia, footman, grunt, armoured grunt
    unit_health: tuple[int, ...]  # hit points
    unit_armour: tuple[int, ...]  # taken off each hit, less the tower's penetration
    unit_speed: tuple[int, ...]  # progress per tick
    unit_cost_gold: tuple[int, ...]
    unit_income_gold: tuple[int, ...]  # added to the buyer's income for the rest of the game
    unit_bounty_gold: tuple[int, ...]  # paid to the owner of the tower that kills
    #                              basic, fast, faster
    tower_damage_min: tuple[int, ...]  # hit points, uniform integer roll
    tower_damage_max: tuple[int, ...]
    tower_penetration: tuple[int, ...]
    tower_attack_speed: tuple[int, ...]  # shots per second
    tower_range_tiles: tuple[int, ...]  # Euclidean, between centres of cells
    tower_cost_gold: tuple[int, ...]
    tower_cost_lumber: tuple[int, ...]
    #                              both players
    start_health: int = 50
    start_gold: int = 100
    start_lumber: int = 0
    start_income_gold: int = 20  # per interval
    income_interval_ticks: int = 100
    lumber_per_interval: int = 0
    projectile_tiles_per_tick: int = 0  # 0: a shot hits in the tick it is fired


_THESIS = Preset(
    unit_health=(40, 80, 140, 190),
    unit_armour=(2, 4, 4, 6),
    unit_speed=(10, 10, 10, 12),
    unit_cost_gold=(10, 20, 40, 100),
    unit_income_gold=(2, 4, 8, 20),
    unit_bounty_gold=(1, 2, 4, 10),
    tower_damage_min=(2, 2, 4),
    tower_damage_max=(4, 4, 6),
    tower_penetration=(2, 2, 3),
    tower_attack_speed=(3, 4, 5),
    tower_range_tiles=(3, 3, 3),
    tower_cost_gold=(10, 20, 30),
    tower_cost_lumber=(0, 0, 0),
)

PRESETS = {
    "2017": replace(_THESIS, unit_health=(20, 40, 60, 100)),
    "2018": _THESIS,
    "balanced": Preset(
        unit_health=(40, 70, 110, 220),
        unit_armour=(0, 2, 4, 6),
        unit_speed=(10, 10, 10, 12),
        unit_cost_gold=(10, 20, 40, 100),
        unit_income_gold=(1, 4, 7, 20),
        unit_bounty_gold=(1, 2, 4, 10),
        tower_damage_min=(5, 3, 8),
        tower_damage_max=(7, 4, 10),
        tower_penetration=(2, 0, 4),
        tower_attack_speed=(2, 5, 2),
        tower_range_tiles=(3, 3, 3),
        tower_cost_gold=(15, 20, 35),
        tower_cost_lumber=(2, 2, 3),
        start_gold=200,
        start_lumber=8,
        start_income_gold=100,
        lumber_per_interval=1,
        projectile_tiles_per_tick=2,
    ),
}
