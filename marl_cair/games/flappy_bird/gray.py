"""Paints the representations `gray`, `gray_80` and `gray_stack` at their own size.

Each pixel is the mean luminance of its cell of `image`, in whole numbers: each layer is blended
over those below by the share of the cell that it covers (see `art`). This is exact where the layers
below are even within the cell, and off by a few levels where edges of two layers meet in one cell.
"""

from __future__ import annotations

from typing import Any

from marl_cair.games.compiled import compiled_compact
from marl_cair.games.flappy_bird import art as a
from marl_cair.games.flappy_bird import frames, rendering
from marl_cair.games.flappy_bird import state as s
from marl_cair.games.flappy_bird.tables import NUM_PIPES, PIPE_WIDTH, SCREEN_HEIGHT, SCREEN_WIDTH
from marl_cair.games.loops import loop_over_seats

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
def blend_tube(gray: Any, phase: int, column: int, first: int, last: int, image: Any) -> None:
    """The rows first..last-1 that show nothing but the body of a pipe."""
    cover, light = gray.pipe_cover[phase, a.BODY], gray.pipe_light[phase, a.BODY]
    begin, end = max(0, -column), min(cover.shape[0], image.shape[1] - column)
    for row in range(first, last):
        for place in range(begin, end):
            below = int(image[row, column + place]) * (SCREEN_WIDTH - cover[place])
            image[row, column + place] = (below + light[place] + SCREEN_WIDTH // 2) // SCREEN_WIDTH


@compiled_compact
def blend_end(
    gray: Any, phase: int, column: int, row: int, top: int, bottom: int, image: Any
) -> None:
    """A row that shows part of the ends of a pipe with its gap at top..bottom-1."""
    side = image.shape[0]
    body = units_in_row(row, side, 0, top - a.CAP_HEIGHT)
    body += units_in_row(row, side, bottom + a.CAP_HEIGHT, SCREEN_HEIGHT)
    cap = units_in_row(row, side, top - a.CAP_HEIGHT + a.CAP_LINE, top - a.CAP_LINE)
    cap += units_in_row(row, side, bottom + a.CAP_LINE, bottom + a.CAP_HEIGHT - a.CAP_LINE)
    ends = units_in_row(row, side, top - a.CAP_HEIGHT, top)
    ends += units_in_row(row, side, bottom, bottom + a.CAP_HEIGHT)
    line = ends - cap
    cover, light = gray.pipe_cover[phase], gray.pipe_light[phase]
    begin, end = max(0, -column), min(cover.shape[1], side - column)
    for place in range(begin, end):
        covered = body * cover[a.BODY, place] + ends * cover[a.CAP, place]
        added = (
            body * light[a.BODY, place] + cap * light[a.CAP, place] + line * light[a.LINE, place]
        )
        below = int(image[row, column + place]) * (CELL_UNITS - covered)
        image[row, column + place] = (below + added + CELL_UNITS // 2) // CELL_UNITS


@compiled_compact
def blend_pipe(world: Any, rules: Any, place: int, gray: Any, pipe: int, image: Any) -> None:
    """Both halves of a pipe."""
    left, top = frames.pipe_in_frame(world, rules, place, pipe)
    if left >= SCREEN_WIDTH or left + PIPE_WIDTH <= 0:
        return
    side = image.shape[0]
    phase = left % gray.period
    column = left // gray.period * gray.period_columns + phase * side // SCREEN_WIDTH
    bottom = top + rules.pipe_gap
    upper = max(0, top - a.CAP_HEIGHT) * side // SCREEN_HEIGHT
    above_gap = (top * side - 1) // SCREEN_HEIGHT + 1
    below_gap = bottom * side // SCREEN_HEIGHT
    last = gray.ground_row + 1
    lower = min(last, ((bottom + a.CAP_HEIGHT) * side - 1) // SCREEN_HEIGHT + 1)
    blend_tube(gray, phase, column, 0, upper, image)
    for row in range(upper, above_gap):
        blend_end(gray, phase, column, row, top, bottom, image)
    for row in range(max(above_gap, below_gap), lower):
        blend_end(gray, phase, column, row, top, bottom, image)
    blend_tube(gray, phase, column, lower, last, image)


@compiled_compact
def blend_ground(phase: int, gray: Any, image: Any) -> None:
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
def blend_box(image: Any, top: int, left: int, height: int, width: int, luma: int) -> None:
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
def blend_gauge(wind: int, image: Any) -> None:
    """The gauge of the wind."""
    blend_box(
        image,
        rendering.GAUGE_TOP,
        rendering.GAUGE_LEFT,
        rendering.GAUGE_HEIGHT,
        rendering.GAUGE_WIDTH,
        GAUGE_DARK_LUMA,
    )
    top, height = rendering.gauge_box(wind)
    if height > 0:
        width = rendering.GAUGE_WIDTH - 2 * rendering.GAUGE_EDGE
        blend_box(
            image,
            top,
            rendering.GAUGE_LEFT + rendering.GAUGE_EDGE,
            height,
            width,
            GAUGE_BRIGHT_LUMA,
        )


@compiled_compact
def blend_bird(pose: int, up: int, colour: int, gray: Any, image: Any) -> None:
    """Blend a bird whose canvas begins in pixel row `up`, unless it is hidden."""
    if pose == frames.HIDDEN:
        return
    side = image.shape[0]
    cover, light = gray.bird_cover[pose], gray.bird_light[colour, pose]
    first, last = max(0, up), min(SCREEN_HEIGHT, up + a.CANVAS)
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
    """The frame at a place of the ring as uint8 [S, S], S the side that `gray` was averaged for."""
    for row in range(gray.ground_row + 1):
        for column in range(image.shape[1]):
            image[row, column] = gray.sky[row, column]
    for pipe in range(NUM_PIPES):
        blend_pipe(world, rules, place, gray, pipe, image)
    blend_ground(frames.scroll_in_frame(world, rules, place), gray, image)
    if rules.wind > 0:
        blend_gauge(int(world.film[place, s.FRAME_WIND]), image)
    for nth in range(1, rules.num_players + 1):
        # The viewer comes last, the others in the order of their seats.
        player = viewer if nth == rules.num_players else nth - int(nth <= viewer)
        pose, up = frames.bird_in_frame(world, place, player)
        blend_bird(pose, up, rendering.colour_of(player, viewer), gray, image)


@compiled_compact
def see_gray(world: Any, rules: Any, player: int, out: Any) -> None:
    """A seat's small pictures uint8 [n, S, S] of the last n steps, the newest last: S 84 or 80."""
    gray = rules.art.gray_84 if out.shape[1] == GRAY_SIDE else rules.art.gray_80
    num_frames = out.shape[0]
    for age in range(num_frames):
        place = frames.frame_place(world, age)
        paint_gray(world, rules, place, gray, player, out[num_frames - 1 - age])


observe_gray = loop_over_seats(see_gray, s.world_at, compact=True)  # out [B, P, 1 or 4, S, S]
