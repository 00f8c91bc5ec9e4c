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
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts.orders.cursor_orders import obey_cursors
from marl_cair.games.deep_rts.orders.grid import obey_grids
from marl_cair.games.deep_rts.rules import work
from marl_cair.games.deep_rts.rules.behaviour import decide
from marl_cair.games.deep_rts.rules.combat import burn, bury_fallen, settle_blows, strike
from marl_cair.games.deep_rts.rules.judging import judge, measure, potential, reward_end
from marl_cair.games.deep_rts.rules.motion import claim_step, clear_claims, settle_step
from marl_cair.games.deep_rts.rules.start import reset_world

# --- one tick ----------------------------------------------------------------------------------


@compiled
def list_acting(world: Any, rules: Any) -> None:
    """Write the units that are due to `world.acting`."""
    count = 0
    tick, wake = world.clock[s.TICK], s.NEVER
    for player in range(rules.num_players):
        for place in range(world.players[player, s.NUM_UNITS]):
            unit = world.roster[player, place]
            due = world.due[unit]
            if due <= tick:
                world.acting[count] = unit
                count += 1
            elif due < wake:
                wake = due
    world.clock[s.WAKE] = wake
    world.clock[s.NUM_ACTING] = count


@compiled
def intend(world: Any, rules: Any, unit: int) -> None:
    """Finish what the unit did, as far as it needs nothing that others may want too."""
    state = world.units[unit, s.UNIT_STATE]
    if state == s.WALKING:
        claim_step(world, rules, unit)
    elif state == s.GATHERING:
        work.gather(world, rules, unit)
    elif state == s.FIGHTING:
        strike(world, rules, unit)
    elif state in (s.RISING, s.TRAINING):
        work.claim_for(world, rules, unit)
    elif state == s.REPAIRING:
        work.repair(world, rules, unit)
    elif state == s.PUMPING:
        work.pump(world, rules, unit)


@compiled
def settle(world: Any, rules: Any) -> None:
    """Give claims, tiles and blows their effect."""
    for place in range(world.clock[s.NUM_ACTING]):
        unit = int(world.acting[place])
        state = world.units[unit, s.UNIT_STATE]
        if world.units[unit, s.UNIT_HEALTH] <= 0:
            continue  # a site that was given up in this tick
        if state == s.WALKING:
            settle_step(world, rules, unit)
        elif state == s.RISING:
            work.finish_site(world, rules, unit)
        elif state == s.TRAINING:
            work.finish_product(world, rules, unit)
    clear_claims(world)
    work.settle_harvest(world, rules)
    settle_blows(world, rules)


@compiled
def play_tick(world: Any, rules: Any) -> None:
    """One tick after the orders."""
    world.clock[s.TICK] += 1
    if world.clock[s.TICK] >= world.clock[s.WAKE]:
        list_acting(world, rules)
        for place in range(world.clock[s.NUM_ACTING]):
            intend(world, rules, int(world.acting[place]))
        settle(world, rules)
    else:
        world.clock[s.NUM_ACTING] = 0
    if world.clock[s.NUM_BURNING] > 0:
        burn(world, rules)
    judge(world, rules)
    if world.clock[s.NUM_FALLEN] > 0:
        bury_fallen(world, rules)
    for place in range(world.clock[s.NUM_ACTING]):
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
    if world.clock[s.PHASE] != s.RUNNING:
        return
    for player in range(rules.num_players):
        rewards[player] -= np.float32(measure(world, rules, player))
        if rules.shaping > 0.0 and world.players[player, s.IS_ALIVE]:
            rewards[player] -= np.float32(rules.shaping * potential(world, rules, player))
    if actions.ndim == 1:  # known when compiling: rules of one kind hold nothing of the other
        obey_cursors(world, rules, actions)
    else:
        obey_grids(world, rules, actions)
    for _ in range(rules.ticks_per_step):
        play_tick(world, rules)
        reward_end(world, rules, rewards)
        if world.clock[s.PHASE] != s.RUNNING:
            break
    for player in range(rules.num_players):
        rewards[player] += np.float32(measure(world, rules, player))
        if (
            rules.shaping > 0.0
            and world.players[player, s.IS_ALIVE]
            and world.clock[s.PHASE] != s.TERMINATED
        ):
            after = rules.discount * potential(world, rules, player)
            rewards[player] += np.float32(rules.shaping * after)


# --- slices of worlds ------------------------------------------------------------------------


@compiled
def reset(worlds: Any, rules: Any, seeds: Any, mask: Any, first: int, last: int) -> None:
    """New games in the worlds of `mask` bool [B] from `seeds` uint64 [B]."""
    for index in range(first, last):
        if mask[index]:
            reset_world(s.world_at(worlds, index), rules, seeds[index])


@compiled
def step(worlds: Any, rules: Any, actions: Any, outcome: Any, first: int, last: int) -> None:
    """Advance and write what the engine reports; a finished world stays as it is."""
    for index in range(first, last):
        world = s.world_at(worlds, index)
        step_world(world, rules, actions[index], outcome.rewards[index])
        outcome.terminated[index] = world.clock[s.PHASE] == s.TERMINATED
        outcome.truncated[index] = world.clock[s.PHASE] == s.TRUNCATED
        outcome.winner[index] = world.clock[s.WINNER]
        for player in range(rules.num_players):
            outcome.eliminated[index, player] = world.players[player, s.IS_OUT] != 0
