"""The values that a state of Flappy Bird may hold."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from marl_cair.games.checks.state import (
    ANY_WORD,
    MOST_COUNTED,
    Condition,
    Range,
    StateLimits,
    has_time,
)
from marl_cair.games.flappy_bird.observation import VECTOR_HIGH, VECTOR_LOW
from marl_cair.games.flappy_bird.scenarios import Scenario
from marl_cair.games.flappy_bird.state import (
    MOTION_BITS,
    NEVER,
    NUM_FRAMES,
    RUNNING,
    STARTING,
    TRUNCATED,
    World,
)
from marl_cair.games.flappy_bird.tables import (
    BIRD_X,
    FIRST_PIPES_X,
    FLAP_VELOCITY,
    GUST_TICKS_MAX,
    HUNDREDTHS,
    MAX_FALL,
    PIPE_WIDTH,
    RENEW_BELOW_X,
    gap_tops,
)
from marl_cair.games.game import NO_WINNER

_SLOWEST, _FASTEST = FLAP_VELOCITY * HUNDREDTHS, MAX_FALL * HUNDREDTHS
_LOWEST_Y, _HIGHEST_Y = int(VECTOR_LOW[0]) * HUNDREDTHS, int(VECTOR_HIGH[0]) * HUNDREDTHS
# The middle of a pipe whose right edge is at the birds' left one.
_BEHIND_X = (BIRD_X - PIPE_WIDTH // 2) * HUNDREDTHS


def state_limits(scenario: Scenario) -> StateLimits:
    """What the worlds of `scenario` may hold."""
    last_player, wind = scenario.num_players - 1, scenario.wind_hundredths
    first_gap, last_gap = gap_tops(scenario.pipe_gap)
    leftmost = RENEW_BELOW_X * HUNDREDTHS - scenario.speed_hundredths

    ranges = {
        "tick": Range(0, scenario.max_ticks),
        "phase": Range(RUNNING, TRUNCATED),
        "winner": Range(NO_WINNER, last_player),
        "random": Range(*ANY_WORD),
        "pipe_x": Range(leftmost, FIRST_PIPES_X[-1] * HUNDREDTHS),
        "gap_top": Range(first_gap, last_gap),
        "former_x": Range(leftmost, 0),
        "former_gap": Range(0, last_gap),
        "wind": Range(-wind, wind),
        "gust_ticks": Range(0, GUST_TICKS_MAX - 1),
        "bird_y": Range(_LOWEST_Y, _HIGHEST_Y),
        "velocity": Range(_SLOWEST, _FASTEST),
        "motion": Range(0, STARTING),
        "pipes_passed": Range(0, scenario.max_ticks),
        "crash_tick": Range(NEVER, scenario.max_ticks),
        "illegal": Range(0, MOST_COUNTED),
        "newest_frame": Range(0, NUM_FRAMES - 1),
        "film": _film_range(scenario),
    }
    return StateLimits(ranges, partial(_list_conditions, max_ticks=scenario.max_ticks))


def _film_range(scenario: Scenario) -> Range:
    wind, players = scenario.wind_hundredths, scenario.num_players
    slowest, fastest = _SLOWEST << MOTION_BITS, (_FASTEST << MOTION_BITS) + STARTING
    return Range(
        (0, -wind, *(_LOWEST_Y, slowest) * players),
        (scenario.max_ticks, wind, *(_HIGHEST_Y, fastest) * players),
        ("tick", "wind", *("height", "flight") * players),
    )


def _list_conditions(worlds: World, max_ticks: int) -> Iterator[Condition]:
    tick = worlds.tick[:, 0]
    yield has_time(tick, worlds.phase[:, 0] == RUNNING, max_ticks)
    yield (
        "no frame of the film and no crash is later than now",
        (worlds.film[:, :, 0] <= worlds.tick).all(axis=1)
        & (worlds.crash_tick <= worlds.tick).all(axis=1),
    )
    is_starting = worlds.motion == STARTING
    is_at_rest = (worlds.velocity == 0) | ~is_starting
    yield "a bird that has not started is at rest", is_at_rest.all(axis=1)
    # Observations show the next two pipes.
    pipe_x = np.sort(worlds.pipe_x, axis=1)
    yield (
        "two pipes, one behind the other, are before the birds",
        (pipe_x[:, 1] > _BEHIND_X) & (np.diff(pipe_x, axis=1) > 0).all(axis=1),
    )
