"""Imports pygame and opens the window on a display; errors name what is missing."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pygame

_WINDOWLESS = ("offscreen", "dummy", "evdev")  # what SDL takes where it finds no display
_FILM = "let `marl-cair watch` write a film with --to game.mp4 or game.gif"


def import_pygame() -> None:
    """Import pygame. Raises ValueError, which names the extra, if it is not installed."""
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    try:
        import pygame  # noqa: F401
    except ModuleNotFoundError:
        raise ValueError(
            'a window needs pygame-ce: pip install "marl_cair[play]" (no display is needed for '
            "matches, leagues and training)"
        ) from None


def open_display(
    size: tuple[int, int], title: str, *, is_resizable: bool = True, instead: str = _FILM
) -> pygame.Surface:
    """The surface of a new window. Raises ValueError without pygame or a display; `instead`: what
    works without one.
    """
    import_pygame()
    import pygame

    try:
        pygame.display.init()
        driver = pygame.display.get_driver()
        if driver in _WINDOWLESS and driver != os.environ.get("SDL_VIDEODRIVER"):
            raise pygame.error(f"SDL found no display and took its driver {driver!r}")
        surface = pygame.display.set_mode(size, pygame.RESIZABLE if is_resizable else 0)
    except pygame.error as error:
        pygame.display.quit()
        raise ValueError(
            f"no window can be opened ({error}): play on a machine with a display, connect with "
            f"`ssh -X`, or {instead}"
        ) from error
    pygame.display.set_caption(title)
    return surface
