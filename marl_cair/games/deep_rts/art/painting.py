"""Paints ground, fog, buildings, units and marks of Deep RTS as one seat sees them.

Marks are bars of health and progress, selections, blows and arrows.

The order follows the rows of the view, so that mirrored worlds look alike to mirrored seats.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games import drawing
from marl_cair.games.compiled import compiled_compact
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts.art import scene as scenes
from marl_cair.games.deep_rts.art import sprites
from marl_cair.games.deep_rts.rules.board import known_tile, sees
from marl_cair.games.deep_rts.rules.rulebook import KIND_RANGE_TILES, TILE_AMOUNT, TILE_RESOURCE
from marl_cair.games.deep_rts.tables import GRASS, NO_RESOURCE, NUM_MOBILE_KINDS
from marl_cair.games.drawing import draw_smooth, fill_box, shade_box

LEAST_SPRITE_PIXELS = 5  # along a tile; on smaller ones a unit is a square of its colour
FOG_COLOUR = np.array((10, 12, 22), np.uint8)
FOG_PERCENT = 55
HEALTHY, HURT, DYING, PROGRESS, EMPTY = np.array(
    [(96, 214, 92), (246, 198, 60), (226, 66, 52), (120, 190, 255), (58, 56, 66)], np.uint8
)
OUTLINE, FLASH, SPARK, SHAFT = np.array(
    [(24, 22, 28), (255, 248, 214), (255, 196, 74), (70, 46, 30)], np.uint8
)
_HURT_PERCENT, _DYING_PERCENT = 66, 33
# [direction], as rulebook.ROW_STEP and COLUMN_STEP list them: north, east, south, west, diagonals.
_POSES = np.array((sprites.BACK, sprites.SIDEWAYS, sprites.FRONT, *[sprites.SIDEWAYS] * 5))
_WESTWARD = np.array((False, False, False, True, False, False, True, True))


# --- ground ------------------------------------------------------------------------------------


@compiled_compact
def resource_pixels(tile: int, amount: int, fresh: int) -> int:
    """Side of a resource in pixels: the less is left, the smaller."""
    if 2 * amount > fresh:
        return tile
    return max(1, tile * (13 if 4 * amount > fresh else 10) // 16)


@compiled_compact
def paint_tile(
    image: Any, kind: int, row: int, column: int, top: int, left: int, tile: int, size: int
) -> None:
    """Paint a tile; a small resource (`size` below `tile`) stands on grass."""
    variant = (row * 73 + column * 151 + row * column * 11) // 3 % sprites.NUM_VARIANTS
    palette = sprites.TILE_PALETTES[(row + column) % 2]
    if size < tile:
        draw_smooth(image, sprites.TILE_SPRITES[GRASS, variant], palette, top, left, tile, False, 0)
    top += (tile - size) * 3 // 4
    left += (tile - size) // 2
    draw_smooth(image, sprites.TILE_SPRITES[kind, variant], palette, top, left, size, False, 0)


@compiled_compact
def paint_ground(scene: Any, image: Any) -> None:
    """Paint the tiles that the viewer knows, dim where it does not see them now."""
    tile = scene.tile_side
    for row in range(scene.rows):
        for column in range(scene.columns):
            cell = int(scene.world_cell[row * scene.columns + column])
            kind, in_sight = int(scene.board[s.TILE, cell]), True
            if scene.viewer != scenes.SPECTATOR and scene.fog != 0:
                kind = known_tile(scene, scene, scene.viewer, cell)
                in_sight = sees(scene, scene, scene.viewer, cell)
            if kind == s.UNKNOWN:
                continue
            top, left, size = scene.top + row * tile, scene.left + column * tile, tile
            if in_sight and scene.tiles[kind, TILE_RESOURCE] != NO_RESOURCE:
                size = resource_pixels(
                    tile, int(scene.board[s.AMOUNT, cell]), int(scene.tiles[kind, TILE_AMOUNT])
                )
            paint_tile(image, kind, row, column, top, left, tile, size)
            if not in_sight:
                shade_box(image, top, left, tile, tile, FOG_COLOUR, FOG_PERCENT)


@compiled_compact
def paint_building(piece: Any, image: Any) -> None:
    """Paint a building; one under construction grows behind its scaffold."""
    top, left, size = piece.top, piece.left, piece.size
    palette = sprites.PALETTES[piece.colour]
    is_great = sprites.GREAT_SPRITE[piece.kind] >= 0
    first_row = 0
    if piece.state == s.RISING:
        ground = sprites.GREAT_SITE if is_great else sprites.SMALL_SITE
        draw_smooth(image, ground, palette, top, left, size, False, 0)
        first_row = ground.shape[0] * (100 - piece.done_percent) // 100
    sprite = sprites.SMALL_BUILDINGS[max(0, sprites.SMALL_SPRITE[piece.kind])]
    if is_great:
        sprite = sprites.GREAT_BUILDINGS[sprites.GREAT_SPRITE[piece.kind]]
    draw_smooth(image, sprite, palette, top, left, size, False, first_row)
    if piece.state == s.RISING:
        scaffold = sprites.GREAT_SCAFFOLD if is_great else sprites.SMALL_SCAFFOLD
        draw_smooth(image, scaffold, palette, top, left, size, False, 0)


@compiled_compact
def paint_walker(piece: Any, image: Any) -> None:
    """Paint a unit that can walk, with the resource that it carries."""
    top, left, size = piece.top, piece.left, piece.size
    pose = _POSES[piece.direction]
    is_flipped = _WESTWARD[piece.direction]
    if piece.state == s.WALKING and piece.ticks // 2 % 2 == 1:
        top -= size // 16
    sprite = sprites.UNIT_SPRITES[piece.kind, pose]
    draw_smooth(image, sprite, sprites.PALETTES[piece.colour], top, left, size, is_flipped, 0)
    if piece.carry_kind != NO_RESOURCE:
        load = max(3, size // 2)
        icon = sprites.ICONS[piece.carry_kind]
        beside = size - load if is_flipped else 0
        draw_smooth(
            image, icon, sprites.PALETTES[0], top + size - load, left + beside, load, False, 0
        )


@compiled_compact
def paint_square(piece: Any, image: Any) -> None:
    """Paint a piece on a board of very small tiles; one under construction is dark."""
    top, left, size = piece.top, piece.left, piece.size
    fill_box(image, top, left, size, size, sprites.PLAYER_COLOURS[piece.colour])
    if piece.state == s.RISING:
        shade_box(image, top, left, size, size, FOG_COLOUR, FOG_PERCENT)


@compiled_compact
def paint_pieces(scene: Any, image: Any) -> None:
    """Paint everything that the viewer sees on the board: buildings, then units over them."""
    for layer in range(2):
        for own in range(scene.rows * scene.columns):
            cell = int(scene.world_cell[own])
            if scene.board[s.OCCUPANT, cell] == s.NO_UNIT:
                continue
            unit = scenes.stands_at(scene, cell)
            if unit == s.NO_UNIT or (scene.units[unit, s.UNIT_KIND] < NUM_MOBILE_KINDS) != (
                layer == 1
            ):
                continue
            piece = scenes.piece_of(scene, unit)
            if scene.tile_side < LEAST_SPRITE_PIXELS:
                paint_square(piece, image)
            elif layer == 0:
                paint_building(piece, image)
            else:
                paint_walker(piece, image)


# --- marks -------------------------------------------------------------------------------------


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
    colour = sprites.PALETTES[piece.colour, sprites.LIGHT_SHADE]
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
