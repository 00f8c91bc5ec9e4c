"""Pictures of Flappy Bird, painted from a frame of the film: for people, and as `image`.

Only reads the state. In a seat's own view its bird is yellow and in front of the others; the
spectator sees each seat in its own colour.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled_compact
from marl_cair.games.drawing import draw_number, fill_box, fill_disc
from marl_cair.games.flappy_bird.art import (
    BIRD_COLOURS,
    BODY,
    CANVAS,
    CANVAS_LEFT,
    CANVAS_UP,
    CAP,
    CAP_HEIGHT,
    CAP_LINE,
)
from marl_cair.games.flappy_bird.film import (
    HIDDEN,
    bird_top,
    frame_place,
    gap_of,
    look_of,
    pipe_left,
    scroll_of,
    wind_of,
)
from marl_cair.games.flappy_bird.state import (
    NEVER,
    World,
    world_at,
)
from marl_cair.games.flappy_bird.tables import (
    GROUND_TOP,
    HUNDREDTHS,
    NUM_PIPES,
    PIPE_WIDTH,
    SCREEN_HEIGHT,
    SCREEN_WIDTH,
)

SPECTATOR = -1

# The gauge of the wind, in the upper left corner: a bar up or down from its middle.
GAUGE_LEFT, GAUGE_TOP, GAUGE_WIDTH, GAUGE_HEIGHT = 8, 8, 16, 88
GAUGE_MIDDLE = GAUGE_TOP + GAUGE_HEIGHT // 2
GAUGE_EDGE = 4  # pixels beside the bar
GAUGE_PIXELS = 14  # a pixel per tick of wind
GAUGE_DARK, GAUGE_BRIGHT, INK = (
    np.array(colour, np.uint8) for colour in ((46, 54, 62), (250, 246, 230), (252, 252, 252))
)
DOTS_Y = 456  # on the ground, where no bird flies
DOT_COLOURS = np.array(BIRD_COLOURS, np.uint8)


@compiled_compact
def colour_of(player: int, viewer: int) -> int:
    """Row of the palette: the viewer's bird has the first colour, whose owner has the viewer's."""
    if viewer == SPECTATOR:
        return player
    if player == viewer:
        return 0
    return viewer if player == 0 else player


@compiled_compact
def gauge_box(wind: int) -> tuple[int, int]:
    """Upper edge and height of the bar for a wind in hundredths of a pixel, in pixels."""
    length = abs(wind) * GAUGE_PIXELS // HUNDREDTHS
    return (GAUGE_MIDDLE - length if wind < 0 else GAUGE_MIDDLE), length


@compiled_compact
def paint_pipe(world: Any, rules: Any, place: int, pipe: int, image: Any) -> None:
    """The upper and the lower half of a pipe, down to the ground."""
    art = rules.art
    left = pipe_left(world, rules, place, pipe)
    top = gap_of(world, rules, place, pipe)
    bottom = top + rules.pipe_gap
    first, last = max(0, left), min(SCREEN_WIDTH, left + PIPE_WIDTH)
    for y in range(GROUND_TOP):
        if top <= y < bottom:
            continue
        depth = top - 1 - y if y < top else y - bottom  # from the end into the pipe
        part = CAP if depth < CAP_HEIGHT else BODY
        is_line = depth < CAP_LINE or CAP_HEIGHT - CAP_LINE <= depth < CAP_HEIGHT
        for x in range(first, last):
            for channel in range(3):
                level = art.outline[channel] if is_line else art.pipe[part, x - left, channel]
                # The body is narrower: black there means that the sky shows.
                if level > 0:
                    image[channel, y, x] = level


@compiled_compact
def paint_ground(world: Any, rules: Any, place: int, image: Any) -> None:
    """The ground, scrolled as the pipes are."""
    phase = scroll_of(world, rules, place)
    for channel in range(3):
        for y in range(GROUND_TOP, SCREEN_HEIGHT):
            for x in range(SCREEN_WIDTH):
                image[channel, y, x] = rules.art.ground[channel, y - GROUND_TOP, x + phase]


@compiled_compact
def paint_gauge(wind: int, image: Any) -> None:
    """The wind: the bar points where birds are blown."""
    fill_box(image, GAUGE_TOP, GAUGE_LEFT, GAUGE_HEIGHT, GAUGE_WIDTH, GAUGE_DARK)
    top, height = gauge_box(wind)
    width = GAUGE_WIDTH - 2 * GAUGE_EDGE
    fill_box(image, top, GAUGE_LEFT + GAUGE_EDGE, height, width, GAUGE_BRIGHT)


@compiled_compact
def paint_bird(world: Any, rules: Any, place: int, player: int, colour: int, image: Any) -> None:
    """One bird, if it is to be seen."""
    look = look_of(world, place, player)
    if look == HIDDEN:
        return
    up = bird_top(world, place, player) - CANVAS_UP
    for row in range(max(0, -up), min(CANVAS, SCREEN_HEIGHT - up)):
        for column in range(CANVAS):
            index = rules.art.bird[look, row, column]
            if index > 0:
                for channel in range(3):
                    value = rules.art.palette[colour, index, channel]
                    image[channel, up + row, CANVAS_LEFT + column] = value


@compiled_compact
def paint(world: Any, rules: Any, place: int, viewer: int, image: Any) -> None:
    """The whole picture of a frame at `place` of the film: image uint8 [3, 512, 288]."""
    for channel in range(3):
        for y in range(GROUND_TOP):
            for x in range(SCREEN_WIDTH):
                image[channel, y, x] = rules.art.sky[channel, y, x]
    for pipe in range(NUM_PIPES):
        paint_pipe(world, rules, place, pipe, image)
    paint_ground(world, rules, place, image)
    if rules.wind > 0:
        paint_gauge(wind_of(world, place), image)
    for player in range(rules.num_players):
        if player != viewer:
            paint_bird(world, rules, place, player, colour_of(player, viewer), image)
    if viewer != SPECTATOR:
        paint_bird(world, rules, place, viewer, 0, image)


@compiled_compact
def paint_score(world: Any, rules: Any, viewer: int, image: Any) -> None:
    """For people: pipes passed; in a race a dot for each bird, dark when it is out."""
    passed = 0
    for player in range(rules.num_players):
        if viewer in (SPECTATOR, player):
            passed = max(passed, int(world.pipes_passed[player]))
    digits, rest = 1, passed // 10
    while rest > 0:
        digits, rest = digits + 1, rest // 10
    left = SCREEN_WIDTH // 2 - digits * 12 + 3
    for dy, dx in ((-2, 0), (2, 0), (0, -2), (0, 2), (2, 2)):
        draw_number(image, passed, 34 + dy, left + dx, 6, GAUGE_DARK, False)
    draw_number(image, passed, 34, left, 6, INK, False)
    if rules.num_players > 1:
        for player in range(rules.num_players):
            x = SCREEN_WIDTH // 2 + 20 * player - 10 * (rules.num_players - 1)
            fill_disc(image, DOTS_Y, x, 8, GAUGE_DARK)
            if world.crash_tick[player] == NEVER:
                fill_disc(image, DOTS_Y, x, 6, DOT_COLOURS[colour_of(player, viewer)])


# --- slices of worlds, and what people call ----------------------------------------------------


@compiled_compact
def observe_image(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write every seat's picture to out [B, P, 3, 512, 288]."""
    for index in range(first, last):
        world = world_at(worlds, index)
        for player in range(rules.num_players):
            paint(world, rules, frame_place(world, 0), player, out[index, player])


@compiled_compact
def paint_world(worlds: Any, rules: Any, index: int, viewer: int, image: Any) -> None:
    """The picture of one world among many, with the score."""
    world = world_at(worlds, index)
    paint(world, rules, frame_place(world, 0), viewer, image)
    paint_score(world, rules, viewer, image)


def draw(worlds: World, rules: Any, world: int, player: int | None) -> NDArray[np.uint8]:
    """The picture of one world with the score, uint8 [512, 288, 3]: of a seat's own view, or the
    spectator's (None).
    """
    image = np.zeros((3, SCREEN_HEIGHT, SCREEN_WIDTH), np.uint8)
    paint_world(worlds, rules, world, SPECTATOR if player is None else player, image)
    return np.ascontiguousarray(image.transpose(1, 2, 0))
