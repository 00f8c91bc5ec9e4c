"""The keys of the window, one table: the menu and what happens are read from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import pygame

from marl_cair.games.replays import REPLAY_SUFFIX
from marl_cair.window.representations import list_shown
from marl_cair.window.session import View
from marl_cair.window.statistics import name_game

if TYPE_CHECKING:
    from marl_cair.window.window import Window

SPEEDS = (0.125, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0, 16.0, 64.0)


class Hotkey(NamedTuple):
    """A key of the window."""

    keys: tuple[int, ...]
    label: str
    text: str  # of the menu
    run: Callable[[Window], None]


def toggle(window: Window, name: str) -> None:
    """Switch one of `shown`."""
    window.shown[name] = not window.shown[name]
    if name != "menu":
        window.message = f"{name} {'on' if window.shown[name] else 'off'}"


def toggle_presence(window: Window) -> None:
    """Show where an agent's capsules find their parts, in that agent's own view."""
    window.finish_job()  # the agents are asked here
    with_capsules = [seat for seat in window.list_seats() if window.session.has_capsules(seat)]
    if not with_capsules:
        window.message = "no player that you may look at has capsules"
        return
    toggle(window, "presence")
    seat = window.view.seat if window.view.seat in with_capsules else with_capsules[0]
    window.set_view(replace(window.view, seat=seat))


def step_once(window: Window) -> None:
    """Pause, and play one step."""
    window.shown["pause"], window.steps_wanted, window.due = True, 1, 0.0
    window.message = "one step; P: continue"


def change_speed(window: Window, step: int) -> None:
    """Take the next or the previous of SPEEDS."""
    nearest = min(range(len(SPEEDS)), key=lambda i: abs(SPEEDS[i] - window.speed))
    window.speed = SPEEDS[max(0, min(len(SPEEDS) - 1, nearest + step))]
    window.message = f"speed {window.speed:g}"


def pass_on(window: Window) -> None:
    """The next person takes keyboard and mouse."""
    if len(window.controls) < 2 or window.session.plays_at_once:
        window.message = "no other person takes turns at the keyboard"
        return
    window.person = (window.person + 1) % len(window.controls)
    window.set_view(View(window.home_seat()))
    window.message = f"player {window.controls[window.person].seat} has keyboard and mouse"


def cycle_seat(window: Window) -> None:
    """The view of the next player, or of all."""
    seats = [None, *window.list_seats()]
    if window.session.persons and not window.moment.is_over and window.home_seat() is not None:
        seats = seats[1:]
    place = seats.index(window.view.seat) if window.view.seat in seats else -1
    window.set_view(replace(window.view, seat=seats[(place + 1) % len(seats)]))
    seat = window.view.seat
    window.message = "view of all" if seat is None else f"view of player {seat}"
    if len(seats) == 1:
        window.message = "other views open when the game is over"


def cycle_representation(window: Window) -> None:
    """The next of the representations that are pictures."""
    names = list_shown(dict(window.session.spec.representations))
    place = names.index(window.view.representation)
    seat = window.list_seats()[0] if window.view.seat is None else window.view.seat
    window.set_view(View(seat, names[(place + 1) % len(names)]))
    window.message = window.view.representation or "the game"


def zoom(window: Window, step: int) -> None:
    """Zoom around the middle of the shown part."""
    left, top, width, height = window.camera.area
    window.camera.change_zoom(step, left + width / 2, top + height / 2)


def save_screenshot(window: Window) -> None:
    """Write the window as a PNG."""
    _save(window, "screenshot.png", lambda path: pygame.image.save(window.surface, path))


def save_replay(window: Window) -> None:
    """Write the replay of the game so far."""
    window.finish_job()
    _save(window, f"{window.session.game.name}{REPLAY_SUFFIX}", window.session.save_replay)


def _save(window: Window, name: str, write: Callable[[Path], None]) -> None:
    """Write a file under the next free name in the window's folder; an error is a message."""
    first, number = window.folder / name, 0
    try:
        first.parent.mkdir(parents=True, exist_ok=True)
        while name_game(first, number).exists():
            number += 1
        path = name_game(first, number)
        write(path)
        window.message = f"saved {path}"
    except OSError as error:
        window.message = f"not saved: {error}"


HOTKEYS = (
    Hotkey((pygame.K_g,), "G", "show or hide this menu", lambda w: toggle(w, "menu")),
    Hotkey((pygame.K_p,), "P", "pause, continue", lambda w: toggle(w, "pause")),
    Hotkey((pygame.K_PERIOD,), ".", "one step, then pause", step_once),
    Hotkey((pygame.K_PLUS, pygame.K_EQUALS, pygame.K_KP_PLUS), "+", "faster",
           lambda w: change_speed(w, 1)),
    Hotkey((pygame.K_MINUS, pygame.K_KP_MINUS), "-", "slower", lambda w: change_speed(w, -1)),
    Hotkey((pygame.K_t,), "T", "turns: the game waits for your action",
           lambda w: toggle(w, "turns")),
    Hotkey((pygame.K_n,), "N", "next game, on the next map", lambda w: w.start_next()),
    Hotkey((pygame.K_TAB,), "Tab", "the next person takes keyboard and mouse", pass_on),
    Hotkey((pygame.K_f,), "F", "view of each player, with its fog; of all", cycle_seat),
    Hotkey((pygame.K_v,), "V", "what agents see: planes, image, heat map, gray",
           cycle_representation),
    Hotkey((pygame.K_o,), "O", "presence of the agent's capsules", toggle_presence),
    Hotkey((pygame.K_h,), "H", "grid lines", lambda w: toggle(w, "grid")),
    Hotkey((pygame.K_b,), "B", "panels", lambda w: toggle(w, "panels")),
    Hotkey((pygame.K_END,), "End", "panels that do not fit (or the mouse wheel over them)",
           lambda w: w.scene.turn_panels()),
    Hotkey((pygame.K_PAGEUP,), "Page up", "zoom in (or the mouse wheel)", lambda w: zoom(w, 1)),
    Hotkey((pygame.K_PAGEDOWN,), "Page down", "zoom out", lambda w: zoom(w, -1)),
    Hotkey((pygame.K_F5,), "F5", "save the replay so far", save_replay),
    Hotkey((pygame.K_F12,), "F12", "save a screenshot", save_screenshot),
    Hotkey((pygame.K_ESCAPE,), "Esc", "quit", lambda w: w.close()),
)  # fmt: skip
# Without a key of their own.
GESTURES = (
    ("Ctrl + arrows", "scroll a large board (or drag with the middle button)"),
    ("minimap", "click: show that part"),
)


def find_hotkey(key: int) -> Hotkey | None:
    """The hotkey of a key; None for a key of the game."""
    return next((hotkey for hotkey in HOTKEYS if key in hotkey.keys), None)
