"""Records the last four steps as frames in the state, from which past pictures are painted again.

A stack of pictures then depends on the state alone: it is the same after a restore and at any place
of a batch. A frame is small because it is written at each step: pipes move evenly, so their past
places follow from the present ones.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled, compiled_compact
from marl_cair.games.flappy_bird import art
from marl_cair.games.flappy_bird import state as s
from marl_cair.games.flappy_bird import tables as t

HIDDEN = -1  # pose of a bird that is not drawn


@compiled
def write_frame(world: Any, num_players: int, place: int) -> None:
    """Write what can be seen now as the frame at a place of the ring."""
    frame = world.film[place]
    frame[s.FRAME_TICK] = world.tick[0]
    frame[s.FRAME_WIND] = world.wind[0]
    for player in range(num_players):
        first = s.FRAME_BIRDS + s.NUM_BIRD_NUMBERS * player
        frame[first + s.FRAME_Y] = world.bird_y[player]
        flight = (int(world.velocity[player]) << s.MOTION_BITS) + int(world.motion[player])
        frame[first + s.FRAME_FLIGHT] = flight


@compiled
def record_frame(world: Any, num_players: int) -> None:
    """Write the newest frame in the place of the oldest."""
    place = (int(world.newest_frame[0]) + 1) & (s.NUM_FRAMES - 1)
    world.newest_frame[0] = place
    write_frame(world, num_players, place)


@compiled_compact
def frame_place(world: Any, age: int) -> int:
    """The place in the ring of the frame of `age` steps ago, 0..3."""
    return int((world.newest_frame[0] + s.NUM_FRAMES - age) & (s.NUM_FRAMES - 1))


@compiled_compact
def pipe_in_frame(world: Any, rules: Any, place: int, pipe: int) -> tuple[int, int]:
    """The left edge of a pipe and the upper edge of its gap, in whole pixels.

    A frame older than the pipe's present gap shows the former one. A pipe is at RENEWED_X when it
    comes back, and moves in that tick. At the start none has come back.
    """
    ticks_ago = int(world.tick[0]) - int(world.film[place, s.FRAME_TICK])
    x, top = int(world.pipe_x[pipe] + rules.speed * ticks_ago), int(world.gap_top[pipe])
    if x >= t.RENEWED_X_HUNDREDTHS and world.former_x[pipe] < 0:
        x += int(world.former_x[pipe]) - t.RENEWED_X_HUNDREDTHS
        top = int(world.former_gap[pipe])
    return int(x // t.HUNDREDTHS - t.PIPE_WIDTH // 2), top


@compiled_compact
def scroll_in_frame(world: Any, rules: Any, place: int) -> int:
    """Pixels that the ground has moved, within its period."""
    travelled = int(world.film[place, s.FRAME_TICK]) * rules.speed // t.HUNDREDTHS
    return int(travelled % art.GROUND_PERIOD)


@compiled_compact
def bird_in_frame(world: Any, place: int, player: int) -> tuple[int, int]:
    """The pose of a bird (its velocity in steps, and whether it has just flapped) or HIDDEN, and
    the upper edge of its canvas in pixels.
    """
    first = s.FRAME_BIRDS + s.NUM_BIRD_NUMBERS * player
    up = int(world.film[place, first + s.FRAME_Y]) // t.HUNDREDTHS - art.CANVAS_UP
    crashed, tick = int(world.crash_tick[player]), int(world.film[place, s.FRAME_TICK])
    if crashed != s.NEVER and crashed <= tick:
        return (art.CRASHED_POSE if crashed == tick else HIDDEN), up
    flight = int(world.film[place, first + s.FRAME_FLIGHT])
    if flight & ((1 << s.MOTION_BITS) - 1) == s.FLAPPED:
        return art.PUSHING_POSE, up
    speed = (flight >> s.MOTION_BITS) // t.HUNDREDTHS
    return int(art.POSE_OF_SPEED[speed - t.FLAP_VELOCITY]), up
