"""All games of a league in one SQLite file: each match is kept at once, a killed league goes on."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from marl_cair.league.match import GameResult, MatchResult

SCHEMA_VERSION = 1
_SCHEMA = """
CREATE TABLE IF NOT EXISTS meta (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS agent (
    id INTEGER PRIMARY KEY, name TEXT UNIQUE NOT NULL, fingerprint TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS game (
    first INTEGER NOT NULL REFERENCES agent, second INTEGER NOT NULL REFERENCES agent,
    block INTEGER NOT NULL, first_seat INTEGER NOT NULL,
    winner INTEGER NOT NULL, is_truncated INTEGER NOT NULL, decisions INTEGER NOT NULL,
    fingerprint TEXT NOT NULL,
    PRIMARY KEY (first, second, block, first_seat)
) WITHOUT ROWID;
"""


class LeagueStoreError(ValueError):
    """A league file that is broken, or of other settings or agents."""


class LeagueStore:
    """The league file at `path`, made if it is not there.

    settings: what results depend on (game, rules version, scenario, seed); a file of other settings
    is refused.

    Raises:
        LeagueStoreError: no league file, or one of other settings; says which.
    """

    def __init__(self, path: Path, settings: Mapping[str, Any]) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._path = path
        try:
            self._database = sqlite3.connect(path)
            self._database.execute("PRAGMA journal_mode = WAL")
            self._database.executescript(_SCHEMA)
            self._check_settings({"schema_version": SCHEMA_VERSION, **settings})
        except sqlite3.DatabaseError as error:
            raise LeagueStoreError(
                f"{path} is no league file, or is damaged ({error}): give another folder"
            ) from error

    def _check_settings(self, settings: Mapping[str, Any]) -> None:
        wanted = {key: json.dumps(value, sort_keys=True) for key, value in settings.items()}
        held = dict(self._database.execute("SELECT key, value FROM meta"))
        if not held:
            with self._database:
                self._database.executemany("INSERT INTO meta VALUES (?, ?)", wanted.items())
            return
        for key, value in wanted.items():
            if held.get(key) != value:
                raise LeagueStoreError(
                    f"{self._path} holds a league with {key} = {held.get(key)}, this one has "
                    f"{value}: their results cannot be mixed; give another folder"
                )

    def add_agent(self, name: str, fingerprint: str) -> int:
        """The agent's number. Raises LeagueStoreError where the name belongs to other weights."""
        with self._database:
            self._database.execute(
                "INSERT OR IGNORE INTO agent (name, fingerprint) VALUES (?, ?)",
                (name, fingerprint),
            )
        query = "SELECT id, fingerprint FROM agent WHERE name = ?"
        number, held = self._database.execute(query, (name,)).fetchone()
        if held != fingerprint:
            raise LeagueStoreError(
                f"{self._path} knows another agent by the name {name!r}: give another folder"
            )
        return int(number)

    def add_match(self, first: int, second: int, match: MatchResult) -> None:
        """Keep all games of a match, in one transaction."""
        rows = [
            (
                first,
                second,
                result.block,
                result.first_seat,
                result.winner,
                result.is_truncated,
                result.decisions,
                result.fingerprint,
            )
            for result in match.results
        ]
        with self._database:
            self._database.executemany(
                "INSERT OR IGNORE INTO game VALUES (?, ?, ?, ?, ?, ?, ?, ?)", rows
            )

    def read_match(self, first: int, second: int) -> MatchResult:
        """The stored games of a pair in this order, by block and seat."""
        query = (
            "SELECT block, first_seat, winner, is_truncated, decisions, fingerprint FROM game "
            "WHERE first = ? AND second = ? ORDER BY block, first_seat"
        )
        return MatchResult(
            tuple(
                GameResult(block, seat, winner, bool(truncated), decisions, fingerprint)
                for block, seat, winner, truncated, decisions, fingerprint in (
                    self._database.execute(query, (first, second))
                )
            )
        )

    def close(self) -> None:
        """Close the file."""
        self._database.close()
