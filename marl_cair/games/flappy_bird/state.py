"""The state of Flappy Bird: struct of arrays, first axis B worlds.

Positions are in hundredths of a pixel from the left and the top, velocities in hundredths per tick,
downwards positive. A bird's position is its upper left corner, a pipe's its middle.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.flappy_bird.scenarios import Scenario
from marl_cair.games.game_package import allocate_world
from marl_cair.games.loops import make_world_at

RUNNING, TERMINATED, TRUNCATED = range(3)
GLIDING, FLAPPED, STARTING = range(3)  # a bird at its start flaps by itself in the first tick
NEVER = -1  # of crash_tick
COURSE, GUSTS = range(2)  # random words: gaps, wind

# A frame: what a past picture showed, as far as it is not in the state itself.
NUM_FRAMES = 4
FRAME_TICK, FRAME_WIND, FRAME_BIRDS = range(3)  # then for each bird:
FRAME_Y, FRAME_FLIGHT = range(2)  # its height; its velocity, the motion in the lowest two bits
NUM_BIRD_NUMBERS, MOTION_BITS = 2, 2


class World(NamedTuple):
    """B worlds (arrays [B, ...]), or one world (the same fields without B).

    P players, 3 pipes, F = 2 + 2 P numbers of a frame.
    """

    tick: Annotated[NDArray[np.int32], "1"]  # ticks played
    phase: Annotated[NDArray[np.int8], "1"]  # RUNNING, TERMINATED or TRUNCATED
    winner: Annotated[NDArray[np.int8], "1"]  # seat, or NO_WINNER
    random: Annotated[NDArray[np.uint64], "2"]  # generator words of COURSE and GUSTS
    pipe_x: Annotated[NDArray[np.int32], "3"]  # hundredths of a pixel
    gap_top: Annotated[NDArray[np.int16], "3"]  # upper edge of each pipe's gap, pixels
    former_x: Annotated[NDArray[np.int32], "3"]  # where each pipe was before it came back last
    former_gap: Annotated[NDArray[np.int16], "3"]  # and the upper edge of its gap then
    wind: Annotated[NDArray[np.int16], "1"]  # hundredths of a pixel per tick, downwards
    gust_ticks: Annotated[NDArray[np.int16], "1"]  # ticks until the wind turns
    bird_y: Annotated[NDArray[np.int32], "P"]  # hundredths of a pixel
    velocity: Annotated[NDArray[np.int16], "P"]  # hundredths of a pixel per tick
    motion: Annotated[NDArray[np.int8], "P"]  # GLIDING, FLAPPED (in the last tick) or STARTING
    pipes_passed: Annotated[NDArray[np.int32], "P"]
    crash_tick: Annotated[NDArray[np.int32], "P"]  # ticks played when the bird crashed, or NEVER
    illegal: Annotated[NDArray[np.int32], "P"]  # illegal actions since reset
    newest_frame: Annotated[NDArray[np.int8], "1"]  # its place in the ring `film`
    film: Annotated[NDArray[np.int32], "4 F"]  # frames of the last steps, see FRAME_...


def allocate(scenario: Scenario, num_worlds: int) -> World:
    """Zeroed arrays for `num_worlds` worlds; play starts with `rules.reset`."""
    players = scenario.num_players
    numbers = FRAME_BIRDS + NUM_BIRD_NUMBERS * players
    return allocate_world(World, num_worlds, P=players, F=numbers)


world_at = make_world_at(World)
