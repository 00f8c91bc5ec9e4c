"""The rules of Flappy Bird, written for one world; the last functions run slices of worlds.

Order of a tick (the README lists the same words): meet, renew, blow, fly, scroll, judge. A flap is
given at the first tick of a decision. As in PyGame Learning Environment, birds and pipes are
judged where the last tick has left them, so a bird that crashes moves once more.

Who flaps and where the pipes are cannot be foreseen, so both are reckoned without branches.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled
from marl_cair.games.flappy_bird.film import film_start, shoot_frame
from marl_cair.games.flappy_bird.state import (
    COURSE,
    FLAPPED,
    GLIDING,
    GUSTS,
    NEVER,
    RUNNING,
    STARTING,
    TERMINATED,
    TRUNCATED,
    world_at,
)
from marl_cair.games.flappy_bird.tables import (
    BIRD_HEIGHT,
    BIRD_X,
    FIRST_PIPES_X,
    FLAP,
    FLAP_IMPULSE,
    GRAVITY,
    GROUND_TOP_HUNDREDTHS,
    GUST_TICKS_MAX,
    GUST_TICKS_MIN,
    HUNDREDTHS,
    MAX_FALL,
    NOOP,
    NUM_PIPES,
    PIPE_WIDTH,
    RENEW_BELOW_X,
    RENEWED_X_HUNDREDTHS,
    START_Y,
    TOUCH_DEPTH,
)
from marl_cair.games.game import NO_WINNER
from marl_cair.games.randomness import draw_below, mix

NO_PIPE = -1

_HALF_PIPE = PIPE_WIDTH // 2 * HUNDREDTHS
# Middles of pipes between which a bird can touch them.
TOUCH_FROM = BIRD_X * HUNDREDTHS - _HALF_PIPE
TOUCH_TO = (BIRD_X + TOUCH_DEPTH) * HUNDREDTHS + _HALF_PIPE
_PASSED = BIRD_X * HUNDREDTHS + _HALF_PIPE  # the pipe's left edge is at the bird's
_LOWEST_Y = GROUND_TOP_HUNDREDTHS - BIRD_HEIGHT * HUNDREDTHS


# --- the phases of a tick --------------------------------------------------------------------


@compiled
def touching_pipe(world: Any) -> int:
    """The pipe between whose edges the birds are, NO_PIPE where there is none."""
    touching = NO_PIPE
    for pipe in range(NUM_PIPES - 1, -1, -1):
        is_there = (world.pipe_x[pipe] > TOUCH_FROM) & (world.pipe_x[pipe] < TOUCH_TO)
        touching = pipe if is_there else touching
    return touching


@compiled
def free_heights(world: Any, rules: Any, pipe: int) -> tuple[int, int]:
    """Heights y between which birds live: above the first < y <= the second."""
    gap_top = int(world.gap_top[max(pipe, 0)]) * HUNDREDTHS
    highest = gap_top if pipe != NO_PIPE else 0
    depth = (rules.pipe_gap - BIRD_HEIGHT) * HUNDREDTHS if pipe != NO_PIPE else _LOWEST_Y - 1
    return highest, min(_LOWEST_Y - 1, highest + depth)


@compiled
def meet(
    world: Any, rules: Any, player: int, heights: tuple[int, int], passes: bool, rewards: Any
) -> bool:
    """A bird is paid for a pipe that it passes and may crash, both even in one tick.

    heights: see `free_heights`. Returns whether it flies on.
    """
    if rules.tick_pay != 0.0:
        rewards[player] += np.float32(rules.tick_pay)
    if passes:
        world.pipes_passed[player] += 1
        rewards[player] += np.float32(rules.pipe_pay)
    if heights[0] < world.bird_y[player] <= heights[1]:
        return True
    world.crash_tick[player] = world.tick[0]
    rewards[player] += np.float32(rules.crash_pay)
    return False


@compiled
def draw_gap(world: Any, rules: Any) -> int:
    """The upper edge of a new gap, pixels."""
    return int(rules.first_gap_top + draw_below(world.random, COURSE, rules.num_gap_tops))


@compiled
def renew(world: Any, rules: Any) -> None:
    """A pipe that has left the screen comes back on the other side with another gap."""
    for pipe in range(NUM_PIPES):
        if world.pipe_x[pipe] < RENEW_BELOW_X * HUNDREDTHS:
            world.former_x[pipe], world.former_gap[pipe] = world.pipe_x[pipe], world.gap_top[pipe]
            world.pipe_x[pipe] = RENEWED_X_HUNDREDTHS
            world.gap_top[pipe] = draw_gap(world, rules)


@compiled
def blow(world: Any, rules: Any) -> None:
    """When a gust is over the next is drawn: its strength and how long it lasts."""
    if world.gust_ticks[0] == 0:
        span = GUST_TICKS_MAX - GUST_TICKS_MIN + 1
        world.wind[0] = draw_below(world.random, GUSTS, 2 * rules.wind + 1) - rules.wind
        world.gust_ticks[0] = GUST_TICKS_MIN + draw_below(world.random, GUSTS, span)
    world.gust_ticks[0] -= 1


@compiled
def fly(world: Any, player: int, flaps: bool) -> None:
    """One tick of a bird's flight.

    A flap sets the velocity to 0; gravity and the impulse follow. The tick after an impulse is
    without gravity, and a flap in it only brakes: PLE spreads an impulse over 1/30 s.
    """
    was_pushed = world.motion[player] == FLAPPED
    is_pushed = (not was_pushed) & (flaps | (world.motion[player] == STARTING))
    velocity = int(world.velocity[player]) * int(not flaps)
    velocity += GRAVITY * HUNDREDTHS * int(not was_pushed)
    velocity = min(velocity, MAX_FALL * HUNDREDTHS) - FLAP_IMPULSE * HUNDREDTHS * int(is_pushed)
    world.motion[player] = FLAPPED if is_pushed else GLIDING
    world.velocity[player] = velocity
    world.bird_y[player] += velocity + int(world.wind[0])


@compiled
def scroll(world: Any, rules: Any) -> None:
    """The pipes come nearer."""
    for pipe in range(NUM_PIPES):
        world.pipe_x[pipe] -= rules.speed


@compiled
def judge(world: Any, rules: Any, num_players: int, num_flying: int, rewards: Any) -> None:
    """A game for one ends with its crash, a race when at most one bird flies; time truncates.

    All birds that fly have passed the same pipes, so at the time limit they have drawn.
    """
    if num_flying == 0 or num_flying < min(2, num_players):
        world.phase[0] = TERMINATED
        for player in range(num_players):
            if world.crash_tick[player] == NEVER:
                world.winner[0] = player
                rewards[player] += np.float32(rules.win_pay)
    elif world.tick[0] >= rules.max_ticks:
        world.phase[0] = TRUNCATED


# --- one world -------------------------------------------------------------------------------


@compiled
def can_flap(world: Any, player: int) -> bool:
    """True where a flap changes something: not at the start, when the bird flaps by itself."""
    return bool(
        world.crash_tick[player] == NEVER
        and world.motion[player] != STARTING
        and world.phase[0] == RUNNING
    )


@compiled
def play_tick(
    world: Any, rules: Any, num_players: int, actions: Any, is_first: bool, rewards: Any
) -> None:
    """One tick; the actions count in the first of a decision."""
    world.tick[0] += 1
    pipe = touching_pipe(world)
    heights = free_heights(world, rules, pipe)
    passes = pipe != NO_PIPE and _PASSED - rules.speed < world.pipe_x[pipe] <= _PASSED
    renew(world, rules)
    if rules.wind > 0:
        blow(world, rules)
    num_flying = 0
    # No bird minds another, so that each can meet and fly by itself.
    for player in range(num_players):
        if world.crash_tick[player] == NEVER:
            num_flying += int(meet(world, rules, player, heights, passes, rewards))
            fly(world, player, is_first and actions[player] == FLAP)
    scroll(world, rules)
    judge(world, rules, num_players, num_flying, rewards)


@compiled
def step_world(
    world: Any, rules: Any, num_players: int, num_ticks: int, actions: Any, rewards: Any
) -> None:
    """One decision: flaps, then its ticks; writes the rewards, summed in float32."""
    for player in range(num_players):
        rewards[player] = 0.0
    if world.phase[0] != RUNNING:
        return
    for player in range(num_players):
        is_illegal = (actions[player] == FLAP) & (not can_flap(world, player))
        world.illegal[player] += int(is_illegal)
    for tick in range(num_ticks):
        play_tick(world, rules, num_players, actions, tick == 0, rewards)
        if world.phase[0] != RUNNING:
            break
    shoot_frame(world, num_players)


@compiled
def reset_world(world: Any, rules: Any, seed: Any) -> None:
    """A new game. Gaps and wind have a random word each, so wind does not change the course."""
    world.tick[0] = 0
    world.phase[0] = RUNNING
    world.winner[0] = NO_WINNER
    world.random[COURSE] = mix(seed + np.uint64(1))
    world.random[GUSTS] = mix(world.random[COURSE] + np.uint64(1))
    for pipe in range(NUM_PIPES):
        world.pipe_x[pipe] = FIRST_PIPES_X[pipe] * HUNDREDTHS
        world.gap_top[pipe] = draw_gap(world, rules)
        world.former_x[pipe], world.former_gap[pipe] = 0, 0
    world.wind[0] = 0
    world.gust_ticks[0] = 0
    for player in range(rules.num_players):
        world.bird_y[player] = START_Y * HUNDREDTHS
        world.velocity[player] = 0
        world.motion[player] = STARTING
        world.pipes_passed[player] = 0
        world.crash_tick[player] = NEVER
        world.illegal[player] = 0
    film_start(world, rules.num_players)


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
        # The compiler makes straight lines of the usual game, half as fast again as loops.
        if rules.num_players == 1 and rules.ticks_per_step == 1:
            step_world(world, rules, 1, 1, actions[index], outcome.rewards[index])
        else:
            players, ticks = rules.num_players, rules.ticks_per_step
            step_world(world, rules, players, ticks, actions[index], outcome.rewards[index])
        outcome.terminated[index] = world.phase[0] == TERMINATED
        outcome.truncated[index] = world.phase[0] == TRUNCATED
        outcome.winner[index] = world.winner[0]
        for player in range(rules.num_players):
            outcome.eliminated[index, player] = world.crash_tick[player] != NEVER


@compiled
def legal_actions(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write the legal actions of every seat: out bool [B, P, A]."""
    for index in range(first, last):
        world = world_at(worlds, index)
        for player in range(rules.num_players):
            out[index, player, NOOP] = True
            out[index, player, FLAP] = can_flap(world, player)
