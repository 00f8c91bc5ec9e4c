"""`ArrayPool`: reuses arrays that are no longer referenced."""

from __future__ import annotations

import weakref
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAX_SPARE = 64  # arrays of one shape that wait for their next use


class ArrayPool:
    """Uninitialised arrays whose memory returns here when the last view of them is gone.

    A batch of observations is megabytes, which the operating system takes back and clears again at
    every step: that costs more than to write the observations.
    """

    def __init__(self) -> None:
        self._spare: dict[tuple[Any, ...], list[NDArray[Any]]] = {}

    def take(self, shape: tuple[int, ...], dtype: Any) -> NDArray[Any]:
        """An unused array; its content is arbitrary."""
        spare = self._spare.setdefault((shape, np.dtype(dtype)), [])
        memory = spare.pop() if spare else np.empty(shape, dtype)
        lent = memory.view()
        weakref.finalize(lent, _give_back, spare, memory).atexit = False
        return lent


def _give_back(spare: list[NDArray[Any]], memory: NDArray[Any]) -> None:
    if len(spare) < MAX_SPARE:
        spare.append(memory)
