"""Tables of a league file: their rows, creation and validation.

Inconsistent contents raise `sqlite3.DatabaseError`, as SQLite does for a damaged file.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import groupby
from operator import itemgetter
from typing import Any

SCHEMA_VERSION = 4
# A block is in the file with all its games or not at all: each chunk is one transaction.
TABLES = """
CREATE TABLE meta (key TEXT PRIMARY KEY, value TEXT NOT NULL);
CREATE TABLE agent (
    id INTEGER PRIMARY KEY,
    fingerprint TEXT UNIQUE NOT NULL,    -- hash of the agent
    name TEXT NOT NULL,                  -- its last one
    kind TEXT NOT NULL,                  -- bot, network or foreign
    evaluation_policy TEXT NOT NULL,     -- greedy, epsilon-greedy 0.05, scripted, ...
    rules_version TEXT NOT NULL,         -- of the game, when it joined
    configuration TEXT NOT NULL          -- JSON
);
CREATE TABLE block (
    id INTEGER PRIMARY KEY,
    line_up TEXT NOT NULL,               -- agent ids in the order of entries, by spaces
    number INTEGER NOT NULL,             -- within the line-up
    map_seed TEXT NOT NULL,              -- unsigned, 64 bits
    UNIQUE (line_up, number)
);
CREATE TABLE game (
    id INTEGER PRIMARY KEY,
    block INTEGER NOT NULL REFERENCES block,
    number INTEGER NOT NULL,             -- within the block
    status TEXT NOT NULL CHECK (status IN ('played', 'forfeit')),
    is_truncated INTEGER NOT NULL,
    decisions INTEGER NOT NULL,
    trajectory TEXT NOT NULL,            -- equal for games that are the same
    reason TEXT NOT NULL,                -- of a forfeit
    UNIQUE (block, number)
);
CREATE TABLE team (
    game INTEGER NOT NULL REFERENCES game,
    team INTEGER NOT NULL,
    entry INTEGER NOT NULL,              -- of the line-up, that plays the team
    agent INTEGER NOT NULL REFERENCES agent,
    points REAL NOT NULL,                -- in sum 1
    rank REAL NOT NULL,                  -- 1 is the best, equal ones share the mean
    is_winner INTEGER NOT NULL,
    has_forfeited INTEGER NOT NULL,
    PRIMARY KEY (game, team)
) WITHOUT ROWID;
CREATE TABLE seat (                      -- which team each seat belongs to, in every game
    seat INTEGER PRIMARY KEY,
    team INTEGER NOT NULL
);
CREATE TABLE rating_run (
    id INTEGER PRIMARY KEY,
    created_at TEXT NOT NULL,            -- UTC
    parameters TEXT NOT NULL,            -- JSON: method, prior, number of resamples, seed
    games_hash TEXT NOT NULL,            -- of all rated games
    num_games INTEGER NOT NULL,
    UNIQUE (parameters, games_hash)
);
CREATE TABLE rating (
    run INTEGER NOT NULL REFERENCES rating_run,
    agent INTEGER NOT NULL REFERENCES agent,
    elo REAL NOT NULL, low REAL NOT NULL, high REAL NOT NULL,
    bound TEXT NOT NULL,                 -- '', 'lower' or 'upper'
    group_number INTEGER NOT NULL,
    probability_first REAL NOT NULL,
    games INTEGER NOT NULL, score REAL NOT NULL,
    PRIMARY KEY (run, agent)
) WITHOUT ROWID;
"""


@dataclass(frozen=True)
class AgentRecord:
    """A row of the table `agent`; see TABLES."""

    fingerprint: str
    name: str
    kind: str
    evaluation_policy: str
    rules_version: str
    configuration: str  # JSON


@dataclass(frozen=True)
class PlayedGame:
    """One finished game of a line-up; each tuple has a value for each of the T teams."""

    block: int  # number of the block within the line-up
    number: int  # number of the game within the block
    map_seed: int  # the engine's
    entries: tuple[int, ...]  # the entry of the line-up that has played the team
    points: tuple[float, ...]  # in sum 1; a draw is shared by the teams that were left
    ranks: tuple[float, ...]  # 1 is the best; equal teams share the mean
    winner: int  # the winning team, or NO_WINNER
    is_truncated: bool  # whether the time limit has ended the game
    decisions: int  # steps of each seat that was in to the end
    trajectory: str  # hash of all actions, the first and the last board
    forfeited: tuple[bool, ...]  # whether the team has crashed or played an illegal action
    reason: str  # of the forfeit; "" without one


class SchemaError(ValueError):
    """No league file, or one of a version that this program cannot read."""


def create_tables(database: sqlite3.Connection, settings: Mapping[str, Any]) -> None:
    """Create all tables in the open transaction; settings are plain data with `team_of_seat`."""
    for statement in TABLES.strip().split(";\n"):
        database.execute(statement)
    rows = {"schema_version": SCHEMA_VERSION, **settings}
    database.executemany(
        "INSERT INTO meta VALUES (?, ?)",
        [(key, json.dumps(value, sort_keys=True)) for key, value in rows.items()],
    )
    database.executemany(
        "INSERT INTO seat VALUES (?, ?)", list(enumerate(settings["team_of_seat"]))
    )


def read_meta(database: sqlite3.Connection) -> dict[str, Any]:
    """Settings and notes by name; empty if the file has no tables yet. Raises SchemaError for
    tables of another program.
    """
    tables = {name for (name,) in database.execute("SELECT name FROM sqlite_master")}
    if not tables:
        return {}
    if "meta" not in tables:
        raise SchemaError(f"holds tables of something else ({', '.join(sorted(tables)[:3])})")
    held = database.execute("SELECT key, value FROM meta")
    return {str(key): json.loads(value) for key, value in held}


def require_version(held: Mapping[str, Any]) -> None:
    """Raise SchemaError unless the settings are of a file of SCHEMA_VERSION."""
    version = held.get("schema_version")
    if version != SCHEMA_VERSION:
        raise SchemaError(
            f"has schema version {version}, this marl_cair reads version {SCHEMA_VERSION}: take "
            "the marl_cair that wrote it, or give another folder"
        )


_SETTINGS = {
    "game": str,
    "game_version": str,
    "scenario": dict,
    "seed": int,
    "seating": str,
    "team_of_seat": list,
}


@contextmanager
def parse_errors() -> Iterator[None]:
    """Turn errors of parsing a file into sqlite3.DatabaseError, but for this package's own."""
    try:
        yield
    except (KeyError, TypeError, IndexError, OverflowError, ValueError) as error:
        if type(error).__module__.startswith("marl_cair."):
            raise
        raise sqlite3.DatabaseError(f"{type(error).__name__}: {error}") from error


def check_settings(held: Mapping[str, Any]) -> None:
    """Raise sqlite3.DatabaseError if a setting is missing or of another type."""
    for key, kind in _SETTINGS.items():
        if not isinstance(held.get(key), kind):
            raise sqlite3.DatabaseError(
                f"its {key} is {json.dumps(held.get(key))}, it must be of type {kind.__name__}"
            )


def check_games(places: Iterable[tuple[Any, Any]], num_teams: int) -> None:
    """Raise sqlite3.DatabaseError if a game has not each of the teams once.

    places: pairs of a game and a team (None: a game without teams), sorted.
    """
    wanted = list(range(num_teams))
    for game, group in groupby(places, itemgetter(0)):
        teams = [team for _, team in group if team is not None]
        if teams != wanted:
            raise sqlite3.DatabaseError(f"game {game} has the teams {teams}, it must have {wanted}")
