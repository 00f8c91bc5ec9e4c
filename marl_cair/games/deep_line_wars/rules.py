"""The rules of Deep Line Wars, written for one world; the last functions run slices of worlds.

Order of a tick (the README lists the same words): orders, walk, land shots, fire, earn, judge.
Orders are given at the first tick of a step.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_line_wars import state as s
from marl_cair.games.deep_line_wars import tables as t
from marl_cair.games.deep_line_wars.orders import list_legal_actions, obey
from marl_cair.games.game import NO_WINNER
from marl_cair.games.loops import loop_over_resets, loop_over_seats
from marl_cair.games.randomness import draw_below, mix

# Weights of the shaping potential. Their sum is below 1, so that no shaped return outweighs a win.
HEALTH_POTENTIAL = 0.5
INCOME_POTENTIAL = 0.3
MAX_STORE = 10**9  # gold that is paid out: only a game of a million ticks comes near


@compiled
def walk(world: Any, rules: Any, player: int) -> int:
    """Units advance; those that reach the far column cost the enemy one health each and are gone.

    Returns the column (own view) of the unit furthest ahead, -1 without units.
    """
    goal = rules.columns - 1
    furthest = -1
    for age in range(world.num_units[player]):
        slot = s.unit_slot(world, player, age)
        if world.unit_health[player, slot] <= 0:
            continue
        speed = rules.unit_speed[world.unit_kind[player, slot]]
        progress = world.unit_progress[player, slot] + speed
        column = world.unit_column[player, slot]
        if progress >= t.PROGRESS_PER_TILE:
            progress -= t.PROGRESS_PER_TILE
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
    while world.num_units[player] > 0:
        if world.unit_health[player, world.first_unit[player]] > 0:
            break
        world.first_unit[player] = s.unit_slot(world, player, 1)
        world.num_units[player] -= 1


@compiled
def hit(world: Any, rules: Any, player: int, tower: int) -> None:
    """The tower's projectile arrives: armour beyond the penetration blunts it, a kill pays."""
    enemy = 1 - player
    target = world.shot_target[player, tower]
    world.shot_target[player, tower] = s.NO_TARGET
    world.num_shots[player] -= 1
    health = world.unit_health[enemy, target]
    if health <= 0:
        return
    kind = world.unit_kind[enemy, target]
    penetration = rules.tower_penetration[world.tower_kind[player, tower]]
    blunted = max(0, rules.unit_armour[kind] - penetration)
    health -= max(t.MIN_HIT_DAMAGE, world.shot_damage[player, tower] - blunted)
    world.unit_health[enemy, target] = max(0, health)
    if health <= 0:
        world.gold[player] += rules.unit_bounty_gold[kind]


@compiled
def land_shots(world: Any, rules: Any, player: int) -> None:
    """Projectiles fly on; those that arrive hit, the oldest tower's first."""
    if world.num_shots[player] == 0:
        return
    for tower in range(world.num_towers[player]):
        if world.shot_target[player, tower] != s.NO_TARGET:
            world.shot_ticks[player, tower] -= 1
            if world.shot_ticks[player, tower] <= 0:
                hit(world, rules, player, tower)


@compiled
def find_target(world: Any, rules: Any, player: int, tower: int) -> int:
    """The enemy unit in range that was bought first, or s.NO_TARGET."""
    enemy = 1 - player
    reach = rules.tower_range_tiles[world.tower_kind[player, tower]]
    reach_squared = reach * reach
    tower_row = int(world.tower_row[player, tower])
    # The tower's column in the view of the enemy, whose units are stored in it.
    tower_column = rules.columns - 1 - int(world.tower_column[player, tower])
    for age in range(world.num_units[enemy]):
        slot = s.unit_slot(world, enemy, age)
        across = int(world.unit_column[enemy, slot]) - tower_column
        along = int(world.unit_row[enemy, slot]) - tower_row
        is_near = across * across + along * along <= reach_squared
        if is_near and world.unit_health[enemy, slot] > 0:
            return slot
    return s.NO_TARGET


@compiled
def reload(world: Any, rules: Any, player: int, tower: int) -> None:
    """Set the tick of the next shot.

    The charge grows by the attack speed each tick and a shot takes CHARGE_PER_SHOT of it, so that a
    speed of 3 gives exactly three shots in ten ticks.
    """
    speed = rules.tower_attack_speed[world.tower_kind[player, tower]]
    missing = t.CHARGE_PER_SHOT - world.tower_spare[player, tower]
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
        if world.shot_target[player, tower] != s.NO_TARGET:
            continue
        # No unit has come near enough yet: spares the search, changes nothing.
        reach = rules.tower_range_tiles[world.tower_kind[player, tower]]
        if enemy_furthest + reach < rules.columns - 1 - world.tower_column[player, tower]:
            continue
        target = find_target(world, rules, player, tower)
        if target != s.NO_TARGET:
            launch(world, rules, player, tower, target)


