"""The rules of Deep Line Wars, written for one world; the last functions run slices of worlds.

Order of a tick (the README lists the same words): orders, walk, land shots, fire, earn, judge.
Orders are given at the first tick of a decision.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_line_wars.combat import fire, forget_dead, land_shots, walk
from marl_cair.games.deep_line_wars.orders import list_legal_actions, obey
from marl_cair.games.deep_line_wars.state import (
    NO_TARGET,
    NO_TOWER,
    NUM_PLAYERS,
    RUNNING,
    TERMINATED,
    TRUNCATED,
    world_at,
)
from marl_cair.games.game import NO_WINNER
from marl_cair.games.randomness import mix

# Weights of the shaping potential. Their sum is below 1, so that no shaped return outweighs a win.
HEALTH_POTENTIAL = 0.5
INCOME_POTENTIAL = 0.3
MAX_STORE = 10**9  # gold that is paid out: only a game of a million ticks comes near


# --- the phases of a tick --------------------------------------------------------------------


@compiled
def earn(world: Any, rules: Any) -> None:
    """At the end of each interval both players are paid."""
    if world.tick[0] % rules.interval_ticks == 0:
        for player in range(NUM_PLAYERS):
            paid = np.int64(world.gold[player]) + world.income[player]
            world.gold[player] = min(MAX_STORE, paid)
            world.lumber[player] += rules.lumber_per_interval


@compiled
def judge(world: Any, rules: Any) -> None:
    """A player without health has lost; both in one tick is a draw; the clock only truncates."""
    if world.health[0] <= 0 or world.health[1] <= 0:
        world.phase[0] = TERMINATED
    elif world.tick[0] >= rules.max_ticks:
        world.phase[0] = TRUNCATED


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


# --- one world -------------------------------------------------------------------------------


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
    """One decision: both players' orders, then its ticks; writes the rewards of both players.

    Shaping adds discount * potential(after) - potential(before), with potential 0 once the game
    has terminated, which leaves the optimal policy as it is (Ng, Harada, Russell 1999).
    """
    if world.phase[0] != RUNNING:
        rewards[:] = 0.0
        return
    before = potential(world, rules, 0)
    for player in range(NUM_PLAYERS):
        obey(world, rules, player, actions[player])
    for _ in range(rules.ticks_per_step):
        play_tick(world, rules)
        if world.phase[0] != RUNNING:
            break
    after = 0.0
    outcome = 0.0
    if world.phase[0] != TERMINATED:
        after = potential(world, rules, 0)
    else:
        winner = winner_of(world)
        if winner != NO_WINNER:
            outcome = 1.0 - 2.0 * winner
    reward = outcome + rules.shaping * (rules.discount * after - before)
    rewards[0] = reward
    rewards[1] = -reward


@compiled
def clear_slots(world: Any) -> None:
    """Empty all slots, so that nothing of the last game stays in the state."""
    world.unit_kind[:] = 0
    world.unit_health[:] = 0
    world.unit_row[:] = 0
    world.unit_column[:] = 0
    world.unit_progress[:] = 0
    world.tower_kind[:] = 0
    world.tower_row[:] = 0
    world.tower_column[:] = 0
    world.tower_ready[:] = 0
    world.tower_spare[:] = 0
    world.shot_target[:] = NO_TARGET
    world.shot_ticks[:] = 0
    world.shot_flight_ticks[:] = 0
    world.shot_damage[:] = 0
    world.tower_at[:] = NO_TOWER


@compiled
def reset_world(world: Any, rules: Any, seed: Any) -> None:
    """A new game. The players draw from two different words, so their luck is independent."""
    world.tick[0] = 0
    world.phase[0] = RUNNING
    word = seed
    for player in range(NUM_PLAYERS):
        word = mix(word + np.uint64(player + 1))
        world.random[player] = word
        world.health[player] = rules.start_health
        world.gold[player] = rules.start_gold
        world.lumber[player] = rules.start_lumber
        world.income[player] = rules.start_income
        world.cursor[player, 0] = rules.rows // 2
        world.cursor[player, 1] = 1
        world.illegal[player] = 0
        world.first_unit[player] = 0
        world.num_units[player] = 0
        world.num_towers[player] = 0
        world.num_shots[player] = 0
    clear_slots(world)


# --- slices of worlds ------------------------------------------------------------------------


@compiled
def reset(worlds: Any, rules: Any, seeds: Any, mask: Any, first: int, last: int) -> None:
    """New games in the worlds of `mask` bool [B] from `seeds` uint64 [B]."""
    for index in range(first, last):
        if mask[index]:
            reset_world(world_at(worlds, index), rules, seeds[index])


@compiled
def step(worlds: Any, rules: Any, actions: Any, outcome: Any, first: int, last: int) -> None:
    """Advance and write what the engine reports; a finished world stays as it is."""
    for index in range(first, last):
        world = world_at(worlds, index)
        step_world(world, rules, actions[index], outcome.rewards[index])
        terminated = world.phase[0] == TERMINATED
        outcome.terminated[index] = terminated
        outcome.truncated[index] = world.phase[0] == TRUNCATED
        outcome.winner[index] = winner_of(world) if terminated else NO_WINNER


@compiled
def legal_actions(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write the legal actions of every seat: out bool [B, P, A]."""
    for index in range(first, last):
        world = world_at(worlds, index)
        for player in range(NUM_PLAYERS):
            list_legal_actions(world, rules, player, out[index, player])
