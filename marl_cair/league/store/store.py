"""Stores a league's games in one SQLite file, from which an interrupted league resumes."""

from __future__ import annotations

import dataclasses
import datetime
import json
import os
import sqlite3
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.league.store import schema
from marl_cair.league.store.schema import AgentRecord, PlayedGame
from marl_cair.text import clean_text

STORE_FILE = "league.sqlite"
BUSY_SECONDS = 60.0  # to wait while another program locks the file
_SAFE = "trusted_schema = OFF"  # triggers in a file call no unsafe functions


class LeagueStoreError(ValueError):
    """A league file that is damaged, cannot be written, or has other settings."""


@dataclass(frozen=True)
class StoredGames:
    """N games of T teams, sorted by line-up, block and game."""

    agents: NDArray[np.int64]  # [N, T], id of the agent that has played the team
    points: NDArray[np.float64]  # [N, T], as in `PlayedGame`
    ranks: NDArray[np.float64]  # [N, T], as in `PlayedGame`
    blocks: NDArray[np.int64]  # [N], equal for games of one block and line-up
    numbers: NDArray[np.int64]  # [N], number of the block within its line-up
    turns: NDArray[np.int64]  # [N], number of the game within its block
    map_seeds: NDArray[np.uint64]  # [N]
    line_ups: NDArray[np.int64]  # [N], equal for games of one line-up
    is_repeat: NDArray[np.bool_]  # [N], see `_find_repeats`
    is_truncated: NDArray[np.bool_]  # [N], ended by the time limit
    has_forfeited: NDArray[np.bool_]  # [N, T]
    decisions: NDArray[np.int64]  # [N], steps of each seat that was in to the end
    reasons: tuple[str, ...]  # N, of forfeits; "" without one
    trajectories: tuple[str, ...]  # N hashes

    def select(self, which: NDArray[Any]) -> StoredGames:
        """The games of an index or a mask [N]; `is_repeat` stays as it is."""
        kept = np.arange(len(self.trajectories))[which].tolist()
        columns: dict[str, Any] = {
            name: column[which]
            if isinstance(column, np.ndarray)
            else tuple(column[place] for place in kept)
            for name, column in vars(self).items()
        }
        return StoredGames(**columns)


