"""Where the page's bars, cells and curves lie, in percent of their frames: HTML does the rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from matplotlib.ticker import MaxNLocator

from marl_cair.league.ratings.rate import Rating
from marl_cair.league.report.background import Curve
from marl_cair.league.report.table import LeagueTable, find_elo_range

MOST_FULL_CELLS = 16  # agents; a matrix of more shows intervals and games on hovering
NUM_LEVELS = 10  # of colour, from 0 to 100 %
NUM_COLOURS = 6  # of curves; further ones have other dashes


@dataclass(frozen=True)
class Axis:
    """From `left` to `right`, with round numbers on it."""

    left: float
    right: float
    num_ticks: int = 4

    def place(self, value: float) -> float:
        """Percent of the way; what lies outside is at the end."""
        share = (value - self.left) / (self.right - self.left)
        return round(100.0 * min(1.0, max(0.0, share)), 2)

    @property
    def ticks(self) -> list[tuple[float, str]]:
        """Percent and label."""
        values = list(MaxNLocator(self.num_ticks).tick_values(self.left, self.right))
        return [
            (self.place(value), _shorten(float(value)))
            for value in values
            if self.left <= value <= self.right
        ]


class Bar(NamedTuple):
    """A rating on an axis, and how it is drawn."""

    low: float
    at: float
    high: float
    kind: str  # "" or "bound"
    arrow: str  # "", "right" or "left": where a bound may lie further
    is_below_line: bool


class Cell(NamedTuple):
    """A pair of agents in the matrix."""

    text: str
    interval: str
    games: str
    level: int
    is_clear: bool
    told: str  # all of it in a sentence


class Mark(NamedTuple):
    """A snapshot in the plane of a chart."""

    x: float
    y: float
    low: float
    high: float
    told: str


class Line(NamedTuple):
    """The snapshots of a run."""

    run: str
    colour: int
    dash: str
    marks: tuple[Mark, ...]

    @property
    def points(self) -> str:
        """For an SVG polyline in a square of 100 by 100, whose y goes down."""
        return " ".join(f"{mark.x},{round(100.0 - mark.y, 2)}" for mark in self.marks)


class Chart(NamedTuple):
    """Rating against training."""

    x: Axis
    y: Axis
    lines: tuple[Line, ...]


def find_axis(table: LeagueTable) -> Axis:
    """Of the ladder."""
    return Axis(*find_elo_range(table.ratings))


def lay_out_bars(table: LeagueTable, axis: Axis) -> list[Bar]:
    """Of the ladder, best first."""
    bars = []
    for place, rating in enumerate(table.ratings):
        low, high = _find_ends(rating, axis)
        arrow = {"lower": "right", "upper": "left"}.get(rating.bound, "")
        is_below = place > 0 and rating.group != table.ratings[place - 1].group
        kind = "bound" if rating.is_bound else ""
        bars.append(Bar(low, axis.place(rating.elo), high, kind, arrow, is_below))
    return bars


def lay_out_cells(table: LeagueTable) -> list[list[Cell | None]]:
    """Of the matrix, [n][n]; None where nothing was played."""
    what = "scores" if table.num_teams == 2 else "comes in first with"
    rows: list[list[Cell | None]] = []
    for row, name in enumerate(table.names):
        cells: list[Cell | None] = []
        for column, other in enumerate(table.names):
            pair = table.pair(row, column)
            if pair is None:
                cells.append(None)
                continue
            share, low, high = (100.0 * part for part in (pair.share, pair.low, pair.high))
            told = f"{name} {what} {share:.1f} % [{low:.0f}, {high:.0f}] against {other}"
            cells.append(
                Cell(
                    f"{share:.1f}",
                    f"{low:.0f}-{high:.0f}",
                    str(pair.games),
                    round(NUM_LEVELS * share / 100.0),
                    low > 50.0 or high < 50.0,
                    f"{told}, {pair.games} games",
                )
            )
        rows.append(cells)
    return rows


def lay_out_curves(table: LeagueTable, curves: Sequence[Curve]) -> Chart:
    """All runs in one plane; `curves` are one or more."""
    decisions = [point.frames for curve in curves for point in curve.points]
    shown = {point.rating.name for curve in curves for point in curve.points}
    ratings = [rating for rating in table.ratings if rating.name in shown]
    x, y = Axis(0.0, 1.03 * max(decisions)), Axis(*find_elo_range(ratings))
    lines = []
    for number, curve in enumerate(curves):
        marks = tuple(
            Mark(
                x.place(point.frames),
                y.place(point.rating.elo),
                *_find_ends(point.rating, y),
                f"{point.rating.name}: {point.rating.elo:+.0f} Elo, {point.frames:,} decisions",
            )
            for point in curve.points
        )
        dash = ("", "6 4", "2 3")[number // NUM_COLOURS % 3]
        lines.append(Line(curve.run, number % NUM_COLOURS, dash, marks))
    return Chart(x, y, tuple(lines))


def _find_ends(rating: Rating, axis: Axis) -> tuple[float, float]:
    """Percent of both ends of the interval; an open one is at the edge."""
    low = -math.inf if rating.open_low else rating.low
    high = math.inf if rating.open_high else rating.high
    return axis.place(low), axis.place(high)


def _shorten(value: float) -> str:
    """1,500,000 -> 1.5M."""
    for size, letter in ((1e9, "G"), (1e6, "M"), (1e3, "k")):
        if abs(value) >= max(size, 1e4):
            return f"{value / size:g}{letter}"
    return f"{value:,g}"
