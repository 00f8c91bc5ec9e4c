"""One step of the rules of Deep RTS for one world; `reset` and `step` run slices of worlds.

Phases of a tick, as in the README: units that are due finish their action (all state what they
want before anything changes); claims, tiles and blows are settled; lava burns; the game is judged;
the dead are removed; the units that were due decide what to do next. Orders are carried out before
the first tick of a step.
"""

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts.orders.cursor import obey_cursors
from marl_cair.games.deep_rts.orders.grid import obey_grids
from marl_cair.games.deep_rts.rules import combat, judging, motion, work
from marl_cair.games.deep_rts.rules.behaviour import decide
from marl_cair.games.deep_rts.rules.start import reset_world


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
def finish_action(world: Any, rules: Any, unit: int) -> None:
    """Finish what the unit did, except for what other units may want too."""
    state = world.units[unit, s.UNIT_STATE]
    if state == s.WALKING:
        motion.claim_step(world, rules, unit)
    elif state == s.GATHERING:
        work.gather(world, rules, unit)
    elif state == s.FIGHTING:
        combat.strike(world, rules, unit)
    elif state in (s.RISING, s.TRAINING):
        motion.claim_exit(world, rules, unit)
    elif state == s.REPAIRING:
        work.repair(world, rules, unit)
    elif state == s.PUMPING:
        work.pump(world, rules, unit)


@compiled
def settle(world: Any, rules: Any) -> None:
    """Apply claims, harvests and blows."""
    for place in range(world.clock[s.NUM_ACTING]):
        unit = int(world.acting[place])
        state = world.units[unit, s.UNIT_STATE]
        if world.units[unit, s.UNIT_HEALTH] <= 0:
            continue  # a site that was cancelled in this tick
        if state == s.WALKING:
            motion.settle_step(world, rules, unit)
        elif state == s.RISING:
            work.finish_site(world, rules, unit)
        elif state == s.TRAINING:
            work.finish_product(world, rules, unit)
    motion.clear_claims(world)
    work.settle_harvest(world, rules)
    combat.settle_blows(world, rules)


@compiled
def play_tick(world: Any, rules: Any) -> None:
    """One tick after the orders."""
    world.clock[s.TICK] += 1
    if world.clock[s.TICK] >= world.clock[s.WAKE]:
        list_acting(world, rules)
        for place in range(world.clock[s.NUM_ACTING]):
            finish_action(world, rules, int(world.acting[place]))
        settle(world, rules)
    else:
        world.clock[s.NUM_ACTING] = 0
    if world.clock[s.NUM_BURNING] > 0:
        combat.burn(world, rules)
    judging.judge(world, rules)
    if world.clock[s.NUM_FALLEN] > 0:
        combat.bury_fallen(world, rules)
    for place in range(world.clock[s.NUM_ACTING]):
        decide(world, rules, int(world.acting[place]))


@compiled
def step_world(world: Any, rules: Any, actions: Any, rewards: Any) -> None:
    """Carry out the orders of all players, play the ticks of a step, write the rewards.

    Shaping adds discount * potential(after) - potential(before), with potential 0 once the game
    has terminated, which keeps the optimal policy (Ng, Harada, Russell 1999). The reward "gains"
    has discount 1, and keeps the potential of who is alive in the end: it pays the change of the
    share in all worth, and a win in full beside it. All is summed in float32: plain Python and
    compiled code would else round differently.
    """
    for player in range(rules.num_players):
        rewards[player] = 0.0
    if world.clock[s.PHASE] != s.RUNNING:
        return
    for player in range(rules.num_players):
        rewards[player] -= np.float32(judging.measure(world, rules, player))
        if rules.shaping > 0.0 and world.players[player, s.IS_ALIVE]:
            rewards[player] -= np.float32(rules.shaping * judging.potential(world, rules, player))
    if actions.ndim == 1:  # known when compiling: only one of the two is compiled
        obey_cursors(world, rules, actions)
    else:
        obey_grids(world, rules, actions)
    for _ in range(rules.ticks_per_step):
        play_tick(world, rules)
        judging.reward_end(world, rules, rewards)
        if world.clock[s.PHASE] != s.RUNNING:
            break
    for player in range(rules.num_players):
        rewards[player] += np.float32(judging.measure(world, rules, player))
        counts = rules.keeps_potential or world.clock[s.PHASE] != s.TERMINATED
        if rules.shaping > 0.0 and counts and world.players[player, s.IS_ALIVE]:
            after = rules.discount * judging.potential(world, rules, player)
            rewards[player] += np.float32(rules.shaping * after)


@compiled
def reset(worlds: Any, rules: Any, seeds: Any, mask: Any, first: int, last: int) -> None:
    """Start new games in the worlds of `mask` bool [B] from `seeds` uint64 [B]."""
    for index in range(first, last):
        if mask[index]:
            reset_world(s.world_at(worlds, index), rules, seeds[index])


@compiled
def step(worlds: Any, rules: Any, actions: Any, outcome: Any, first: int, last: int) -> None:
    """Play one step and write the outcome; a finished world stays as it is."""
    for index in range(first, last):
        world = s.world_at(worlds, index)
        step_world(world, rules, actions[index], outcome.rewards[index])
        outcome.terminated[index] = world.clock[s.PHASE] == s.TERMINATED
        outcome.truncated[index] = world.clock[s.PHASE] == s.TRUNCATED
        outcome.winner[index] = world.clock[s.WINNER]
        for player in range(rules.num_players):
            outcome.eliminated[index, player] = world.players[player, s.IS_OUT] != 0
