"""Exports a league file as tables: CSV, JSON or Parquet."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from marl_cair.files import atomic_path, write_atomically
from marl_cair.league.store.store import LeagueStore
from marl_cair.lookup import find_by_name
from marl_cair.text import format_csv

# Queries by the name of the table; `games` has a row for each team of each game.
QUERIES = {
    "agents": "SELECT id, fingerprint, name, kind, evaluation_policy, rules_version, configuration "
    "FROM agent ORDER BY id",
    "games": "SELECT g.id AS game, b.line_up, b.number AS block, b.map_seed, g.number, g.status, "
    "g.is_truncated, g.decisions, g.trajectory, g.reason, t.team, t.entry, t.agent, "
    "a.name AS agent_name, t.points, t.rank, t.is_winner, t.has_forfeited "
    "FROM team t JOIN game g ON g.id = t.game JOIN block b ON b.id = g.block "
    "JOIN agent a ON a.id = t.agent ORDER BY g.id, t.team",
    "seats": "SELECT seat, team FROM seat ORDER BY seat",
    "ratings": "SELECT u.id AS run, u.created_at, u.parameters, u.games_hash, r.agent, "
    "a.name AS agent_name, r.elo, r.low, r.high, r.bound, r.group_number, r.probability_first, "
    "r.games, r.score FROM rating r JOIN rating_run u ON u.id = r.run "
    "JOIN agent a ON a.id = r.agent ORDER BY u.id, r.group_number, r.elo DESC, a.name",
}


def export_league(store: LeagueStore, folder: Path, file_format: str) -> list[Path]:
    """Write each table of `QUERIES` to `folder` as <name>.<format>; returns the paths.

    Raises UnknownNameError for an unknown format, and ValueError for Parquet without pyarrow.
    """
    write = find_by_name("export format", file_format, FORMATS)
    paths = []
    for name, query in QUERIES.items():
        paths.append(folder / f"{name}.{file_format}")
        write(paths[-1], *store.read_rows(query))
    return paths


def _write_csv(path: Path, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    write_atomically(path, format_csv([columns, *rows]))


def _write_json(path: Path, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    records = [dict(zip(columns, row, strict=True)) for row in rows]
    write_atomically(path, json.dumps(records, indent=1) + "\n")


def _write_parquet(path: Path, columns: Sequence[str], rows: Sequence[Sequence[Any]]) -> None:
    try:
        import pyarrow  # an extra
        from pyarrow import parquet
    except ModuleNotFoundError as error:
        raise ValueError(
            "Parquet needs pyarrow: pip install 'marl_cair[parquet]', or export csv or json"
        ) from error
    arrays = [[row[place] for row in rows] for place in range(len(columns))]
    with atomic_path(path) as unfinished:
        parquet.write_table(pyarrow.table(arrays, names=list(columns)), unfinished)


FORMATS = {"csv": _write_csv, "json": _write_json, "parquet": _write_parquet}
