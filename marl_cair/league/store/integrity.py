"""Validates league files; raises `sqlite3.DatabaseError` if the contents are inconsistent."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import groupby
from operator import itemgetter
from typing import Any

_SETTINGS = {
    "game": str,
    "game_version": str,
    "scenario": dict,
    "seed": int,
    "seating": str,
    "team_of_seat": list,
}


@contextmanager
def named_damage() -> Iterator[None]:
    """What fails while a file is parsed is damage of the file; our own errors stay as they are."""
    try:
        yield
    except (KeyError, TypeError, IndexError, OverflowError, ValueError) as error:
        if type(error).__module__.startswith("marl_cair."):
            raise
        raise sqlite3.DatabaseError(f"{type(error).__name__}: {error}") from error


def check_settings(held: Mapping[str, Any]) -> None:
    """Raise sqlite3.DatabaseError where what results depend on is missing or of another type."""
    for key, kind in _SETTINGS.items():
        if not isinstance(held.get(key), kind):
            raise sqlite3.DatabaseError(
                f"its {key} is {json.dumps(held.get(key))}, it must be of type {kind.__name__}"
            )


def check_games(places: Iterable[tuple[Any, Any]], num_teams: int) -> None:
    """Raise sqlite3.DatabaseError where a game has not each of the teams once.

    places: a game and a team of it, in the order of the games and teams.
    """
    wanted = list(range(num_teams))
    for game, group in groupby(places, itemgetter(0)):
        teams = [team for _, team in group if team is not None]
        if teams != wanted:
            raise sqlite3.DatabaseError(f"game {game} has the teams {teams}, it must have {wanted}")
