"""Prints a notice when JIT compilation takes more than a second."""

import sys
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

ANNOUNCE_AFTER_SECONDS = 1.0

_announced_games: set[str] = set()
_called: ContextVar[str] = ContextVar("the game whose rules are called", default="")


def _announce(game: str) -> None:
    if game not in _announced_games:
        _announced_games.add(game)
        message = f"marl_cair: compiling the rules of {game} (once for each version) ...\n"
        sys.stderr.write(message)


def announce_nothing(games: Iterable[str]) -> None:
    """Leave these games out in this process: another process reports its progress."""
    _announced_games.update(games)


@contextmanager
def calling(game: str) -> Iterator[None]:
    """Call rules of this game, which are compiled if they have never been."""
    token = _called.set(game)
    try:
        yield
    finally:
        _called.reset(token)


@contextmanager
def compiling() -> Iterator[None]:
    """Print which game is compiled when this takes more than a second."""
    if not (game := _called.get()):
        yield
        return
    timer = threading.Timer(ANNOUNCE_AFTER_SECONDS, _announce, (game,))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
