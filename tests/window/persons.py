"""Windows with and without a display, and scripted persons who press keys and click on cells."""

import time
from pathlib import Path

import numpy as np
import pygame

from marl_cair.games import GAMES
from marl_cair.games.deep_rts import state as rts
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.rules.rulebook import SEAT_FRAME
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

    def send(self, event):
        self.window.handle(event)

    def press(self, *keys, mod=0):
        for key in keys:
            self.hold(key, mod=mod)
            self.release(key, mod=mod)

    def hold(self, *keys, mod=0):
        for key in keys:
            self.send(pygame.event.Event(pygame.KEYDOWN, key=key, mod=mod))

    def release(self, *keys, mod=0):
        for key in keys:
            self.send(pygame.event.Event(pygame.KEYUP, key=key, mod=mod))

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
            self.send(pygame.event.Event(kind, pos=pos, button=button))

    def move(self, place, buttons=(0, 0, 0), rel=(0, 0)):
        motion = pygame.event.Event(pygame.MOUSEMOTION, pos=place, buttons=buttons, rel=rel)
        self.send(motion)

    def click_cell(self, row, column, button=1):
        self.click(self.find_pixel(row, column), button)

    def wait(self, steps=1):
        for _ in range(steps):
            self.window.update(1.0 / self.window.session.steps_per_second / self.window.speed)


class PersonAtDisplay(Person):
    """Puts events into SDL's queue, and waits while the window's own loop plays."""

    def send(self, event):
        pygame.event.post(event)

    def wait(self, steps=1):
        window, frames = self.window, self.window._frames
        goal = window.moment.step + steps
        while not window.moment.is_over and (
            window.moment.step < goal or window._frames < frames + 2  # events are taken by then
        ):
            time.sleep(0.005)


def win_line_wars(person):
    """Four towers, then footmen (20 gold) as soon as they can be paid."""
    for row in (1, 4, 6, 8):
        person.press(pygame.K_5)
        person.click_cell(row, 3)
        person.wait()
        person.click_cell(row, 3, button=3)  # no tower is chosen any more
    while not person.window.moment.is_over:
        gold = person.window.moment.numbers.resources["gold"][0]
        person.press(*[pygame.K_2] * int(gold // 20))
        person.wait(10)


def win_skirmish(person):
    """All soldiers in one box are sent to the nearest enemy, again and again."""
    window, control = person.window, person.window.controls[0]
    board = window.find_board()
    last = board.rows - 1, board.columns - 1
    while not window.moment.is_over:
        person.click(person.find_pixel(0, 0), until=person.find_pixel(*last))
        person.press(pygame.K_a)
        own = [(unit.row, unit.column) for unit in control.list_units(window.moment)]
        enemies = find_enemies(window)
        away = np.linalg.norm(enemies[:, None] - np.array(own)[None], axis=2)
        person.click_cell(*enemies[away.min(1).argmin()].tolist())
        person.wait(40)


def find_enemies(window):
    """Row and column of the enemies' units in the view of player 0, int [N, 2]."""
    control, world = window.controls[0], window.moment.world
    units = world.units[0, world.roster.shape[2] :]
    cells = units[units[:, rts.UNIT_KIND] != t.NO_KIND, rts.UNIT_CELL]
    frame = control.rules.seats[world.clock[0, rts.MAP_INDEX], control.seat, SEAT_FRAME]
    return control.rules.own_place[frame, cells]
