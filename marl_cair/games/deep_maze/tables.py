"""The numbers of Deep Maze: actions, rewards, sizes and the original's settings, with their source.

"Original" is the public code of the thesis's maze: v1 of January 2018 (which its experiments used)
and v2 of March 2018.
"""

from __future__ import annotations

ACTION_NAMES = ("down", "up", "left", "right", "noop")  # the original's four, in its order
DOWN, UP, LEFT, RIGHT, NOOP = range(len(ACTION_NAMES))
NUM_MOVES = 4
ROW_STEP = (1, -1, 0, 0)  # rows that a move goes down
COLUMN_STEP = (0, 0, -1, 1)  # columns that it goes to the right

MAX_PLAYERS = 4

GOAL_REWARD = 1.0  # original: for the move that reaches the goal
STEP_REWARD = -0.01  # original: for every other move
EXCESS_REWARD = -1.0  # thesis: for each move beyond the optimal count

ORIGINAL_MAZE_SEED = 1337  # v1, of its deterministic mazes
ORIGINAL_VISION_CELLS = 3  # v2
ORIGINAL_PREVIEW_MOVES = 5  # v2: all is seen so long in its timed variants

# v1: seeds of walls for each pair of rows and columns at density 1, and how far a wall grows for
# each row and column at complexity 1.
GROWTH_STEPS_PER_SIDE_CELL = 5

# Sizes of the thesis (7 to 55) with a time limit in moves. A uniform random walk from corner to
# corner takes 790 moves on 7x7 and 1,503 on 9x9 (measured), the shortest way 12 and 16; the
# original's experiments stopped at 1,000 moves on 25x25. Each limit is above the number of cells,
# so that no way is too long.
MAX_TICKS_OF_SIZE = {
    7: 200,
    9: 300,
    11: 400,
    13: 500,
    15: 600,
    19: 800,
    25: 1_000,
    35: 2_000,
    55: 5_000,
}
