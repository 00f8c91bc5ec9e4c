"""Plays a Flash game by hand: a window that shows the frames of its VNC server and sends keys."""

from __future__ import annotations

import sys
import time
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PIL import Image

from marl_cair.games.flash.browser.keys import find_key
from marl_cair.games.flash.client import Game
from marl_cair.games.flash.description import find_stage
from marl_cair.lookup import UnknownNameError
from marl_cair.window.display import open_display

if TYPE_CHECKING:
    import pygame

_SAVE_KEY = "f12"
_BUTTONS = {1: "left", 2: "middle", 3: "right"}


def play_by_hand(name: str, *, with_window: bool = True) -> None:
    """Run the game until its window is closed or the command is interrupted.

    Raises:
        ValueError: there is no such game; or no pygame, or no display, for a window.
        FlashError: browser or display cannot be started.
    """
    window = None
    if with_window:
        stage = find_stage(name)
        title = f"{stage.title} (F12 saves the picture)"
        instead = "give --vnc and use a VNC viewer"
        window = open_display(stage.size, title, is_resizable=False, instead=instead)
    with Game(name) as game:
        if window is not None:
            _show(game, window)
            return
        sys.stdout.write(f"VNC server: {game.address}\n")
        sys.stdout.write(f"connect with: xtigervncviewer {game.address}   (end with Ctrl-C)\n")
        sys.stdout.write("viewers without UNIX sockets connect to 127.0.0.1:5900 after: socat ")
        sys.stdout.write(f"TCP-LISTEN:5900,bind=127.0.0.1,fork UNIX-CONNECT:{game.address}\n")
        sys.stdout.flush()
        while True:
            time.sleep(1.0)


def _show(game: Game, window: pygame.Surface) -> None:
    import pygame

    pygame.mouse.set_visible(False)  # the game's own mouse cursor is in its picture
    clock = pygame.time.Clock()
    try:
        while not any(_send(game, event) for event in pygame.event.get()):
            window.blit(pygame.surfarray.make_surface(game.screen().swapaxes(0, 1)), (0, 0))
            pygame.display.flip()
            clock.tick(60)
    finally:
        pygame.display.quit()


def _send(game: Game, event: Any) -> bool:
    """Send one event of the window to the game; True where the window was closed."""
    import pygame

    from marl_cair.window.controls.held_keys import name_key

    if event.type in (pygame.KEYDOWN, pygame.KEYUP):
        name = name_key(event.key)
        if name == _SAVE_KEY:
            if event.type == pygame.KEYDOWN:
                _save_picture(game)
            return False
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


def _save_picture(game: Game) -> None:
    """Write the newest frame to the first name of <SWF>-1.png, -2.png, ... that is free."""
    paths = (Path(f"{game.stage.swf.stem}-{number}.png") for number in count(1))
    path = next(path for path in paths if not path.exists())
    Image.fromarray(game.screen()).save(path)
    sys.stdout.write(f"saved {path}\n")
    sys.stdout.flush()
