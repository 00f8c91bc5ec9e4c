"""Renders a recorded frame of Flappy Bird for people, and as the observation `image`.

Only reads the state. In a seat's own view its bird is yellow and in front of the others; the
spectator sees each seat in its own colour.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games import drawing as d
from marl_cair.games.compiled import compiled_compact
from marl_cair.games.drawing import SPECTATOR, fill_box, fill_disc
from marl_cair.games.flappy_bird import art as a
from marl_cair.games.flappy_bird import frames
from marl_cair.games.flappy_bird import state as s
from marl_cair.games.flappy_bird import tables as t
from marl_cair.games.loops import loop_over_seats

# The gauge of the wind, in the upper left corner: a bar up or down from its middle.
GAUGE_LEFT, GAUGE_TOP, GAUGE_WIDTH, GAUGE_HEIGHT = 8, 8, 16, 88
GAUGE_MIDDLE = GAUGE_TOP + GAUGE_HEIGHT // 2
GAUGE_EDGE = 4  # pixels beside the bar
GAUGE_PIXELS = 14  # a pixel per tick of wind
GAUGE_DARK, GAUGE_BRIGHT, INK = d.read_colours("2e363e faf6e6 fcfcfc")
DOTS_Y = 456  # on the ground, where no bird flies


@compiled_compact
def colour_of(player: int, viewer: int) -> int:
    """Row of the palette: the viewer takes colour 0, and seat 0 takes the viewer's colour."""
    if viewer == SPECTATOR:
        return player
    if player == viewer:
        return 0
    return viewer if player == 0 else player


@compiled_compact
def gauge_box(wind: int) -> tuple[int, int]:
    """Upper edge and height of the bar for a wind in hundredths of a pixel, in pixels."""
    length = abs(wind) * GAUGE_PIXELS // t.HUNDREDTHS
    return (GAUGE_MIDDLE - length if wind < 0 else GAUGE_MIDDLE), length


@compiled_compact
def paint_pipe(world: Any, rules: Any, place: int, pipe: int, image: Any) -> None:
    """The upper and the lower half of a pipe, down to the ground."""
    art = rules.art
    left, top = frames.pipe_in_frame(world, rules, place, pipe)
    bottom = top + rules.pipe_gap
    first, last = max(0, left), min(t.SCREEN_WIDTH, left + t.PIPE_WIDTH)
    for y in range(t.GROUND_TOP):
        if top <= y < bottom:
            continue
        depth = top - 1 - y if y < top else y - bottom  # from the end into the pipe
        part = a.CAP if depth < a.CAP_HEIGHT else a.BODY
        is_line = depth < a.CAP_LINE or a.CAP_HEIGHT - a.CAP_LINE <= depth < a.CAP_HEIGHT
        for x in range(first, last):
            for channel in range(3):
                level = art.outline[channel] if is_line else art.pipe[part, x - left, channel]
                # The body is narrower: black there means that the sky shows.
                if level > 0:
                    image[channel, y, x] = level


@compiled_compact
def paint_ground(world: Any, rules: Any, place: int, image: Any) -> None:
    """The ground, scrolled as the pipes are."""
    phase = frames.scroll_in_frame(world, rules, place)
    for channel in range(3):
        for y in range(t.GROUND_TOP, t.SCREEN_HEIGHT):
            for x in range(t.SCREEN_WIDTH):
                image[channel, y, x] = rules.art.ground[channel, y - t.GROUND_TOP, x + phase]


@compiled_compact
def paint_gauge(wind: int, image: Any) -> None:
    """The wind: the bar points where birds are blown."""
    fill_box(image, GAUGE_TOP, GAUGE_LEFT, GAUGE_HEIGHT, GAUGE_WIDTH, GAUGE_DARK)
    top, height = gauge_box(wind)
    width = GAUGE_WIDTH - 2 * GAUGE_EDGE
    fill_box(image, top, GAUGE_LEFT + GAUGE_EDGE, height, width, GAUGE_BRIGHT)


@compiled_compact
def paint_bird(world: Any, rules: Any, place: int, player: int, colour: int, image: Any) -> None:
    """Paint one bird, unless it is hidden."""
    pose, up = frames.bird_in_frame(world, place, player)
    if pose == frames.HIDDEN:
        return
    for row in range(max(0, -up), min(a.CANVAS, t.SCREEN_HEIGHT - up)):
        for column in range(a.CANVAS):
            index = rules.art.bird[pose, row, column]
            if index > 0:
                for channel in range(3):
                    value = rules.art.palette[colour, index, channel]
                    image[channel, up + row, a.CANVAS_LEFT + column] = value


@compiled_compact
def see_image(world: Any, rules: Any, viewer: int, image: Any) -> None:
    """The newest frame without the score: image uint8 [3, 512, 288]."""
    place = frames.frame_place(world, 0)
    for channel in range(3):
        for y in range(t.GROUND_TOP):
            for x in range(t.SCREEN_WIDTH):
                image[channel, y, x] = rules.art.sky[channel, y, x]
    for pipe in range(t.NUM_PIPES):
        paint_pipe(world, rules, place, pipe, image)
    paint_ground(world, rules, place, image)
    if rules.wind > 0:
        paint_gauge(int(world.film[place, s.FRAME_WIND]), image)
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
    left = t.SCREEN_WIDTH // 2 - d.num_digits(passed) * 12 + 3
    for dy, dx in ((-2, 0), (2, 0), (0, -2), (0, 2), (2, 2)):
        d.draw_number(image, passed, 34 + dy, left + dx, 6, GAUGE_DARK, False)
    d.draw_number(image, passed, 34, left, 6, INK, False)
    if rules.num_players > 1:
        for player in range(rules.num_players):
            x = t.SCREEN_WIDTH // 2 + 20 * player - 10 * (rules.num_players - 1)
            fill_disc(image, DOTS_Y, x, 8, GAUGE_DARK)
            if world.crash_tick[player] == s.NEVER:
                fill_disc(image, DOTS_Y, x, 6, a.BIRD_COLOURS[colour_of(player, viewer)])


@compiled_compact
def paint(world: Any, rules: Any, viewer: int, image: Any) -> None:
    """What a person sees: the newest frame and the score."""
    see_image(world, rules, viewer, image)
    paint_score(world, rules, viewer, image)


observe_image = loop_over_seats(see_image, s.world_at, compact=True)  # out [B, P, 3, 512, 288]
draw = d.make_draw(paint, s.world_at, t.SCREEN_HEIGHT, t.SCREEN_WIDTH)
