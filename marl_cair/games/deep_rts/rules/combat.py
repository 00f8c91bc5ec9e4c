"""Fighting: who may be struck, the roll of a blow, finding an enemy, striking back, dying."""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts.rules.board import (
    owner_of,
    reach_of,
    sees_unit,
    sight_of,
    unit_distance,
)
from marl_cair.games.deep_rts.rules.dice import DAMAGE_DIE, SHARE_DIE, roll
from marl_cair.games.deep_rts.rules.roster import enter_state, remove_unit
from marl_cair.games.deep_rts.rules.rulebook import (
    KIND_ARMOUR,
    KIND_ATTACK_TICKS,
    KIND_DAMAGE_MAX,
    KIND_DAMAGE_MIN,
    KIND_PIERCING,
    SEAT_FRAME,
    TILE_DAMAGE,
    UPGRADE_BONUS,
)
from marl_cair.games.deep_rts.state import (
    ATTACK,
    DAMAGE_DONE,
    DAMAGE_TAKEN,
    IDLE,
    MAP_INDEX,
    NO_GOAL,
    NO_ORDER,
    NO_UNIT,
    NUM_ACTING,
    NUM_FALLEN,
    NUM_UNITS,
    OCCUPANT,
    STRUCK,
    TICK,
    TILE,
    UNIT_CELL,
    UNIT_EXIT,
    UNIT_HEALTH,
    UNIT_HURT,
    UNIT_HURT_BY,
    UNIT_KIND,
    UNIT_ORDER,
    UNIT_READY,
    UNIT_SERIAL,
    UNIT_STATE,
    UNIT_TARGET,
    UNIT_TARGET_SERIAL,
    UPGRADES,
)
from marl_cair.games.deep_rts.tables import (
    BLADES,
    NO_KIND,
    NUM_MOBILE_KINDS,
    PEASANT,
    PLATES,
)

_PERCENT = 100


@compiled_copy
def is_soldier(kind: int) -> bool:
    """Footmen, archers and cavalry: they attack by themselves and profit from upgrades."""
    return bool(PEASANT < kind < NUM_MOBILE_KINDS)


