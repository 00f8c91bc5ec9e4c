"""Charts of a league: ladder, score matrix and learning curves, as inline SVG, PNG and PDF."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps, rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.rcsetup import cycler
from matplotlib.ticker import EngFormatter

from marl_cair.files import atomic_path
from marl_cair.league.ratings.rate import Rating
from marl_cair.league.report.sections import Report
from marl_cair.league.report.table import LeagueTable
from marl_cair.text import clean_text

DOT_COLOUR, BOUND_COLOUR = "#0072b2", "#d55e00"  # Okabe and Ito: safe for the colour-blind
CURVE_COLOURS = (DOT_COLOUR, BOUND_COLOUR, "#009e73", "#a6387a", "#7a7300", "#4a5661")
TEXT_COLOUR, QUIET_COLOUR, GRID_COLOUR = "#1d2125", "#59616b", "#d9dad7"
# On the page these colours are CSS variables, which follow its light or dark scheme.
CSS_COLOURS = {
    TEXT_COLOUR: "var(--text)",
    QUIET_COLOUR: "var(--quiet)",
    GRID_COLOUR: "var(--line)",
    **{colour: f"var(--c{number})" for number, colour in enumerate(CURVE_COLOURS)},
}
STYLE: dict[Any, Any] = {  # matplotlib spells out all its keys as a type
    "font.size": 8.0,
    "text.parse_math": False,  # a $ in a name is a $
    "text.color": TEXT_COLOUR,
    "axes.labelcolor": TEXT_COLOUR,
    "axes.edgecolor": QUIET_COLOUR,
    "axes.linewidth": 0.6,
    "xtick.color": QUIET_COLOUR,
    "ytick.color": QUIET_COLOUR,
    "xtick.labelcolor": TEXT_COLOUR,
    "ytick.labelcolor": TEXT_COLOUR,
    "grid.color": GRID_COLOUR,
    "grid.linewidth": 0.5,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.prop_cycle": cycler(linestyle=("-", "--", ":")) * cycler(color=CURVE_COLOURS),
    "pdf.fonttype": 42,  # text stays text
    "svg.fonttype": "none",
}
WIDTH_INCHES = 7.2  # two columns of a paper
DOTS_PER_INCH = 300
MAX_PIXELS = 2_400  # of the longer side
MAX_LABELLED = 30  # agents; a larger matrix has colours only
MAX_NAME_LENGTH = 32  # of a longer name the end is shown
ARROW_SHARE = 0.08  # of the ladder's width
_METADATA = dict.fromkeys(("Date", "Creator", "Format", "Type"))  # none


def write_figures(folder: Path, report: Report) -> None:
    """Write ladder and matrix, both best first, as `league.png` and `league.pdf`."""
    table = report.table
    with rc_context(STYLE):
        width, height = _find_size(table)
        height += 0.45
        figure = Figure(figsize=(width, height), layout="constrained")
        ladder, matrix = figure.subplots(1, 2, sharey=True, width_ratios=(1.0, 1.2))
        if table.names:
            draw_matrix(matrix, report)
            draw_ladder(ladder, report)
        figure.supxlabel(_describe_marks(table), fontsize=6.5, color="0.35", x=0.01, ha="left")
        dots = min(DOTS_PER_INCH, MAX_PIXELS / max(width, height))
        figure.set_dpi(dots)
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # the layout is fixed: computing it takes a second
        # Canvases draw once, `savefig` twice.
        canvas: Any
        for kind, canvas in (("png", FigureCanvasAgg(figure)), ("pdf", FigureCanvasPdf(figure))):
            options = {"metadata": {"CreationDate": None}} if kind == "pdf" else {}
            with atomic_path(folder / f"league.{kind}") as unfinished:
                getattr(canvas, f"print_{kind}")(unfinished, **options)


def make_svg(report: Report, name: str, label: str) -> str:
    """The chart `name` ("ladder", "matrix" or "training") as an SVG element for the page."""
    with rc_context({**STYLE, "svg.hashsalt": name}):
        width, height = _find_size(report.table)
        height = 3.4 if name == "training" else height
        figure = Figure(figsize=(width, height), layout="constrained", facecolor="none")
        panel = figure.subplots()
        panel.set_facecolor("none")
        draw = {"ladder": draw_ladder, "matrix": draw_matrix, "training": draw_curves}[name]
        draw(panel, report)
        written = io.StringIO()
        canvas: Any = FigureCanvasSVG(figure)
        canvas.print_svg(written, metadata=_METADATA)
    _, text = written.getvalue().split("<svg ", 1)
    text = f'<svg role="img" aria-label="{label}" {text}'
    for colour, variable in CSS_COLOURS.items():
        text = text.replace(colour, variable)
    return text


def _find_size(table: LeagueTable) -> tuple[float, float]:
    """Width and height in inches."""
    size = len(table.names)
    width = WIDTH_INCHES * max(1.0, min(size, MAX_LABELLED) / 14.0)
    return width, 0.6 + (0.27 if size <= MAX_LABELLED else 0.12) * size


def _shorten(names: Sequence[str]) -> list[str]:
    return [
        name if len(name) <= MAX_NAME_LENGTH else f"...{name[3 - MAX_NAME_LENGTH :]}"
        for name in map(clean_text, names)
    ]


def _describe_marks(table: LeagueTable) -> str:
    games = int(table.payoffs.counts.max(initial=0))
    bold = "Bold scores: significantly different from 50 %"
    lines = [f"Bars: 95 % confidence intervals. {bold}; up to {games} games per pair."]
    ratings = table.ratings
    if any(rating.is_bound for rating in ratings):
        lines.append(
            "Dashed line: no agent below it took a point off an agent above it.\n"
            "Orange: a bound; the whole group may lie further along the arrow."
        )
    if any(rating.open_low or rating.open_high for rating in ratings):
        lines.append("Bars that reach the edge: the games do not limit the rating on that side.")
    return "\n".join(lines)


def draw_ladder(panel: Any, report: Report) -> None:
    """Ratings with intervals, best on top."""
    table, ratings = report.table, report.table.ratings
    left, right = _find_range(ratings)
    for place, rating in enumerate(ratings):
        colour = BOUND_COLOUR if rating.is_bound else DOT_COLOUR
        low = left if rating.open_low else rating.low
        high = right if rating.open_high else rating.high
        panel.hlines(place, low, high, color=colour, linewidth=1.6)
        panel.plot(rating.elo, place, "o", color=colour, markersize=4)
        if rating.is_bound:
            start, way = (high, 1.0) if rating.bound == "lower" else (low, -1.0)
            arrow = {"arrowstyle": "->", "color": colour, "linewidth": 0.9, "shrinkA": 4.0}
            end = start + way * ARROW_SHARE * (right - left)
            panel.annotate("", (end, place), (start, place), arrowprops=arrow)
        if place and rating.group != ratings[place - 1].group:
            panel.axhline(place - 0.5, color=QUIET_COLOUR, linewidth=0.7, linestyle=(0, (4, 3)))
    _label_rows(panel, table)
    label = f"Elo ({table.zero})" if ratings else "no ladder: see the report"
    panel.set(xlim=(left, right), xlabel=label, ylim=(len(table.names) - 0.5, -0.5))
    panel.axvline(0.0, color=QUIET_COLOUR, linewidth=0.6)
    panel.grid(axis="x")
    panel.spines["left"].set_visible(False)
    panel.tick_params(axis="y", which="both", length=0)


def _find_range(ratings: Sequence[Rating]) -> tuple[float, float]:
    """The ends of an axis that holds all intervals; open ends may lie beyond."""
    lows = [r.elo if r.open_low else r.low for r in ratings]
    highs = [r.elo if r.open_high else r.high for r in ratings]
    low, high = min(lows, default=0.0), max(highs, default=0.0)
    margin = 0.1 * (high - low) or 1.0
    return low - margin, high + margin


def draw_matrix(panel: Any, report: Report) -> None:
    """Score of each row's agent against each column's in percent, as colours and numbers."""
    table = report.table
    payoffs, size = table.payoffs, len(table.names)
    shares = np.ma.masked_where(payoffs.counts == 0, payoffs.shares)
    # Coloured before it is enlarged: the other order takes a second for every drawing.
    colours = colormaps["PuOr"]((shares + 0.15) / 1.3, bytes=True)
    panel.imshow(colours, aspect="auto", interpolation="none")
    is_clear = (payoffs.low > 0.5) | (payoffs.high < 0.5)
    for row, column in np.argwhere(payoffs.counts > 0) if size <= MAX_LABELLED else ():
        share = shares[row, column]
        panel.text(
            column,
            row,
            f"{100.0 * share:.0f}",
            ha="center",
            va="center",
            color="white" if abs(share - 0.5) > 0.36 else "black",
            fontsize=7.0,
            fontweight="bold" if is_clear[row, column] else "normal",
        )
    if size <= MAX_LABELLED:
        panel.set_xticks(range(size), range(1, size + 1))
        panel.set_xticks(np.arange(size + 1) - 0.5, minor=True)
        panel.set_yticks(np.arange(size + 1) - 0.5, minor=True)
        panel.grid(which="minor", color="white", linewidth=0.8)
    _label_rows(panel, table)
    what = "Score of row against column" if table.num_teams == 2 else "Row came in above column"
    panel.set_xlabel(f"{what}, %")
    panel.spines[:].set_visible(False)
    panel.tick_params(which="both", length=0)


def _label_rows(panel: Any, table: LeagueTable) -> None:
    names = [f"{name}  {place}" for place, name in enumerate(_shorten(table.names), start=1)]
    panel.set_yticks(range(len(names)), names, fontsize=8.0 if len(names) <= MAX_LABELLED else 5.0)


def draw_curves(panel: Any, report: Report) -> None:
    """Ratings with intervals by environment steps, one line for each run."""
    for curve in report.curves:
        steps, ratings = zip(*curve.points, strict=True)
        elo = np.array([rating.elo for rating in ratings])
        ends = elo - [r.low for r in ratings], [r.high for r in ratings] - elo
        name = _shorten([curve.run])[0]
        panel.errorbar(steps, elo, ends, marker="o", markersize=4, elinewidth=1.0, label=name)
    panel.set(xlabel="steps of training", ylabel=f"Elo ({report.table.zero})")
    panel.set_xlim(left=0.0)
    panel.xaxis.set_major_formatter(EngFormatter(sep=""))
    panel.grid(axis="y")
    panel.legend(frameon=False, labelcolor=TEXT_COLOUR)
