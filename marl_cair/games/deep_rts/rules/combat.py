"""Fighting: who may be struck, the roll of a blow, finding an enemy, striking back, dying."""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled, compiled_copy
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules import board
from marl_cair.games.deep_rts.rules import rulebook as rb
from marl_cair.games.deep_rts.rules.dice import DAMAGE_DIE, SHARE_DIE, roll
from marl_cair.games.deep_rts.rules.roster import enter_state, remove_unit

_PERCENT = 100


@compiled_copy
def is_soldier(kind: int) -> bool:
    """Footmen, archers and cavalry: they attack by themselves and profit from upgrades."""
    return bool(t.PEASANT < kind < t.NUM_MOBILE_KINDS)


@compiled
def blow(world: Any, rules: Any, unit: int, target: int) -> int:
    """Hit points that a blow takes: the rolled damage less armour plus piercing, then its share."""
    kind, other = world.units[unit, s.UNIT_KIND], world.units[target, s.UNIT_KIND]
    serial = int(world.units[unit, s.UNIT_SERIAL])
    damage = roll(
        world,
        serial,
        DAMAGE_DIE,
        int(rules.kinds[kind, rb.KIND_DAMAGE_MIN]),
        int(rules.kinds[kind, rb.KIND_DAMAGE_MAX]),
    )
    damage += int(rules.kinds[kind, rb.KIND_DAMAGE_MIN]) * rules.adds_minimum_twice + int(
        rules.kinds[kind, rb.KIND_PIERCING]
    )
    if is_soldier(kind):
        levels = int(world.players[board.owner_of(rules, unit), s.UPGRADES + t.BLADES])
        damage += int(rules.upgrade[t.BLADES, rb.UPGRADE_BONUS]) * levels
    armour = int(rules.kinds[other, rb.KIND_ARMOUR])
    if is_soldier(other):
        levels = int(world.players[board.owner_of(rules, target), s.UPGRADES + t.PLATES])
        armour += int(rules.upgrade[t.PLATES, rb.UPGRADE_BONUS]) * levels
    percent = max(0, damage * _PERCENT - armour * rules.armour_percent)
    share = roll(world, serial, SHARE_DIE, rules.roll_low, rules.roll_high)
    return int(percent * share // (_PERCENT * _PERCENT))


@compiled_copy
def is_enemy(rules: Any, unit: int, other: int) -> bool:
    """True for units of different teams."""
    return bool(rules.team[board.owner_of(rules, unit)] != rules.team[board.owner_of(rules, other)])


@compiled
def has_target(world: Any, rules: Any, unit: int) -> bool:
    """True while the unit's target lives, can be struck and is in its team's sight."""
    target = int(world.units[unit, s.UNIT_TARGET])
    if (
        target == s.NO_UNIT
        or world.units[target, s.UNIT_SERIAL] != world.units[unit, s.UNIT_TARGET_SERIAL]
    ):
        return False
    if (
        world.units[target, s.UNIT_KIND] == t.NO_KIND
        or world.units[target, s.UNIT_CELL] == s.NO_GOAL
    ):
        return False
    return is_on_board(world, target) and board.sees_unit(
        world, rules, board.owner_of(rules, unit), target
    )


@compiled_copy
def is_on_board(world: Any, unit: int) -> bool:
    """False for a builder inside its site."""
    return bool(world.board[s.OCCUPANT, world.units[unit, s.UNIT_CELL]] == unit)


@compiled
def in_range(world: Any, rules: Any, unit: int, target: int) -> bool:
    """True where a blow or shot reaches the target."""
    reach = board.reach_of(rules, int(world.units[unit, s.UNIT_KIND]))
    return bool(
        board.unit_distance(world, rules, int(world.units[unit, s.UNIT_CELL]), target) < reach
    )


@compiled_copy
def aim_at(world: Any, unit: int, target: int) -> None:
    """Remember the target, and which unit of its slot it is."""
    world.units[unit, s.UNIT_TARGET] = target
    world.units[unit, s.UNIT_TARGET_SERIAL] = world.units[target, s.UNIT_SERIAL]


@compiled
def seniority(world: Any, rules: Any, player: int, unit: int) -> int:
    """What breaks ties between units, the lowest first: the serial, then the cell in own view."""
    frame = int(rules.seats[world.clock[s.MAP_INDEX], player, rb.SEAT_FRAME])
    cell = int(rules.own_cell[frame, world.units[unit, s.UNIT_CELL]])
    return int(world.units[unit, s.UNIT_SERIAL]) * 2**15 + cell


@compiled
def find_enemy(world: Any, rules: Any, unit: int) -> int:
    """The enemy in the unit's own sight that it fights first: the nearest, fighters before others.

    Ties go to the lower serial, then to the first cell in the own view.
    """
    player, cell = board.owner_of(rules, unit), int(world.units[unit, s.UNIT_CELL])
    sight = board.sight_of(rules, world.units[unit, s.UNIT_KIND])
    limit = sight * sight + sight
    best, best_rank = s.NO_UNIT, np.int64(2) ** 62
    for step in range(1, rules.num_players):
        other = (player + step) % rules.num_players
        if rules.team[other] == rules.team[player]:
            continue
        for place in range(world.players[other, s.NUM_UNITS]):
            enemy = int(world.roster[other, place])
            distance = board.unit_distance(world, rules, cell, enemy)
            if distance > limit or not is_on_board(world, enemy):
                continue
            kind = world.units[enemy, s.UNIT_KIND]
            rank = np.int64(distance)
            if not is_soldier(kind):
                rank += 1_000 if kind < t.NUM_MOBILE_KINDS else 2_000
            rank = rank * 2**39 + np.int64(seniority(world, rules, player, enemy))
            if rank < best_rank:
                best, best_rank = enemy, rank
    return best


@compiled
def strike(world: Any, rules: Any, unit: int) -> None:
    """The blow falls: the target will lose health when all blows of the tick are known."""
    if world.clock[s.TICK] < world.units[unit, s.UNIT_READY] or not has_target(world, rules, unit):
        return
    target = int(world.units[unit, s.UNIT_TARGET])
    if not in_range(world, rules, unit, target):
        return
    world.units[target, s.UNIT_HURT] += blow(world, rules, unit, target)
    world.units[unit, s.UNIT_READY] = (
        world.clock[s.TICK] + rules.kinds[world.units[unit, s.UNIT_KIND], rb.KIND_ATTACK_TICKS]
    )
    world.units[unit, s.UNIT_EXIT] = s.STRUCK
    rival = int(world.units[target, s.UNIT_HURT_BY])
    if rival == s.NO_UNIT or strikes_first(world, rules, target, unit, rival):
        world.units[target, s.UNIT_HURT_BY] = unit


@compiled
def strikes_first(world: Any, rules: Any, target: int, unit: int, rival: int) -> bool:
    """True where the target answers `unit` rather than `rival`: nearer, older, first in view."""
    cell = int(world.units[target, s.UNIT_CELL])
    distance = board.unit_distance(world, rules, cell, unit)
    other = board.unit_distance(world, rules, cell, rival)
    if distance != other:
        return distance < other
    if world.units[unit, s.UNIT_SERIAL] != world.units[rival, s.UNIT_SERIAL]:
        return bool(world.units[unit, s.UNIT_SERIAL] < world.units[rival, s.UNIT_SERIAL])
    frame = rules.seats[world.clock[s.MAP_INDEX], board.owner_of(rules, target), rb.SEAT_FRAME]
    first = rules.own_cell[frame, world.units[unit, s.UNIT_CELL]]
    return bool(first < rules.own_cell[frame, world.units[rival, s.UNIT_CELL]])


@compiled
def suffer(world: Any, rules: Any, unit: int) -> None:
    """A unit loses what the blows of the tick took; who lives and is idle strikes back."""
    hurt = min(int(world.units[unit, s.UNIT_HURT]), int(world.units[unit, s.UNIT_HEALTH]))
    attacker = int(world.units[unit, s.UNIT_HURT_BY])
    world.units[unit, s.UNIT_HURT] = 0
    world.units[unit, s.UNIT_HURT_BY] = s.NO_UNIT
    world.units[unit, s.UNIT_HEALTH] -= hurt
    world.players[board.owner_of(rules, unit), s.DAMAGE_TAKEN] += hurt
    if attacker != s.NO_UNIT:
        world.players[board.owner_of(rules, attacker), s.DAMAGE_DONE] += hurt
    if world.units[unit, s.UNIT_HEALTH] <= 0:
        world.clock[s.NUM_FALLEN] += 1
    elif (
        attacker != s.NO_UNIT
        and world.units[unit, s.UNIT_STATE] == s.IDLE
        and world.units[unit, s.UNIT_ORDER] == s.NO_ORDER
        and world.units[unit, s.UNIT_KIND] < t.NUM_MOBILE_KINDS
    ):
        aim_at(world, unit, attacker)
        world.units[unit, s.UNIT_ORDER] = s.ATTACK
        enter_state(world, unit, s.IDLE, world.clock[s.TICK] + 1)


@compiled
def settle_blows(world: Any, rules: Any) -> None:
    """All blows of the tick fall at once: two may kill each other."""
    for place in range(world.clock[s.NUM_ACTING]):
        unit = int(world.acting[place])
        if world.units[unit, s.UNIT_EXIT] == s.STRUCK:
            world.units[unit, s.UNIT_EXIT] = s.NO_GOAL
            target = int(world.units[unit, s.UNIT_TARGET])
            if world.units[target, s.UNIT_HURT] > 0:
                suffer(world, rules, target)


@compiled
def burn(world: Any, rules: Any) -> None:
    """Units on lava lose health each tick."""
    for player in range(rules.num_players):
        for place in range(world.players[player, s.NUM_UNITS]):
            unit = int(world.roster[player, place])
            damage = int(
                rules.tiles[world.board[s.TILE, world.units[unit, s.UNIT_CELL]], rb.TILE_DAMAGE]
            )
            if damage > 0 and world.units[unit, s.UNIT_HEALTH] > 0 and is_on_board(world, unit):
                world.units[unit, s.UNIT_HURT] = damage
                suffer(world, rules, unit)


@compiled
def bury_fallen(world: Any, rules: Any) -> None:
    """Take units without health off the board."""
    world.clock[s.NUM_FALLEN] = 0
    for player in range(rules.num_players):
        place = 0
        while place < world.players[player, s.NUM_UNITS]:
            unit = int(world.roster[player, place])
            if world.units[unit, s.UNIT_HEALTH] > 0:
                place += 1
            else:
                remove_unit(world, rules, unit)
