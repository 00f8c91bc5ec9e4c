"""A window without a display, and a scripted person who presses keys and clicks on cells."""

from pathlib import Path

import pygame

from marl_cair.games import GAMES
from marl_cair.window.session import Session
from marl_cair.window.window import Window

SIZE = (1280, 800)


def make_session(game, scenario=None, players=(None,), **options):
    """A session of `players`: None is a person, a name a bot; options starting a scenario's field
    change it.
    """
    where = {
        name: options.pop(name) for name in ("seed", "record", "statistics") if name in options
    }
    chosen = GAMES[game].scenario(scenario, **options)
    agents = [None if name is None else GAMES[game].bot(name, chosen) for name in players]
    return Session(GAMES[game], chosen, agents, **where)


def make_window(game, scenario=None, players=(None,), size=SIZE, folder=None, **options):
    pygame.display.init()  # names of keys
    session = make_session(game, scenario, players, **options)
    window = Window(session, pygame.Surface(size), folder or Path(), threaded=False)
    window.draw()  # lays the parts out
    return window


class Person:
    """Sends events to a window, as pygame does for a person's hands."""

    def __init__(self, window):
        self.window = window

    def press(self, *keys, mod=0):
        for key in keys:
            self.hold(key, mod=mod)
            self.release(key, mod=mod)

    def hold(self, *keys, mod=0):
        for key in keys:
            self.window.handle(pygame.event.Event(pygame.KEYDOWN, key=key, mod=mod))

    def release(self, *keys, mod=0):
        for key in keys:
            self.window.handle(pygame.event.Event(pygame.KEYUP, key=key, mod=mod))

    def find_pixel(self, row, column):
        """The middle of a cell in the window."""
        board, camera = self.window.find_board(), self.window.camera
        x, y = board.find_box(row + 0.5, column + 0.5)
        left, top = camera.corner()
        return round(left + x * camera.scale), round(top + y * camera.scale)

    def click(self, place, button=1, until=None):
        """Click at a pixel; with `until` the button is released there."""
        end = until or place
        for kind, pos in ((pygame.MOUSEBUTTONDOWN, place), (pygame.MOUSEBUTTONUP, end)):
            self.window.handle(pygame.event.Event(kind, pos=pos, button=button))

    def move(self, place, buttons=(0, 0, 0), rel=(0, 0)):
        motion = pygame.event.Event(pygame.MOUSEMOTION, pos=place, buttons=buttons, rel=rel)
        self.window.handle(motion)

    def click_cell(self, row, column, button=1):
        self.click(self.find_pixel(row, column), button)

    def wait(self, steps=1):
        for _ in range(steps):
            self.window.update(1.0 / self.window.session.steps_per_second / self.window.speed)
