"""Renders a world of Deep Line Wars for people, and as the observations `image` and `gray`.

Only reads the state. A seat's own view has its base on the left and itself in blue; the enemy's
cursor, which is hidden from it, is not drawn. The spectator sees seat 0 on the left.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import compiled_compact
from marl_cair.games.deep_line_wars.observation import (
    LOG_LEVELS,
    ticks_to_income,
)
from marl_cair.games.deep_line_wars.rulebook import CENTRE, CLASSIC, ENEMY_HALF, OWN_HALF, OWN_SPAWN
from marl_cair.games.deep_line_wars.sprites import (
    PALETTES,
    SIDE_COLOURS,
    TOWER_SPRITES,
    UNIT_SPRITES,
)
from marl_cair.games.deep_line_wars.state import NO_TARGET, NUM_PLAYERS, World, world_at
from marl_cair.games.deep_line_wars.tables import PROGRESS_PER_TILE
from marl_cair.games.drawing import (
    draw_bar,
    draw_corners,
    draw_number,
    draw_sprite,
    fill_box,
    fill_disc,
    fill_gray_cell,
)

IMAGE_WIDTH, IMAGE_HEIGHT = 800, 600
HUD_HEIGHT = 74  # pixels above the board
MARGIN = 8
GRAY_SIDE = 84
GRAY_BARS = 12  # rows of the gray picture that show the economy

BACKGROUND, PANEL, INK, DIM = np.array(
    [(22, 24, 32), (36, 39, 50), (236, 238, 244), (84, 88, 102)], np.uint8
)
HEALTHY, HURT, GOLD, LUMBER, SHOT, CURSOR_COLOUR = np.array(
    [(92, 208, 96), (222, 68, 56), (250, 204, 72), (170, 116, 66), (255, 240, 160), (94, 252, 242)],
    np.uint8,
)
# Terrain by kind, two shades each for the chequered ground.
GROUND: NDArray[np.uint8] = np.array(
    [
        [(54, 78, 140), (50, 72, 132)],  # left spawn column
        [(74, 118, 82), (68, 110, 76)],  # left half
        [(92, 96, 104), (86, 90, 98)],  # neutral
        [(104, 112, 72), (97, 105, 66)],  # right half
        [(136, 60, 62), (128, 56, 58)],  # right spawn column
    ],
    np.uint8,
)
# Levels of `gray`; units are drawn over towers, the enemy's over the own.
GRAY_TERRAIN = (40, 20, 10, 20, 40)
GRAY_OWN_TOWER, GRAY_ENEMY_TOWER, GRAY_OWN_UNIT, GRAY_ENEMY_UNIT = 110, 80, 180, 250
GRAY_CURSOR = 215


@compiled_compact
def ground_kind(rules: Any, column: int) -> int:
    """Row of GROUND for a column of the picture."""
    level = rules.terrain[column]
    if level == OWN_SPAWN:
        return 0
    if level == OWN_HALF:
        return 1
    if level == CENTRE:
        return 2
    return 3 if level == ENEMY_HALF else 4


@compiled_compact
def tile_size(rules: Any) -> float:
    """Side of a cell in pixels; the board fits below the bars."""
    across = (IMAGE_WIDTH - 2 * MARGIN) / rules.columns
    down = (IMAGE_HEIGHT - HUD_HEIGHT - 2 * MARGIN) / rules.rows
    return float(min(across, down))


@compiled_compact
def board_left(rules: Any) -> float:
    """Pixels left of the board."""
    return float((IMAGE_WIDTH - tile_size(rules) * rules.columns) / 2.0)


@compiled_compact
def board_top(rules: Any) -> float:
    """Pixels above the board."""
    room = IMAGE_HEIGHT - HUD_HEIGHT
    return float(HUD_HEIGHT + (room - tile_size(rules) * rules.rows) / 2.0)


@compiled_compact
def paint_ground(rules: Any, image: Any) -> None:
    """Background and chequered board."""
    fill_box(image, 0, 0, IMAGE_HEIGHT, IMAGE_WIDTH, BACKGROUND)
    tile, top, left = tile_size(rules), board_top(rules), board_left(rules)
    for row in range(rules.rows):
        y, below = int(top + row * tile), int(top + (row + 1) * tile)
        for column in range(rules.columns):
            x, right = int(left + column * tile), int(left + (column + 1) * tile)
            colour = GROUND[ground_kind(rules, column), (row + column) % 2]
            fill_box(image, y, x, below - y, right - x, colour)


@compiled_compact
def paint_towers(world: Any, rules: Any, owner: int, side: int, image: Any) -> None:
    """All towers of a player, who plays from the left (side 0) or from the right."""
    tile = tile_size(rules)
    size = max(3, int(tile * 0.92))
    for tower in range(world.num_towers[owner]):
        column = int(world.tower_column[owner, tower])
        if side == 1:
            column = rules.columns - 1 - column
        top = int(board_top(rules) + world.tower_row[owner, tower] * tile + (tile - size) / 2.0)
        left = int(board_left(rules) + column * tile + (tile - size) / 2.0)
        sprite = TOWER_SPRITES[world.tower_kind[owner, tower]]
        draw_sprite(image, sprite, PALETTES[side], top, left, size, side == 1)


@compiled_compact
def unit_x(world: Any, rules: Any, owner: int, side: int, slot: int) -> float:
    """Centre of a unit in pixels from the left, between cells as it walks."""
    tile = tile_size(rules)
    along = world.unit_column[owner, slot] + 0.5
    along += world.unit_progress[owner, slot] / PROGRESS_PER_TILE
    if side == 1:
        along = rules.columns - along
    return float(board_left(rules) + along * tile)


@compiled_compact
def unit_y(world: Any, rules: Any, owner: int, slot: int) -> float:
    """Centre of a unit in pixels from the top."""
    return float(board_top(rules) + (world.unit_row[owner, slot] + 0.5) * tile_size(rules))


@compiled_compact
def paint_units(world: Any, rules: Any, owner: int, side: int, image: Any) -> None:
    """The living units of a player with their health bars, the oldest on top."""
    tile = tile_size(rules)
    size = max(3, int(tile * 0.72))
    bar = max(1, int(tile * 0.08))
    slots = world.unit_kind.shape[1] - 1
    for age in range(world.num_units[owner] - 1, -1, -1):
        slot = (world.first_unit[owner] + age) & slots
        health = int(world.unit_health[owner, slot])
        if health <= 0:
            continue
        kind = world.unit_kind[owner, slot]
        left = int(unit_x(world, rules, owner, side, slot) - size / 2.0)
        top = int(unit_y(world, rules, owner, slot) - size / 2.0)
        draw_sprite(image, UNIT_SPRITES[kind], PALETTES[side], top, left, size, side == 1)
        share = health / rules.unit_health[kind]
        draw_bar(image, top - bar, left, bar, size, share, HEALTHY, HURT)


@compiled_compact
def paint_shots(world: Any, rules: Any, owner: int, side: int, image: Any) -> None:
    """Projectiles on their way from tower to target."""
    tile = tile_size(rules)
    radius = max(1, int(tile * 0.09))
    for tower in range(world.num_towers[owner]):
        target = world.shot_target[owner, tower]
        flight = world.shot_flight_ticks[owner, tower]
        if target == NO_TARGET or flight == 0:
            continue
        column = world.tower_column[owner, tower] + 0.5
        if side == 1:
            column = rules.columns - column
        x = board_left(rules) + column * tile
        y = board_top(rules) + (world.tower_row[owner, tower] + 0.3) * tile
        done = 1.0 - world.shot_ticks[owner, tower] / (flight + 1.0)
        x += done * (unit_x(world, rules, 1 - owner, 1 - side, target) - x)
        y += done * (unit_y(world, rules, 1 - owner, target) - y)
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
    draw_bar(
        image, MARGIN + 10, left + 66, 16, half - 84, health / rules.start_health, HEALTHY, HURT
    )
    draw_number(image, health, MARGIN + 8, left + 18, 4, INK, False)
    row = MARGIN + 40
    fill_disc(image, row + 8, left + 26, 8, GOLD)
    draw_number(image, int(world.gold[owner]), row, left + 42, 3, INK, False)
    draw_number(image, int(world.income[owner]), row, left + 132, 3, GOLD, True)
    fill_box(image, row + 1, left + 226, 14, 18, LUMBER)
    draw_number(image, int(world.lumber[owner]), row, left + 252, 3, INK, False)


@compiled_compact
def paint_clock(world: Any, rules: Any, image: Any) -> None:
    """Ticks played, time to the next income and time left, in the middle of the top."""
    left = IMAGE_WIDTH // 2 - 48
    draw_number(image, int(world.tick[0]), MARGIN + 8, left, 4, INK, False)
    waited = 1.0 - ticks_to_income(world, rules) / rules.interval_ticks
    draw_bar(image, MARGIN + 38, left, 8, 96, waited, GOLD, DIM)
    played = world.tick[0] / rules.max_ticks
    draw_bar(image, MARGIN + 52, left, 8, 96, 1.0 - played, INK, DIM)


@compiled_compact
def paint_cursor(world: Any, rules: Any, owner: int, side: int, image: Any) -> None:
    """A frame around the cell of a player's cursor."""
    tile = tile_size(rules)
    column = int(world.cursor[owner, 1])
    if side == 1:
        column = rules.columns - 1 - column
    top = int(board_top(rules) + world.cursor[owner, 0] * tile)
    left = int(board_left(rules) + column * tile)
    size, line = int(tile), max(1, int(tile * 0.07))
    draw_corners(image, top, left, size, size, line, CURSOR_COLOUR)


