"""Draws marks over the units of Deep RTS: health, progress, selections, blows and arrows."""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games import drawing
from marl_cair.games.compiled import compiled_compact
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts.art import scene as scenes
from marl_cair.games.deep_rts.art.painting import LEAST_SPRITE_PIXELS
from marl_cair.games.deep_rts.art.sprites import LIGHT_SHADE, PALETTES
from marl_cair.games.deep_rts.rules.rulebook import KIND_RANGE_TILES

HEALTHY, HURT, DYING, PROGRESS, EMPTY = np.array(
    [(96, 214, 92), (246, 198, 60), (226, 66, 52), (120, 190, 255), (58, 56, 66)], np.uint8
)
OUTLINE, FLASH, SPARK, SHAFT = np.array(
    [(24, 22, 28), (255, 248, 214), (255, 196, 74), (70, 46, 30)], np.uint8
)
_HURT_PERCENT, _DYING_PERCENT = 66, 33


@compiled_compact
def mark_bar(piece: Any, top: int, height: int, percent: int, colour: Any, image: Any) -> None:
    """A bar along a piece, with a dark frame of a pixel."""
    inset = piece.size // 16
    left, width = piece.left + inset, piece.size - 2 * inset
    drawing.fill_box(image, top, left, height, width, OUTLINE)
    share = percent / 100.0
    drawing.draw_bar(image, top + 1, left + 1, height - 2, width - 2, share, colour, EMPTY)


@compiled_compact
def mark_health(piece: Any, height: int, least_top: int, image: Any) -> None:
    """A bar over a piece that is damaged."""
    percent = piece.health_percent
    if percent >= 100:
        return
    colour = HEALTHY
    if percent <= _DYING_PERCENT:
        colour = DYING
    elif percent <= _HURT_PERCENT:
        colour = HURT
    mark_bar(piece, max(least_top, piece.top - height // 2), height, percent, colour, image)


@compiled_compact
def mark_selection(piece: Any, tile: int, image: Any) -> None:
    """Corners around a selected piece, in its player's light shade."""
    line, arm = max(1, tile // 16), piece.size // 3
    if tile >= 2 * LEAST_SPRITE_PIXELS:
        drawing.draw_corners(image, piece.top, piece.left, piece.size, arm, 2 * line, OUTLINE)
    colour = PALETTES[piece.colour, LIGHT_SHADE]
    drawing.draw_corners(image, piece.top, piece.left, piece.size, max(1, arm - line), line, colour)


@compiled_compact
def paint_flash(y: float, x: float, tile: int, ticks: int, image: Any) -> None:
    """Paint a blow that fell `ticks` ago."""
    reach = tile * (scenes.FLASH_TICKS + 1 - ticks) / (5.0 * scenes.FLASH_TICKS)
    line = max(1, tile // 16)
    drawing.draw_line(image, y - reach, x, y + reach, x, line, SPARK)
    drawing.draw_line(image, y, x - reach, y, x + reach, line, SPARK)
    drawing.fill_disc(image, int(y), int(x), int(reach / 2.0), FLASH)


@compiled_compact
def paint_arrow(
    y: float, x: float, y_step: float, x_step: float, away: float, tile: int, ticks: int, image: Any
) -> None:
    """Paint an arrow that left (y, x) `ticks` ago, with `away` pixels to fly in all."""
    tip = away * (ticks + 1.0) / (scenes.FLASH_TICKS + 0.5)
    tail, head = max(0.0, tip - 0.6 * tile), max(0.0, tip - 0.2 * tile)
    line = max(1, tile // 16) + 1
    y_tip, x_tip = y + y_step * tip, x + x_step * tip
    drawing.draw_line(image, y + y_step * tail, x + x_step * tail, y_tip, x_tip, line, SHAFT)
    drawing.draw_line(image, y + y_step * head, x + x_step * head, y_tip, x_tip, line, FLASH)


@compiled_compact
def paint_blow(piece: Any, target: Any, tile: int, is_shot: bool, image: Any) -> None:
    """Paint the flash of a blow, or an arrow in flight."""
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
    """Paint all marks that the viewer may see; training and selections only of its own units."""
    tile = scene.tile_side
    for own in range(scene.rows * scene.columns):
        cell = int(scene.world_cell[own])
        if scene.board[s.OCCUPANT, cell] == s.NO_UNIT:
            continue
        unit = scenes.stands_at(scene, cell)
        if unit == s.NO_UNIT:
            continue
        piece = scenes.piece_of(scene, unit)
        is_own = scene.viewer in (scenes.SPECTATOR, piece.owner)
        if piece.blow_ticks != scenes.NO_BLOW:
            target = scenes.target_in_sight(scene, unit)
            if target != s.NO_UNIT:
                is_shot = scene.kinds[piece.kind, KIND_RANGE_TILES] > 1
                paint_blow(piece, scenes.piece_of(scene, target), tile, is_shot, image)
        if tile > LEAST_SPRITE_PIXELS:
            height = max(3, tile // 6)  # of a bar
            mark_health(piece, height, scene.top, image)
            if piece.state == s.RISING or (piece.state == s.TRAINING and is_own):
                top = piece.top + piece.size - height
                mark_bar(piece, top, height, piece.done_percent, PROGRESS, image)
        if is_own and scene.players[piece.owner, s.CURSOR] == unit:
            mark_selection(piece, tile, image)