@compiled
def blow(world: Any, rules: Any, unit: int, target: int) -> int:
    """Hit points that a blow takes: the rolled damage less armour plus piercing, then its share."""
    kind, other = world.units[unit, UNIT_KIND], world.units[target, UNIT_KIND]
    serial = int(world.units[unit, UNIT_SERIAL])
    damage = roll(
        world,
        serial,
        DAMAGE_DIE,
        int(rules.kinds[kind, KIND_DAMAGE_MIN]),
        int(rules.kinds[kind, KIND_DAMAGE_MAX]),
    )
    damage += int(rules.kinds[kind, KIND_DAMAGE_MIN]) * rules.adds_minimum_twice + int(
        rules.kinds[kind, KIND_PIERCING]
    )
    if is_soldier(kind):
        levels = int(world.players[owner_of(rules, unit), UPGRADES + BLADES])
        damage += int(rules.upgrade[BLADES, UPGRADE_BONUS]) * levels
    armour = int(rules.kinds[other, KIND_ARMOUR])
    if is_soldier(other):
        levels = int(world.players[owner_of(rules, target), UPGRADES + PLATES])
        armour += int(rules.upgrade[PLATES, UPGRADE_BONUS]) * levels
    percent = max(0, damage * _PERCENT - armour * rules.armour_percent)
    share = roll(world, serial, SHARE_DIE, rules.roll_low, rules.roll_high)
    return int(percent * share // (_PERCENT * _PERCENT))


@compiled_copy
def is_enemy(rules: Any, unit: int, other: int) -> bool:
    """True for units of different teams."""
    return bool(rules.team[owner_of(rules, unit)] != rules.team[owner_of(rules, other)])


@compiled
def has_target(world: Any, rules: Any, unit: int) -> bool:
    """True while the unit's target lives, can be struck and is in its team's sight."""
    target = int(world.units[unit, UNIT_TARGET])
    if (
        target == NO_UNIT
        or world.units[target, UNIT_SERIAL] != world.units[unit, UNIT_TARGET_SERIAL]
    ):
        return False
    if world.units[target, UNIT_KIND] == NO_KIND or world.units[target, UNIT_CELL] == NO_GOAL:
        return False
    return is_on_board(world, target) and sees_unit(world, rules, owner_of(rules, unit), target)


@compiled_copy
def is_on_board(world: Any, unit: int) -> bool:
    """False for a builder inside its site."""
    return bool(world.board[OCCUPANT, world.units[unit, UNIT_CELL]] == unit)


@compiled
def in_range(world: Any, rules: Any, unit: int, target: int) -> bool:
    """True where a blow or shot reaches the target."""
    reach = reach_of(rules, int(world.units[unit, UNIT_KIND]))
    return bool(unit_distance(world, rules, int(world.units[unit, UNIT_CELL]), target) < reach)


@compiled_copy
def aim_at(world: Any, unit: int, target: int) -> None:
    """Remember the target, and which unit of its slot it is."""
    world.units[unit, UNIT_TARGET] = target
    world.units[unit, UNIT_TARGET_SERIAL] = world.units[target, UNIT_SERIAL]


@compiled
def seniority(world: Any, rules: Any, player: int, unit: int) -> int:
    """What breaks ties between units, the lowest first: the serial, then the cell in own view."""
    frame = int(rules.seats[world.clock[MAP_INDEX], player, SEAT_FRAME])
    cell = int(rules.own_cell[frame, world.units[unit, UNIT_CELL]])
    return int(world.units[unit, UNIT_SERIAL]) * 2**15 + cell


@compiled
def find_enemy(world: Any, rules: Any, unit: int) -> int:
    """The enemy in the unit's own sight that it fights first: the nearest, fighters before others.

    Ties go to the lower serial, then to the first cell in the own view.
    """
    player, cell = owner_of(rules, unit), int(world.units[unit, UNIT_CELL])
    sight = sight_of(rules, world.units[unit, UNIT_KIND])
    limit = sight * sight + sight
    best, best_rank = NO_UNIT, np.int64(2) ** 62
    for step in range(1, rules.num_players):
        other = (player + step) % rules.num_players
        if rules.team[other] == rules.team[player]:
            continue
        for place in range(world.players[other, NUM_UNITS]):
            enemy = int(world.roster[other, place])
            distance = unit_distance(world, rules, cell, enemy)
            if distance > limit or not is_on_board(world, enemy):
                continue
            kind = world.units[enemy, UNIT_KIND]
            rank = np.int64(distance)
            if not is_soldier(kind):
                rank += 1_000 if kind < NUM_MOBILE_KINDS else 2_000
            rank = rank * 2**39 + np.int64(seniority(world, rules, player, enemy))
            if rank < best_rank:
                best, best_rank = enemy, rank
    return best


@compiled
def strike(world: Any, rules: Any, unit: int) -> None:
    """The blow falls: the target will lose health when all blows of the tick are known."""
    if world.clock[TICK] < world.units[unit, UNIT_READY] or not has_target(world, rules, unit):
        return
    target = int(world.units[unit, UNIT_TARGET])
    if not in_range(world, rules, unit, target):
        return
    world.units[target, UNIT_HURT] += blow(world, rules, unit, target)
    world.units[unit, UNIT_READY] = (
        world.clock[TICK] + rules.kinds[world.units[unit, UNIT_KIND], KIND_ATTACK_TICKS]
    )
    world.units[unit, UNIT_EXIT] = STRUCK
    rival = int(world.units[target, UNIT_HURT_BY])
    if rival == NO_UNIT or strikes_first(world, rules, target, unit, rival):
        world.units[target, UNIT_HURT_BY] = unit


@compiled
def strikes_first(world: Any, rules: Any, target: int, unit: int, rival: int) -> bool:
    """True where the target answers `unit` rather than `rival`: nearer, older, first in view."""
    cell = int(world.units[target, UNIT_CELL])
    distance = unit_distance(world, rules, cell, unit)
    other = unit_distance(world, rules, cell, rival)
    if distance != other:
        return distance < other
    if world.units[unit, UNIT_SERIAL] != world.units[rival, UNIT_SERIAL]:
        return bool(world.units[unit, UNIT_SERIAL] < world.units[rival, UNIT_SERIAL])
    frame = rules.seats[world.clock[MAP_INDEX], owner_of(rules, target), SEAT_FRAME]
    first = rules.own_cell[frame, world.units[unit, UNIT_CELL]]
    return bool(first < rules.own_cell[frame, world.units[rival, UNIT_CELL]])


@compiled
def suffer(world: Any, rules: Any, unit: int) -> None:
    """A unit loses what the blows of the tick took; who lives and is idle strikes back."""
    hurt = min(int(world.units[unit, UNIT_HURT]), int(world.units[unit, UNIT_HEALTH]))
    attacker = int(world.units[unit, UNIT_HURT_BY])
    world.units[unit, UNIT_HURT] = 0
    world.units[unit, UNIT_HURT_BY] = NO_UNIT
    world.units[unit, UNIT_HEALTH] -= hurt
    world.players[owner_of(rules, unit), DAMAGE_TAKEN] += hurt
    if attacker != NO_UNIT:
        world.players[owner_of(rules, attacker), DAMAGE_DONE] += hurt
    if world.units[unit, UNIT_HEALTH] <= 0:
        world.clock[NUM_FALLEN] += 1
    elif (
        attacker != NO_UNIT
        and world.units[unit, UNIT_STATE] == IDLE
        and world.units[unit, UNIT_ORDER] == NO_ORDER
        and world.units[unit, UNIT_KIND] < NUM_MOBILE_KINDS
    ):
        aim_at(world, unit, attacker)
        world.units[unit, UNIT_ORDER] = ATTACK
        enter_state(world, unit, IDLE, world.clock[TICK] + 1)


@compiled
def settle_blows(world: Any, rules: Any) -> None:
    """All blows of the tick fall at once: two may kill each other."""
    for place in range(world.clock[NUM_ACTING]):
        unit = int(world.acting[place])
        if world.units[unit, UNIT_EXIT] == STRUCK:
            world.units[unit, UNIT_EXIT] = NO_GOAL
            target = int(world.units[unit, UNIT_TARGET])
            if world.units[target, UNIT_HURT] > 0:
                suffer(world, rules, target)


@compiled
def burn(world: Any, rules: Any) -> None:
    """Everybody who stands on lava loses health, each tick."""
    for player in range(rules.num_players):
        for place in range(world.players[player, NUM_UNITS]):
            unit = int(world.roster[player, place])
            damage = int(rules.tiles[world.board[TILE, world.units[unit, UNIT_CELL]], TILE_DAMAGE])
            if damage > 0 and world.units[unit, UNIT_HEALTH] > 0 and is_on_board(world, unit):
                world.units[unit, UNIT_HURT] = damage
                suffer(world, rules, unit)


@compiled
def bury_fallen(world: Any, rules: Any) -> None:
    """Take everybody without health off the board."""
    world.clock[NUM_FALLEN] = 0
    for player in range(rules.num_players):
        place = 0
        while place < world.players[player, NUM_UNITS]:
            unit = int(world.roster[player, place])
            if world.units[unit, UNIT_HEALTH] > 0:
                place += 1
            else:
                remove_unit(world, rules, unit)
