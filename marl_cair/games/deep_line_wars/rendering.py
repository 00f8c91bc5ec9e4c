"""Renders a world of Deep Line Wars for people, and as the observations `image` and `gray`.

Only reads the state. A seat's own view has its base on the left and itself in blue; the enemy's
cursor, which is hidden from it, is not drawn. The spectator sees seat 0 on the left.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games import drawing as d
from marl_cair.games.compiled import compiled_compact
from marl_cair.games.deep_line_wars import rulebook as rb
from marl_cair.games.deep_line_wars import state as s
from marl_cair.games.deep_line_wars.observation import LOG_LEVELS, ticks_to_income
from marl_cair.games.deep_line_wars.state import seen_column, unit_slot
from marl_cair.games.deep_line_wars.tables import NUM_UNIT_KINDS, PROGRESS_PER_TILE
from marl_cair.games.drawing import SPECTATOR, fill_box, fill_disc
from marl_cair.games.loops import loop_over_seats

IMAGE_WIDTH, IMAGE_HEIGHT = 800, 600
HUD_HEIGHT = 74  # pixels above the board
MARGIN = 8
GRAY_SIDE = 84
GRAY_BARS = 12  # rows of the gray picture that show the economy

BACKGROUND, PANEL, INK, DIM = d.read_colours("161820 242732 eceef4 545866")
HEALTHY, HURT, GOLD, LUMBER, SHOT, CURSOR_COLOUR = d.read_colours(
    "5cd060 de4438 facc48 aa7442 fff0a0 5efcf2"
)
# Columns of the left spawn, left half, centre, right half and right spawn, two shades each for the
# chequered ground.
GROUND = d.read_colours(
    "364e8c 324884 4a7652 446e4c 5c6068 565a62 687048 616942 883c3e 80383a"
).reshape(5, 2, 3)
# The atlas is a row of cells of 12 x 12 pixels: the four units, then the three towers.
_INDICES, _PALETTE = d.read_atlas(Path(__file__).with_name("sprites.png"))
_CELLS = d.cut_cells(_INDICES, 12)[0]
UNIT_SPRITES, TOWER_SPRITES = _CELLS[:NUM_UNIT_KINDS], _CELLS[NUM_UNIT_KINDS:]
# [side, palette row, RGB]; rows 2 and 3 are the player's colour and its light shade: blue plays
# from the left, red from the right.
PALETTES: NDArray[np.uint8] = np.stack([_PALETTE, _PALETTE])
PALETTES[:, 2:4] = d.read_colours("2a68d6 7aacff ce3430 ff8674").reshape(2, 2, 3)
SIDE_COLOURS: NDArray[np.uint8] = PALETTES[:, 2].copy()
# Levels of `gray`; units are drawn over towers, the enemy's over the own.
GRAY_TERRAIN = (40, 20, 10, 20, 40)
GRAY_OWN_TOWER, GRAY_ENEMY_TOWER, GRAY_OWN_UNIT, GRAY_ENEMY_UNIT = 110, 80, 180, 250
GRAY_CURSOR = 215


@compiled_compact
def ground_kind(rules: Any, column: int) -> int:
    """Row of GROUND for a column of the picture."""
    return int(rules.terrain[column]) // rb.OWN_SPAWN - 1  # the levels are 50, 100, ... 250


@compiled_compact
def board_box(rules: Any) -> tuple[float, float, float]:
    """Side of a cell in pixels, so that the board fits below the bars; pixels above the board and
    left of it.
    """
    across = (IMAGE_WIDTH - 2 * MARGIN) / rules.columns
    down = (IMAGE_HEIGHT - HUD_HEIGHT - 2 * MARGIN) / rules.rows
    tile = float(min(across, down))
    top = float(HUD_HEIGHT + (IMAGE_HEIGHT - HUD_HEIGHT - tile * rules.rows) / 2.0)
    return tile, top, float((IMAGE_WIDTH - tile * rules.columns) / 2.0)


@compiled_compact
def paint_ground(rules: Any, image: Any) -> None:
    """Background and chequered board."""
    fill_box(image, 0, 0, IMAGE_HEIGHT, IMAGE_WIDTH, BACKGROUND)
    tile, top, left = board_box(rules)
    for row in range(rules.rows):
        y, below = int(top + row * tile), int(top + (row + 1) * tile)
        for column in range(rules.columns):
            x, right = int(left + column * tile), int(left + (column + 1) * tile)
            colour = GROUND[ground_kind(rules, column), (row + column) % 2]
            fill_box(image, y, x, below - y, right - x, colour)


@compiled_compact
def paint_towers(world: Any, rules: Any, owner: int, side: int, image: Any) -> None:
    """All towers of a player that plays from the left (side 0) or from the right."""
    tile, board_top, board_left = board_box(rules)
    size = max(3, int(tile * 0.92))
    for tower in range(world.num_towers[owner]):
        column = seen_column(rules, world.tower_column[owner, tower], side == 1)
        top = int(board_top + world.tower_row[owner, tower] * tile + (tile - size) / 2.0)
        left = int(board_left + column * tile + (tile - size) / 2.0)
        sprite = TOWER_SPRITES[world.tower_kind[owner, tower]]
        d.draw_sprite(image, sprite, PALETTES[side], top, left, size, side == 1)


@compiled_compact
def unit_place(world: Any, rules: Any, owner: int, side: int, slot: int) -> tuple[float, float]:
    """Centre of a unit in pixels from the top and from the left, between cells as it walks."""
    tile, top, left = board_box(rules)
    along = world.unit_column[owner, slot] + 0.5
    along += world.unit_progress[owner, slot] / PROGRESS_PER_TILE
    if side == 1:
        along = rules.columns - along
    y = float(top + (world.unit_row[owner, slot] + 0.5) * tile)
    return y, float(left + along * tile)


@compiled_compact
def paint_units(world: Any, rules: Any, owner: int, side: int, image: Any) -> None:
    """The living units of a player with their health bars, the oldest on top."""
    tile, _, _ = board_box(rules)
    size = max(3, int(tile * 0.72))
    bar = max(1, int(tile * 0.08))
    for age in range(world.num_units[owner] - 1, -1, -1):
        slot = unit_slot(world, owner, age)
        health = int(world.unit_health[owner, slot])
        if health <= 0:
            continue
        kind = world.unit_kind[owner, slot]
        y, x = unit_place(world, rules, owner, side, slot)
        top, left = int(y - size / 2.0), int(x - size / 2.0)
        d.draw_sprite(image, UNIT_SPRITES[kind], PALETTES[side], top, left, size, side == 1)
        share = health / rules.unit_health[kind]
        d.draw_bar(image, top - bar, left, bar, size, share, HEALTHY, HURT)


@compiled_compact
def paint_shots(world: Any, rules: Any, owner: int, side: int, image: Any) -> None:
    """Projectiles on their way from tower to target."""
    tile, top, left = board_box(rules)
    radius = max(1, int(tile * 0.09))
    for tower in range(world.num_towers[owner]):
        target = world.shot_target[owner, tower]
        flight = world.shot_flight_ticks[owner, tower]
        if target == s.NO_TARGET or flight == 0:
            continue
        column = world.tower_column[owner, tower] + 0.5
        if side == 1:
            column = rules.columns - column
        x = left + column * tile
        y = top + (world.tower_row[owner, tower] + 0.3) * tile
        done = 1.0 - world.shot_ticks[owner, tower] / (flight + 1.0)
        y_target, x_target = unit_place(world, rules, 1 - owner, 1 - side, target)
        x += done * (x_target - x)
        y += done * (y_target - y)
        fill_disc(image, int(y), int(x), radius, SHOT)


@compiled_compact
def paint_player(world: Any, rules: Any, owner: int, side: int, image: Any) -> None:
    """A player's half of the bar on top: health, gold, income, lumber."""
    half = IMAGE_WIDTH // 2 - 64
    left = MARGIN if side == 0 else IMAGE_WIDTH - MARGIN - half
    fill_box(image, MARGIN, left, HUD_HEIGHT - MARGIN, half, PANEL)
    edge = left if side == 0 else left + half - 6
    fill_box(image, MARGIN, edge, HUD_HEIGHT - MARGIN, 6, SIDE_COLOURS[side])
    health = max(0, int(world.health[owner]))
    d.draw_bar(
        image, MARGIN + 10, left + 66, 16, half - 84, health / rules.start_health, HEALTHY, HURT
    )
    d.draw_number(image, health, MARGIN + 8, left + 18, 4, INK, False)
    row = MARGIN + 40
    fill_disc(image, row + 8, left + 26, 8, GOLD)
    d.draw_number(image, int(world.gold[owner]), row, left + 42, 3, INK, False)
    d.draw_number(image, int(world.income[owner]), row, left + 132, 3, GOLD, True)
    fill_box(image, row + 1, left + 226, 14, 18, LUMBER)
    d.draw_number(image, int(world.lumber[owner]), row, left + 252, 3, INK, False)


