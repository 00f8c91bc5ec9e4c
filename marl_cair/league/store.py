"""All games of a league in one SQLite file: chunks are kept at once, a killed league goes on."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from marl_cair.league.match import GameResult, MatchResult

SCHEMA_VERSION = 2
BUSY_SECONDS = 60.0  # to wait for another program that holds the file
_SCHEMA = """
CREATE TABLE IF NOT EXISTS meta (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS agent (
    id INTEGER PRIMARY KEY, fingerprint TEXT UNIQUE NOT NULL, name TEXT NOT NULL
);
CREATE TABLE IF NOT EXISTS game (
    first INTEGER NOT NULL REFERENCES agent, second INTEGER NOT NULL REFERENCES agent,
    block INTEGER NOT NULL, first_seat INTEGER NOT NULL,
    winner INTEGER NOT NULL, is_truncated INTEGER NOT NULL, decisions INTEGER NOT NULL,
    fingerprint TEXT NOT NULL,
    PRIMARY KEY (first, second, block, first_seat)
) WITHOUT ROWID;
"""
_COLUMNS = "block, first_seat, winner, is_truncated, decisions, fingerprint"


class LeagueStoreError(ValueError):
    """A league file that is broken, cannot be written, or is of other settings."""


class LeagueStore:
    """The league file at `path`, made if it is not there.

    settings: what results depend on beside the agents (game, rules version, scenario, seed) as
    plain data; a file of other settings is refused.

    Raises:
        LeagueStoreError: no league file, or one of other settings; says which. Each method raises
            it where the file cannot be read or written.
    """

    def __init__(self, path: Path, settings: Mapping[str, Any]) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        self._path = path
        with self._named_errors():
            self._database = sqlite3.connect(path, timeout=BUSY_SECONDS)
            self._database.execute("PRAGMA journal_mode = WAL")
            self._database.executescript(_SCHEMA)
            self._check_settings({"schema_version": SCHEMA_VERSION, **settings})

    @contextmanager
    def _named_errors(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.OperationalError as error:
            raise LeagueStoreError(
                f"{self._path} cannot be read or written ({error}): see whether the disk is full "
                "or another program holds the file; the same command then goes on"
            ) from error
        except sqlite3.DatabaseError as error:
            raise LeagueStoreError(
                f"{self._path} is no league file, or is damaged ({error}): give another folder"
            ) from error

    def _check_settings(self, settings: Mapping[str, Any]) -> None:
        wanted = {key: json.dumps(value, sort_keys=True) for key, value in settings.items()}
        held = dict(self._database.execute("SELECT key, value FROM meta"))
        if not held:
            with self._database:
                self._database.executemany("INSERT INTO meta VALUES (?, ?)", wanted.items())
            return
        for key in sorted(wanted.keys() | held.keys()):
            if held.get(key) != wanted.get(key):
                raise LeagueStoreError(
                    f"{self._path} holds a league with {key} = {held.get(key)}, this one has "
                    f"{wanted.get(key)}: their results cannot be mixed; give another folder"
                )

    def add_agent(self, name: str, fingerprint: str) -> int:
        """The number of the agent with this fingerprint; `name` is only what it is called now."""
        with self._named_errors(), self._database:
            self._database.execute(
                "INSERT INTO agent (fingerprint, name) VALUES (?, ?) "
                "ON CONFLICT (fingerprint) DO UPDATE SET name = excluded.name",
                (fingerprint, name),
            )
            query = "SELECT id FROM agent WHERE fingerprint = ?"
            (number,) = self._database.execute(query, (fingerprint,)).fetchone()
        return int(number)

    def add_match(self, first: int, second: int, match: MatchResult) -> None:
        """Keep all games of a match in one transaction; games that are there already stay."""
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
        with self._named_errors(), self._database:
            self._database.executemany(
                f"INSERT OR IGNORE INTO game (first, second, {_COLUMNS}) "  # noqa: S608  # constant
                "VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
                rows,
            )

    def read_match(self, first: int, second: int) -> MatchResult:
        """The stored games of a pair in this order, by block and seat."""
        query = (
            f"SELECT {_COLUMNS} FROM game "  # noqa: S608  # a constant of this file
            "WHERE first = ? AND second = ? ORDER BY block, first_seat"
        )
        with self._named_errors():
            rows = self._database.execute(query, (first, second)).fetchall()
        return MatchResult(
            tuple(
                GameResult(block, seat, winner, bool(truncated), decisions, fingerprint)
                for block, seat, winner, truncated, decisions, fingerprint in rows
            )
        )

    def close(self) -> None:
        """Close the file."""
        self._database.close()
