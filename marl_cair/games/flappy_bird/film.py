"""The last four decisions as frames of a film, from which past pictures can be painted again.

So a stack of pictures needs no past pixels: it depends on the state alone, and is the same after a
restore and in any place of a batch. A frame holds little, since it is written at each decision:
pipes move evenly, so where they were follows from where they are.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled, compiled_compact
from marl_cair.games.flappy_bird.art import (
    CRASHED_LOOK,
    GROUND_PERIOD,
    LOOK_OF_SPEED,
    PUSHING_LOOK,
)
from marl_cair.games.flappy_bird.state import (
    FLAPPED,
    FRAME_BIRDS,
    FRAME_FLIGHT,
    FRAME_TICK,
    FRAME_WIND,
    FRAME_Y,
    MOTION_BITS,
    NEVER,
    NUM_BIRD_NUMBERS,
    NUM_FRAMES,
)
from marl_cair.games.flappy_bird.tables import (
    FLAP_VELOCITY,
    HUNDREDTHS,
    PIPE_WIDTH,
    RENEWED_X_HUNDREDTHS,
)

HIDDEN = -1  # the look of a bird that is not drawn


@compiled
def write_frame(world: Any, num_players: int, place: int) -> None:
    """Write what can be seen now into a place of the film."""
    frame = world.film[place]
    frame[FRAME_TICK] = world.tick[0]
    frame[FRAME_WIND] = world.wind[0]
    for player in range(num_players):
        first = FRAME_BIRDS + NUM_BIRD_NUMBERS * player
        frame[first + FRAME_Y] = world.bird_y[player]
        flight = (int(world.velocity[player]) << MOTION_BITS) + int(world.motion[player])
        frame[first + FRAME_FLIGHT] = flight


@compiled
def shoot_frame(world: Any, num_players: int) -> None:
    """The newest frame takes the place of the oldest."""
    place = (int(world.newest_frame[0]) + 1) & (NUM_FRAMES - 1)
    world.newest_frame[0] = place
    write_frame(world, num_players, place)


@compiled
def film_start(world: Any, num_players: int) -> None:
    """Before the first decision all frames show the start."""
    world.newest_frame[0] = 0
    for place in range(NUM_FRAMES):
        write_frame(world, num_players, place)


# --- looking at a frame --------------------------------------------------------------------------


@compiled_compact
def frame_place(world: Any, age: int) -> int:
    """The place in the film of the frame of `age` decisions ago, 0..3."""
    return int((world.newest_frame[0] + NUM_FRAMES - age) & (NUM_FRAMES - 1))


@compiled_compact
def past_x(world: Any, rules: Any, place: int, pipe: int) -> int:
    """Where the pipe would have been if it had never come back: right of all, if it has."""
    ticks_ago = int(world.tick[0]) - int(world.film[place, FRAME_TICK])
    return int(world.pipe_x[pipe] + rules.speed * ticks_ago)


@compiled_compact
def has_come_back(world: Any, rules: Any, place: int, pipe: int) -> bool:
    """Whether the frame is older than the pipe's present gap.

    A pipe is at RENEWED_X when it comes back, and moves in that tick. At the start none has.
    """
    was_before = past_x(world, rules, place, pipe) >= RENEWED_X_HUNDREDTHS
    return bool(was_before and world.former_x[pipe] < 0)


@compiled_compact
def pipe_left(world: Any, rules: Any, place: int, pipe: int) -> int:
    """A pipe's left edge in a frame, in whole pixels."""
    x = past_x(world, rules, place, pipe)
    if has_come_back(world, rules, place, pipe):
        x += int(world.former_x[pipe]) - RENEWED_X_HUNDREDTHS
    return int(x // HUNDREDTHS - PIPE_WIDTH // 2)


@compiled_compact
def gap_of(world: Any, rules: Any, place: int, pipe: int) -> int:
    """The upper edge of a pipe's gap in a frame, in pixels."""
    if has_come_back(world, rules, place, pipe):
        return int(world.former_gap[pipe])
    return int(world.gap_top[pipe])


@compiled_compact
def scroll_of(world: Any, rules: Any, place: int) -> int:
    """Pixels that the ground has moved in a frame, as far as it can be seen."""
    travelled = int(world.film[place, FRAME_TICK]) * rules.speed // HUNDREDTHS
    return int(travelled % GROUND_PERIOD)


@compiled_compact
def wind_of(world: Any, place: int) -> int:
    """Hundredths of a pixel per tick, downwards."""
    return int(world.film[place, FRAME_WIND])


@compiled_compact
def bird_top(world: Any, place: int, player: int) -> int:
    """A bird's upper edge in a frame, in whole pixels."""
    y = int(world.film[place, FRAME_BIRDS + NUM_BIRD_NUMBERS * player + FRAME_Y])
    return y // HUNDREDTHS


@compiled_compact
def look_of(world: Any, place: int, player: int) -> int:
    """How a bird looks: it tells the velocity in steps, and whether the bird has just flapped."""
    crashed, tick = int(world.crash_tick[player]), int(world.film[place, FRAME_TICK])
    if crashed != NEVER and crashed <= tick:
        return CRASHED_LOOK if crashed == tick else HIDDEN
    flight = int(world.film[place, FRAME_BIRDS + NUM_BIRD_NUMBERS * player + FRAME_FLIGHT])
    if flight & ((1 << MOTION_BITS) - 1) == FLAPPED:
        return PUSHING_LOOK
    return int(LOOK_OF_SPEED[(flight >> MOTION_BITS) // HUNDREDTHS - FLAP_VELOCITY])