@compiled_compact
def paint(world: Any, rules: Any, left_player: int, image: Any, all_cursors: bool) -> None:
    """The whole picture, `left_player` on the left; image uint8 [3, IMAGE_HEIGHT, IMAGE_WIDTH]."""
    paint_ground(rules, image)
    for side in range(NUM_PLAYERS):
        owner = left_player if side == 0 else 1 - left_player
        paint_towers(world, rules, owner, side, image)
        if rules.action_space == CLASSIC and (side == 0 or all_cursors):
            paint_cursor(world, rules, owner, side, image)
    for side in range(NUM_PLAYERS):
        owner = left_player if side == 0 else 1 - left_player
        paint_units(world, rules, owner, side, image)
        paint_player(world, rules, owner, side, image)
    for side in range(NUM_PLAYERS):
        paint_shots(world, rules, left_player if side == 0 else 1 - left_player, side, image)
    paint_clock(world, rules, image)


@compiled_compact
def gray_cell(image: Any, rules: Any, row: int, column: int, level: int) -> None:
    """Fill the pixels of a cell."""
    row, column = int(row), int(column)
    fill_gray_cell(image, GRAY_BARS, row, column, rules.rows, rules.columns, level)


@compiled_compact
def paint_gray(world: Any, rules: Any, player: int, image: Any) -> None:
    """The small picture, uint8 [GRAY_SIDE, GRAY_SIDE]: four bars over the board.

    The bars are own and enemy health, own gold and own income (log scale).
    """
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
    for side in range(NUM_PLAYERS):
        owner = enemy if side == 1 else player
        level = GRAY_ENEMY_TOWER if side == 1 else GRAY_OWN_TOWER
        for tower in range(world.num_towers[owner]):
            column = int(world.tower_column[owner, tower])
            if side == 1:
                column = rules.columns - 1 - column
            shade = level + 8 * world.tower_kind[owner, tower]
            gray_cell(image, rules, world.tower_row[owner, tower], column, shade)
    if rules.action_space == CLASSIC:
        gray_cell(image, rules, world.cursor[player, 0], world.cursor[player, 1], GRAY_CURSOR)
    slots = world.unit_kind.shape[1] - 1
    for side in range(NUM_PLAYERS):
        owner = enemy if side == 1 else player
        level = GRAY_ENEMY_UNIT if side == 1 else GRAY_OWN_UNIT
        for age in range(world.num_units[owner]):
            slot = (world.first_unit[owner] + age) & slots
            if world.unit_health[owner, slot] > 0:
                column = int(world.unit_column[owner, slot])
                if side == 1:
                    column = rules.columns - 1 - column
                shade = level - 8 * int(world.unit_kind[owner, slot])
                gray_cell(image, rules, world.unit_row[owner, slot], column, shade)