@compiled_compact
def paint_clock(world: Any, rules: Any, image: Any) -> None:
    """Ticks played, time to the next income and time left, in the middle of the top."""
    left = IMAGE_WIDTH // 2 - 48
    d.draw_number(image, int(world.tick[0]), MARGIN + 8, left, 4, INK, False)
    waited = 1.0 - ticks_to_income(world, rules) / rules.income_interval_ticks
    d.draw_bar(image, MARGIN + 38, left, 8, 96, waited, GOLD, DIM)
    played = world.tick[0] / rules.max_ticks
    d.draw_bar(image, MARGIN + 52, left, 8, 96, 1.0 - played, INK, DIM)


@compiled_compact
def paint_cursor(world: Any, rules: Any, owner: int, side: int, image: Any) -> None:
    """A frame around the cell of a player's cursor."""
    tile, board_top, board_left = board_box(rules)
    column = seen_column(rules, world.cursor[owner, 1], side == 1)
    top = int(board_top + world.cursor[owner, 0] * tile)
    left = int(board_left + column * tile)
    size, line = int(tile), max(1, int(tile * 0.07))
    d.draw_corners(image, top, left, size, size, line, CURSOR_COLOUR)


@compiled_compact
def paint(world: Any, rules: Any, viewer: int, image: Any) -> None:
    """The whole picture, the viewer on the left; image uint8 [3, IMAGE_HEIGHT, IMAGE_WIDTH]."""
    left_player = max(0, viewer)
    paint_ground(rules, image)
    for side in range(s.NUM_PLAYERS):
        owner = left_player if side == 0 else 1 - left_player
        paint_towers(world, rules, owner, side, image)
        if rules.action_space == rb.CLASSIC and (side == 0 or viewer == SPECTATOR):
            paint_cursor(world, rules, owner, side, image)
    for side in range(s.NUM_PLAYERS):
        owner = left_player if side == 0 else 1 - left_player
        paint_units(world, rules, owner, side, image)
        paint_player(world, rules, owner, side, image)
    for side in range(s.NUM_PLAYERS):
        paint_shots(world, rules, left_player if side == 0 else 1 - left_player, side, image)
    paint_clock(world, rules, image)


