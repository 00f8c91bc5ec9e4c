"""Ladders of agents that were trained for hours, and best responses to them: played by
`marl-cair league`, read, drawn and formatted as rows.

One learner is `main_0`, and its past selves are called as leagues call them, by the decisions that
they had learned from.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import re
import sys
from collections.abc import Mapping
from math import isnan, nan
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.optimize import isotonic_regression
from scipy.stats import spearmanr

from marl_cair.cli import main as marl_cair
from marl_cair.files import atomic_path, write_atomically
from marl_cair.training.curves import COLOURS
from marl_cair.training.population.exploit import RESULT_FILE
from marl_cair.training.run_log import RunLog, read_log

MAIN, ALONE, LADDER, EXPLOIT = "main_0", "alone", "ladder", "exploit"
_PAST = re.compile(rf"{MAIN}-\d+-(\d+)$")  # the name of a frozen player ends in its decisions
LABEL_HEIGHT = 0.033  # of a line of text beside the ladder, in heights of the panel
COLUMNS = ("what", "against", "value", "low", "high", "games")
_VALUES = ("score", "low", "high", "games")  # as files of leagues call the last four

Row = tuple[Any, ...]  # of COLUMNS


class Rated(NamedTuple):
    """A row of the ladder."""

    elo: float
    low: float
    high: float


def run(words: list[str]) -> None:
    """One command of marl-cair; exits where that fails or is interrupted."""
    if code := marl_cair(words):
        sys.exit(code)


def trained_minutes(run: Path) -> float:
    """Minutes that a run has trained so far, over all its sittings."""
    rows = read_log(run / RunLog.FILE)
    seconds = [value for row in rows for name, value in row.items() if name.startswith("seconds/")]
    return sum(seconds) / 60.0


def exploit(agent: Path, options: argparse.Namespace, out: Path) -> None:
    """A best response to `agent`, rated by twice as many games as a pair plays."""
    words = ["--budget", options.budget, "--seeds", "1", "--games", str(2 * options.games)]
    run(["league", "exploit", str(agent), *words, "--out", str(out), *options.words])


def name_past(decisions: int) -> str:
    """The name of the learner's past self of so many decisions."""
    return f"{MAIN}-0-{decisions}"


def read_decisions(name: str) -> int | None:
    """Of a past self of the learner, by its name; None of all others."""
    found = _PAST.fullmatch(name)
    return int(found[1]) if found else None


