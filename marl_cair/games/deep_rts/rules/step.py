"""The rules of Deep RTS, written for one world; the last functions run slices of worlds.

Order of a tick (the README lists the same words): those who are due finish what they did (all name
what they want before anything changes); claims, tiles and blows are settled; lava burns; the game
is judged; the fallen are buried; those who were due decide what to do next. Orders are given at the
first tick of a decision.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts.orders.obedience import obey_all
from marl_cair.games.deep_rts.rules.behaviour import decide
from marl_cair.games.deep_rts.rules.combat import burn, bury_fallen, settle_blows, strike
from marl_cair.games.deep_rts.rules.judging import judge, measure, potential, reward_end
from marl_cair.games.deep_rts.rules.motion import claim_step, clear_claims, settle_step
from marl_cair.games.deep_rts.rules.start import reset_world
from marl_cair.games.deep_rts.rules.work import (
    claim_for,
    finish_product,
    finish_site,
    gather,
    mend,
    pump,
    settle_harvest,
)
from marl_cair.games.deep_rts.state import (
    FIGHTING,
    GATHERING,
    IS_ALIVE,
    IS_OUT,
    NEVER,
    NUM_ACTING,
    NUM_BURNING,
    NUM_FALLEN,
    NUM_UNITS,
    PHASE,
    PUMPING,
    REPAIRING,
    RISING,
    RUNNING,
    TERMINATED,
    TICK,
    TRAINING,
    TRUNCATED,
    UNIT_HEALTH,
    UNIT_STATE,
    WAKE,
    WALKING,
    WINNER,
    world_at,
)

# --- one tick ----------------------------------------------------------------------------------


@compiled
def list_acting(world: Any, rules: Any) -> None:
    """Write the units that are due to `world.acting`."""
    count = 0
    tick, wake = world.clock[TICK], NEVER
    for player in range(rules.num_players):
        for place in range(world.players[player, NUM_UNITS]):
            unit = world.roster[player, place]
            due = world.due[unit]
            if due <= tick:
                world.acting[count] = unit
                count += 1
            elif due < wake:
                wake = due
    world.clock[WAKE] = wake
    world.clock[NUM_ACTING] = count


@compiled
def intend(world: Any, rules: Any, unit: int) -> None:
    """Finish what the unit did, as far as it needs nothing that others may want too."""
    state = world.units[unit, UNIT_STATE]
    if state == WALKING:
        claim_step(world, rules, unit)
    elif state == GATHERING:
        gather(world, rules, unit)
    elif state == FIGHTING:
        strike(world, rules, unit)
    elif state in (RISING, TRAINING):
        claim_for(world, rules, unit)
    elif state == REPAIRING:
        mend(world, rules, unit)
    elif state == PUMPING:
        pump(world, rules, unit)


@compiled
def settle(world: Any, rules: Any) -> None:
    """Give claims, tiles and blows their effect."""
    for place in range(world.clock[NUM_ACTING]):
        unit = int(world.acting[place])
        state = world.units[unit, UNIT_STATE]
        if world.units[unit, UNIT_HEALTH] <= 0:
            continue  # a site that was given up in this tick
        if state == WALKING:
            settle_step(world, rules, unit)
        elif state == RISING:
            finish_site(world, rules, unit)
        elif state == TRAINING:
            finish_product(world, rules, unit)
    clear_claims(world)
    settle_harvest(world, rules)
    settle_blows(world, rules)


@compiled
def play_tick(world: Any, rules: Any) -> None:
    """One tick after the orders."""
    world.clock[TICK] += 1
    if world.clock[TICK] >= world.clock[WAKE]:
        list_acting(world, rules)
        for place in range(world.clock[NUM_ACTING]):
            intend(world, rules, int(world.acting[place]))
        settle(world, rules)
    else:
        world.clock[NUM_ACTING] = 0
    if world.clock[NUM_BURNING] > 0:
        burn(world, rules)
    judge(world, rules)
    if world.clock[NUM_FALLEN] > 0:
        bury_fallen(world, rules)
    for place in range(world.clock[NUM_ACTING]):
        decide(world, rules, int(world.acting[place]))


# --- one world -------------------------------------------------------------------------------


@compiled
def step_world(world: Any, rules: Any, actions: Any, rewards: Any) -> None:
    """One decision: the orders of all players, then its ticks; writes the rewards.

    Shaping adds discount * potential(after) - potential(before), with potential 0 once the game
    has terminated, which leaves the optimal policy as it is (Ng, Harada, Russell 1999). All is
    summed in float32, as plain Python and compiled code would else round differently.
    """
    for player in range(rules.num_players):
        rewards[player] = 0.0
    if world.clock[PHASE] != RUNNING:
        return
    for player in range(rules.num_players):
        rewards[player] -= np.float32(measure(world, rules, player))
        if rules.shaping > 0.0 and world.players[player, IS_ALIVE]:
            rewards[player] -= np.float32(rules.shaping * potential(world, rules, player))
    obey_all(world, rules, actions)
    for _ in range(rules.ticks_per_step):
        play_tick(world, rules)
        reward_end(world, rules, rewards)
        if world.clock[PHASE] != RUNNING:
            break
    for player in range(rules.num_players):
        rewards[player] += np.float32(measure(world, rules, player))
        if (
            rules.shaping > 0.0
            and world.players[player, IS_ALIVE]
            and world.clock[PHASE] != TERMINATED
        ):
            after = rules.discount * potential(world, rules, player)
            rewards[player] += np.float32(rules.shaping * after)


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
        outcome.terminated[index] = world.clock[PHASE] == TERMINATED
        outcome.truncated[index] = world.clock[PHASE] == TRUNCATED
        outcome.winner[index] = world.clock[WINNER]
        for player in range(rules.num_players):
            outcome.eliminated[index, player] = world.players[player, IS_OUT] != 0
