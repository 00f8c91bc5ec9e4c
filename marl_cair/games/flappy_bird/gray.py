"""The small pictures `gray`, `gray_80` and `gray_stack`, painted at their own size.

Each dot is the mean luminance of what `image` shows in its cell, in whole numbers: each layer is
laid over those below by the share of the cell that it covers (see `art`). This is exact where a
layer below is even within the cell, and off by a few levels at the edges of two layers in one cell.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled_compact
from marl_cair.games.flappy_bird.art import (
    BODY,
    CANVAS,
    CANVAS_UP,
    CAP,
    CAP_HEIGHT,
    CAP_LINE,
    LINE,
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
from marl_cair.games.flappy_bird.rendering import (
    GAUGE_EDGE,
    GAUGE_HEIGHT,
    GAUGE_LEFT,
    GAUGE_TOP,
    GAUGE_WIDTH,
    colour_of,
    gauge_box,
)
from marl_cair.games.flappy_bird.state import (
    NUM_FRAMES,
    world_at,
)
from marl_cair.games.flappy_bird.tables import (
    NUM_PIPES,
    PIPE_WIDTH,
    SCREEN_HEIGHT,
    SCREEN_WIDTH,
)

GRAY_SIDE, GRAY_SMALL_SIDE = 84, 80
CELL_UNITS = SCREEN_WIDTH * SCREEN_HEIGHT  # of a cell's area
GAUGE_DARK_LUMA, GAUGE_BRIGHT_LUMA = 53, 245


@compiled_compact
def units_in_row(row: int, side: int, first: int, last: int) -> int:
    """Units of a row's 512 that the pixel rows first..last-1 take."""
    begin = max(row * SCREEN_HEIGHT, first * side)
    end = min((row + 1) * SCREEN_HEIGHT, last * side)
    return max(0, end - begin)


