"""Observations beside the planes: the economy as a vector, and the original's ten layers."""

from __future__ import annotations

from math import ceil
from operator import mul
from typing import TYPE_CHECKING, Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.board import is_building, known_tile, owner_of, sees
from marl_cair.games.deep_rts.rules.judging import score_of
from marl_cair.games.deep_rts.rules.roster import food_limit
from marl_cair.games.deep_rts.views import planes
from marl_cair.games.deep_rts.views.appearance import side_of
from marl_cair.games.loops import loop_over_seats

if TYPE_CHECKING:
    from marl_cair.games.deep_rts.scenarios import Scenario

VECTOR_NAMES = (
    *(f"own {name}" for name in t.RESOURCE_NAMES),
    *(f"gathered {name}" for name in t.RESOURCE_NAMES),
    "own food used",
    "own food limit",
    *(f"own {name}" for name in t.UPGRADE_NAMES),
    *(f"own {name}" for name in t.UNIT_NAMES),
    *(f"enemy {name} in sight" for name in t.UNIT_NAMES),
    *("own damage done", "own damage taken", "own score", "ticks played", "ticks left"),
)

CLASSIC_NAMES = (
    *("tile", "owner", "building", "mobile", "kind"),  # owner: 1 own, 2 ally, 3 enemy
    *("health", "state", "carried", "attack", "armour"),
)


