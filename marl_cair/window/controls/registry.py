"""Makes the controls of each person: a table by game, and digits for games without an entry."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pygame

from marl_cair.window.boards import Board
from marl_cair.window.controls.controls import Controls, KeyControls, find_action
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


def _make_line_wars(session: Session, seat: int, person: int, board: Board | None) -> Controls:
    return LineWarsControls(session, seat, _require(board))


def _make_rts(session: Session, seat: int, person: int, board: Board | None) -> Controls:
    if session.scenario.actions != "classic":
        return RtsControls(session, seat, _require(board))
    keys = {key: find_action(session.spec, name) for key, name in CLASSIC_KEYS.items()}
    return KeyControls(session, seat, keys)


def _make_maze(session: Session, seat: int, person: int, board: Board | None) -> Controls:
    return KeyControls(session, seat, dict(zip(MAZE_KEYS[person], range(4), strict=True)))


def _make_flappy(session: Session, seat: int, person: int, board: Board | None) -> Controls:
    return KeyControls(session, seat, {FLAP_KEYS[person]: find_action(session.spec, "flap")})


def _make_digits(session: Session, seat: int, person: int, board: Board | None) -> Controls:
    others = [a for a in range(session.spec.num_actions) if a != session.spec.noop_action]
    return KeyControls(session, seat, dict(zip(DIGITS, others, strict=False)))


def _require(board: Board | None) -> Board:
    if board is None:
        raise ValueError("controls by mouse need a game with a board")
    return board


_MAKERS: dict[str, Callable[[Session, int, int, Board | None], Controls]] = {
    "deep_line_wars": _make_line_wars,
    "deep_rts": _make_rts,
    "deep_maze": _make_maze,
    "flappy_bird": _make_flappy,
}
# Games that wait for a person who plays alone.
TURNS = ("deep_maze",)


def make_controls(session: Session, board: Board | None) -> Sequence[Controls]:
    """The controls of each person, in the order of their seats."""
    make = _MAKERS.get(session.game.name, _make_digits)
    return [make(session, seat, person, board) for person, seat in enumerate(session.persons)]
