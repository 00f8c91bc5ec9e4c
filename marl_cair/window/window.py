"""`Window`: the event loop, and what keys and clicks do; `scene` draws it."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pygame
from numpy.typing import NDArray

from marl_cair.window.boards import Board, Cell, Point, find_board, find_cell
from marl_cair.window.camera import Camera
from marl_cair.window.controls.controls import ARROWS, LEFT, RIGHT, Controls
from marl_cair.window.controls.registry import TURNS, make_controls
from marl_cair.window.hotkeys import find_hotkey
from marl_cair.window.panels import PanelState
from marl_cair.window.scene import Scene
from marl_cair.window.session import Moment, Session, View

MAX_FPS = 60
MOST_STEPS = 32  # between two pictures
SCROLL_PIXELS = 64


class Window:
    """Shows a session on a surface and lets its persons play.

    Args:
        session: the games.
        surface: of the display, or any other: films and tests need no display.
        folder: of screenshots and of replays that are saved by hand.
        speed: 1 is the game's own.
        threaded: whether the game goes on beside the drawing, in a thread of its own.
    """

    def __init__(
        self,
        session: Session,
        surface: pygame.Surface,
        folder: Path = Path("runs/play"),
        speed: float = 1.0,
        threaded: bool = True,
    ) -> None:
        self.session, self.surface = session, surface
        self.folder, self.speed = folder, speed
        self.is_open = True
        self.message = ""
        alone = len(session.persons) == 1
        self.shown = {
            **dict.fromkeys(("menu", "pause", "presence", "grid"), False),
            "panels": True,
            "turns": alone and session.game.name in TURNS and session.spec.num_players == 1,
        }
        self.person = 0  # whose turn it is at keyboard and mouse
        self.view = View(self.home_seat())
        self.camera = Camera()
        self.moment: Moment = session.look(self.view)
        self._pool = ThreadPoolExecutor(1) if threaded else None
        self._job: Future[Moment] | None = None
        self.due, self.steps_wanted, self.needs_look = 0.0, 0, False
        self.controls: Sequence[Controls] = ()
        self._make_controls()
        self._wait_for_start()
        self.pointer: tuple[int, int] | None = None
        self.drag_start: Cell | None = None
        self._clock, self._counted = pygame.time.Clock(), (0, 0, time.monotonic())
        self._frames, self.frame_rates, self.tick_rates = 0, list[float](), list[float]()
        self.scene: Scene = Scene(self)

    # --- the loop ---------------------------------------------------------------------------------

    def run(self) -> None:
        """Show the window until it is closed."""
        pygame.key.set_repeat(250, 90)
        try:
            while self.is_open:
                for event in pygame.event.get():
                    self.handle(event)
                self.update(self._clock.tick(MAX_FPS) / 1000)
                self.draw()
                pygame.display.flip()
        finally:
            self.shut_down()

    def shut_down(self) -> None:
        """Wait for the game's thread and end the recording."""
        if self._pool is not None:
            self._pool.shutdown()
        self.session.close()

    def update(self, seconds: float) -> None:
        """Let the game go on for the time that has passed."""
        if self._job is not None and self._job.done():
            self.finish_job()
        if not self.shown["pause"] and not self.moment.is_over:
            rate = self.session.steps_per_second * self.speed
            self.due = min(self.due + seconds * rate, float(MOST_STEPS))
        if self._job is None:
            self._begin_job()
        self._measure()

    def step(self) -> None:
        """Play one step now, without waiting for its time."""
        self.steps_wanted = 1
        self._begin_job()
        self.finish_job()

    def draw(self) -> None:
        """Draw everything on the surface."""
        self._frames += 1
        self.scene.draw()

    def _begin_job(self) -> None:
        count = self.steps_wanted or int(self.due)
        persons = [c for c in self.controls if not self.moment.eliminated[c.seat]]
        if self.moment.is_over:
            count = 0
        elif self.shown["pause"]:
            count = self.steps_wanted
        elif self.shown["turns"] and persons:
            count = int(all(control.is_ready for control in persons))
        elif persons:
            count = min(count, 1)  # an order is chosen for each step
        if not count and not self.needs_look:
            return
        orders = {}
        if count:
            chosen = {control.seat: control.choose(self.moment) for control in persons}
            orders = {seat: order for seat, order in chosen.items() if order is not None}
            for control in persons:
                if control.message:
                    self._say(control)
            self.due = 0.0 if self.shown["turns"] else max(0.0, self.due - count)
            self.steps_wanted = 0
        self.needs_look = False
        work = partial(self._advance, count, orders, self.view, self.shown["presence"])
        if self._pool is None:
            self._take(work())
        else:
            self._job = self._pool.submit(work)

    def _advance(self, count: int, orders: Any, view: View, with_presence: bool) -> Moment:
        """Some steps, and the game after them; runs in the game's thread."""
        for _ in range(count):
            self.session.advance(orders)
            orders = None
        return self.session.look(view, with_presence)

    def _take(self, moment: Moment) -> None:
        has_ended = moment.is_over and not self.moment.is_over
        self.moment = moment
        if has_ended:
            self.message = f"{self.session.describe_end()}. N: next game, Esc: quit"

    def _measure(self) -> None:
        """Count frames and ticks of each half second."""
        frames, step, since = self._counted
        passed = time.monotonic() - since
        if passed < 0.5:
            return
        ticks = max(0, self.moment.step - step) * self.session.spec.ticks_per_step
        self.frame_rates.append((self._frames - frames) / passed)
        self.tick_rates.append(ticks / passed)
        self._counted = self._frames, self.moment.step, time.monotonic()

    def finish_job(self) -> None:
        """Wait until the game's thread has nothing to do."""
        if self._job is not None:
            self._take(self._job.result())
            self._job = None

    # --- events -----------------------------------------------------------------------------------

    def handle(self, event: pygame.event.Event) -> None:
        """Do what one event asks for."""
        if event.type == pygame.QUIT:
            self.close()
        elif event.type == pygame.VIDEORESIZE:
            self.surface = pygame.display.get_surface() or self.surface
        elif event.type == pygame.KEYDOWN:
            self.press(event.key, getattr(event, "mod", 0))
        elif event.type == pygame.KEYUP:
            for control in self.list_active():
                control.release(event.key)
        elif event.type == pygame.MOUSEMOTION:
            self.pointer = event.pos
            if event.buttons[1]:
                self.camera.scroll(-event.rel[0], -event.rel[1])
        elif event.type == pygame.MOUSEWHEEL:
            self.scene.roll_wheel(event.y)
        elif event.type == pygame.MOUSEBUTTONDOWN:
            self._mouse_down(event.pos, event.button)
        elif event.type == pygame.MOUSEBUTTONUP:
            self._mouse_up(event.pos, event.button)

    def press(self, key: int, mod: int = 0) -> None:
        """A key was pressed."""
        active = self.list_active()
        # Where a game has the key control, it is no modifier.
        is_modified = mod & pygame.KMOD_CTRL and not any(c.claims(pygame.K_LCTRL) for c in active)
        if is_modified and key in ARROWS:
            rows, columns = ARROWS[key]
            self.camera.scroll(columns * SCROLL_PIXELS, rows * SCROLL_PIXELS)
            return
        hotkey = find_hotkey(key)
        is_claimed = any(control.claims(key) for control in active)
        if hotkey is not None and (is_modified or not is_claimed):
            hotkey.run(self)
            return
        for control in active:
            if control.press(key, self.moment):
                self._say(control)
                self._start_clock()
        if key in ARROWS:
            self.scene.follow_frame()

    def _start_clock(self) -> None:
        if self.moment.step == 0:
            self.shown["pause"] = False

    def list_active(self) -> Sequence[Controls]:
        """The controls that keys reach now."""
        if self.session.plays_at_once or not self.controls:
            return self.controls
        return [self.controls[self.person]]

    def _say(self, control: Controls) -> None:
        self.message, control.message = control.message, ""

    def _mouse_down(self, place: tuple[int, int], button: int) -> None:
        self.pointer = place
        if button == LEFT and self.scene.click(place):
            return
        point = self.find_point(place)
        if point is None or button not in (LEFT, RIGHT) or not self.controls:
            return
        control = self.controls[self.person]
        if self.view != View(control.seat):
            self.message = f"F or V: turn to the view of player {control.seat} to give orders"
        elif button == LEFT:
            self.drag_start = find_cell(point)
        else:
            control.click(point, RIGHT, self.moment)
            self._say(control)

    def _mouse_up(self, place: tuple[int, int], button: int) -> None:
        start, self.drag_start = self.drag_start, None
        point = self.find_point(place)
        if start is None or button != LEFT or point is None:
            return
        self._start_clock()
        control = self.controls[self.person]
        if find_cell(point) == start:
            control.click(point, LEFT, self.moment)
        else:
            control.drag(start, find_cell(point), self.moment)
        self._say(control)

    def find_point(self, place: tuple[int, int]) -> Point | None:
        """The point of the board at a pixel of the window."""
        board = self.find_board()
        if board is None or not self.camera.contains(*place):
            return None
        return board.find_point(*self.camera.to_picture(*place))

    def find_cell(self, place: tuple[int, int]) -> Cell | None:
        """The cell of the board at a pixel of the window."""
        point = self.find_point(place)
        return None if point is None else find_cell(point)

    def find_board(self) -> Board | None:
        """Where cells lie in the picture; None for pictures without a board."""
        if self.moment.view.representation:
            return None
        height, width = self.moment.picture.shape[:2]
        session = self.session
        return find_board(session.game.name, session.scenario, self.rules, height, width)

    # --- games and views --------------------------------------------------------------------------

    def close(self) -> None:
        """Leave the loop."""
        self.is_open = False

    def start_next(self) -> None:
        """Begin the next game."""
        self.finish_job()
        self.session.start()
        self.message, self.due = "", 0.0
        self._make_controls()
        if self.session.persons:
            self.set_view(replace(self.view, seat=self.home_seat()))  # F may show another
        self._take(self.session.look(self.view))
        self._wait_for_start()
        self._counted = self._frames, 0, time.monotonic()

    def _wait_for_start(self) -> None:
        """A game in real time begins with the person's first key or click."""
        if self.controls and not self.shown["turns"]:
            self.shown["pause"] = True
            self.message = "the game begins with your first key or click; G: all keys"

    def _make_controls(self) -> None:
        self.rules = self.session.game.make_rules(self.session.scenario)
        look = self.moment
        if look.view.representation:
            look = self.session.look(replace(self.view, representation=""))
        height, width = look.picture.shape[:2]
        name, scenario = self.session.game.name, self.session.scenario
        board = find_board(name, scenario, self.rules, height, width)
        self.controls = make_controls(self.session, board)

    def home_seat(self) -> int | None:
        """The seat of the person's own view: None where several play at once on an open board."""
        persons = self.session.persons
        if not persons or (self.session.plays_at_once and len(persons) > 1):
            return None
        return persons[self.person]

    def list_seats(self) -> tuple[int, ...]:
        """The players whose numbers and views may be seen: of persons alone while they play."""
        session = self.session
        if not session.persons or self.moment.is_over:
            return tuple(range(session.spec.num_players))
        at_once = session.plays_at_once
        return session.persons if at_once else (session.persons[self.person],)

    def set_view(self, view: View) -> None:
        """Show something else, from the next picture on."""
        self.view, self.needs_look = view, True
        self.camera.zoom = 0

    # --- for the scene ----------------------------------------------------------------------------

    def describe_panels(self, inks: list[Any]) -> PanelState:
        """What the panels show now."""
        speed = "waits for you" if self.shown["turns"] else f"speed {self.speed:g}"
        if self.shown["pause"]:
            speed = "paused"
        return PanelState(
            self.session, self.moment, self.list_seats(), inks, speed, self.frame_rates,
            self.tick_rates,
        )  # fmt: skip


def film_game(
    session: Session, size: tuple[int, int], every: int = 1
) -> Iterator[NDArray[np.uint8]]:
    """Play a game of agents without a display; yields the window, uint8 [h, w, 3], at the start,
    after each `every`-th step and at the end.
    """
    window = Window(session, pygame.Surface(size), threaded=False)
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
