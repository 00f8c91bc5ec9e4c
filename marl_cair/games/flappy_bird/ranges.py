"""The values that a state of Flappy Bird may hold."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np

from marl_cair.games.checks import state as checks
from marl_cair.games.checks.state import Range, StateLimits
from marl_cair.games.flappy_bird import state as s
from marl_cair.games.flappy_bird import tables as t
from marl_cair.games.flappy_bird.observation import VECTOR_HIGH, VECTOR_LOW
from marl_cair.games.flappy_bird.scenarios import Scenario
from marl_cair.games.game import NO_WINNER

_SLOWEST, _FASTEST = t.FLAP_VELOCITY * t.HUNDREDTHS, t.MAX_FALL * t.HUNDREDTHS
_LOWEST_Y, _HIGHEST_Y = int(VECTOR_LOW[0]) * t.HUNDREDTHS, int(VECTOR_HIGH[0]) * t.HUNDREDTHS
# The middle of a pipe whose right edge is at the birds' left one.
_BEHIND_X = (t.BIRD_X - t.PIPE_WIDTH // 2) * t.HUNDREDTHS


def state_limits(scenario: Scenario) -> StateLimits:
    """What the worlds of `scenario` may hold."""
    last_player, wind = scenario.num_players - 1, scenario.wind_hundredths
    first_gap, last_gap = t.gap_tops(scenario.pipe_gap)
    leftmost = t.RENEW_BELOW_X * t.HUNDREDTHS - scenario.speed_hundredths

    ranges = {
        "tick": Range(0, scenario.max_ticks),
        "phase": Range(s.RUNNING, s.TRUNCATED),
        "winner": Range(NO_WINNER, last_player),
        "random": Range(*checks.ANY_WORD),
        "pipe_x": Range(leftmost, t.FIRST_PIPES_X[-1] * t.HUNDREDTHS),
        "gap_top": Range(first_gap, last_gap),
        "former_x": Range(leftmost, 0),
        "former_gap": Range(0, last_gap),
        "wind": Range(-wind, wind),
        "gust_ticks": Range(0, t.GUST_TICKS_MAX - 1),
        "bird_y": Range(_LOWEST_Y, _HIGHEST_Y),
        "velocity": Range(_SLOWEST, _FASTEST),
        "motion": Range(0, s.STARTING),
        "pipes_passed": Range(0, scenario.max_ticks),
        "crash_tick": Range(s.NEVER, scenario.max_ticks),
        "illegal": Range(0, checks.MOST_COUNTED),
        "newest_frame": Range(0, s.NUM_FRAMES - 1),
        "film": _frame_range(scenario),
    }
    return StateLimits(ranges, partial(_list_conditions, max_ticks=scenario.max_ticks))


def _frame_range(scenario: Scenario) -> Range:
    wind, players = scenario.wind_hundredths, scenario.num_players
    slowest, fastest = _SLOWEST << s.MOTION_BITS, (_FASTEST << s.MOTION_BITS) + s.STARTING
    return Range(
        (0, -wind, *(_LOWEST_Y, slowest) * players),
        (scenario.max_ticks, wind, *(_HIGHEST_Y, fastest) * players),
        ("tick", "wind", *("height", "flight") * players),
    )


def _list_conditions(worlds: s.World, max_ticks: int) -> Iterator[checks.Condition]:
    tick = worlds.tick[:, 0]
    yield checks.has_time(tick, worlds.phase[:, 0] == s.RUNNING, max_ticks)
    yield (
        "no frame and no crash is later than now",
        (worlds.film[:, :, 0] <= worlds.tick).all(axis=1)
        & (worlds.crash_tick <= worlds.tick).all(axis=1),
    )
    is_starting = worlds.motion == s.STARTING
    is_at_rest = (worlds.velocity == 0) | ~is_starting
    yield "a bird that has not started is at rest", is_at_rest.all(axis=1)
    # Observations show the next two pipes.
    pipe_x = np.sort(worlds.pipe_x, axis=1)
    yield (
        "two pipes, one behind the other, are before the birds",
        (pipe_x[:, 1] > _BEHIND_X) & (np.diff(pipe_x, axis=1) > 0).all(axis=1),
    )
