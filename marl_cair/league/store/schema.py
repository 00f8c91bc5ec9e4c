"""Tables of a league file: creation, migrations from older versions, and validation.

Inconsistent contents raise `sqlite3.DatabaseError`, as SQLite does for a damaged file.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from itertools import groupby
from operator import itemgetter
from typing import Any

import numpy as np

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


def migrate(database: sqlite3.Connection, settings: Mapping[str, Any]) -> None:
    """Migrate the tables to SCHEMA_VERSION in the open transaction.

    settings: of the league that opens the file; older versions did not store all of them. Raises
    SchemaError for a newer version, or one that was never released.
    """
    version = read_meta(database).get("schema_version")
    if not isinstance(version, int) or version > SCHEMA_VERSION:
        raise SchemaError(
            f"has schema version {version}, this marl_cair reads versions up to {SCHEMA_VERSION}: "
            "update marl_cair, or give another folder"
        )
    while version < SCHEMA_VERSION:
        if version not in _MIGRATIONS:
            raise SchemaError(f"has schema version {version}, which cannot be brought up")
        _MIGRATIONS[version](database, settings)
        version += 1


def _migrate_2(database: sqlite3.Connection, settings: Mapping[str, Any]) -> None:
    """Version 2 had both teams in a row of `game`, no kinds of agents and no forfeits."""
    if "team_of_seat" not in settings:
        raise SchemaError(
            "has schema version 2, which does not say which seats play together: give the command "
            "that played it (`marl-cair league ...`) once more, which brings it up"
        )
    meta = read_meta(database)
    agents = database.execute("SELECT id, fingerprint, name FROM agent").fetchall()
    games = database.execute(
        "SELECT first, second, block, first_seat, winner, is_truncated, decisions, fingerprint "
        "FROM game ORDER BY first, second, block, first_seat"
    ).fetchall()
    for table in ("game", "agent", "meta"):
        database.execute(f"DROP TABLE {table}")
    del meta["schema_version"]
    teams = list(settings["team_of_seat"])
    create_tables(database, {**settings, **meta})
    version = str(meta["game_version"])
    from marl_cair.games.randomness import episode_seeds  # compiled: numba takes a second

    database.executemany(
        "INSERT INTO agent VALUES (?, ?, ?, 'unknown', 'unknown', ?, '{}')",
        [(*agent, version) for agent in agents],
    )
    blocks: dict[tuple[str, int], int] = {}
    for first, second, block, first_seat, winner, *about, fingerprint in games:
        key = f"{first} {second}", block
        if key not in blocks:
            map_seed = episode_seeds(meta["seed"], np.array([block]), np.zeros(1, np.int64))
            cursor = database.execute(
                "INSERT INTO block (line_up, number, map_seed) VALUES (?, ?, ?)",
                (*key, str(map_seed[0])),
            )
            blocks[key] = int(cursor.lastrowid or 0)
        own = teams[first_seat]
        winning = None if winner < 0 else teams[winner]
        game = database.execute(
            "INSERT INTO game (block, number, status, is_truncated, decisions, trajectory, reason) "
            "VALUES (?, ?, 'played', ?, ?, ?, '')",
            # Hashes of actions alone: never equal to those of newer games.
            (blocks[key], own, *about, f"actions {fingerprint}"),
        ).lastrowid
        for team in (0, 1):
            entry = int(team != own)
            points = 0.5 if winning is None else float(team == winning)
            row = game, team, entry, (first, second)[entry], points, 2.0 - points, team == winning
            database.execute("INSERT INTO team VALUES (?, ?, ?, ?, ?, ?, ?, 0)", row)


def _migrate_3(database: sqlite3.Connection, settings: Mapping[str, Any]) -> None:
    """Version 3 had another fingerprint for a function that runs in a process of its own.

    A file with both agents keeps both, as each has its games.
    """
    database.execute(
        "UPDATE OR IGNORE agent SET fingerprint = replace(fingerprint, 'hosted ', 'foreign ') "
        "WHERE fingerprint LIKE 'hosted %'"
    )
    database.execute("UPDATE meta SET value = '4' WHERE key = 'schema_version'")


# By the version that each migrates to the next one.
_MIGRATIONS: dict[int, Callable[[sqlite3.Connection, Mapping[str, Any]], None]] = {
    2: _migrate_2,
    3: _migrate_3,
}

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
