"""What each bird sees as numbers: PLE's eight, all that counts scaled for a network, and planes.

Hidden from agents: the random words, what lies beyond the screen, and when the wind turns.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled
from marl_cair.games.flappy_bird import tables as t
from marl_cair.games.flappy_bird.state import GLIDING, NEVER, world_at
from marl_cair.games.loops import loop_over_seats

VECTOR_NAMES = (
    *("bird y", "bird velocity", "distance to the end of the next pipe"),
    *("upper edge of the next gap", "lower edge of the next gap"),
    *("distance to the end of the pipe after it", "upper edge of its gap", "lower edge of its gap"),
)
# Pixels. What lies nearer than the number says is known better where it is stored in bytes.
VECTOR_LOW = (-64.0, -12.0, *(0.0, 0.0, 0.0) * 2)
VECTOR_HIGH = (512.0, 12.0, 400.0, 512.0, 512.0, 600.0, 512.0, 512.0)

FEATURE_NAMES = (
    *("bird y", "bird velocity", "flapped in the last tick", "wind"),
    *VECTOR_NAMES[2:],
    *("other birds flying", "time left"),
)
BIRD_Y, VELOCITY, HAS_FLAPPED, WIND = range(4)
NEXT_END, NEXT_TOP, NEXT_BOTTOM, LATER_END, LATER_TOP, LATER_BOTTOM = range(4, 10)
OTHERS_FLYING, TIME_LEFT = 10, 11
FEATURE_LOW = (-0.125, -1.2, 0.0, -1.0, *(0.0, 0.0, 0.0) * 2, 0.0, 0.0)
FEATURE_HIGH = (1.0, 1.2, 1.0, 1.0, 1.4, 1.0, 1.0, 2.1, 1.0, 1.0, 1.0, 1.0)

CELL = 16  # pixels along a cell of the planes
ROWS, COLUMNS = t.SCREEN_HEIGHT // CELL, t.SCREEN_WIDTH // CELL
FULL = 255
PLANE_NAMES = (
    *("own bird", "other birds", "pipes"),
    *("own velocity", "flapped in the last tick", "wind", "other birds flying", "time left"),
)
OWN_BIRD, OTHER_BIRDS, PIPES = range(3)
FIRST_UNIFORM = 3
NUM_UNIFORM = len(PLANE_NAMES) - FIRST_UNIFORM
SPEED_LEVEL = FULL // (t.MAX_FALL - t.FLAP_VELOCITY)  # of a pixel per tick
OTHERS_LEVEL = FULL // (t.MAX_PLAYERS - 1)
CALM_LEVEL = 128  # of no wind
WIND_HUNDREDTHS = int(t.MAX_WIND * t.HUNDREDTHS)
NO_PIPE = -1


@compiled
def pipe_end(world: Any, pipe: int) -> int:
    """Hundredths of a pixel from the birds' left edge to the pipe's right edge."""
    return int(world.pipe_x[pipe]) + (t.PIPE_WIDTH // 2 - t.BIRD_X) * t.HUNDREDTHS


@compiled
def next_pipe(world: Any, after: int) -> int:
    """The nearest pipe that ends right of the birds and, unless NO_PIPE, later than `after`."""
    best = NO_PIPE
    beyond = 0 if after == NO_PIPE else pipe_end(world, after)
    for pipe in range(t.NUM_PIPES):
        end = pipe_end(world, pipe)
        if end > beyond and (best == NO_PIPE or end < pipe_end(world, best)):
            best = pipe
    return best


@compiled
def others_flying(world: Any, rules: Any, player: int) -> int:
    """Birds beside the player's that have not crashed."""
    count = 0
    for other in range(rules.num_players):
        count += int(other != player and world.crash_tick[other] == NEVER)
    return count


@compiled
def see_vector(world: Any, rules: Any, player: int, out: Any) -> None:
    """PLE's eight numbers, in pixels and pixels per tick."""
    out[0] = int(world.bird_y[player]) / t.HUNDREDTHS
    out[1] = int(world.velocity[player]) / t.HUNDREDTHS
    pipe = NO_PIPE
    for place in range(2):
        pipe = next_pipe(world, pipe)
        top = int(world.gap_top[pipe])
        out[2 + 3 * place] = pipe_end(world, pipe) / t.HUNDREDTHS
        out[3 + 3 * place] = top
        out[4 + 3 * place] = top + rules.pipe_gap


