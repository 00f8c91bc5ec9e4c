"""Writes the files of a report: HTML, Markdown, text, CSV, PNG and PDF."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from marl_cair.files import write_atomically
from marl_cair.league.ratings.fit import FitTest
from marl_cair.league.ratings.payoffs import Share
from marl_cair.league.ratings.rate import Rating
from marl_cair.league.report.render import render_html, render_markdown, render_text
from marl_cair.league.report.sections import Report
from marl_cair.league.report.table import LeagueTable
from marl_cair.text import clean_cell

FILES = (
    "report.html",
    "report.md",
    "ladder.txt",
    "league.png",
    "league.pdf",
    "ladder.csv",
    "differences.csv",
    "winrates.csv",
    "seats.csv",
    "maps.csv",
    "training.csv",
    "averages.csv",
    "cycles.csv",
    "fit.csv",
    "forfeits.csv",
)


def write_report(folder: Path, report: Report) -> str:
    """Write all of FILES to `folder`, each whole or not at all; returns the plain text."""
    from marl_cair.league.report.charts import write_figures  # matplotlib takes long to import

    text = render_text(report)
    write_atomically(folder / "ladder.txt", text)
    for name, (header, rows) in _list_tables(report).items():
        write_atomically(folder / f"{name}.csv", _as_csv(header, rows))
    write_figures(folder, report.table)
    write_atomically(folder / "report.md", render_markdown(report))
    write_atomically(folder / "report.html", render_html(report))
    return text


def _list_tables(report: Report) -> dict[str, tuple[Sequence[str], Sequence[Sequence[Any]]]]:
    """Header and rows of each CSV file by its name."""
    table = report.table
    scores = ("weight", "low", "high", "score", "score_low", "score_high")
    share = ("score", "low", "high", "games")
    return {
        "ladder": _list_ladder(table.ratings),
        "winrates": _list_matrix(table),
        "differences": _list_differences(table),
        "seats": (
            ("agent", "team", *share),
            [(name, team + 1, *_format(found)) for (name, team), found in _sort(table.team_shares)],
        ),
        "maps": (
            ("agent", "map", *share),
            [(*key, *_format(found)) for key, found in _sort(report.background.map_shares)],
        ),
        "training": (
            ("run", "decisions", "agent", "elo", "low", "high"),
            [
                (curve.run, frames, r.name, f"{r.elo:.2f}", f"{r.low:.2f}", f"{r.high:.2f}")
                for curve in report.curves
                for frames, r in curve.points
            ],
        ),
        "averages": (("method", "agent", *scores), _list_averages(table)),
        "cycles": (("first", "second", "third", "share"), _list_cycles(table)),
        "fit": (("number", "value"), _list_fit(table)),
        "forfeits": (("reason", "games"), table.forfeits),
    }


def _sort(shares: Mapping[Any, Share]) -> list[tuple[Any, Share]]:
    return sorted(shares.items())


def _format(share: Share) -> tuple[str, str, str, int]:
    return f"{share.share:.4f}", f"{share.low:.4f}", f"{share.high:.4f}", share.games


def _list_ladder(ratings: Sequence[Rating]) -> tuple[Sequence[str], list[tuple[Any, ...]]]:
    return (
        ("agent", "elo", "low", "high", "open", "bound", "group", "first", "score", "games"),
        [
            (
                r.name,
                f"{r.elo:.2f}",
                f"{r.low:.2f}",
                f"{r.high:.2f}",
                " ".join(end for end in ("low", "high") if getattr(r, f"open_{end}")),
                r.bound,
                r.group,
                f"{r.probability_first:.3f}",
                f"{r.score:.4f}",
                r.games,
            )
            for r in ratings
        ],
    )


def _list_matrix(table: LeagueTable) -> tuple[Sequence[str], list[tuple[Any, ...]]]:
    rows: list[tuple[Any, ...]] = []
    for row, column in np.ndindex(table.counts.shape):
        pair = table.pair(row, column)
        if pair is not None:
            names = table.names[row], table.names[column]
            draws = int(table.draws[row, column])
            wins = round(float(table.points[row, column]) - 0.5 * draws)
            found = wins, draws, pair.games - wins - draws
            rows.append((*names, *_format(pair), table.repeats[row, column], *found))
    share = "score", "low", "high", "games", "repeated_games"
    return ("agent", "opponent", *share, "wins", "draws", "losses"), rows


def _list_differences(table: LeagueTable) -> tuple[Sequence[str], list[tuple[Any, ...]]]:
    rows: list[tuple[Any, ...]] = []
    header = ("agent", "opponent", "elo", "low", "high", "bound")
    if table.ladder is None:
        return header, rows
    for row, column in np.argwhere(~np.eye(len(table.names), dtype=np.bool_)).tolist():
        gap = table.ladder.differences[row][column]
        own, other = table.ratings[row], table.ratings[column]
        elo = own.elo - other.elo
        ends = ("", "") if gap is None else (f"{gap.low:.2f}", f"{gap.high:.2f}")
        bound = "" if gap else "lower" if own.group < other.group else "upper"
        rows.append((own.name, other.name, f"{elo:.2f}", *ends, bound))
    return header, rows


def _list_fit(table: LeagueTable) -> list[tuple[str, str]]:
    if table.diagnostics is None:
        return []
    fit = table.diagnostics.fit
    names = [field.name for field in fields(FitTest)]
    return [(name, "" if fit is None else f"{getattr(fit, name):.6g}") for name in names]


def _list_cycles(table: LeagueTable) -> list[tuple[str, ...]]:
    return [
        (*(table.numbered_names[agent] for agent in cycle.agents), f"{cycle.share:.4f}")
        for cycle in (table.diagnostics.cycles if table.diagnostics else ())
    ]


def _list_averages(table: LeagueTable) -> list[tuple[str, ...]]:
    """Best agent first."""
    place = {name: number for number, name in enumerate(table.numbered_names)}
    rows = []
    for title, found in (table.diagnostics.averages if table.diagnostics else {}).items():
        columns = [getattr(found, field.name) for field in fields(found)]
        rows += [
            (title, name, *(f"{column[place[name]]:.4f}" for column in columns))
            for name in table.names
        ]
    return rows


def _as_csv(header: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerows(map(clean_cell, row) for row in (header, *rows))
    return text.getvalue()
