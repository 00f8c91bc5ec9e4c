"""Frames of a game of agents as the window shows it, drawn without a display."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pygame
from numpy.typing import NDArray

from marl_cair.window.session import Session
from marl_cair.window.window import Settings, Window


def film_game(
    session: Session, size: tuple[int, int], every: int = 1
) -> Iterator[NDArray[np.uint8]]:
    """Play the game; yields the window, uint8 [h, w, 3], at the start, after each `every`-th step
    and at the end.
    """
    window = Window(session, pygame.Surface(size), Settings(threaded=False))
    try:
        while True:
            if window.moment.step % every == 0 or window.moment.is_over:
                window.draw()
                pixels = pygame.surfarray.array3d(window.surface)
                yield np.ascontiguousarray(pixels.swapaxes(0, 1))
            if window.moment.is_over:
                return
            window.step()
    finally:
        window.shut_down()
