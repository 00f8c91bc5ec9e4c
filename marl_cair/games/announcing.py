"""A word to the user whom the first call of a rule keeps waiting for the compiler."""

import sys
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

ANNOUNCE_AFTER_SECONDS = 1.0

_announced_games: set[str] = set()


def _announce(game: str) -> None:
    if game not in _announced_games:
        _announced_games.add(game)
        message = f"marl_cair: compiling the rules of {game} (once for each version) ...\n"
        sys.stderr.write(message)


def announce_nothing(games: Iterable[str]) -> None:
    """Leave these games out in this process: somebody else tells what it is doing."""
    _announced_games.update(games)


@contextmanager
def announced(game: str) -> Iterator[None]:
    """Tell the user when the first call of a kernel keeps them waiting for the compiler."""
    timer = threading.Timer(ANNOUNCE_AFTER_SECONDS, _announce, (game,))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