def vector_high(scenario: Scenario) -> tuple[float, ...]:
    """The largest value of each entry of VECTOR_NAMES that rules and ground allow; 1 where it is
    always 0 in the scenario.
    """
    preset = t.PRESETS[scenario.preset]
    start = [preset.wealth * store for store in preset.start_stores]
    found = _most_found(scenario)
    stored = [min(t.MAX_RESOURCE, first + more) for first, more in zip(start, found, strict=True)]
    counted = [min(t.MAX_RESOURCE, more) for more in found]
    food = max(preset.food_limit, sum(map(mul, _starting_units(scenario), preset.food_consumed)))
    teams = scenario.teams or tuple(range(scenario.num_players))
    num_enemies = scenario.num_players - min(map(teams.count, teams))  # of the seat with most
    slots = scenario.slots_per_player
    units = [min(slots, food // eats) if eats else slots for eats in preset.food_consumed]
    units_in_sight = [num_enemies * most for most in units]
    done = _most_lost(scenario, num_enemies, found[t.GOLD]) if num_enemies else 0.0
    taken = _most_lost(scenario, 1, found[t.GOLD])
    gathered = found[t.GOLD] + 0.5 * found[t.LUMBER] + 1.5 * found[t.STONE]
    created = (start[t.GOLD] + found[t.GOLD]) * _for_one_gold(preset)[0]
    score = gathered + 2.0 * created + slots + 0.6 * done
    highest = (
        *(*stored, *counted, food, preset.food_limit, *preset.upgrade_levels),
        *(*units, *units_in_sight, done, taken, score, scenario.max_ticks, scenario.max_ticks),
    )
    return tuple(float(min(s.NEVER, max(1, ceil(value)))) for value in highest)


def _most_found(scenario: Scenario) -> list[int]:
    """All of each resource on any of the maps, as workers bring it home. Each of the workers around
    a tile may take its last unit.
    """
    preset = t.PRESETS[scenario.preset]
    most = [0] * t.NUM_RESOURCES
    for tile, resource in enumerate(t.TILE_RESOURCE):
        if resource != t.NO_RESOURCE:
            num_tiles = max(int((game_map.tiles == tile).sum()) for game_map in scenario.maps)
            units = num_tiles * (preset.tile_amount[tile] + rb.NUM_DIRECTIONS - 1)
            most[resource] = units * preset.tile_yield[tile]
    return most


def _starting_units(scenario: Scenario) -> tuple[int, ...]:
    """Units of each kind that a player has at the start."""
    preset, num_buildings = t.PRESETS[scenario.preset], t.NUM_KINDS - t.NUM_MOBILE_KINDS
    if scenario.army:
        return (*scenario.army, *[0] * num_buildings)
    base = [0] * t.NUM_KINDS
    base[t.PEASANT], base[t.TOWN_HALL] = preset.start_peasants, int(preset.starts_with_hall)
    return tuple(base)


def _for_one_gold(preset: t.Preset) -> tuple[float, float]:
    """The most units, and the most hit points, that one gold buys. Repairing buys the most hit
    points: a site that is hit and cancelled loses a tenth of its health and a quarter of its price.
    """
    enabled = [kind for kind, is_enabled in enumerate(preset.is_enabled) if is_enabled]
    prices = [preset.cost_gold[kind] for kind in enabled]
    if not (all(prices) and preset.repair_percent):
        return s.NEVER, s.NEVER  # something is free: no bound but that of the state's numbers
    built = max(preset.health[kind] / preset.cost_gold[kind] for kind in enabled)
    return 1.0 / min(prices), built * max(1.0, 100.0 / preset.repair_percent)


def _most_lost(scenario: Scenario, num_players: int, gold: int) -> float:
    """Hit points that so many players can lose together: those of the start, and those bought with
    the gold of the start and the gold that they find (`gold`).
    """
    preset = t.PRESETS[scenario.preset]
    _, health = _for_one_gold(preset)
    first: int = sum(map(mul, _starting_units(scenario), preset.health))
    return num_players * (first + health * preset.wealth * preset.start_gold) + health * gold


@compiled
def see_vector(world: Any, rules: Any, player: int, out: Any) -> None:
    """The economy of one seat: out float32 [V]."""
    for resource in range(t.NUM_RESOURCES):
        out[resource] = world.players[player, s.RESOURCES + resource]
        out[t.NUM_RESOURCES + resource] = world.players[player, s.GATHERED + resource]
    index = 2 * t.NUM_RESOURCES
    out[index] = world.players[player, s.FOOD_USED]
    out[index + 1] = food_limit(world, rules, player)
    index += 2
    for upgrade in range(t.NUM_UPGRADES):
        out[index + upgrade] = world.players[player, s.UPGRADES + upgrade]
    index += t.NUM_UPGRADES
    for kind in range(t.NUM_KINDS):
        out[index + kind] = world.players[player, s.NUM_OWNED + kind]
        out[index + t.NUM_KINDS + kind] = 0.0
    for owner in range(rules.num_players):
        if rules.team[owner] == rules.team[player]:
            continue
        for place in range(world.players[owner, s.NUM_UNITS]):
            unit = int(world.roster[owner, place])
            cell = int(world.units[unit, s.UNIT_CELL])
            if world.board[s.OCCUPANT, cell] == unit and sees(world, rules, player, cell):
                out[index + t.NUM_KINDS + world.units[unit, s.UNIT_KIND]] += 1.0
    index += 2 * t.NUM_KINDS
    out[index] = world.players[player, s.DAMAGE_DONE]
    out[index + 1] = world.players[player, s.DAMAGE_TAKEN]
    out[index + 2] = score_of(world, player)
    out[index + 3] = world.clock[s.TICK]
    out[index + 4] = rules.max_ticks - world.clock[s.TICK]


@compiled
def see_classic(world: Any, rules: Any, player: int, out: Any) -> None:
    """The original's ten planes, of this tick: out uint8 [10, H, W]."""
    out[:] = 0
    frame = int(rules.seats[world.clock[s.MAP_INDEX], player, rb.SEAT_FRAME])
    for row in range(rules.rows):
        for column in range(rules.columns):
            cell = int(rules.world_cell[frame, row * rules.columns + column])
            tile = known_tile(world, rules, player, cell)
            if tile != s.UNKNOWN:
                out[0, row, column] = tile + 1
            unit = int(world.board[s.OCCUPANT, cell])
            if unit == s.NO_UNIT or not sees(world, rules, player, cell):
                continue
            kind = int(world.units[unit, s.UNIT_KIND])
            out[1, row, column] = 1 + side_of(rules, player, owner_of(rules, unit))
            out[2, row, column] = int(is_building(world, unit))
            out[3, row, column] = int(kind < t.NUM_MOBILE_KINDS)
            out[4, row, column] = kind + 1
            health = 100 * int(world.units[unit, s.UNIT_HEALTH])
            out[5, row, column] = health // int(rules.kinds[kind, rb.KIND_HEALTH])
            out[6, row, column] = world.units[unit, s.UNIT_STATE] + 1
            if world.units[unit, s.UNIT_CARRY_KIND] != t.NO_RESOURCE:
                out[7, row, column] = min(planes.FULL, int(world.units[unit, s.UNIT_CARRY]))
            attack = rules.kinds[kind, rb.KIND_DAMAGE_MIN] + rules.kinds[kind, rb.KIND_DAMAGE_MAX]
            attack += rules.kinds[kind, rb.KIND_PIERCING]
            out[8, row, column] = min(planes.FULL, int(attack))
            out[9, row, column] = min(planes.FULL, int(rules.kinds[kind, rb.KIND_ARMOUR]))


observe_classic = loop_over_seats(see_classic, s.world_at)  # out uint8 [B, P, 10, H, W]
observe_vector = loop_over_seats(see_vector, s.world_at)  # out float32 [B, P, V]
