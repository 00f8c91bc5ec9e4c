"""Renders a world of Deep Maze for people, and as the observations `image` and `gray`.

Only reads the state. A seat's view shows the seat in green. Cells that it never saw are dark, cells
that it does not see now are dim. The spectator sees all, with dots along the shortest paths.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games import drawing as d
from marl_cair.games.compiled import compiled_compact
from marl_cair.games.deep_maze import observation as obs
from marl_cair.games.deep_maze import state as s
from marl_cair.games.deep_maze.sight import knows, sees
from marl_cair.games.deep_maze.tables import NUM_MOVES
from marl_cair.games.drawing import SPECTATOR, fill_box, fill_disc
from marl_cair.games.loops import loop_over_seats

IMAGE_WIDTH, IMAGE_HEIGHT = 640, 480
GRAY_SIDE = 84
GRAY_BAR = 4  # rows of the gray picture that show the time
BOARD_SIDE, MARGIN, FRAME = 456, 8, 4  # pixels
PANEL_LEFT = BOARD_SIDE + 2 * (MARGIN + FRAME)
LEAST_SHADED = 6  # least pixels along a cell whose wall has an edge
BACKGROUND, PANEL, INK, TRACK, FRAME_COLOUR, UNSEEN, FOG = d.read_colours(
    "181a22 242732 eef0f6 464b5c 2e3446 0f1016 141620"
)
WALL_TOP, WALL_FACE, FLOOR, FLOOR_2, GOAL_RED, GOAL_WHITE, PATH, DARK, WHITE = d.read_colours(
    "5c688a 3e4762 f4efe2 ece6d6 d63031 ffd6d0 ffb03b 1a1e26 ffffff"
)
# Self (and seat 0 for the spectator), the others, and last the hunter of a chase.
PLAYER_COLOURS = d.read_colours("27ae60 3478d8 9b59b6 e69123 b01e3e")
HUNTER_COLOUR = 4
FOG_PERCENT = 52

# Colours of the picture at cell scale: the original's, and three for roles that it lacks.
CELL_OPEN, CELL_WALL, CELL_SELF, CELL_GOAL, CELL_UNKNOWN, CELL_RIVAL, CELL_MATE, CELL_HUNTER = (
    d.read_colours("ffffff 000000 00ff00 ff0000 696969 0000ff 00c8c8 ffa000")
)
# Levels of `gray`; cells that are remembered but not seen now are darker.
GRAY_WALL, GRAY_OPEN, GRAY_SELF, GRAY_GOAL, GRAY_RIVAL, GRAY_MATE = 50, 120, 200, 255, 230, 175
GRAY_HUNTER, GRAY_REMEMBERED = 150, 15
# By `role_of`.
ROLE_COLOURS: NDArray[np.uint8] = np.stack([CELL_SELF, CELL_MATE, CELL_RIVAL, CELL_HUNTER])
ROLE_GRAYS: NDArray[np.int64] = np.array([GRAY_SELF, GRAY_MATE, GRAY_RIVAL, GRAY_HUNTER], np.int64)


@compiled_compact
def cell_edge(rules: Any, index: int, count: int) -> int:
    """First pixel of row or column `index` of `count`; the board is centred in a square."""
    side = int(max(rules.rows, rules.columns))
    margin = (side - count) * BOARD_SIDE // (2 * side)
    return MARGIN + FRAME + margin + index * BOARD_SIDE // side


@compiled_compact
def cell_box(rules: Any, cell: int) -> tuple[int, int, int, int]:
    """Top, left, height and width of a cell in pixels."""
    row, column = cell // rules.columns, cell % rules.columns
    top, left = cell_edge(rules, row, rules.rows), cell_edge(rules, column, rules.columns)
    height = cell_edge(rules, row + 1, rules.rows) - top
    return top, left, height, cell_edge(rules, column + 1, rules.columns) - left


@compiled_compact
def shows_face(world: Any, rules: Any, viewer: int, cell: int) -> bool:
    """Whether the front of a wall shows: there is no wall below it that the viewer knows."""
    below = cell + rules.columns
    if below >= world.walls.shape[0] or world.walls[below] != s.WALL:
        return True
    return viewer != SPECTATOR and not knows(world, rules, viewer, below)


@compiled_compact
def paint_cell(world: Any, rules: Any, viewer: int, cell: int, image: Any) -> None:
    """Floor or wall as the viewer knows it, with a front edge where the floor begins below."""
    top, left, height, width = cell_box(rules, cell)
    if viewer != SPECTATOR and not knows(world, rules, viewer, cell):
        fill_box(image, top, left, height, width, UNSEEN)
        return
    if world.walls[cell] == s.WALL:
        fill_box(image, top, left, height, width, WALL_TOP)
        if height >= LEAST_SHADED and shows_face(world, rules, viewer, cell):
            face = max(2, height // 4)
            fill_box(image, top + height - face, left, face, width, WALL_FACE)
    else:
        is_even = (cell // rules.columns + cell % rules.columns) % 2 == 0
        fill_box(image, top, left, height, width, FLOOR if is_even else FLOOR_2)
    if viewer != SPECTATOR and not sees(world, rules, viewer, cell):
        d.shade_box(image, top, left, height, width, FOG, FOG_PERCENT)


@compiled_compact
def paint_goal(rules: Any, cell: int, image: Any) -> None:
    """A flag on a red floor."""
    top, left, height, width = cell_box(rules, cell)
    fill_box(image, top, left, height, width, GOAL_RED)
    if height < 2 * LEAST_SHADED:
        return
    pole = max(1, width // 12)
    x = left + width // 3
    fill_box(image, top + height // 6, x, height - height // 3, pole, WHITE)
    flag = height // 3
    for line in range(flag):
        length = (width // 2) * (flag - abs(2 * line - flag)) // flag
        fill_box(image, top + height // 6 + line, x + pole, 1, length, GOAL_WHITE)


@compiled_compact
def paint_path(world: Any, rules: Any, player: int, colour: Any, image: Any) -> None:
    """Paint dots along a shortest path of a seat to the goal."""
    cell = int(world.cell[player])
    while world.distance[cell] > 1:
        for move in range(NUM_MOVES):
            beside = int(rules.neighbours[cell, move])
            if world.distance[beside] == world.distance[cell] - 1:
                cell = beside
                break
        top, left, size, _ = cell_box(rules, cell)
        fill_disc(image, top + size // 2, left + size // 2, max(1, size // 9), colour)


@compiled_compact
def player_colour(rules: Any, viewer: int, player: int) -> int:
    """The row of PLAYER_COLOURS of a seat in a viewer's picture."""
    if obs.is_hunter(rules, player):
        return HUNTER_COLOUR
    return int((player - max(0, viewer)) % HUNTER_COLOUR)