@compiled
def earn(world: Any, rules: Any) -> None:
    """At the end of each interval both players are paid."""
    if world.tick[0] % rules.income_interval_ticks == 0:
        for player in range(s.NUM_PLAYERS):
            paid = np.int64(world.gold[player]) + world.income[player]
            world.gold[player] = min(MAX_STORE, paid)
            world.lumber[player] += rules.lumber_per_interval


@compiled
def judge(world: Any, rules: Any) -> None:
    """A player without health has lost; both in one tick is a draw; the clock only truncates."""
    if world.health[0] <= 0 or world.health[1] <= 0:
        world.phase[0] = s.TERMINATED
    elif world.tick[0] >= rules.max_ticks:
        world.phase[0] = s.TRUNCATED


@compiled
def play_tick(world: Any, rules: Any) -> None:
    """One tick after the orders: walk, land shots, fire, earn, judge."""
    world.tick[0] += 1
    furthest_0 = walk(world, rules, 0)
    furthest_1 = walk(world, rules, 1)
    land_shots(world, rules, 0)
    land_shots(world, rules, 1)
    fire(world, rules, 0, furthest_1)
    fire(world, rules, 1, furthest_0)
    forget_dead(world, 0)
    forget_dead(world, 1)
    earn(world, rules)
    judge(world, rules)


@compiled
def potential(world: Any, rules: Any, player: int) -> float:
    """How well the player stands, in -0.8..0.8: lead in health and share of the income."""
    enemy = 1 - player
    health_lead = (world.health[player] - world.health[enemy]) / rules.start_health
    income_lead = (world.income[player] - world.income[enemy]) / (
        world.income[player] + world.income[enemy]
    )
    return float(HEALTH_POTENTIAL * health_lead + INCOME_POTENTIAL * income_lead)


@compiled
def winner_of(world: Any) -> int:
    """The player left standing once a world has terminated; NO_WINNER for a draw."""
    if world.health[0] > 0:
        return 0
    if world.health[1] > 0:
        return 1
    return NO_WINNER


@compiled
def step_world(world: Any, rules: Any, actions: Any, rewards: Any) -> None:
    """One step: both players' orders, then its ticks; writes the rewards of both players.

    Shaping adds discount * potential(after) - potential(before), with potential 0 once the game
    has terminated, which leaves the optimal policy as it is (Ng, Harada, Russell 1999).
    """
    if world.phase[0] != s.RUNNING:
        rewards[:] = 0.0
        return
    before = potential(world, rules, 0)
    for player in range(s.NUM_PLAYERS):
        obey(world, rules, player, actions[player])
    for _ in range(rules.ticks_per_step):
        play_tick(world, rules)
        if world.phase[0] != s.RUNNING:
            break
    after = 0.0
    outcome = 0.0
    if world.phase[0] != s.TERMINATED:
        after = potential(world, rules, 0)
    else:
        winner = winner_of(world)
        if winner != NO_WINNER:
            outcome = 1.0 - 2.0 * winner
    reward = outcome + rules.shaping * (rules.shaping_discount * after - before)
    rewards[0] = reward
    rewards[1] = -reward


@compiled
def reset_world(world: Any, rules: Any, seed: Any) -> None:
    """Begin a game in a zeroed world. The players draw from two words, independently."""
    world.phase[0] = s.RUNNING
    word = seed
    for player in range(s.NUM_PLAYERS):
        word = mix(word + np.uint64(player + 1))
        world.random[player] = word
        world.health[player] = rules.start_health
        world.gold[player] = rules.start_gold
        world.lumber[player] = rules.start_lumber
        world.income[player] = rules.start_income_gold
        world.cursor[player, 0] = rules.rows // 2
        world.cursor[player, 1] = 1
    world.shot_target[:] = s.NO_TARGET
    world.tower_at[:] = s.NO_TOWER


reset = loop_over_resets(reset_world, s.world_at, s.World)
legal_actions = loop_over_seats(list_legal_actions, s.world_at, num_players=s.NUM_PLAYERS)


@compiled
def step(worlds: Any, rules: Any, actions: Any, outcome: Any, first: int, last: int) -> None:
    """Advance and write what the engine reports; a finished world stays as it is."""
    for index in range(first, last):
        world = s.world_at(worlds, index)
        step_world(world, rules, actions[index], outcome.rewards[index])
        terminated = world.phase[0] == s.TERMINATED
        outcome.terminated[index] = terminated
        outcome.truncated[index] = world.phase[0] == s.TRUNCATED
        outcome.winner[index] = winner_of(world) if terminated else NO_WINNER
