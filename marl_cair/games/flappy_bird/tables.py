"""The numbers of Flappy Bird, in pixels and ticks of 1/30 s.

Source, where no other is named: PyGame Learning Environment (github.com/ntasfi/PyGame-Learning-
Environment, commit 3dbe79d), ple/games/flappybird/__init__.py: its class and the size of its
pictures. Positions are floats there and here in whole hundredths of a pixel, which hold
all of its numbers exactly.
"""

from __future__ import annotations

NOOP, FLAP = range(2)  # the actions

HUNDREDTHS = 100  # of a pixel: the unit of positions and speeds in the state
TICKS_PER_SECOND = 30  # `allowed_fps`

SCREEN_WIDTH, SCREEN_HEIGHT = 288, 512
# The ground begins at 0.79 of the height, the bird dies when it reaches it: 404.48.
GROUND_TOP_HUNDREDTHS = 40_448
GROUND_TOP = GROUND_TOP_HUNDREDTHS // HUNDREDTHS  # where it is drawn

BIRD_WIDTH, BIRD_HEIGHT = 34, 24
BIRD_X = 57  # left edge: int(0.2 * 288)
START_Y = 256  # top edge: half the height
GRAVITY = 1  # pixels per tick, added to the velocity at each tick
FLAP_IMPULSE = 9  # pixels per tick, upwards, from a velocity of 0
MAX_FALL = 10  # pixels per tick
# Velocity after a flap: gravity has acted once when the impulse does.
FLAP_VELOCITY = GRAVITY - FLAP_IMPULSE

PIPE_WIDTH = 52
PIPE_GAP = 100
PIPE_SPEED = 4.0  # pixels per tick
NUM_PIPES = 3
# Centres of the pipes at the start: 288 + 52 and then half a screen further each.
FIRST_PIPES_X = (340, 484, 628)
# A pipe whose centre is left of -52 comes back with its centre at 288 + 52 + 0.2 * 288.
RENEW_BELOW_X = -PIPE_WIDTH
RENEWED_X_HUNDREDTHS = 39_760
# A pipe and a bird can only touch when the bird is this far in: half its width, since PLE tests a
# box that lies half a bird further left than the bird that it draws.
TOUCH_DEPTH = BIRD_WIDTH // 2


def gap_tops(pipe_gap: int) -> tuple[int, int]:
    """The highest and the lowest upper edge of a gap, pixels from the top; all are as likely."""
    return pipe_gap // 4, int(SCREEN_HEIGHT * 0.79 * 0.6 - pipe_gap / 2)


# Of our own: gusts push all birds up or down, evenly within the scenario's wind.
GUST_TICKS_MIN, GUST_TICKS_MAX = 15, 45
MAX_WIND = 3.0  # pixels per tick
MAX_SPEED = 12.0  # pixels per tick
MIN_SPEED = 1.0
MAX_GAP = 300
MAX_PLAYERS = 8
# With one flap in 20 ticks no bird keeps its height. With 12 of the fastest, a pipe that came back
# within four steps has done so once, as `frames` needs.
MAX_TICKS_PER_STEP = 12
