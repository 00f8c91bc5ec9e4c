"""Draws random legal actions from masks, compiled."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

BLOCK = 64  # actions


def make_draw_legal() -> Callable[..., None]:
    """`draw(mask bool [B, P, A], draws float [B, P], out [B, P])`: each seat's random legal action.

    Each draw in [0, 1) chooses among that seat's legal actions, all equally likely.
    """

    @numba.njit
    def count(legal: NDArray[Any]) -> int:
        found = 0
        for action in range(len(legal)):
            found += legal[action]
        return found

    @numba.njit
    def choose(legal: NDArray[Any], draw: float) -> int:
        before, action = int(draw * count(legal)), 0  # legal ones before the chosen one
        # Whole blocks first: the compiler counts many actions at once.
        here = count(legal[:BLOCK])
        while here <= before:
            before -= here
            action += BLOCK
            here = count(legal[action : action + BLOCK])
        while before > 0 or not legal[action]:
            before -= int(legal[action])
            action += 1
        return action

    def draw(mask: NDArray[Any], draws: NDArray[Any], out: NDArray[Any]) -> None:
        for world, seat in np.ndindex(draws.shape):
            out[world, seat] = choose(mask[world, seat], draws[world, seat])

    compiled: Callable[..., None] = numba.njit(draw)
    return compiled