def read_table(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def read_ladder(ladder: Path) -> dict[str, Rated]:
    """Ratings by name."""
    return {
        row["agent"]: Rated(*(float(row[name]) for name in Rated._fields))
        for row in read_table(ladder / "ladder.csv")
    }


def read_scores(ladder: Path, agent: str) -> dict[str, dict[str, str]]:
    """What `agent` scores against today's others, by their names."""
    return {
        row["opponent"]: row
        for row in read_table(ladder / "winrates.csv")
        if row["agent"] == agent and read_decisions(row["opponent"]) is None
    }


def read_response(folder: Path) -> dict[str, Any]:
    """Score, interval and games of the best response that was chosen."""
    shown = json.loads((folder / RESULT_FILE).read_text("utf-8"))
    chosen: dict[str, Any] = next(r for r in shown["responses"] if r["name"] == shown["chosen"])
    return chosen


class Traced(NamedTuple):
    """A ladder, parted into what was trained and the rest.

    Attributes:
        progress: ratings of what was trained, by decisions, ascending.
        others: ratings of the rest.
        scores: of one agent against today's others, as `read_scores`.
    """

    progress: list[tuple[int, Rated]]
    others: Mapping[str, Rated]
    scores: Mapping[str, Mapping[str, str]]


def trace_learner(ladder: Path, decisions: int) -> Traced:
    """MAIN, which has learned for so many decisions, and its past selves, beside all others."""
    rated = read_ladder(ladder)
    past = {at: one for name, one in rated.items() if (at := read_decisions(name)) is not None}
    others = {
        name: one for name, one in rated.items() if name != MAIN and read_decisions(name) is None
    }
    progress = sorted({**past, decisions: rated[MAIN]}.items())
    return Traced(progress, others, read_scores(ladder, MAIN))


def show(
    traced: Traced, rows: list[Row], titles: tuple[str, str], shown: str, out: Path, picture: Path
) -> None:
    """Write and draw what was found, print `shown`, and the rows as Markdown; the last row is how
    ratings rise with decisions.
    """
    rows = [*rows, _format_progress(traced.progress)]
    _write_rows(rows, out)
    _draw(traced, titles, picture)
    print(f"{shown}\n")
    _print_rows(rows)


def _space_out(heights: list[float], least: float) -> list[float]:
    """The same heights, in their order, moved as little as it takes to stand `least` apart."""
    if not heights:
        return []
    order = np.argsort(heights, kind="stable")
    steps = least * np.arange(len(heights))
    spaced = np.empty(len(heights))
    spaced[order] = isotonic_regression(np.array(heights)[order] - steps).x + steps
    return list(spaced.tolist())


def _draw(traced: Traced, titles: tuple[str, str], path: Path) -> None:
    """Ratings over decisions beside the others', and what one agent scores."""
    progress, others, scores = traced
    figure = Figure(figsize=(9.0, 3.9), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, width_ratios=(1.45, 1.0))
    thousands = [frames / 1_000 for frames, _ in progress]
    elo = [r.elo for _, r in progress]
    errors = [[r.elo - r.low for _, r in progress], [r.high - r.elo for _, r in progress]]
    left.errorbar(thousands, elo, errors, color=COLOURS[0], marker="o", capsize=2, markersize=4)
    for r in others.values():
        left.axhline(r.elo, color="0.6", linewidth=0.8, linestyle="--", zorder=0)
    low, high = left.get_ylim()
    heights = _space_out([r.elo for r in others.values()], LABEL_HEIGHT * (high - low))
    place = ("axes fraction", "data")
    for (name, rating), height in zip(others.items(), heights, strict=True):
        left.annotate(
            _format_name(name),
            (1.0, rating.elo),
            xycoords=place,
            xytext=(1.05, height),  # a thin line leads from there to its own
            textcoords=place,
            arrowprops={"arrowstyle": "-", "color": "0.6", "linewidth": 0.6, "shrinkB": 0.0},
            va="center",
            fontsize=7,
            color="0.3",
        )
    left.set(xlabel="decisions (thousands)", ylabel="Elo (random = 0), 95 %", xlim=(0, None))
    left.set_title(titles[0], fontsize=9)
    names = sorted(scores, key=lambda name: float(scores[name]["score"]))
    values = [100 * float(scores[name]["score"]) for name in names]
    ends = [
        [100 * abs(float(scores[name][end]) - float(scores[name]["score"])) for name in names]
        for end in ("low", "high")
    ]
    labels = [_format_name(name) for name in names]
    right.barh(labels, values, xerr=ends, color=COLOURS[5], error_kw={"capsize": 2, "lw": 0.9})
    right.axvline(50, color="black", linewidth=0.7)
    right.set(xlim=(0, 100), xlabel="score, %, 95 %")
    right.set_title(f"{titles[1]} against", fontsize=9)
    for panel in (left, right):
        panel.spines[["top", "right"]].set_visible(False)
        panel.grid(alpha=0.25)
        panel.set_axisbelow(True)
        panel.tick_params(labelsize=7.5)
        for axis in (panel.xaxis, panel.yaxis):
            axis.label.set_size(8)
    with atomic_path(path) as unfinished:
        figure.savefig(unfinished, dpi=150)


def format_scores(title: str, ladder: Path, agent: str) -> list[Row]:
    """A row for each of today's others, and the score of `agent` against it; `title`: its name."""
    scores = read_scores(ladder, agent).items()
    return [(f"{title} scores", name, *(row[key] for key in _VALUES)) for name, row in scores]


def format_least(ladder: Path, agent: str) -> Row:
    """A row of the one against whom `agent` scores least."""
    row = min(read_scores(ladder, agent).values(), key=lambda one: float(one["score"]))
    return f"{agent} scores least", row["opponent"], *(row[key] for key in _VALUES)


def format_response(folder: Path, budget: str, against: str) -> Row:
    """A row of the best response in `folder`, of a budget of training."""
    found = read_response(folder)
    return f"best response of {budget} scores", against, *map(found.get, _VALUES)


def _format_progress(progress: list[tuple[int, Rated]]) -> Row:
    """A row of Spearman's rank correlation: nan where no two ratings differ."""
    decisions, elo = [at for at, _ in progress], [rated.elo for _, rated in progress]
    rank = float(spearmanr(decisions, elo).statistic) if len(set(elo)) > 1 else nan
    return "rank correlation of rating with decisions", "", rank, "", "", len(progress)


def _write_rows(rows: list[Row], out: Path) -> None:
    """COLUMNS of all rows as <out>/results.csv."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([COLUMNS, *rows])
    write_atomically(out / "results.csv", text.getvalue())


def _print_rows(rows: list[Row]) -> None:
    """The same as Markdown."""
    print("| what | against | result | games |\n|---|---|---|---|")
    for what, against, value, low, high, number in rows:
        if low == "":
            shown = "not defined: no two ratings differ" if isnan(value) else f"{value:.2f}"
            print(f"| {what} | | {shown} | {number} agents |")
        else:
            shares = (f"{100 * float(one):.1f}" for one in (value, low, high))
            result = "{} % [{}, {}]".format(*shares)
            print(f"| {what} | `{against}` | {result} | {number} |")


def _format_name(name: str) -> str:
    return "only met random" if name == ALONE else name
