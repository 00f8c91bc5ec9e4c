"""State of Flash games: what each browser showed and reported last; first axis B worlds."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.flash.scenarios import Scenario
from marl_cair.games.game_package import allocate_world

RUNNING, TERMINATED, TRUNCATED = range(3)  # of phase
SIDE = 84  # of the small pictures
NUM_FRAMES = 4  # of `gray_stack`


class World(NamedTuple):
    """B worlds. P players, K keys of a player, V numbers; the game itself is in the browser."""

    slot: Annotated[NDArray[np.int32], ""]  # which browser plays it
    tick: Annotated[NDArray[np.int32], ""]  # frames since the game began
    phase: Annotated[NDArray[np.uint8], ""]
    score: Annotated[NDArray[np.float64], "P"]
    held: Annotated[NDArray[np.bool_], "P K"]  # keys that are down
    picture: Annotated[NDArray[np.uint8], "3 S S"]  # of the whole SWF
    film: Annotated[NDArray[np.uint8], "F S S"]  # luma of the last steps, the newest last
    numbers: Annotated[NDArray[np.float32], "P V"]
    illegal: Annotated[NDArray[np.int32], "P"]  # illegal actions since reset


def allocate(scenario: Scenario, num_worlds: int) -> World:
    """Zeroed arrays for `num_worlds` worlds."""
    from marl_cair.games.flash.description import find_description

    described = find_description(scenario.description)
    keys = described.keys
    sizes = {"P": len(keys), "K": len(keys[0]), "V": len(described.numbers)}
    worlds = allocate_world(World, num_worlds, S=SIDE, F=NUM_FRAMES, **sizes)
    worlds.slot[:] = np.arange(num_worlds)
    return worlds
