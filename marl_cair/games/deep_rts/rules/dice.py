"""Random numbers, hashed from what mirrored units share, so that both get the same."""

from typing import Any

import numpy as np

from marl_cair.games.compiled import compiled
from marl_cair.games.deep_rts import state as s
from marl_cair.games.randomness import GOLDEN_STEP, mix

DAMAGE_DIE, SHARE_DIE = range(2)
_NUM_DICE = np.uint64(2)
_SHIFT_32 = np.uint64(32)


@compiled
def number_below(word: Any, count: Any) -> int:
    """A number in 0..count - 1 from the upper half of a random word uint64; count < 2**32."""
    return int(np.int64(((word >> _SHIFT_32) * np.uint64(count)) >> _SHIFT_32))


@compiled
def roll(world: Any, serial: int, die: int, low: int, high: int) -> int:
    """A uniform integer in low..high, hashed from the game's seed, the tick and the unit's serial.

    It does not depend on the seat, so the same unit of a mirrored player rolls the same.
    """
    key = np.uint64(world.clock[s.TICK]) * np.uint64(2**24) + np.uint64(serial) * _NUM_DICE
    word = mix(world.seed[0] + (key + np.uint64(die + 1)) * GOLDEN_STEP)
    return int(low + number_below(word, high - low + 1))


@compiled
def precedence_of(world: Any, serial: int) -> int:
    """The order among equals, 0..2**32 - 1: drawn once a game for each serial number."""
    return int(np.int64(mix(world.seed[0] ^ (np.uint64(serial) * GOLDEN_STEP)) >> _SHIFT_32))