@compiled_compact
def gray_cell(image: Any, rules: Any, row: int, column: int, level: int) -> None:
    """Fill the pixels of a cell."""
    row, column = int(row), int(column)
    d.fill_gray_cell(image, GRAY_BARS, row, column, rules.rows, rules.columns, level)


@compiled_compact
def paint_gray(world: Any, rules: Any, player: int, out: Any) -> None:
    """The small picture, uint8 [1, GRAY_SIDE, GRAY_SIDE]: four bars over the board.

    The bars are own and enemy health, own gold and own income (log scale).
    """
    image = out[0]
    enemy = 1 - player
    image[:] = 0
    shares = (
        max(0, int(world.health[player])) / rules.start_health,
        max(0, int(world.health[enemy])) / rules.start_health,
        LOG_LEVELS[min(len(LOG_LEVELS) - 1, int(world.gold[player]))] / 255.0,
        LOG_LEVELS[min(len(LOG_LEVELS) - 1, int(world.income[player]))] / 255.0,
    )
    for bar in range(4):
        image[bar * 3 : bar * 3 + 2, : int(shares[bar] * GRAY_SIDE)] = 140 + 30 * bar
    for row in range(rules.rows):
        for column in range(rules.columns):
            gray_cell(image, rules, row, column, GRAY_TERRAIN[ground_kind(rules, column)])
    for side in range(s.NUM_PLAYERS):
        owner = enemy if side == 1 else player
        level = GRAY_ENEMY_TOWER if side == 1 else GRAY_OWN_TOWER
        for tower in range(world.num_towers[owner]):
            column = seen_column(rules, world.tower_column[owner, tower], side == 1)
            shade = level + 8 * world.tower_kind[owner, tower]
            gray_cell(image, rules, world.tower_row[owner, tower], column, shade)
    if rules.action_space == rb.CLASSIC:
        gray_cell(image, rules, world.cursor[player, 0], world.cursor[player, 1], GRAY_CURSOR)
    for side in range(s.NUM_PLAYERS):
        owner = enemy if side == 1 else player
        level = GRAY_ENEMY_UNIT if side == 1 else GRAY_OWN_UNIT
        for age in range(world.num_units[owner]):
            slot = unit_slot(world, owner, age)
            if world.unit_health[owner, slot] > 0:
                column = seen_column(rules, world.unit_column[owner, slot], side == 1)
                shade = level - 8 * int(world.unit_kind[owner, slot])
                gray_cell(image, rules, world.unit_row[owner, slot], column, shade)


observe_image = loop_over_seats(paint, s.world_at, compact=True)  # out [B, P, 3, h, w]
observe_gray = loop_over_seats(paint_gray, s.world_at, compact=True)  # out [B, P, 1, 84, 84]
draw = d.make_draw(paint, s.world_at, IMAGE_HEIGHT, IMAGE_WIDTH)
