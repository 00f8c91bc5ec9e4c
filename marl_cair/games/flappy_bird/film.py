"""The last four decisions as frames of a film: what a picture shows, a few numbers each.

Pictures are painted from frames, so that a stack of past pictures needs no past pixels: it depends
on the state alone, and is the same after a restore and in any place of a batch. Frames are copies
of the state's numbers; what is drawn is worked out when somebody looks.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled, compiled_compact
from marl_cair.games.flappy_bird.sprites import (
    CRASHED_LOOK,
    GROUND_PERIOD,
    LOOK_OF_SPEED,
    PUSHING_LOOK,
)
from marl_cair.games.flappy_bird.state import (
    FLAPPED,
    FRAME_BIRDS,
    FRAME_CRASH,
    FRAME_GAP,
    FRAME_MOTION,
    FRAME_PIPE,
    FRAME_TICK,
    FRAME_VELOCITY,
    FRAME_WIND,
    FRAME_Y,
    NEVER,
    NUM_BIRD_NUMBERS,
    NUM_FRAMES,
)
from marl_cair.games.flappy_bird.tables import (
    FLAP_VELOCITY,
    HUNDREDTHS,
    NUM_PIPES,
    PIPE_WIDTH,
)

HIDDEN = -1  # the look of a bird that is not drawn


@compiled
def write_frame(world: Any, rules: Any, index: int) -> None:
    """Write what can be seen now into a frame of the film."""
    frame = world.film[index]
    for pipe in range(NUM_PIPES):
        frame[FRAME_PIPE + pipe] = world.pipe_x[pipe]
        frame[FRAME_GAP + pipe] = world.gap_top[pipe]
    frame[FRAME_WIND] = world.wind[0]
    frame[FRAME_TICK] = world.tick[0]
    for player in range(rules.num_players):
        first = FRAME_BIRDS + NUM_BIRD_NUMBERS * player
        frame[first + FRAME_Y] = world.bird_y[player]
        frame[first + FRAME_VELOCITY] = world.velocity[player]
        frame[first + FRAME_MOTION] = world.motion[player]
        frame[first + FRAME_CRASH] = world.crash_tick[player]


@compiled
def shoot_frame(world: Any, rules: Any) -> None:
    """The newest frame takes the place of the oldest."""
    index = (int(world.newest_frame[0]) + 1) & (NUM_FRAMES - 1)
    world.newest_frame[0] = index
    write_frame(world, rules, index)


@compiled
def film_start(world: Any, rules: Any) -> None:
    """Before the first decision all frames show the start."""
    world.newest_frame[0] = 0
    for index in range(NUM_FRAMES):
        write_frame(world, rules, index)


# --- reading a frame -----------------------------------------------------------------------------


@compiled_compact
def frame_index(world: Any, age: int) -> int:
    """The place in the film of the frame of `age` decisions ago, 0..3."""
    return int((world.newest_frame[0] + NUM_FRAMES - age) % NUM_FRAMES)


@compiled_compact
def pipe_left(frame: Any, pipe: int) -> int:
    """A pipe's left edge, in whole pixels."""
    return int(frame[FRAME_PIPE + pipe] // HUNDREDTHS - PIPE_WIDTH // 2)


@compiled_compact
def scroll_of(frame: Any, rules: Any) -> int:
    """Pixels that the ground has moved, as far as it can be seen."""
    return int(int(frame[FRAME_TICK]) * rules.speed // HUNDREDTHS % GROUND_PERIOD)


@compiled_compact
def bird_top(frame: Any, player: int) -> int:
    """A bird's upper edge, in whole pixels."""
    return int(frame[FRAME_BIRDS + NUM_BIRD_NUMBERS * player + FRAME_Y] // HUNDREDTHS)


@compiled_compact
def look_of(frame: Any, player: int) -> int:
    """How a bird looks: it tells the velocity in steps, and whether the bird has just flapped."""
    first = FRAME_BIRDS + NUM_BIRD_NUMBERS * player
    crashed = frame[first + FRAME_CRASH]
    if crashed != NEVER:
        return CRASHED_LOOK if crashed == frame[FRAME_TICK] else HIDDEN
    if frame[first + FRAME_MOTION] == FLAPPED:
        return PUSHING_LOOK
    return int(LOOK_OF_SPEED[frame[first + FRAME_VELOCITY] // HUNDREDTHS - FLAP_VELOCITY])
