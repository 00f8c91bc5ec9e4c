"""The state of Tug of war: arrays whose first axis is the world."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class World(NamedTuple):
    """B worlds, 2 players."""

    tick: NDArray[np.int32]  # [B] ticks played
    rope: NDArray[np.int32]  # [B] positive: towards player 0
    stamina: NDArray[np.int32]  # [B, 2]
    is_over: NDArray[np.bool_]  # [B]
    random: NDArray[np.uint64]  # [B, 1] generator word
    illegal: NDArray[np.int32]  # [B, 2] illegal actions since reset


def allocate(scenario, num_worlds):
    """Zeroed arrays for `num_worlds` worlds."""
    return World(
        tick=np.zeros(num_worlds, np.int32),
        rope=np.zeros(num_worlds, np.int32),
        stamina=np.zeros((num_worlds, 2), np.int32),
        is_over=np.zeros(num_worlds, np.bool_),
        random=np.zeros((num_worlds, 1), np.uint64),
        illegal=np.zeros((num_worlds, 2), np.int32),
    )
