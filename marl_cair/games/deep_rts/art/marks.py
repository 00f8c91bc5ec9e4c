"""What is drawn over the pieces of Deep RTS: health, progress, selections, blows and arrows."""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled_compact
from marl_cair.games.deep_rts.art.painting import LEAST_SPRITE_PIXELS
from marl_cair.games.deep_rts.art.scene import (
    FLASH_TICKS,
    NO_BLOW,
    SPECTATOR,
    piece_of,
    stands_at,
    target_in_sight,
)
from marl_cair.games.deep_rts.art.sprites import LIGHT_SHADE, PALETTES
from marl_cair.games.deep_rts.rules.rulebook import KIND_RANGE_TILES
from marl_cair.games.deep_rts.state import (
    CURSOR,
    NO_UNIT,
    OCCUPANT,
    RISING,
    TRAINING,
)
from marl_cair.games.drawing import draw_bar, draw_corners, draw_line, fill_box, fill_disc

HEALTHY, HURT, DYING, PROGRESS, EMPTY, OUTLINE, FLASH, SPARK, SHAFT = (
    np.array(colour, np.uint8)
    for colour in (
        (96, 214, 92),
        (246, 198, 60),
        (226, 66, 52),
        (120, 190, 255),
        (58, 56, 66),
        (24, 22, 28),
        (255, 248, 214),
        (255, 196, 74),
        (70, 46, 30),
    )
)
_HURT_PERCENT, _DYING_PERCENT = 66, 33


@compiled_compact
def draw_framed_bar(
    image: Any, top: int, left: int, height: int, width: int, percent: int, colour: Any
) -> None:
    """A bar in a dark frame of a pixel, the frame included in its size."""
    fill_box(image, top, left, height, width, OUTLINE)
    draw_bar(image, top + 1, left + 1, height - 2, width - 2, percent / 100.0, colour, EMPTY)


@compiled_compact
def bar_pixels(tile: int) -> int:
    """Height of a bar with its frame."""
    return int(max(3, tile // 6))


@compiled_compact
def mark_health(piece: Any, tile: int, least_top: int, image: Any) -> None:
    """A bar over a piece that is damaged."""
    percent = piece.health_percent
    if percent >= 100:
        return
    colour = HEALTHY
    if percent <= _DYING_PERCENT:
        colour = DYING
    elif percent <= _HURT_PERCENT:
        colour = HURT
    height, inset = bar_pixels(tile), piece.size // 16
    top = max(least_top, piece.top - height // 2)
    width = piece.size - 2 * inset
    draw_framed_bar(image, top, piece.left + inset, height, width, percent, colour)


@compiled_compact
def mark_progress(piece: Any, tile: int, image: Any) -> None:
    """A bar at the foot of a building."""
    height, inset = bar_pixels(tile), piece.size // 16
    top, width = piece.top + piece.size - height, piece.size - 2 * inset
    draw_framed_bar(image, top, piece.left + inset, height, width, piece.done_percent, PROGRESS)


@compiled_compact
def mark_selection(piece: Any, tile: int, image: Any) -> None:
    """Corners around a selected piece, in its player's light shade."""
    line, arm = max(1, tile // 16), piece.size // 3
    if tile >= 2 * LEAST_SPRITE_PIXELS:
        draw_corners(image, piece.top, piece.left, piece.size, arm, 2 * line, OUTLINE)
    colour = PALETTES[piece.colour, LIGHT_SHADE]
    draw_corners(image, piece.top, piece.left, piece.size, max(1, arm - line), line, colour)


@compiled_compact
def paint_flash(y: float, x: float, tile: int, ticks: int, image: Any) -> None:
    """Where a blow fell `ticks` ago."""
    reach = tile * (FLASH_TICKS + 1 - ticks) / (5.0 * FLASH_TICKS)
    line = max(1, tile // 16)
    draw_line(image, y - reach, x, y + reach, x, line, SPARK)
    draw_line(image, y, x - reach, y, x + reach, line, SPARK)
    fill_disc(image, int(y), int(x), int(reach / 2.0), FLASH)


@compiled_compact
def paint_arrow(
    y: float, x: float, y_step: float, x_step: float, away: float, tile: int, ticks: int, image: Any
) -> None:
    """An arrow that flew off (y, x) `ticks` ago, to fly `away` pixels in all."""
    tip = away * (ticks + 1.0) / (FLASH_TICKS + 0.5)
    tail, head = max(0.0, tip - 0.6 * tile), max(0.0, tip - 0.2 * tile)
    line = max(1, tile // 16) + 1
    y_tip, x_tip = y + y_step * tip, x + x_step * tip
    draw_line(image, y + y_step * tail, x + x_step * tail, y_tip, x_tip, line, SHAFT)
    draw_line(image, y + y_step * head, x + x_step * head, y_tip, x_tip, line, FLASH)


@compiled_compact
def paint_blow(piece: Any, target: Any, tile: int, is_shot: bool, image: Any) -> None:
    """The flash of a blow, or an arrow on its way."""
    y, x = piece.top + piece.size / 2.0, piece.left + piece.size / 2.0
    y_far = target.top + target.size / 2.0 - y
    x_far = target.left + target.size / 2.0 - x
    away = max(1.0, (y_far * y_far + x_far * x_far) ** 0.5)
    y_step, x_step = y_far / away, x_far / away
    if is_shot:
        paint_arrow(y, x, y_step, x_step, away, tile, piece.blow_ticks, image)
    else:
        near = 0.58 * tile
        paint_flash(y + near * y_step, x + near * x_step, tile, piece.blow_ticks, image)


@compiled_compact
def paint_marks(scene: Any, image: Any) -> None:
    """All marks that the viewer may see; of training only its own, of selections too."""
    tile = scene.tile_side
    for own in range(scene.rows * scene.columns):
        cell = int(scene.world_cell[own])
        if scene.board[OCCUPANT, cell] == NO_UNIT:
            continue
        unit = stands_at(scene, cell)
        if unit == NO_UNIT:
            continue
        piece = piece_of(scene, unit)
        is_own = scene.viewer in (SPECTATOR, piece.owner)
        if piece.blow_ticks != NO_BLOW:
            target = target_in_sight(scene, unit)
            if target != NO_UNIT:
                is_shot = scene.kinds[piece.kind, KIND_RANGE_TILES] > 1
                paint_blow(piece, piece_of(scene, target), tile, is_shot, image)
        if tile > LEAST_SPRITE_PIXELS:
            mark_health(piece, tile, scene.top, image)
            if piece.state == RISING or (piece.state == TRAINING and is_own):
                mark_progress(piece, tile, image)
        if is_own and scene.players[piece.owner, CURSOR] == unit:
            mark_selection(piece, tile, image)
