"""Whether a scenario can be played at all: is there a sequence of flaps through its hardest course?

All states that a bird can be in are followed tick by tick: for each velocity (and whether it
flapped in the tick before) the heights are the bits of one whole number, so that a move of all of
them is a shift. It needs neither NumPy nor the compiler, so that scenarios can be named at once.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from marl_cair.games.flappy_bird import tables as t

# Heights at which a bird is alive: 1..GROUND_TOP - BIRD_HEIGHT.
_ALIVE = (1 << (t.GROUND_TOP - t.BIRD_HEIGHT + 1)) - 2

# Found with the search below once and for all, so that most scenarios are named without it:
# (speed and wind at most, gap at least), where a bird may flap in every tick.
SURELY_PLAYABLE = ((400, 300, 96), (500, 300, 108), (500, 0, 80))

Birds = dict[tuple[int, bool], int]  # heights by velocity and whether the last tick was a flap


def is_playable(pipe_gap: int, speed: int, wind: int, ticks_per_step: int = 1) -> bool:
    """True if some sequence of flaps passes gaps that are by turns as high and as low as can be.

    pipe_gap: pixels. speed, wind: hundredths of a pixel per tick; a wind is tried that blows
    without an end upwards, and one downwards. ticks_per_step: a bird may flap in the first of so
    many ticks.
    """
    if ticks_per_step == 1 and any(
        speed <= most_speed and wind <= most_wind and pipe_gap >= least_gap
        for most_speed, most_wind, least_gap in SURELY_PLAYABLE
    ):
        return True
    return search_course(pipe_gap, speed, wind, ticks_per_step)


@cache
def search_course(pipe_gap: int, speed: int, wind: int, ticks_per_step: int = 1) -> bool:
    """As `is_playable`, found by the search."""
    pixels = -(-wind // t.HUNDREDTHS)
    return all(
        _passes_course(pipe_gap, speed, blow, first, ticks_per_step)
        for first in (0, 1)
        for blow in {-pixels, pixels}
    )


def _passes_course(pipe_gap: int, speed: int, blow: int, first: int, ticks_per_step: int) -> bool:
    """Whether birds pass pipes without an end; gap `first` of the two extremes begins."""
    edges = t.gap_tops(pipe_gap)
    pipes = [
        (x * t.HUNDREDTHS, edges[(first + index) % 2]) for index, x in enumerate(t.FIRST_PIPES_X)
    ]
    birds: Birds = {(t.FLAP_VELOCITY, True): 1 << (t.START_Y + t.FLAP_VELOCITY)}
    num_met, tick = len(pipes), 0  # in which the bird flaps by itself
    been: set[Any] = set()
    while birds:
        for index, (x, _) in enumerate(pipes):
            if x < t.RENEW_BELOW_X * t.HUNDREDTHS:
                pipes[index] = (t.RENEWED_X_HUNDREDTHS, edges[(first + num_met) % 2])
                num_met += 1
                state = tuple(pipes), tick % ticks_per_step, num_met % 2, frozenset(birds.items())
                if state in been:  # and so again and again
                    return True
                been.add(state)
        pipes = [(x - speed, top) for x, top in pipes]
        tick += 1
        birds = _move(birds, blow, may_flap=tick % ticks_per_step == 0)
        birds = _keep(birds, _free_heights(pipes, pipe_gap))
    return False


def _free_heights(pipes: list[tuple[int, int]], pipe_gap: int) -> int:
    free = _ALIVE
    for x, top in pipes:
        left, right = x - t.PIPE_WIDTH // 2 * t.HUNDREDTHS, x + t.PIPE_WIDTH // 2 * t.HUNDREDTHS
        if left < (t.BIRD_X + t.TOUCH_DEPTH) * t.HUNDREDTHS and right > t.BIRD_X * t.HUNDREDTHS:
            free &= (1 << (top + pipe_gap - t.BIRD_HEIGHT + 1)) - (1 << (top + 1))
    return free


def _keep(birds: Birds, free: int) -> Birds:
    return {motion: heights & free for motion, heights in birds.items() if heights & free}


def _move(birds: Birds, blow: int, may_flap: bool) -> Birds:
    """Every bird glides, and where it may it flaps too."""
    moved: Birds = {}
    for (velocity, has_flapped), heights in birds.items():
        if has_flapped:  # no gravity in this tick, and a flap only brakes
            motions = ((velocity, False), (0, False))
        else:
            motions = ((min(t.MAX_FALL, velocity + t.GRAVITY), False), (t.FLAP_VELOCITY, True))
        for motion in motions if may_flap else motions[:1]:
            shift = motion[0] + blow
            there = heights << shift if shift >= 0 else heights >> -shift
            moved[motion] = moved.get(motion, 0) | there
    return moved