@compiled
def see_features(world: Any, rules: Any, player: int, out: Any) -> None:
    """All that counts, each number about -1..1: see FEATURE_NAMES."""
    out[BIRD_Y] = int(world.bird_y[player]) / (t.HUNDREDTHS * t.SCREEN_HEIGHT)
    out[VELOCITY] = int(world.velocity[player]) / (t.HUNDREDTHS * t.MAX_FALL)
    out[HAS_FLAPPED] = 0.0 if world.motion[player] == GLIDING else 1.0
    out[WIND] = int(world.wind[0]) / WIND_HUNDREDTHS
    pipe = NO_PIPE
    for place in range(2):
        pipe = next_pipe(world, pipe)
        top = int(world.gap_top[pipe])
        first = NEXT_END + 3 * place
        out[first] = pipe_end(world, pipe) / (t.HUNDREDTHS * t.SCREEN_WIDTH)
        out[first + 1] = top / t.SCREEN_HEIGHT
        out[first + 2] = (top + rules.pipe_gap) / t.SCREEN_HEIGHT
    out[OTHERS_FLYING] = others_flying(world, rules, player) / (t.MAX_PLAYERS - 1)
    out[TIME_LEFT] = max(0, rules.max_ticks - int(world.tick[0])) / rules.max_ticks


@compiled
def cover_box(plane: Any, left: int, top: int, width: int, height: int) -> None:
    """Mark the cells that a box of pixels covers, by the covered share of their area."""
    right, bottom = min(t.SCREEN_WIDTH, left + width), min(t.SCREEN_HEIGHT, top + height)
    left, top = max(0, left), max(0, top)
    if left >= right or top >= bottom:
        return
    for row in range(top // CELL, (bottom - 1) // CELL + 1):
        down = min(bottom, (row + 1) * CELL) - max(top, row * CELL)
        for column in range(left // CELL, (right - 1) // CELL + 1):
            across = min(right, (column + 1) * CELL) - max(left, column * CELL)
            level = int(plane[row, column]) + FULL * down * across // (CELL * CELL)
            plane[row, column] = min(FULL, level)


@compiled
def see_planes(world: Any, rules: Any, player: int, out: Any) -> None:
    """Write the planes of PLANE_NAMES."""
    cells = ROWS * COLUMNS
    flat = out.reshape(out.size)
    flat[: FIRST_UNIFORM * cells] = 0
    for other in range(rules.num_players):
        if world.crash_tick[other] == NEVER or other == player:
            plane = OWN_BIRD if other == player else OTHER_BIRDS
            y = int(world.bird_y[other]) // t.HUNDREDTHS
            cover_box(out[plane], t.BIRD_X, y, t.BIRD_WIDTH, t.BIRD_HEIGHT)
    for pipe in range(t.NUM_PIPES):
        left = int(world.pipe_x[pipe]) // t.HUNDREDTHS - t.PIPE_WIDTH // 2
        top = int(world.gap_top[pipe])
        bottom = top + rules.pipe_gap
        cover_box(out[PIPES], left, 0, t.PIPE_WIDTH, top)
        cover_box(out[PIPES], left, bottom, t.PIPE_WIDTH, t.GROUND_TOP - bottom)
    speed = int(world.velocity[player]) // t.HUNDREDTHS - t.FLAP_VELOCITY
    blowing = 127 * int(world.wind[0]) // WIND_HUNDREDTHS
    left_ticks = max(0, rules.max_ticks - int(world.tick[0]))
    levels = (
        speed * SPEED_LEVEL,
        0 if world.motion[player] == GLIDING else FULL,
        CALM_LEVEL + blowing,
        others_flying(world, rules, player) * OTHERS_LEVEL,
        FULL * left_ticks // rules.max_ticks,
    )
    for place in range(NUM_UNIFORM):
        first = (FIRST_UNIFORM + place) * cells
        flat[first : first + cells] = levels[place]


observe_planes = loop_over_seats(see_planes, world_at)  # out uint8 [B, P, C, H, W]
observe_vector = loop_over_seats(see_vector, world_at)  # out float32 [B, P, 8]
observe_features = loop_over_seats(see_features, world_at)  # out float32 [B, P, 12]