class LeagueStore:
    """The league file at `path`, created if missing. A file that is read-only can be read, unless a
    killed league has left a log beside it.

    settings: plain data that results depend on, beside the agents (game, rules version, scenario,
    seed, seating, team of each seat); a file with other settings is refused. None: the file must
    exist, and has any settings.

    Raises LeagueStoreError: no league file, one of another version, a damaged one, or one with
    other settings. Each method raises it if the file cannot be read or written.
    """

    def __init__(self, path: Path, settings: Mapping[str, Any] | None = None) -> None:
        if not path.is_file() and (settings is None or path.exists()):  # a pipe would block
            problem = "no regular file" if path.exists() else "not there"
            raise LeagueStoreError(
                f"{path} is {problem}: give the folder of a league (`marl-cair league ... --out`)"
            )
        path.parent.mkdir(parents=True, exist_ok=True)
        self._path = path
        is_fixed = settings is None and not all(os.access(p, os.W_OK) for p in (path, path.parent))
        self._begin = "BEGIN" if is_fixed else "BEGIN IMMEDIATE"
        with self._explain_errors():
            self._database = _open_to_read(path) if is_fixed else _open_to_write(path)
            try:
                self.settings = self._open(settings)
            except BaseException:
                self._database.close()
                raise

    def _open(self, settings: Mapping[str, Any] | None) -> dict[str, Any]:
        (state,) = self._database.execute("PRAGMA quick_check(1)").fetchone()
        if state != "ok":
            raise sqlite3.DatabaseError(state)
        with self._transaction():
            held = schema.read_meta(self._database)
            if not held:
                if settings is None:
                    raise schema.SchemaError("holds no league")
                schema.create_tables(self._database, settings)
                return schema.read_meta(self._database)
            if settings is not None:
                self._check_settings(held, settings)
            schema.require_version(held)
            schema.check_settings(held)
        return held

    @contextmanager
    def _explain_errors(self) -> Iterator[None]:
        try:
            with schema.parse_errors():
                yield
        except schema.SchemaError as error:
            raise LeagueStoreError(f"{self._path} {error}") from error
        except sqlite3.OperationalError as error:
            raise LeagueStoreError(
                f"{self._path} cannot be read or written ({error}): see whether the disk is full "
                "or another program holds the file; then run the same command to resume"
            ) from error
        except sqlite3.DatabaseError as error:
            raise LeagueStoreError(
                f"{self._path} is no league file, or is damaged ({error}): give another folder"
            ) from error

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        """Commit all or nothing; the lock is taken at the start."""
        self._database.execute(self._begin)
        try:
            yield
        except BaseException:
            self._database.execute("ROLLBACK")
            raise
        self._database.execute("COMMIT")

    @contextmanager
    def _writing(self) -> Iterator[None]:
        with self._explain_errors(), self._transaction():
            yield

    def _check_settings(self, held: Mapping[str, Any], settings: Mapping[str, Any]) -> None:
        wanted = json.loads(json.dumps(settings))  # as JSON gives it back: tuples as lists
        for key in sorted(wanted):
            if key in held and held[key] != wanted[key]:
                raise LeagueStoreError(
                    f"{self._path} holds a league with {key} = {json.dumps(held[key])}, this one "
                    f"has {json.dumps(wanted[key])}: their results cannot be mixed; give another "
                    "folder"
                )

    def add_agent(self, agent: AgentRecord) -> int:
        """Add an agent, or update the one with this fingerprint; returns its id."""
        row = vars(agent)
        changes = ", ".join(f"{name} = excluded.{name}" for name in row)
        with self._writing():
            self._insert("agent", row, f"ON CONFLICT (fingerprint) DO UPDATE SET {changes}")
            query = "SELECT id FROM agent WHERE fingerprint = ?"
            (number,) = self._database.execute(query, (agent.fingerprint,)).fetchone()
        return int(number)

    def _insert(self, table: str, row: Mapping[str, Any], conflict: str = "") -> int | None:
        """Add a row; returns its id, None if it conflicts with one that is there."""
        values = ", ".join("?" * len(row))
        statement = f"INSERT INTO {table} ({', '.join(row)}) VALUES ({values}) {conflict}"  # noqa: S608  # names of ours
        cursor = self._database.execute(statement, tuple(row.values()))
        return cursor.lastrowid if cursor.rowcount else None

    def read_agents(self) -> dict[int, AgentRecord]:
        """All agents by id."""
        with self._explain_errors():
            columns = ", ".join(field.name for field in dataclasses.fields(AgentRecord))
            query = f"SELECT id, {columns} FROM agent ORDER BY id"  # noqa: S608  # names of ours
            rows = self._database.execute(query).fetchall()
            for *_, configuration in rows:
                dict(json.loads(configuration))
        cleaned = ([one, *map(clean_text, map(str, shown)), last] for one, *shown, last in rows)
        return {int(number): AgentRecord(*about) for number, *about in cleaned}

    def add_games(self, line_up: Sequence[int], games: Iterable[PlayedGame]) -> None:
        """Store games of whole blocks in one transaction; blocks that are stored already stay.

        line_up: the agents' ids, by entry.
        """
        key = " ".join(map(str, line_up))
        blocks: dict[int, int | None] = {}
        with self._writing():
            for game in games:
                if game.block not in blocks:
                    row = {"line_up": key, "number": game.block, "map_seed": str(game.map_seed)}
                    blocks[game.block] = self._insert("block", row, "ON CONFLICT DO NOTHING")
                block = blocks[game.block]
                if block is not None:
                    self._add_game(line_up, block, game)

    def _add_game(self, line_up: Sequence[int], block: int, game: PlayedGame) -> None:
        row = {
            "block": block,
            "number": game.number,
            "status": "forfeit" if any(game.forfeited) else "played",
            "is_truncated": game.is_truncated,
            "decisions": game.decisions,
            "trajectory": game.trajectory,
            "reason": game.reason,
        }
        number = self._insert("game", row)
        columns = zip(game.entries, game.points, game.ranks, game.forfeited, strict=True)
        teams = [
            (number, team, entry, line_up[entry], points, rank, team == game.winner, gave_up)
            for team, (entry, points, rank, gave_up) in enumerate(columns)
        ]
        self._database.executemany("INSERT INTO team VALUES (?, ?, ?, ?, ?, ?, ?, ?)", teams)

    def read_blocks(self) -> dict[tuple[int, ...], set[int]]:
        """Numbers of the stored blocks of each line-up."""
        held: dict[tuple[int, ...], set[int]] = {}
        with self._explain_errors():
            for line_up, number in self._database.execute("SELECT line_up, number FROM block"):
                held.setdefault(tuple(map(int, line_up.split())), set()).add(number)
        return held

    def read_games(self) -> StoredGames:
        """All games, sorted by the agents' fingerprints: the order does not depend on history."""
        with self._explain_errors():
            rows = self._database.execute(
                "SELECT b.line_up, b.number, g.number, b.map_seed, g.is_truncated, g.decisions, "
                "g.trajectory, g.reason, t.agent, t.points, t.rank, g.id, t.team, "
                "t.has_forfeited "
                "FROM game g JOIN block b ON b.id = g.block LEFT JOIN team t ON t.game = g.id "
                "ORDER BY g.id, t.team"
            ).fetchall()
            num_teams = len(set(self.settings["team_of_seat"]))
            schema.check_games([row[11:13] for row in rows], num_teams)
            prints = {number: agent.fingerprint for number, agent in self.read_agents().items()}
            return _parse_games(rows, prints, num_teams)

    def note(self, key: str, value: str) -> None:
        """Add `value` to the texts under `key`, once."""
        with self._writing():
            values = schema.read_meta(self._database).get(key, [])
            if value not in values:
                self._database.execute(
                    "INSERT OR REPLACE INTO meta VALUES (?, ?)", (key, json.dumps([*values, value]))
                )
            self.settings = schema.read_meta(self._database)

    def read_rows(self, query: str) -> tuple[list[str], list[tuple[Any, ...]]]:
        """Names of columns, and rows; bytes, which damaged files may hold, become text."""
        with self._explain_errors():
            cursor = self._database.execute(query)
            rows = [tuple(str(c) if isinstance(c, bytes) else c for c in row) for row in cursor]
            return [column[0] for column in cursor.description], rows

    def add_ratings(
        self,
        parameters: Mapping[str, Any],
        games_hash: str,
        num_games: int,
        rows: Iterable[tuple[Any, ...]],
    ) -> None:
        """Store a rating run, once for the same games and parameters; rows as table `rating`."""
        row = {
            "created_at": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
            "parameters": json.dumps(parameters, sort_keys=True),
            "games_hash": games_hash,
            "num_games": num_games,
        }
        with self._writing():
            run = self._insert("rating_run", row, "ON CONFLICT DO NOTHING")
            if run is not None:
                self._database.executemany(
                    "INSERT INTO rating VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                    [(run, *values) for values in rows],
                )

    def close(self) -> None:
        """Close the file."""
        self._database.close()