@compiled_compact
def paint_player(world: Any, rules: Any, viewer: int, player: int, image: Any) -> None:
    """Paint a seat as a disc with eyes in its direction; the hunter has brows."""
    cell, came_from = int(world.cell[player]), int(world.came_from[player])
    top, left, height, width = cell_box(rules, cell)
    size = min(height, width)
    y, x = top + size // 2, left + size // 2
    radius = max(1, size * 2 // 5)
    colour = PLAYER_COLOURS[player_colour(rules, viewer, player)]
    if size < LEAST_SHADED:
        fill_box(image, top, left, size, size, colour)
        return
    fill_disc(image, y, x, radius, DARK)
    fill_disc(image, y, x, radius - max(1, size // 16), colour)
    if size < 2 * LEAST_SHADED:
        return
    down, across = 0, 0
    if came_from != cell:
        down = cell // rules.columns - came_from // rules.columns
        across = cell % rules.columns - came_from % rules.columns
    apart, eye = max(1, radius * 2 // 5), max(1, radius // 4)
    y_eyes = y + down * radius // 4 - (radius // 8)
    for side in range(2):
        x_eye = x + (2 * side - 1) * apart + across * radius // 4
        fill_disc(image, y_eyes, x_eye, eye, WHITE)
        fill_disc(
            image, y_eyes + down * eye // 2, x_eye + across * eye // 2, max(1, eye // 2), DARK
        )
        if obs.is_hunter(rules, player):
            brow = max(1, eye // 2)
            fill_box(image, y_eyes - eye - brow // 2, x_eye - eye, brow + 1, 2 * eye + 1, DARK)


@compiled_compact
def paint_board(world: Any, rules: Any, viewer: int, image: Any) -> None:
    """Paint frame, cells, goal, paths and all seats that the viewer sees, itself on top."""
    top = cell_edge(rules, 0, rules.rows) - FRAME
    left = cell_edge(rules, 0, rules.columns) - FRAME
    height = cell_edge(rules, rules.rows, rules.rows) - top + FRAME
    width = cell_edge(rules, rules.columns, rules.columns) - left + FRAME
    fill_box(image, top, left, height, width, FRAME_COLOUR)
    for cell in range(world.walls.shape[0]):
        paint_cell(world, rules, viewer, cell, image)
    goal = int(world.clock[s.GOAL])
    if viewer == SPECTATOR or knows(world, rules, viewer, goal):
        paint_goal(rules, goal, image)
    if viewer == SPECTATOR:
        for player in range(rules.num_players):
            if world.is_caught[player] == 0 and not obs.is_hunter(rules, player):
                paint_path(world, rules, player, PATH, image)
    for player in range(rules.num_players - 1, -1, -1):
        if player == viewer or world.is_caught[player] != 0:
            continue
        if viewer == SPECTATOR or obs.sees_player(world, rules, viewer, player):
            paint_player(world, rules, viewer, player, image)
    if viewer != SPECTATOR:
        paint_player(world, rules, viewer, viewer, image)


@compiled_compact
def paint_panel(world: Any, rules: Any, viewer: int, image: Any) -> None:
    """Moves made, the bars of time and preview, mazes of a sequence, and the seats in play.

    The spectator's picture also shows the optimal number of moves of each seat.
    """
    width = IMAGE_WIDTH - PANEL_LEFT - MARGIN
    fill_box(image, MARGIN, PANEL_LEFT, IMAGE_HEIGHT - 2 * MARGIN, width, PANEL)
    left, inner = PANEL_LEFT + 12, width - 24
    d.draw_number(image, int(world.clock[s.TICK]), MARGIN + 14, left, 6, INK, False)
    share = obs.time_left(world, rules) / rules.max_ticks
    d.draw_bar(image, MARGIN + 56, left, 8, inner, share, INK, TRACK)
    if rules.preview_moves > 0:
        share = obs.preview_left(world, rules) / rules.preview_moves
        d.draw_bar(image, MARGIN + 70, left, 8, inner, share, PATH, TRACK)
    for maze in range(min(rules.num_mazes, inner // 12) if rules.num_mazes > 1 else 0):
        colour = GOAL_RED if maze < world.clock[s.MAZE] else TRACK
        fill_box(image, MARGIN + 84, left + 12 * maze, 9, 9, colour)
    top = MARGIN + 108
    for player in range(rules.num_players):
        if viewer not in (SPECTATOR, player):
            continue
        is_caught = world.is_caught[player] != 0
        colour = PLAYER_COLOURS[player_colour(rules, viewer, player)]
        fill_disc(image, top + 12, left + 12, 12, TRACK if is_caught else colour)
        if viewer == SPECTATOR:
            optimal = int(world.optimal[player] + world.clock[s.EARLIER_OPTIMAL])
            d.draw_number(
                image, optimal, top + 2, left + 36, 4, TRACK if is_caught else PATH, False
            )
        top += 36


@compiled_compact
def paint(world: Any, rules: Any, viewer: int, image: Any) -> None:
    """The whole picture: image uint8 [3, IMAGE_HEIGHT, IMAGE_WIDTH]."""
    fill_box(image, 0, 0, IMAGE_HEIGHT, IMAGE_WIDTH, BACKGROUND)
    paint_board(world, rules, viewer, image)
    paint_panel(world, rules, viewer, image)


draw = d.make_draw(paint, s.world_at, IMAGE_HEIGHT, IMAGE_WIDTH)


@compiled_compact
def paint_cells(world: Any, rules: Any, player: int, image: Any) -> None:
    """The board in the original's colours, `cell_pixels` along a cell."""
    size = rules.cell_pixels
    for cell in range(world.walls.shape[0]):
        colour = CELL_WALL if world.walls[cell] == s.WALL else CELL_OPEN
        if not knows(world, rules, player, cell):
            colour = CELL_UNKNOWN
        elif cell == world.clock[s.GOAL]:
            colour = CELL_GOAL
        row, column = cell // rules.columns, cell % rules.columns
        fill_box(image, row * size, column * size, size, size, colour)
    for turn in range(rules.num_players):
        other = (player + 1 + turn) % rules.num_players  # the seat itself comes last
        if other != player and not obs.sees_player(world, rules, player, other):
            continue
        row, column = divmod(int(world.cell[other]), rules.columns)
        colour = ROLE_COLOURS[obs.role_of(rules, player, other)]
        fill_box(image, row * size, column * size, size, size, colour)


@compiled_compact
def gray_cell(image: Any, rules: Any, cell: int, level: int) -> None:
    """Fill the pixels of a cell."""
    row, column = cell // rules.columns, cell % rules.columns
    d.fill_gray_cell(image, GRAY_BAR, row, column, rules.rows, rules.columns, level)


@compiled_compact
def paint_gray(world: Any, rules: Any, player: int, out: Any) -> None:
    """The small picture, uint8 [1, GRAY_SIDE, GRAY_SIDE]: a bar of the time left over the board."""
    image = out[0]
    image[:] = 0
    image[: GRAY_BAR - 1, : GRAY_SIDE * obs.time_left(world, rules) // rules.max_ticks] = GRAY_OPEN
    for cell in range(world.walls.shape[0]):
        if not knows(world, rules, player, cell):
            continue
        level = GRAY_WALL if world.walls[cell] == s.WALL else GRAY_OPEN
        if not sees(world, rules, player, cell):
            level -= GRAY_REMEMBERED
        gray_cell(image, rules, cell, level)
    goal = int(world.clock[s.GOAL])
    if knows(world, rules, player, goal):
        gray_cell(image, rules, goal, GRAY_GOAL)
    for other in range(rules.num_players):
        if other != player and obs.sees_player(world, rules, player, other):
            level = ROLE_GRAYS[obs.role_of(rules, player, other)]
            gray_cell(image, rules, int(world.cell[other]), level)
    level = ROLE_GRAYS[obs.role_of(rules, player, player)]
    gray_cell(image, rules, int(world.cell[player]), level)


@compiled_compact
def see_image(world: Any, rules: Any, player: int, image: Any) -> None:
    """A seat's picture uint8 [3, h, w]: 480 x 640, or rows and columns times `cell_pixels`."""
    if rules.cell_pixels > 0:
        paint_cells(world, rules, player, image)
    else:
        paint(world, rules, player, image)


observe_image = loop_over_seats(see_image, s.world_at, compact=True)  # out [B, P, 3, h, w]
observe_gray = loop_over_seats(paint_gray, s.world_at, compact=True)  # out [B, P, 1, 84, 84]
