"""Opens the window on a display."""

from __future__ import annotations

import os

import pygame

WINDOWLESS = ("offscreen", "dummy", "evdev")  # what SDL takes where it finds no display


def open_display(size: tuple[int, int], title: str) -> pygame.Surface:
    """The surface of a new window. Raises ValueError where there is no display."""
    try:
        pygame.display.init()
        driver = pygame.display.get_driver()
        if driver in WINDOWLESS and driver != os.environ.get("SDL_VIDEODRIVER"):
            raise pygame.error(f"SDL found no display and took its driver {driver!r}")
        surface = pygame.display.set_mode(size, pygame.RESIZABLE)
    except pygame.error as error:
        raise ValueError(
            f"no window can be opened ({error}): play on a machine with a display, connect with "
            "`ssh -X`, or let `marl-cair watch` write a film with --to game.mp4 or game.gif"
        ) from error
    pygame.display.set_caption(title)
    return surface
