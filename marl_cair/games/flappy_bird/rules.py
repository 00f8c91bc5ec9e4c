"""The rules of Flappy Bird, written for one world; the last functions run slices of worlds.

Order of a tick (the README lists the same words): meet, renew, blow, fly, scroll, judge. A flap is
given at the first tick of a step. As in PyGame Learning Environment, birds and pipes are
judged where the last tick has left them, so a bird that crashes still moves in that tick.

Flaps and places of pipes cannot be predicted by a processor, so both are computed without branches.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled
from marl_cair.games.flappy_bird import state as s
from marl_cair.games.flappy_bird import tables as t
from marl_cair.games.flappy_bird.frames import record_frame, write_frame
from marl_cair.games.game import NO_WINNER
from marl_cair.games.loops import loop_over_resets, loop_over_seats
from marl_cair.games.randomness import draw_below, mix

NO_PIPE = -1

_HALF_PIPE = t.PIPE_WIDTH // 2 * t.HUNDREDTHS
# Middles of pipes between which a bird can touch them.
TOUCH_FROM = t.BIRD_X * t.HUNDREDTHS - _HALF_PIPE
TOUCH_TO = (t.BIRD_X + t.TOUCH_DEPTH) * t.HUNDREDTHS + _HALF_PIPE
_PASSED = t.BIRD_X * t.HUNDREDTHS + _HALF_PIPE  # the pipe's left edge is at the bird's
_LOWEST_Y = t.GROUND_TOP_HUNDREDTHS - t.BIRD_HEIGHT * t.HUNDREDTHS


@compiled
def touching_pipe(world: Any) -> int:
    """The pipe between whose edges the birds are, NO_PIPE where there is none."""
    touching = NO_PIPE
    for pipe in range(t.NUM_PIPES - 1, -1, -1):
        is_there = (world.pipe_x[pipe] > TOUCH_FROM) & (world.pipe_x[pipe] < TOUCH_TO)
        touching = pipe if is_there else touching
    return touching


@compiled
def free_heights(world: Any, rules: Any, pipe: int) -> tuple[int, int]:
    """Heights y between which birds live: above the first < y <= the second."""
    gap_top = int(world.gap_top[max(pipe, 0)]) * t.HUNDREDTHS
    highest = gap_top if pipe != NO_PIPE else 0
    depth = (rules.pipe_gap - t.BIRD_HEIGHT) * t.HUNDREDTHS if pipe != NO_PIPE else _LOWEST_Y - 1
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
    return int(rules.first_gap_top + draw_below(world.random, s.COURSE, rules.num_gap_tops))


@compiled
def renew(world: Any, rules: Any) -> None:
    """A pipe that has left the screen comes back on the other side with another gap."""
    for pipe in range(t.NUM_PIPES):
        if world.pipe_x[pipe] < t.RENEW_BELOW_X * t.HUNDREDTHS:
            world.former_x[pipe], world.former_gap[pipe] = world.pipe_x[pipe], world.gap_top[pipe]
            world.pipe_x[pipe] = t.RENEWED_X_HUNDREDTHS
            world.gap_top[pipe] = draw_gap(world, rules)


@compiled
def blow(world: Any, rules: Any) -> None:
    """When a gust is over the next is drawn: its strength and how long it lasts."""
    if world.gust_ticks[0] == 0:
        span = t.GUST_TICKS_MAX - t.GUST_TICKS_MIN + 1
        world.wind[0] = draw_below(world.random, s.GUSTS, 2 * rules.wind + 1) - rules.wind
        world.gust_ticks[0] = t.GUST_TICKS_MIN + draw_below(world.random, s.GUSTS, span)
    world.gust_ticks[0] -= 1


@compiled
def fly(world: Any, player: int, flaps: bool) -> None:
    """One tick of a bird's flight.

    A flap sets the velocity to 0; gravity and the impulse follow. The tick after an impulse is
    without gravity, and a flap in it only brakes: PLE spreads an impulse over 1/30 s.
    """
    was_pushed = world.motion[player] == s.FLAPPED
    is_pushed = (not was_pushed) & (flaps | (world.motion[player] == s.STARTING))
    velocity = int(world.velocity[player]) * int(not flaps)
    velocity += t.GRAVITY * t.HUNDREDTHS * int(not was_pushed)
    velocity = min(velocity, t.MAX_FALL * t.HUNDREDTHS) - t.FLAP_IMPULSE * t.HUNDREDTHS * int(
        is_pushed
    )
    world.motion[player] = s.FLAPPED if is_pushed else s.GLIDING
    world.velocity[player] = velocity
    world.bird_y[player] += velocity + int(world.wind[0])


@compiled
def scroll(world: Any, rules: Any) -> None:
    """The pipes come nearer."""
    for pipe in range(t.NUM_PIPES):
        world.pipe_x[pipe] -= rules.speed


@compiled
def judge(world: Any, rules: Any, num_players: int, num_flying: int, rewards: Any) -> None:
    """A game for one ends with its crash, a race when at most one bird flies; time truncates.

    All birds that fly have passed the same pipes, so at the time limit they have drawn.
    """
    if num_flying == 0 or num_flying < min(2, num_players):
        world.phase[0] = s.TERMINATED
        for player in range(num_players):
            if world.crash_tick[player] == s.NEVER:
                world.winner[0] = player
                rewards[player] += np.float32(rules.win_pay)
    elif world.tick[0] >= rules.max_ticks:
        world.phase[0] = s.TRUNCATED


@compiled
def can_flap(world: Any, player: int) -> bool:
    """True where a flap changes something: not at the start, when the bird flaps by itself."""
    return bool(
        world.crash_tick[player] == s.NEVER
        and world.motion[player] != s.STARTING
        and world.phase[0] == s.RUNNING
    )


@compiled
def play_tick(
    world: Any, rules: Any, num_players: int, actions: Any, is_first: bool, rewards: Any
) -> None:
    """One tick; the actions count in the first of a step."""
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
        if world.crash_tick[player] == s.NEVER:
            num_flying += int(meet(world, rules, player, heights, passes, rewards))
            fly(world, player, is_first and actions[player] == t.FLAP)
    scroll(world, rules)
    judge(world, rules, num_players, num_flying, rewards)


@compiled
def step_world(
    world: Any, rules: Any, num_players: int, num_ticks: int, actions: Any, rewards: Any
) -> None:
    """One step: flaps, then its ticks; writes the rewards, summed in float32."""
    for player in range(num_players):
        rewards[player] = 0.0
    if world.phase[0] != s.RUNNING:
        return
    for player in range(num_players):
        is_illegal = (actions[player] == t.FLAP) & (not can_flap(world, player))
        world.illegal[player] += int(is_illegal)
    for tick in range(num_ticks):
        play_tick(world, rules, num_players, actions, tick == 0, rewards)
        if world.phase[0] != s.RUNNING:
            break
    record_frame(world, num_players)


@compiled
def list_legal_actions(world: Any, rules: Any, player: int, legal: Any) -> None:
    """Write the mask of one seat: legal bool [A]."""
    legal[t.NOOP] = True
    legal[t.FLAP] = can_flap(world, player)


@compiled
def reset_world(world: Any, rules: Any, seed: Any) -> None:
    """Begin a game in a zeroed world. Gaps and wind draw from two words: wind changes no gap."""
    world.phase[0] = s.RUNNING
    world.winner[0] = NO_WINNER
    world.random[s.COURSE] = mix(seed + np.uint64(1))
    world.random[s.GUSTS] = mix(world.random[s.COURSE] + np.uint64(1))
    for pipe in range(t.NUM_PIPES):
        world.pipe_x[pipe] = t.FIRST_PIPES_X[pipe] * t.HUNDREDTHS
        world.gap_top[pipe] = draw_gap(world, rules)
    for player in range(rules.num_players):
        world.bird_y[player] = t.START_Y * t.HUNDREDTHS
        world.motion[player] = s.STARTING
        world.crash_tick[player] = s.NEVER
    for place in range(s.NUM_FRAMES):
        write_frame(world, rules.num_players, place)


reset = loop_over_resets(reset_world, s.world_at, s.World)
legal_actions = loop_over_seats(list_legal_actions, s.world_at)  # out bool [B, P, A]


@compiled
def step(worlds: Any, rules: Any, actions: Any, outcome: Any, first: int, last: int) -> None:
    """Advance and write what the engine reports; a finished world stays as it is."""
    for index in range(first, last):
        world = s.world_at(worlds, index)
        # The compiler makes straight lines of the usual game, half as fast again as loops.
        if rules.num_players == 1 and rules.ticks_per_step == 1:
            step_world(world, rules, 1, 1, actions[index], outcome.rewards[index])
        else:
            players, ticks = rules.num_players, rules.ticks_per_step
            step_world(world, rules, players, ticks, actions[index], outcome.rewards[index])
        outcome.terminated[index] = world.phase[0] == s.TERMINATED
        outcome.truncated[index] = world.phase[0] == s.TRUNCATED
        outcome.winner[index] = world.winner[0]
        for player in range(rules.num_players):
            outcome.eliminated[index, player] = world.crash_tick[player] != s.NEVER
