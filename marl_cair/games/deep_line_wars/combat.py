"""Walking and shooting: the phases of a tick in which units and towers meet."""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_line_wars.state import NO_TARGET
from marl_cair.games.deep_line_wars.tables import CHARGE_PER_SHOT, PROGRESS_PER_TILE
from marl_cair.games.randomness import draw_below

MIN_HIT_DAMAGE = 1  # armour can blunt a hit, never make a unit invulnerable


@compiled
def walk(world: Any, rules: Any, player: int) -> int:
    """Units advance; those that reach the far column cost the enemy one health each and are gone.

    Returns the column (own view) of the unit furthest ahead, -1 without units.
    """
    mask = world.unit_kind.shape[1] - 1
    goal = rules.columns - 1
    furthest = -1
    for age in range(world.num_units[player]):
        slot = (world.first_unit[player] + age) & mask
        if world.unit_health[player, slot] <= 0:
            continue
        progress = (
            world.unit_progress[player, slot] + rules.unit_speed[world.unit_kind[player, slot]]
        )
        column = world.unit_column[player, slot]
        if progress >= PROGRESS_PER_TILE:
            progress -= PROGRESS_PER_TILE
            column += 1
            world.unit_column[player, slot] = column
            if column >= goal:
                world.unit_health[player, slot] = 0
                world.health[1 - player] -= 1
                continue
        world.unit_progress[player, slot] = progress
        furthest = max(furthest, column)
    return furthest


@compiled
def forget_dead(world: Any, player: int) -> None:
    """Free the slots of dead units at the old end of the ring."""
    mask = world.unit_kind.shape[1] - 1
    while world.num_units[player] > 0:
        if world.unit_health[player, world.first_unit[player]] > 0:
            break
        world.first_unit[player] = (world.first_unit[player] + 1) & mask
        world.num_units[player] -= 1


@compiled
def hit(world: Any, rules: Any, player: int, tower: int) -> None:
    """The tower's projectile arrives: armour beyond the penetration blunts it, a kill pays."""
    enemy = 1 - player
    target = world.shot_target[player, tower]
    world.shot_target[player, tower] = NO_TARGET
    world.num_shots[player] -= 1
    health = world.unit_health[enemy, target]
    if health <= 0:
        return
    kind = world.unit_kind[enemy, target]
    penetration = rules.tower_penetration[world.tower_kind[player, tower]]
    blunted = max(0, rules.unit_armour[kind] - penetration)
    health -= max(MIN_HIT_DAMAGE, world.shot_damage[player, tower] - blunted)
    world.unit_health[enemy, target] = max(0, health)
    if health <= 0:
        world.gold[player] += rules.unit_bounty[kind]


@compiled
def land_shots(world: Any, rules: Any, player: int) -> None:
    """Projectiles fly on; those that arrive hit, the oldest tower's first."""
    if world.num_shots[player] == 0:
        return
    for tower in range(world.num_towers[player]):
        if world.shot_target[player, tower] != NO_TARGET:
            world.shot_ticks[player, tower] -= 1
            if world.shot_ticks[player, tower] <= 0:
                hit(world, rules, player, tower)


@compiled
def find_target(world: Any, rules: Any, player: int, tower: int) -> int:
    """The enemy unit in range that was bought first, or NO_TARGET."""
    enemy = 1 - player
    mask = world.unit_kind.shape[1] - 1
    reach = rules.tower_range[world.tower_kind[player, tower]]
    reach_squared = reach * reach
    tower_row = int(world.tower_row[player, tower])
    # The tower's column in the view of the enemy, whose units are stored in it.
    tower_column = rules.columns - 1 - int(world.tower_column[player, tower])
    for age in range(world.num_units[enemy]):
        slot = (world.first_unit[enemy] + age) & mask
        across = int(world.unit_column[enemy, slot]) - tower_column
        along = int(world.unit_row[enemy, slot]) - tower_row
        is_near = across * across + along * along <= reach_squared
        if is_near and world.unit_health[enemy, slot] > 0:
            return int(slot)
    return NO_TARGET


@compiled
def reload(world: Any, rules: Any, player: int, tower: int) -> None:
    """Set the tick of the next shot.

    The charge grows by the attack speed each tick and a shot takes CHARGE_PER_SHOT of it, so that a
    speed of 3 gives exactly three shots in ten ticks.
    """
    speed = rules.tower_speed[world.tower_kind[player, tower]]
    missing = CHARGE_PER_SHOT - world.tower_spare[player, tower]
    reload_ticks = (missing + speed - 1) // speed
    world.tower_ready[player, tower] = world.tick[0] + reload_ticks
    world.tower_spare[player, tower] = reload_ticks * speed - missing


@compiled
def launch(world: Any, rules: Any, player: int, tower: int, target: int) -> None:
    """Roll the damage and send the projectile; without flight time it hits at once."""
    enemy = 1 - player
    kind = world.tower_kind[player, tower]
    low, high = rules.tower_damage_min[kind], rules.tower_damage_max[kind]
    world.shot_damage[player, tower] = low + draw_below(world.random, player, high - low + 1)
    world.shot_target[player, tower] = target
    world.num_shots[player] += 1
    reload(world, rules, player, tower)
    rows_apart = abs(world.unit_row[enemy, target] - world.tower_row[player, tower])
    tower_column = rules.columns - 1 - int(world.tower_column[player, tower])
    columns_apart = abs(world.unit_column[enemy, target] - tower_column)
    flight = rules.flight_ticks[rows_apart, columns_apart]
    world.shot_ticks[player, tower] = flight
    world.shot_flight_ticks[player, tower] = flight
    if flight == 0:
        hit(world, rules, player, tower)


@compiled
def fire(world: Any, rules: Any, player: int, enemy_furthest: int) -> None:
    """A tower that is ready and whose last projectile has landed fires at its target."""
    if enemy_furthest < 0:
        return
    tick = world.tick[0]
    for tower in range(world.num_towers[player]):
        if world.tower_ready[player, tower] > tick:
            continue
        if world.shot_target[player, tower] != NO_TARGET:
            continue
        # No unit has come near enough yet: spares the search, changes nothing.
        reach = rules.tower_range[world.tower_kind[player, tower]]
        if enemy_furthest + reach < rules.columns - 1 - world.tower_column[player, tower]:
            continue
        target = find_target(world, rules, player, tower)
        if target != NO_TARGET:
            launch(world, rules, player, tower, target)
