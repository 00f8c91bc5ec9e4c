"""Dice, hashed from what mirrored units have in common, so that both have the same luck."""

from __future__ import annotations

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts import state as s
from marl_cair.games.randomness import GOLDEN_STEP, mix

NUM_DICE = 2
DAMAGE_DIE, SHARE_DIE = range(2)
_SHIFT_32 = np.uint64(32)


@compiled
def roll(world: Any, serial: int, die: int, low: int, high: int) -> int:
    """A uniform integer in low..high, hashed from the game's seed, the tick and the unit's serial.

    It does not depend on the seat, so the same unit of a mirrored player has the same luck.
    """
    key = np.uint64(world.clock[s.TICK]) * np.uint64(2**24) + np.uint64(serial) * np.uint64(
        NUM_DICE
    )
    word = mix(world.seed[0] + (key + np.uint64(die + 1)) * GOLDEN_STEP)
    share = (word >> _SHIFT_32) * np.uint64(high - low + 1)
    return int(low + np.int64(share >> _SHIFT_32))


@compiled
def precedence_of(world: Any, serial: int) -> int:
    """Who goes first among equals, 0..2**32 - 1: drawn once a game for each serial number."""
    word = mix(world.seed[0] ^ (np.uint64(serial) * GOLDEN_STEP))
    return int(np.int64(word >> _SHIFT_32))