# --- slices of worlds, and what people call ----------------------------------------------------


@compiled_compact
def observe_image(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write every seat's picture to out [B, P, 3, IMAGE_HEIGHT, IMAGE_WIDTH]."""
    for index in range(first, last):
        for player in range(NUM_PLAYERS):
            paint(world_at(worlds, index), rules, player, out[index, player], False)


@compiled_compact
def observe_gray(worlds: Any, rules: Any, out: Any, first: int, last: int) -> None:
    """Write every seat's small picture to out [B, P, 1, GRAY_SIDE, GRAY_SIDE]."""
    for index in range(first, last):
        for player in range(NUM_PLAYERS):
            paint_gray(world_at(worlds, index), rules, player, out[index, player, 0])


@compiled_compact
def paint_world(
    worlds: Any, rules: Any, index: int, left_player: int, image: Any, all_cursors: bool
) -> None:
    """`paint` of one world among many."""
    paint(world_at(worlds, index), rules, left_player, image, all_cursors)


def draw(worlds: World, rules: Any, world: int, player: int | None) -> NDArray[np.uint8]:
    """The picture of one world, uint8 [IMAGE_HEIGHT, IMAGE_WIDTH, 3]: of a seat's own view, or the
    spectator's (None).
    """
    image = np.zeros((3, IMAGE_HEIGHT, IMAGE_WIDTH), np.uint8)
    paint_world(worlds, rules, world, player or 0, image, player is None)
    return np.ascontiguousarray(image.transpose(1, 2, 0))
