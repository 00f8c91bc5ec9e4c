"""Makes the controls of each person: mouse or keys by game, digits for other games."""

from __future__ import annotations

from collections.abc import Sequence

import pygame

from marl_cair.window.boards import Board
from marl_cair.window.controls.controls import (
    ClickControls,
    Controls,
    KeyControls,
    find_action,
)
from marl_cair.window.controls.held_keys import HeldKeys
from marl_cair.window.controls.line_wars import LineWarsControls
from marl_cair.window.controls.rts import CLASSIC_KEYS, RtsControls
from marl_cair.window.session import Session

# Keys of down, up, left and right of each person in a maze.
MAZE_KEYS = (
    (pygame.K_DOWN, pygame.K_UP, pygame.K_LEFT, pygame.K_RIGHT),
    (pygame.K_s, pygame.K_w, pygame.K_a, pygame.K_d),
    (pygame.K_k, pygame.K_i, pygame.K_j, pygame.K_l),
    (pygame.K_KP2, pygame.K_KP8, pygame.K_KP4, pygame.K_KP6),
)
FLAP_KEYS = (pygame.K_SPACE, pygame.K_UP, pygame.K_w, pygame.K_i, pygame.K_KP8, pygame.K_q,
             pygame.K_y, pygame.K_RETURN)  # fmt: skip
DIGITS = tuple(range(pygame.K_1, pygame.K_9 + 1))
# Games that wait for a person who plays alone.
TURNS = ("deep_maze",)


def make_controls(session: Session, board: Board | None) -> Sequence[Controls]:
    """The controls of each person, in the order of their seats."""
    return [_make(session, seat, person, board) for person, seat in enumerate(session.persons)]


def _make(session: Session, seat: int, person: int, board: Board | None) -> Controls:
    game = session.game.name
    if game == "deep_line_wars" and board is not None:
        return LineWarsControls(session, seat, board)
    if game == "deep_rts" and board is not None and session.scenario.actions != "classic":
        return RtsControls(session, seat, board)
    if game == "flash" and session.scenario.actions == "keys":
        return HeldKeys(session, seat)
    if game == "flash" and board is not None:
        return ClickControls(session, seat, board)
    return KeyControls(session, seat, _choose_keys(session, person))


def _choose_keys(session: Session, person: int) -> dict[int, int]:
    """The actions of the keys of a person."""
    game, spec = session.game.name, session.spec
    if game == "deep_rts":
        return {key: find_action(spec, name) for key, name in CLASSIC_KEYS.items()}
    if game == "deep_maze":
        return dict(zip(MAZE_KEYS[person], range(4), strict=True))
    if game == "flappy_bird":
        return {FLAP_KEYS[person]: find_action(spec, "flap")}
    others = [a for a in range(spec.num_actions) if a != spec.noop_action]
    return dict(zip(DIGITS, others, strict=False))
