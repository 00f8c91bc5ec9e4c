"""The picture of a league: ladder and matrix of scores side by side, for a page of a paper."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps, rc_context
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.figure import Figure

from marl_cair.files import atomic_path
from marl_cair.league.report.table import LeagueTable, find_elo_range

DOT_COLOUR, BOUND_COLOUR = "#0072B2", "#D55E00"  # Okabe and Ito: told apart by the colour-blind
STYLE: dict[Any, Any] = {  # matplotlib spells out all its keys as a type
    "font.size": 8.0,
    "axes.linewidth": 0.6,
    "pdf.fonttype": 42,  # text stays text
}
WIDTH_INCHES = 7.2  # two columns of a paper
DOTS_PER_INCH = 300
MAX_PIXELS = 2_400  # of the longer side
MOST_NUMBERS = 30  # agents; a larger matrix is shown by its colours alone
MOST_LETTERS = 40  # of a name; of longer ones the end is shown
INCHES_PER_LETTER = 0.04  # that a turned name is higher for each
ARROW_SHARE = 0.08  # of the ladder's width


def draw_league(folder: Path, table: LeagueTable) -> None:
    """Write ladder and matrix, both best first, as `league.png` and `league.pdf`."""
    size = len(table.names)
    with rc_context(STYLE):
        height = 1.25 + (0.27 if size <= MOST_NUMBERS else 0.12) * size
        longest = max(map(len, _shorten(table.names)), default=0)
        height += INCHES_PER_LETTER * max(0, longest - 12)
        width = WIDTH_INCHES * max(1.0, min(size, MOST_NUMBERS) / 14.0)
        figure = Figure(figsize=(width, height), layout="constrained")
        ladder, matrix = figure.subplots(1, 2, sharey=True, width_ratios=(1.0, 1.2))
        if size:
            _draw_matrix(matrix, table)
            _draw_ladder(ladder, table)
        figure.supxlabel(_caption(table), fontsize=6.5, color="0.35", x=0.01, ha="left")
        dots = min(DOTS_PER_INCH, MAX_PIXELS / max(width, height))
        figure.set_dpi(dots)
        figure.draw_without_rendering()
        figure.set_layout_engine("none")  # all is in its place: to find it takes a second
        # Canvases draw once, `savefig` twice.
        canvas: Any = FigureCanvasAgg(figure)
        with atomic_path(folder / "league.png") as unfinished:
            canvas.print_png(unfinished)
        canvas = FigureCanvasPdf(figure)
        with atomic_path(folder / "league.pdf") as unfinished:
            canvas.print_pdf(unfinished, metadata={"CreationDate": None})


def _shorten(names: Sequence[str]) -> list[str]:
    return [
        name if len(name) <= MOST_LETTERS else f"...{name[3 - MOST_LETTERS :]}" for name in names
    ]


def _caption(table: LeagueTable) -> str:
    lines = ["Bars: 95 % intervals about the zero. Bold scores: clear of 50 %."]
    ratings = table.ratings
    if any(rating.is_bound for rating in ratings):
        lines.append(
            "Dashed line: nobody below it took a point off anybody above it.\n"
            "Orange: a bound, the whole group may lie further along the arrow."
        )
    if any(rating.open_low or rating.open_high for rating in ratings):
        lines.append("Bars that reach the edge: too few points to limit the rating on that side.")
    return "\n".join(lines)


def _draw_ladder(panel: Any, table: LeagueTable) -> None:
    ratings = table.ratings
    left, right = find_elo_range(ratings)
    span = right - left
    for place, rating in enumerate(ratings):
        colour = BOUND_COLOUR if rating.is_bound else DOT_COLOUR
        low = left if rating.open_low else rating.low
        high = right if rating.open_high else rating.high
        panel.hlines(place, low, high, color=colour, linewidth=1.6)
        panel.plot(rating.elo, place, "o", color=colour, markersize=4)
        if rating.is_bound:
            start, way = (high, 1.0) if rating.bound == "lower" else (low, -1.0)
            arrow = {"arrowstyle": "->", "color": colour, "linewidth": 0.9, "shrinkA": 4.0}
            end = start + way * ARROW_SHARE * span
            panel.annotate("", (end, place), (start, place), arrowprops=arrow)
        if place and rating.group != ratings[place - 1].group:
            panel.axhline(place - 0.5, color="0.4", linewidth=0.7, linestyle=(0, (4, 3)))
    size = len(table.names)
    panel.set_yticks(
        range(size), _shorten(table.names), fontsize=8.0 if size <= MOST_NUMBERS else 5.0
    )
    label = f"Elo ({table.zero})" if ratings else "no ladder: see the report"
    panel.set(xlim=(left, right), xlabel=label)
    panel.set_ylim(size - 0.5, -0.5)
    panel.axvline(0.0, color="black", linewidth=0.6, alpha=0.5)
    panel.grid(axis="x", alpha=0.25, linewidth=0.5)
    panel.spines[["top", "right", "left"]].set_visible(False)
    panel.tick_params(axis="y", which="both", length=0)


def _draw_matrix(panel: Any, table: LeagueTable) -> None:
    shares, size = table.shares, len(table.names)
    # Coloured before it is enlarged: the other way round takes a second for every drawing.
    colours = colormaps["PuOr"]((np.ma.masked_invalid(shares) + 0.15) / 1.3, bytes=True)
    panel.imshow(colours, aspect="auto", interpolation="none")
    is_clear = (table.low > 0.5) | (table.high < 0.5)
    for row, column in np.argwhere(table.counts > 0) if size <= MOST_NUMBERS else ():
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
    if size <= MOST_NUMBERS:
        turned: dict[str, Any] = {"rotation": 38, "ha": "right", "rotation_mode": "anchor"}
        panel.set_xticks(range(size), _shorten(table.names), **turned)
        panel.set_xticks(np.arange(size + 1) - 0.5, minor=True)
        panel.set_yticks(np.arange(size + 1) - 0.5, minor=True)
        panel.grid(which="minor", color="white", linewidth=0.8)
    number = int(table.counts.max(initial=0))
    what = "Score of row against column" if table.num_teams == 2 else "Row came in above column"
    panel.set_title(f"{what}, % (up to {number} games a pair)", fontsize=8.0)
    panel.spines[:].set_visible(False)
    panel.tick_params(which="both", length=0)
