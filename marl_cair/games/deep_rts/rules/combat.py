"""Fighting: legal targets, damage, finding an enemy, striking back, dying."""

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
    """Footmen, archers and cavalry: they attack without orders and profit from upgrades."""
    return bool(t.PEASANT < kind < t.NUM_MOBILE_KINDS)


@compiled_copy
def is_on_board(world: Any, unit: int) -> bool:
    """False for a builder inside its site."""
    return bool(world.board[s.OCCUPANT, world.units[unit, s.UNIT_CELL]] == unit)


@compiled_copy
def aim_at(world: Any, unit: int, target: int) -> None:
    """Set the unit's target, with its serial number: slots are used again."""
    world.units[unit, s.UNIT_TARGET] = target
    world.units[unit, s.UNIT_TARGET_SERIAL] = world.units[target, s.UNIT_SERIAL]


@compiled
def has_target(world: Any, rules: Any, unit: int) -> bool:
    """True while the unit's target lives, can be struck and is in its team's sight."""
    target, serial = int(world.units[unit, s.UNIT_TARGET]), world.units[unit, s.UNIT_TARGET_SERIAL]
    if target == s.NO_UNIT or world.units[target, s.UNIT_SERIAL] != serial:
        return False
    player = board.owner_of(rules, unit)
    return is_on_board(world, target) and board.sees_unit(world, rules, player, target)


@compiled
def rank_target(world: Any, rules: Any, player: int, distance: int, unit: int) -> int:
    """Order of units as targets, lowest first: distance, then serial, then cell in own view."""
    cell = int(rules.own_cell[board.frame_of(world, rules, player), world.units[unit, s.UNIT_CELL]])
    return int(np.int64(distance) * 2**39 + int(world.units[unit, s.UNIT_SERIAL]) * 2**15 + cell)


@compiled
def find_enemy(world: Any, rules: Any, unit: int, limit: int, oldest_first: bool) -> int:
    """The enemy to attack at a squared distance below `limit`, or NO_UNIT.

    Soldiers before workers before buildings, then as in `rank_target`; with `oldest_first` the
    oldest of those whose centre the team sees.
    """
    player, cell = board.owner_of(rules, unit), int(world.units[unit, s.UNIT_CELL])
    best, best_rank = s.NO_UNIT, 2**62
    for step in range(1, rules.num_players):
        other = (player + step) % rules.num_players
        if rules.team[other] == rules.team[player]:
            continue
        for place in range(world.players[other, s.NUM_UNITS]):
            enemy = int(world.roster[other, place])
            distance = board.unit_distance(world, rules, cell, enemy)
            if distance >= limit or not is_on_board(world, enemy):
                continue
            kind = world.units[enemy, s.UNIT_KIND]
            if oldest_first:
                distance = 0
                if not board.sees(world, rules, player, int(world.units[enemy, s.UNIT_CELL])):
                    continue
            elif not is_soldier(kind):
                distance += 1_000 if kind < t.NUM_MOBILE_KINDS else 2_000
            rank = rank_target(world, rules, player, distance, enemy)
            if rank < best_rank:
                best, best_rank = enemy, rank
    return best


@compiled
def upgrade_bonus(world: Any, rules: Any, unit: int, upgrade: int) -> int:
    """The bonus of the owner's levels of an upgrade for a unit; 0 for units that get none."""
    if not is_soldier(world.units[unit, s.UNIT_KIND]):
        return 0
    levels = int(world.players[board.owner_of(rules, unit), s.UPGRADES + upgrade])
    return int(rules.upgrade[upgrade, rb.UPGRADE_BONUS]) * levels


@compiled
def blow(world: Any, rules: Any, unit: int, target: int) -> int:
    """Hit points of a blow: the rolled damage plus piercing, less armour, times a rolled share."""
    serial = int(world.units[unit, s.UNIT_SERIAL])
    lowest = board.kind_value(world, rules, unit, rb.KIND_DAMAGE_MIN)
    highest = board.kind_value(world, rules, unit, rb.KIND_DAMAGE_MAX)
    damage = roll(world, serial, DAMAGE_DIE, lowest, highest) + lowest * rules.adds_minimum_twice
    damage += board.kind_value(world, rules, unit, rb.KIND_PIERCING)
    damage += upgrade_bonus(world, rules, unit, t.BLADES)
    armour = board.kind_value(world, rules, target, rb.KIND_ARMOUR)
    armour += upgrade_bonus(world, rules, target, t.PLATES)
    percent = max(0, damage * _PERCENT - armour * rules.armour_percent)
    share = roll(world, serial, SHARE_DIE, rules.roll_low_percent, rules.roll_high_percent)
    return int(percent * share // (_PERCENT * _PERCENT))


@compiled
def strike(world: Any, rules: Any, unit: int) -> None:
    """Add a blow to those that the target suffers at the end of the tick."""
    if world.clock[s.TICK] < world.units[unit, s.UNIT_READY] or not has_target(world, rules, unit):
        return
    target, cell = int(world.units[unit, s.UNIT_TARGET]), int(world.units[unit, s.UNIT_CELL])
    if board.unit_distance(world, rules, cell, target) >= board.reach_of(world, rules, unit):
        return
    world.units[target, s.UNIT_HURT] += blow(world, rules, unit, target)
    ticks = board.kind_value(world, rules, unit, rb.KIND_ATTACK_TICKS)
    world.units[unit, s.UNIT_READY] = world.clock[s.TICK] + ticks
    world.units[unit, s.UNIT_EXIT] = s.STRUCK
    rival = int(world.units[target, s.UNIT_HURT_BY])
    if rival == s.NO_UNIT or strikes_first(world, rules, target, unit, rival):
        world.units[target, s.UNIT_HURT_BY] = unit


@compiled
def strikes_first(world: Any, rules: Any, target: int, unit: int, rival: int) -> bool:
    """True where the target strikes back at `unit` rather than at `rival`; see `rank_target`."""
    player, cell = board.owner_of(rules, target), int(world.units[target, s.UNIT_CELL])
    near = board.unit_distance(world, rules, cell, unit)
    far = board.unit_distance(world, rules, cell, rival)
    own = rank_target(world, rules, player, near, unit)
    return bool(own < rank_target(world, rules, player, far, rival))


@compiled
def suffer(world: Any, rules: Any, unit: int) -> None:
    """Take the damage of the tick off a unit; an idle unit that lives strikes back."""
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
        and not board.is_building(world, unit)
    ):
        aim_at(world, unit, attacker)
        world.units[unit, s.UNIT_ORDER] = s.ATTACK
        enter_state(world, unit, s.IDLE, world.clock[s.TICK] + 1)


@compiled
def settle_blows(world: Any, rules: Any) -> None:
    """Apply all blows of the tick at once: two units may kill each other."""
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
            cell = int(world.units[unit, s.UNIT_CELL])
            damage = board.tile_value(world, rules, cell, rb.TILE_DAMAGE)
            if damage > 0 and world.units[unit, s.UNIT_HEALTH] > 0 and is_on_board(world, unit):
                world.units[unit, s.UNIT_HURT] = damage
                suffer(world, rules, unit)


@compiled
def bury_fallen(world: Any, rules: Any) -> None:
    """Remove units without health."""
    world.clock[s.NUM_FALLEN] = 0
    for player in range(rules.num_players):
        place = 0
        while place < world.players[player, s.NUM_UNITS]:
            unit = int(world.roster[player, place])
            if world.units[unit, s.UNIT_HEALTH] > 0:
                place += 1
            else:
                remove_unit(world, rules, unit)
