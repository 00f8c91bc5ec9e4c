"""`HeldKeys`: Flash games by hand; a key of the game is down while the person holds it."""

from __future__ import annotations

from typing import Any

import pygame

from marl_cair.games.flash.description import find_description
from marl_cair.games.flash.rules import list_actions
from marl_cair.window.controls.controls import Controls
from marl_cair.window.session import Moment, Session

# Names of pygame that differ from those of Flash games.
_NAMES = {"return": "enter", "left shift": "shift", "right shift": "shift", "left ctrl": "control",
          "right ctrl": "control", "left alt": "alt", "right alt": "alt", "page up": "page_up",
          "page down": "page_down", "scroll lock": "scroll_lock", "break": "pause"}  # fmt: skip
MOST_KEYS = 2  # of an action


def name_key(key: int) -> str:
    """The name that Flash games have for a key of pygame."""
    name = pygame.key.name(key)
    return _NAMES.get(name, name)


class HeldKeys(Controls):
    """Of the keys that are down the two newest count. A key that is released within a step is down
    for all of that step.
    """

    def __init__(self, session: Session, seat: int) -> None:
        super().__init__(session, seat)
        described = find_description(session.scenario.description)
        # A person alone who sees the mirrored game plays it as the first player does.
        is_first = described.is_mirrored and len(session.persons) == 1
        self._names = described.keys[0 if is_first else seat]
        actions = list_actions(described, session.scenario.actions)
        self._actions = {frozenset(action.keys): n for n, action in enumerate(actions)}
        self._held: list[int] = []  # keys of the game by number, the newest last
        self._new: set[int] = set()  # since the last step
        self._released: set[int] = set()  # since then too
        self.lines = ((" ".join(self._names), "hold: keys of the game, two at a time"),)

    @property
    def is_ready(self) -> bool:
        return bool(self._held)

    def claims(self, key: int) -> bool:
        return name_key(key) in self._names

    def press(self, key: int, moment: Moment) -> bool:
        if not self.claims(key):
            return False
        number = self._names.index(name_key(key))
        if number not in self._held:
            self._held.append(number)
            self._new.add(number)
        self._released.discard(number)
        return True

    def release(self, key: int) -> None:
        if self.claims(key):
            self._released.add(self._names.index(name_key(key)))
            self._drop()

    def _drop(self) -> None:
        self._held = [n for n in self._held if n in self._new or n not in self._released]

    def choose(self, moment: Moment) -> Any:
        action = self._actions[frozenset(self._held[-MOST_KEYS:])]
        self._new.clear()
        self._drop()
        return action
