"""Defaults of the tests' small games: one kind for each action, no board, no pictures."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from marl_cair.games import GAMES
from marl_cair.games.game import NO_CELL, Game, GameSpec, Representation


def make_plain_spec(
    action_names: tuple[str, ...], *shown: Representation, **fields: Any
) -> GameSpec:
    """A spec of a duel whose first action is the no-op; `fields` take the place of its others."""
    num_actions = len(action_names)
    plain = {
        "num_players": 2,
        "action_groups": np.arange(num_actions, dtype=np.int16),
        "action_group_names": action_names,
        "action_cells": np.full(num_actions, NO_CELL, np.int32),
        "noop_action": 0,
        "static_planes": (),
        "exclusive_planes": (),
        "event_planes": (),
        "resources": (),
        "ticks_per_step": 1,
        "reward_bound": 1.0,
        "pays": "+1 win, -1 loss",
    }
    representations = {one.name: one for one in shown}
    return GameSpec(
        **{**plain, "action_names": action_names, "representations": representations, **fields}
    )


def make_game(module: str, title: str, **fields: Any) -> Game:
    """The game whose functions have the contract's names in `module`, which has a NAME too."""
    names = ("make_rules", "make_spec", "allocate", "reset", "step", "legal_actions")
    place = vars(sys.modules[module])
    plain = {
        "version": "1",
        "summary": title,
        "player_range": (2, 2),
        "draw": draw_nothing,
        "rewards": {"sparse": "+1 win, -1 loss"},
        "hidden_fields": (),
        "gymnasium_prefix": title.title().replace(",", "").replace(" ", ""),
        "default_scenario": next(iter(fields["scenarios"])),
        **{name: place[name] for name in names},
    }
    return Game(name=place["NAME"], title=title, **{**plain, **fields})


def register(module: str, monkeypatch) -> None:
    """Make a module's game known by its name while a test runs."""
    place = sys.modules[module]
    monkeypatch.setitem(GAMES.modules, place.NAME, place)


def draw_nothing(worlds, rules, world, player):
    """A black picture."""
    return np.zeros((4, 4, 3), np.uint8)


class Stateless:
    """The methods of an agent without randomness, beside `act`."""

    representation = "vector"

    def seed(self, seed):
        """There is nothing to seed."""

    def state_dict(self):
        return {}

    def load_state_dict(self, state):
        """There is nothing to load."""
