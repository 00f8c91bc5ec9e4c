"""The state of Flappy Bird: struct of arrays, first axis B worlds.

Positions are in hundredths of a pixel from the left and the top, velocities in hundredths per tick,
downwards positive. A bird's position is its upper left corner, a pipe's its middle.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.compiled import make_world_at
from marl_cair.games.flappy_bird.scenarios import Scenario
from marl_cair.games.flappy_bird.tables import NUM_PIPES

RUNNING, TERMINATED, TRUNCATED = range(3)
GLIDING, FLAPPED, STARTING = range(3)  # a bird at its start flaps by itself in the first tick
NEVER = -1  # of crash_tick
COURSE, GUSTS = range(2)  # random words: gaps, wind

# A frame of the film: what is needed beside the state to tell what a past picture showed.
NUM_FRAMES = 4
FRAME_TICK, FRAME_WIND, FRAME_BIRDS = range(3)  # then for each bird:
FRAME_Y, FRAME_FLIGHT = range(2)  # its height; its velocity, the motion in the lowest two bits
NUM_BIRD_NUMBERS, MOTION_BITS = 2, 2


class World(NamedTuple):
    """B worlds (arrays [B, ...]), or one world (the same fields without B).

    P players, 3 pipes.
    """

    tick: NDArray[np.int32]  # [B, 1] ticks played
    phase: NDArray[np.int8]  # [B, 1] RUNNING, TERMINATED or TRUNCATED
    winner: NDArray[np.int8]  # [B, 1] seat, or NO_WINNER
    random: NDArray[np.uint64]  # [B, 2] generator words of COURSE and GUSTS
    pipe_x: NDArray[np.int32]  # [B, 3] hundredths of a pixel
    gap_top: NDArray[np.int16]  # [B, 3] upper edge of each pipe's gap, pixels
    former_x: NDArray[np.int32]  # [B, 3] where each pipe was before it came back last
    former_gap: NDArray[np.int16]  # [B, 3] and the upper edge of its gap then
    wind: NDArray[np.int16]  # [B, 1] hundredths of a pixel per tick, downwards
    gust_ticks: NDArray[np.int16]  # [B, 1] ticks until the wind turns
    bird_y: NDArray[np.int32]  # [B, P] hundredths of a pixel
    velocity: NDArray[np.int16]  # [B, P] hundredths of a pixel per tick
    motion: NDArray[np.int8]  # [B, P] GLIDING, FLAPPED (in the last tick) or STARTING
    pipes_passed: NDArray[np.int32]  # [B, P]
    crash_tick: NDArray[np.int32]  # [B, P] ticks played when the bird crashed, or NEVER
    illegal: NDArray[np.int32]  # [B, P] illegal actions since reset
    newest_frame: NDArray[np.int8]  # [B, 1] of the film, a ring
    film: NDArray[np.int32]  # [B, 4, 2 + 2 P] the last decisions' frames, see FRAME_...


def allocate(scenario: Scenario, num_worlds: int) -> World:
    """Zeroed arrays for `num_worlds` worlds; play starts with `rules.reset`."""
    players = scenario.num_players

    def zeros(dtype: Any, *shape: int) -> NDArray[Any]:
        return np.zeros((num_worlds, *shape), dtype)

    return World(
        tick=zeros(np.int32, 1),
        phase=zeros(np.int8, 1),
        winner=zeros(np.int8, 1),
        random=zeros(np.uint64, 2),
        pipe_x=zeros(np.int32, NUM_PIPES),
        gap_top=zeros(np.int16, NUM_PIPES),
        former_x=zeros(np.int32, NUM_PIPES),
        former_gap=zeros(np.int16, NUM_PIPES),
        wind=zeros(np.int16, 1),
        gust_ticks=zeros(np.int16, 1),
        bird_y=zeros(np.int32, players),
        velocity=zeros(np.int16, players),
        motion=zeros(np.int8, players),
        pipes_passed=zeros(np.int32, players),
        crash_tick=zeros(np.int32, players),
        illegal=zeros(np.int32, players),
        newest_frame=zeros(np.int8, 1),
        film=zeros(np.int32, NUM_FRAMES, FRAME_BIRDS + NUM_BIRD_NUMBERS * players),
    )


world_at = make_world_at(World)
