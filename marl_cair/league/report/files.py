"""Writes the files of a report: HTML, Markdown, text, CSV, PNG and PDF."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import astuple, fields
from pathlib import Path
from typing import Any

import numpy as np

from marl_cair.files import write_atomically
from marl_cair.league.ratings.fit import FitTest
from marl_cair.league.report.render import render_html, render_markdown, render_text
from marl_cair.league.report.sections import Report
from marl_cair.league.report.table import LeagueTable
from marl_cair.text import format_csv

Rows = Iterator[tuple[Any, ...]]

_SHARE = ("score", "low", "high", "games")
_AVERAGE = ("weight", "low", "high", "score", "score_low", "score_high")
# Columns of each CSV file; a number with a fraction is written with 4 digits, Elo with 2.
_COLUMNS = {
    "ladder": ("agent", "elo", "low", "high", "open", "bound", "group", "first", "score", "games"),
    "winrates": ("agent", "opponent", *_SHARE, "repeated_games", "wins", "draws", "losses"),
    "differences": ("agent", "opponent", "elo", "low", "high", "bound"),
    "seats": ("agent", "team", *_SHARE),
    "maps": ("agent", "map", *_SHARE),
    "training": ("run", "decisions", "agent", "elo", "low", "high"),
    "averages": ("method", "agent", *_AVERAGE),
    "cycles": ("first", "second", "third", "share"),
    "fit": ("number", "value"),
    "forfeits": ("agent", "reason", "games"),
}
FILES = (
    *("report.html", "report.md", "ladder.txt", "league.png", "league.pdf"),
    *(f"{name}.csv" for name in _COLUMNS),
)


def write_report(folder: Path, report: Report) -> str:
    """Write all of FILES to `folder`, each whole or not at all; returns the plain text."""
    from marl_cair.league.report.charts import write_figures  # matplotlib takes long to import

    text = render_text(report)
    write_atomically(folder / "ladder.txt", text)
    for name, rows in _list_rows(report).items():
        cells = ([f"{c:.4f}" if isinstance(c, float) else c for c in row] for row in rows)
        write_atomically(folder / f"{name}.csv", format_csv([_COLUMNS[name], *cells]))
    write_figures(folder, report)
    write_atomically(folder / "report.md", render_markdown(report))
    write_atomically(folder / "report.html", render_html(report))
    return text


def _list_rows(report: Report) -> dict[str, Rows | Sequence[tuple[Any, ...]]]:
    """Rows of each CSV file by its name."""
    table, maps, fit = report.table, report.background.map_shares, report.table.fit
    return {
        "ladder": [
            (
                r.name,
                *_format_elo(r.elo, r.low, r.high),
                " ".join(end for end in ("low", "high") if getattr(r, f"open_{end}")),
                *(r.bound, r.group, f"{r.probability_first:.3f}", r.score, r.games),
            )
            for r in table.ratings
        ],
        "winrates": _list_scores(table),
        "differences": _list_differences(table),
        "seats": [(*key, *share) for key, share in sorted(table.team_shares.items())],
        "maps": [(*key, *share) for key, share in sorted(maps.items())],
        "training": [
            (curve.run, steps, r.name, *_format_elo(r.elo, r.low, r.high))
            for curve in report.curves
            for steps, r in curve.points
        ],
        "averages": [
            (title, name, *map(float, row))
            for title, found in table.averages.items()
            for name, *row in zip(table.names, *vars(found).values(), strict=True)
        ],
        "cycles": table.cycles,
        "fit": [
            (field.name, f"{getattr(fit, field.name):.6g}" if fit else "")
            for field in (fields(FitTest) if table.num_games else ())
        ],
        "forfeits": table.forfeits,
    }


def _format_elo(*values: float) -> Iterator[str]:
    return (f"{value:.2f}" for value in values)


def _list_scores(table: LeagueTable) -> Rows:
    payoffs = table.payoffs
    for row, column in np.ndindex(payoffs.counts.shape):
        if (share := payoffs.pair(row, column)) is not None:
            draws = int(payoffs.draws[row, column])
            wins = round(float(payoffs.points[row, column]) - 0.5 * draws)
            counts = payoffs.repeats[row, column], wins, draws, share.games - wins - draws
            yield table.names[row], table.names[column], *share, *counts


def _list_differences(table: LeagueTable) -> Rows:
    for row, gaps in enumerate(table.ladder.differences if table.ladder else ()):
        for column, gap in enumerate(gaps):
            own, other = table.ratings[row], table.ratings[column]
            if row == column:
                continue
            if gap is not None:
                yield own.name, other.name, *_format_elo(*astuple(gap)), ""
            else:
                bound = "lower" if own.group < other.group else "upper"
                yield own.name, other.name, *_format_elo(own.elo - other.elo), "", "", bound
