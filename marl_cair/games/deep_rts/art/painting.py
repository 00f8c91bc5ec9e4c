"""Paints ground, fog, buildings and units of Deep RTS as one seat sees them.

The order follows the rows of the view, so that mirrored worlds look alike to mirrored seats.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled_compact
from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts.art import sprites
from marl_cair.games.deep_rts.art.scene import SPECTATOR, piece_of, stands_at
from marl_cair.games.deep_rts.rules.board import known_tile, sees
from marl_cair.games.deep_rts.rules.rulebook import TILE_AMOUNT, TILE_RESOURCE
from marl_cair.games.deep_rts.tables import GRASS, NO_RESOURCE, NUM_MOBILE_KINDS
from marl_cair.games.drawing import draw_smooth, fill_box, shade_box

LEAST_SPRITE_PIXELS = 5  # along a tile; on smaller ones a unit is a square of its colour
FOG_COLOUR = np.array((10, 12, 22), np.uint8)
FOG_PERCENT = 55
_NORTH, _SOUTH = 0, 2
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
            if scene.viewer != SPECTATOR and scene.fog != 0:
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


# --- buildings and units -----------------------------------------------------------------------


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
    pose = sprites.SIDEWAYS
    if piece.direction == _NORTH:
        pose = sprites.BACK
    elif piece.direction == _SOUTH:
        pose = sprites.FRONT
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
            unit = stands_at(scene, cell)
            if unit == s.NO_UNIT or (scene.units[unit, s.UNIT_KIND] < NUM_MOBILE_KINDS) != (
                layer == 1
            ):
                continue
            piece = piece_of(scene, unit)
            if scene.tile_side < LEAST_SPRITE_PIXELS:
                paint_square(piece, image)
            elif layer == 0:
                paint_building(piece, image)
            else:
                paint_walker(piece, image)