def _parse_games(
    rows: Sequence[tuple[Any, ...]], prints: Mapping[int, str], num_teams: int
) -> StoredGames:
    """Games from rows of the query in `read_games`, one for each team of a game.

    prints: fingerprints by agent.
    """
    firsts = rows[::num_teams]  # one for each game
    names = {
        text: tuple(prints[int(word)] for word in text.split())
        for text in {row[0] for row in firsts}
    }
    rank = {text: place for place, text in enumerate(sorted(names, key=lambda t: names[t]))}
    keys = np.array([(rank[r[0]], r[1], r[2]) for r in firsts], np.int64).reshape(-1, 3)
    order = np.lexsort(keys.T[::-1])
    parts = [firsts[place] for place in order.tolist()]

    def by_team(column: int, kind: type) -> NDArray[Any]:
        values: NDArray[Any] = np.array([row[column] for row in rows], kind)
        return values.reshape(-1, num_teams)[order]

    agents = by_team(8, np.int64)
    if unknown := set(agents.ravel().tolist()) - prints.keys():
        raise sqlite3.DatabaseError(f"games of agents {sorted(unknown)}, which are not there")
    trajectories = tuple(str(part[6]) for part in parts)
    return StoredGames(
        agents=agents,
        points=by_team(9, np.float64),
        ranks=by_team(10, np.float64),
        blocks=_number([part[:2] for part in parts]),
        numbers=keys[order, 1],
        turns=keys[order, 2],
        map_seeds=np.array([int(part[3]) for part in parts], np.uint64),
        line_ups=_number([part[0] for part in parts]),
        is_repeat=_find_repeats(agents, trajectories, [part[7] for part in parts]),
        is_truncated=np.array([part[4] for part in parts], np.bool_),
        has_forfeited=by_team(13, np.bool_),
        decisions=np.array([part[5] for part in parts], np.int64),
        reasons=tuple(clean_text(str(part[7])) for part in parts),
        trajectories=trajectories,
    )


def _open_to_write(path: Path) -> sqlite3.Connection:
    database = sqlite3.connect(path, timeout=BUSY_SECONDS, isolation_level=None)
    try:
        for setting in ("journal_mode = WAL", "synchronous = NORMAL", "foreign_keys = ON", _SAFE):
            database.execute(f"PRAGMA {setting}")
    except BaseException:
        database.close()
        raise
    return database


def _open_to_read(path: Path) -> sqlite3.Connection:
    """Open read-only, without creating SQLite's files beside the file."""
    options = "mode=ro" if Path(f"{path}-wal").exists() else "mode=ro&immutable=1"
    uri = f"{path.absolute().as_uri()}?{options}"
    database = sqlite3.connect(uri, timeout=BUSY_SECONDS, isolation_level=None, uri=True)
    database.execute(f"PRAGMA {_SAFE}")
    return database


def _number(keys: Sequence[Any]) -> NDArray[np.int64]:
    """Number equal keys alike, from 0 in the order in which they come."""
    numbers = {key: number for number, key in enumerate(dict.fromkeys(keys))}
    return np.array([numbers[key] for key in keys], np.int64)


def _find_repeats(
    agents: NDArray[np.int64], trajectories: Sequence[str], reasons: Sequence[str]
) -> NDArray[np.bool_]:
    """All games but the first in the same seats, of line-ups whose games are always the same there:
    neither the agents nor the maps vary. Else equal games count as often as they happen.
    """
    seats = [tuple(row) for row in agents.tolist()]
    first: dict[tuple[int, ...], int] = {}
    is_repeat = np.array([first.setdefault(row, n) != n for n, row in enumerate(seats)], np.bool_)
    varied = {
        tuple(sorted(row))
        for n, row in enumerate(seats)
        if reasons[n] or trajectories[n] != trajectories[first[row]]
    }
    return is_repeat & np.array([tuple(sorted(row)) not in varied for row in seats], np.bool_)
