"""Plays a Flash game by hand: a window that shows the frames of its VNC server and sends keys."""

from __future__ import annotations

import sys
import time
from typing import Any

from marl_cair.games.flash.browser.keys import find_key
from marl_cair.games.flash.client import Game
from marl_cair.lookup import UnknownNameError

_NAMES = {"return": "enter", "left shift": "shift", "right shift": "shift", "left ctrl": "control",
          "right ctrl": "control", "left alt": "alt", "right alt": "alt"}  # fmt: skip
_BUTTONS = {1: "left", 2: "middle", 3: "right"}


def play_by_hand(name: str, *, with_window: bool = True) -> None:
    """Run the game until its window is closed or the command is interrupted.

    Raises:
        ValueError: there is no such game, or no pygame for a window.
        FlashError: browser or display cannot be started.
    """
    with Game(name) as game:
        if with_window:
            _show(game)
            return
        sys.stdout.write(f"VNC server: {game.address}\n")
        sys.stdout.write(f"connect with: xtigervncviewer {game.address}   (end with Ctrl-C)\n")
        sys.stdout.flush()
        while True:
            time.sleep(1.0)


def _show(game: Game) -> None:
    try:
        import pygame
    except ModuleNotFoundError:
        raise ValueError(
            'a window needs pygame-ce: pip install "marl_cair[play]"; or give --vnc and use a VNC '
            "viewer"
        ) from None
    pygame.display.init()
    window = pygame.display.set_mode(game.description.size)
    pygame.display.set_caption(game.description.title)
    clock = pygame.time.Clock()
    try:
        while not any(_send(game, pygame, event) for event in pygame.event.get()):
            window.blit(pygame.surfarray.make_surface(game.screen().swapaxes(0, 1)), (0, 0))
            pygame.display.flip()
            clock.tick(60)
    finally:
        pygame.display.quit()


def _send(game: Game, pygame: Any, event: Any) -> bool:
    """Send one event of the window to the game; True where the window was closed."""
    if event.type in (pygame.KEYDOWN, pygame.KEYUP):
        name = pygame.key.name(event.key)
        name = _NAMES.get(name, name)
        try:
            find_key(name)
        except UnknownNameError:
            return False
        (game.press if event.type == pygame.KEYDOWN else game.release)(name)
    elif event.type == pygame.MOUSEMOTION:
        game.move(*event.pos)
    elif event.type in (pygame.MOUSEBUTTONDOWN, pygame.MOUSEBUTTONUP) and event.button in _BUTTONS:
        move = game.mouse_down if event.type == pygame.MOUSEBUTTONDOWN else game.mouse_up
        x, y = event.pos
        move(x, y, _BUTTONS[event.button])
    return bool(event.type == pygame.QUIT)
