"""Films a game that a scripted person plays by mouse and keys: `python docs/play_film.py`.

The person takes the orders of a bot, and gives them as a person would: the key of a unit, or the
key of a tower and a click on a cell. The opponent is the trained agent of the repository.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

os.environ.setdefault("SDL_VIDEODRIVER", "dummy")

import numpy as np
import pygame

from marl_cair import load_agent
from marl_cair.games import GAMES
from marl_cair.games.game import NO_CELL
from marl_cair.league.play.film import Frame, write_gif
from marl_cair.window.session import Session
from marl_cair.window.window import Window

ROOT = Path(__file__).resolve().parents[1]
GAME, SCENARIO, OPPONENT, BOT = "deep_line_wars", "10x15", "deep_line_wars_10x15", "economist"
SIZE, EVERY = (1144, 664), 6  # the window, in which the board fits; ticks between frames
NUM_FRAMES, FPS = 76, 8  # the first 42 seconds of the game, in nine
KEYS = {"buy_militia": "1", "buy_footman": "2", "buy_grunt": "3", "buy_armoured_grunt": "4",
        "build_basic": "5", "build_fast": "6", "build_faster": "7"}  # fmt: skip
ARROW = ((0, 0), (0, 16), (4, 12), (7, 18), (9, 17), (6, 11), (11, 11))  # pixels from the pointer


def main() -> None:
    """Write docs/images/play.gif."""
    chosen = GAMES[GAME].scenario(SCENARIO)
    opponent = load_agent(str(ROOT / "agents" / OPPONENT), GAME, chosen)
    session = Session(GAMES[GAME], chosen, [None, opponent])
    window = Window(session, pygame.Surface(SIZE), threaded=False)
    write_gif(ROOT / "docs/images/play.gif", islice(play(window), NUM_FRAMES), FPS)


def play(window: Window) -> Iterator[Frame]:
    """Play the game; yields the window at each click and after each EVERY ticks."""
    window.draw()  # lays the parts out
    session, spec, pointer = window.session, window.session.spec, (400, 300)
    bot = GAMES[GAME].bot(BOT, session.scenario)
    while not window.moment.is_over:
        if window.moment.step % session.steps_per_decision == 0:
            seen = session.engine.observe(bot.representation)[:, 0]
            (action,) = bot.act(seen.copy(), session.engine.action_mask()[:, 0])
            kind = spec.action_group_names[spec.action_groups[action]]
            if kind in KEYS:
                window.press(ord(KEYS[kind]))
            if spec.action_cells[action] != NO_CELL:
                pointer = find_pixel(window, int(spec.action_cells[action]))
                click(window, pointer)
                yield take_picture(window, pointer)
                window.press(ord(KEYS[kind]))  # puts the tower away
        window.step()
        if window.moment.step % EVERY == 0:
            yield take_picture(window, pointer)


def find_pixel(window: Window, cell: int) -> tuple[int, int]:
    """The middle of a cell in the window."""
    board, camera = window.find_board(), window.camera
    if board is None:
        raise ValueError("the view has no board")
    row, column = divmod(cell, board.columns)
    x, y = board.find_box(row + 0.5, column + 0.5)
    left, top = camera.corner()
    return round(left + x * camera.scale), round(top + y * camera.scale)


def click(window: Window, pixel: tuple[int, int]) -> None:
    """Move the mouse to a pixel, press its left button and release it."""
    window.handle(pygame.event.Event(pygame.MOUSEMOTION, pos=pixel, buttons=(0, 0, 0)))
    for kind in (pygame.MOUSEBUTTONDOWN, pygame.MOUSEBUTTONUP):
        window.handle(pygame.event.Event(kind, pos=pixel, button=1))


def take_picture(window: Window, pointer: tuple[int, int]) -> Frame:
    """The window with the pointer of the mouse, which pygame leaves to the system."""
    window.draw()
    surface = window.surface.copy()
    corners = [(pointer[0] + x, pointer[1] + y) for x, y in ARROW]
    pygame.draw.polygon(surface, "white", corners)
    pygame.draw.polygon(surface, "black", corners, 1)
    return np.ascontiguousarray(pygame.surfarray.array3d(surface).swapaxes(0, 1))


if __name__ == "__main__":
    main()