@compiled_compact
def lay_tube(gray: Any, phase: int, column: int, first: int, last: int, image: Any) -> None:
    """The rows first..last-1 that show nothing but the body of a pipe."""
    cover, light = gray.pipe_cover[phase, BODY], gray.pipe_light[phase, BODY]
    begin, end = max(0, -column), min(cover.shape[0], image.shape[1] - column)
    for row in range(first, last):
        for place in range(begin, end):
            below = int(image[row, column + place]) * (SCREEN_WIDTH - cover[place])
            image[row, column + place] = (below + light[place] + SCREEN_WIDTH // 2) // SCREEN_WIDTH


@compiled_compact
def lay_end(
    gray: Any, phase: int, column: int, row: int, top: int, bottom: int, image: Any
) -> None:
    """A row that shows part of the ends of a pipe with its gap at top..bottom-1."""
    side = image.shape[0]
    body = units_in_row(row, side, 0, top - CAP_HEIGHT)
    body += units_in_row(row, side, bottom + CAP_HEIGHT, SCREEN_HEIGHT)
    cap = units_in_row(row, side, top - CAP_HEIGHT + CAP_LINE, top - CAP_LINE)
    cap += units_in_row(row, side, bottom + CAP_LINE, bottom + CAP_HEIGHT - CAP_LINE)
    ends = units_in_row(row, side, top - CAP_HEIGHT, top)
    ends += units_in_row(row, side, bottom, bottom + CAP_HEIGHT)
    line = ends - cap
    cover, light = gray.pipe_cover[phase], gray.pipe_light[phase]
    begin, end = max(0, -column), min(cover.shape[1], side - column)
    for place in range(begin, end):
        covered = body * cover[BODY, place] + ends * cover[CAP, place]
        added = body * light[BODY, place] + cap * light[CAP, place] + line * light[LINE, place]
        below = int(image[row, column + place]) * (CELL_UNITS - covered)
        image[row, column + place] = (below + added + CELL_UNITS // 2) // CELL_UNITS


@compiled_compact
def lay_pipe(world: Any, rules: Any, place: int, gray: Any, pipe: int, image: Any) -> None:
    """Both halves of a pipe."""
    left = pipe_left(world, rules, place, pipe)
    if left >= SCREEN_WIDTH or left + PIPE_WIDTH <= 0:
        return
    side = image.shape[0]
    phase = left % gray.period
    column = left // gray.period * gray.period_columns + phase * side // SCREEN_WIDTH
    top = gap_of(world, rules, place, pipe)
    bottom = top + rules.pipe_gap
    upper = max(0, top - CAP_HEIGHT) * side // SCREEN_HEIGHT
    above_gap = (top * side - 1) // SCREEN_HEIGHT + 1
    below_gap = bottom * side // SCREEN_HEIGHT
    last = gray.ground_row + 1
    lower = min(last, ((bottom + CAP_HEIGHT) * side - 1) // SCREEN_HEIGHT + 1)
    lay_tube(gray, phase, column, 0, upper, image)
    for row in range(upper, above_gap):
        lay_end(gray, phase, column, row, top, bottom, image)
    for row in range(max(above_gap, below_gap), lower):
        lay_end(gray, phase, column, row, top, bottom, image)
    lay_tube(gray, phase, column, lower, last, image)


@compiled_compact
def lay_ground(phase: int, gray: Any, image: Any) -> None:
    """The ground; its first row shares its cells with what is above."""
    side, units = image.shape[0], gray.ground_units
    for column in range(side):
        above = int(image[gray.ground_row, column]) * (SCREEN_HEIGHT - units)
        below = int(gray.ground[phase, 0, column]) * units
        image[gray.ground_row, column] = (above + below + SCREEN_HEIGHT // 2) // SCREEN_HEIGHT
    for row in range(gray.ground_row + 1, side):
        for column in range(side):
            image[row, column] = gray.ground[phase, row - gray.ground_row, column]


@compiled_compact
def lay_box(image: Any, top: int, left: int, height: int, width: int, luma: int) -> None:
    """An even box of pixels of the large picture."""
    side = image.shape[0]
    for row in range(top * side // SCREEN_HEIGHT, ((top + height) * side - 1) // SCREEN_HEIGHT + 1):
        down = units_in_row(row, side, top, top + height)
        for column in range(
            left * side // SCREEN_WIDTH, ((left + width) * side - 1) // SCREEN_WIDTH + 1
        ):
            begin = max(column * SCREEN_WIDTH, left * side)
            end = min((column + 1) * SCREEN_WIDTH, (left + width) * side)
            covered = down * (end - begin)
            below = int(image[row, column]) * (CELL_UNITS - covered)
            image[row, column] = (below + luma * covered + CELL_UNITS // 2) // CELL_UNITS


@compiled_compact
def lay_gauge(wind: int, image: Any) -> None:
    """The gauge of the wind."""
    lay_box(image, GAUGE_TOP, GAUGE_LEFT, GAUGE_HEIGHT, GAUGE_WIDTH, GAUGE_DARK_LUMA)
    top, height = gauge_box(wind)
    if height > 0:
        width = GAUGE_WIDTH - 2 * GAUGE_EDGE
        lay_box(image, top, GAUGE_LEFT + GAUGE_EDGE, height, width, GAUGE_BRIGHT_LUMA)


@compiled_compact
def lay_bird(look: int, up: int, colour: int, gray: Any, image: Any) -> None:
    """A bird whose canvas begins in pixel row `up`, if it is to be seen."""
    if look == HIDDEN:
        return
    side = image.shape[0]
    cover, light = gray.bird_cover[look], gray.bird_light[colour, look]
    first, last = max(0, up), min(SCREEN_HEIGHT, up + CANVAS)
    for row in range(first * side // SCREEN_HEIGHT, (last * side - 1) // SCREEN_HEIGHT + 1):
        begin = max(first, row * SCREEN_HEIGHT // side)
        end = min(last, ((row + 1) * SCREEN_HEIGHT - 1) // side + 1)
        for place in range(cover.shape[1]):
            covered, added = 0, 0
            for y in range(begin, end):
                units = units_in_row(row, side, y, y + 1)
                covered += units * cover[y - up, place]
                added += units * light[y - up, place]
            if covered > 0:
                column = gray.bird_column + place
                below = int(image[row, column]) * (CELL_UNITS - covered)
                image[row, column] = (below + added + CELL_UNITS // 2) // CELL_UNITS


@compiled_compact
def paint_gray(world: Any, rules: Any, place: int, gray: Any, viewer: int, image: Any) -> None:
    """A frame at `place` of the film as uint8 [S, S], S the side that `gray` was averaged for."""
    for row in range(gray.ground_row + 1):
        for column in range(image.shape[1]):
            image[row, column] = gray.sky[row, column]
    for pipe in range(NUM_PIPES):
        lay_pipe(world, rules, place, gray, pipe, image)
    lay_ground(scroll_of(world, rules, place), gray, image)
    if rules.wind > 0:
        lay_gauge(wind_of(world, place), image)
    for nth in range(1, rules.num_players + 1):
        # The viewer comes last, the others in the order of their seats.
        player = viewer if nth == rules.num_players else nth - int(nth <= viewer)
        look = look_of(world, place, player)
        up = bird_top(world, place, player) - CANVAS_UP
        lay_bird(look, up, colour_of(player, viewer), gray, image)


# --- slices of worlds ------------------------------------------------------------------------


@compiled_compact
def observe_gray(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write every seat's small picture to out [B, P, 1, 84, 84]."""
    for index in range(first, last):
        world = world_at(worlds, index)
        place = frame_place(world, 0)
        for player in range(rules.num_players):
            paint_gray(world, rules, place, rules.art.gray_84, player, out[index, player, 0])


@compiled_compact
def observe_gray_80(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write every seat's small picture in the thesis's size to out [B, P, 1, 80, 80]."""
    for index in range(first, last):
        world = world_at(worlds, index)
        place = frame_place(world, 0)
        for player in range(rules.num_players):
            paint_gray(world, rules, place, rules.art.gray_80, player, out[index, player, 0])


@compiled_compact
def observe_gray_stack(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write the last four decisions' small pictures, the newest last: out [B, P, 4, 84, 84]."""
    for index in range(first, last):
        world = world_at(worlds, index)
        for age in range(NUM_FRAMES):
            place = frame_place(world, age)
            for player in range(rules.num_players):
                image = out[index, player, NUM_FRAMES - 1 - age]
                paint_gray(world, rules, place, rules.art.gray_84, player, image)
