"""The report of a league: ladder and win-rate matrix as text, CSV and one picture."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from marl_cair.files import atomic_path, write_atomically
from marl_cair.league.ratings import ANCHOR, Games, Rating, score_matrix, win_rate_interval

CAVEAT = (
    "Intervals (95 %) are about these very agents on these games, by a bootstrap over seeds; they "
    "say nothing of how another training run would turn out."
)
DOT_COLOUR, BOUND_COLOUR = "#0072B2", "#D55E00"


def describe_league(
    names: Sequence[str],
    games: Games,
    ratings: Sequence[Rating],
    distinct: Mapping[tuple[str, str], int],
) -> str:
    """Ladder, matrix and a sentence for each neighbouring pair, as plain text."""
    parts = [
        _ladder_text(ratings),
        _matrix_text(names, games, ratings),
        _sentences(names, games, ratings),
    ]
    counts = score_matrix(len(names), games)[1]
    for (first, second), number in distinct.items():
        played = counts[names.index(first), names.index(second)]
        if number < played:
            parts.append(
                f"Only {number} of the {played} games of {first} v {second} differ: their "
                "intervals are too narrow."
            )
    return "\n\n".join([*parts, CAVEAT]) + "\n"


def write_report(
    folder: Path, names: Sequence[str], games: Games, ratings: Sequence[Rating], text: str
) -> None:
    """Write ladder.txt, ladder.csv, winrates.csv and league.png to `folder`, each whole."""
    write_atomically(folder / "ladder.txt", text)
    write_atomically(folder / "ladder.csv", _ladder_csv(ratings))
    write_atomically(folder / "winrates.csv", _matrix_csv(names, games, ratings))
    draw_league(folder / "league.png", names, games, ratings)


def _ladder_text(ratings: Sequence[Rating]) -> str:
    zero = f"{ANCHOR} = 0" if any(r.name == ANCHOR for r in ratings) else "mean = 0"
    width = max(len("agent"), *(len(rating.name) for rating in ratings))
    lines = [
        f"{'':>3} {'agent':{width}} {'Elo':>7} {'95 % interval':>18} {'score':>7} {'games':>6}"
    ]
    for place, rating in enumerate(ratings, start=1):
        bound = " " if not rating.is_bound else (">" if rating.score == 1.0 else "<")
        interval = f"[{rating.low:+.0f}, {rating.high:+.0f}]"
        lines.append(
            f"{place:>3} {rating.name:{width}} {bound}{rating.elo:+6.0f} {interval:>18} "
            f"{rating.score:7.1%} {rating.games:>6}"
        )
    return f"Ladder (Elo, {zero}; > and < mark agents that won or lost every game)\n" + "\n".join(
        lines
    )


def _ordered(
    names: Sequence[str], games: Games, ratings: Sequence[Rating]
) -> tuple[list[str], NDArray[np.float64], NDArray[np.int64]]:
    """Names, points and counts in the order of the ladder."""
    order = [list(names).index(rating.name) for rating in ratings]
    points, counts = score_matrix(len(names), games)
    grid = np.ix_(order, order)
    return [names[index] for index in order], points[grid], counts[grid]


def _matrix_text(names: Sequence[str], games: Games, ratings: Sequence[Rating]) -> str:
    ordered, points, counts = _ordered(names, games, ratings)
    width = max(len(name) for name in ordered)
    head = " " * (width + 4) + "".join(f"{place:>6}" for place in range(1, len(ordered) + 1))
    lines = [f"Score of the row's agent in %, draws count half\n{head}"]
    for row, name in enumerate(ordered):
        cells = [
            f"{100 * points[row, column] / counts[row, column]:6.1f}"
            if counts[row, column]
            else "     -"
            for column in range(len(ordered))
        ]
        lines.append(f"{row + 1:>2}  {name:{width}}{''.join(cells)}")
    return "\n".join(lines)


def _sentences(names: Sequence[str], games: Games, ratings: Sequence[Rating]) -> str:
    ordered, points, counts = _ordered(names, games, ratings)
    lines = []
    for above in range(len(ordered) - 1):
        number = int(counts[above, above + 1])
        if not number:
            continue
        low, high = win_rate_interval(int(points[above, above + 1]), 0, number)
        share = points[above, above + 1] / number
        told = f"{share:.0%} of the points in {number} games [{low:.0%}, {high:.0%}]"
        pair = f"{ordered[above]} v {ordered[above + 1]}: {told}"
        if low > 0.5:
            verdict = f"{ordered[above]} is stronger"
        elif high < 0.5:
            verdict = f"{ordered[above + 1]} wins their games although it is rated lower"
        else:
            verdict = "they cannot be told apart"
        lines.append(f"{pair}: {verdict}.")
    return "\n".join(lines)


def _ladder_csv(ratings: Sequence[Rating]) -> str:
    return _as_csv(
        ("agent", "elo", "low", "high", "score", "games", "is_bound"),
        [
            (
                r.name,
                f"{r.elo:.2f}",
                f"{r.low:.2f}",
                f"{r.high:.2f}",
                f"{r.score:.4f}",
                r.games,
                int(r.is_bound),
            )
            for r in ratings
        ],
    )


def _matrix_csv(names: Sequence[str], games: Games, ratings: Sequence[Rating]) -> str:
    ordered, points, counts = _ordered(names, games, ratings)
    rows = []
    for row, agent in enumerate(ordered):
        for column, opponent in enumerate(ordered):
            number = int(counts[row, column])
            if number:
                low, high = win_rate_interval(int(points[row, column]), 0, number)
                share = points[row, column] / number
                rows.append((agent, opponent, f"{share:.4f}", f"{low:.4f}", f"{high:.4f}", number))
    return _as_csv(("agent", "opponent", "score", "low", "high", "games"), rows)


def _as_csv(header: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()


def draw_league(path: Path, names: Sequence[str], games: Games, ratings: Sequence[Rating]) -> None:
    """Write the ladder with intervals beside the score matrix, both best first, as PNG."""
    ordered, points, counts = _ordered(names, games, ratings)
    size = len(ordered)
    figure = Figure(figsize=(6.5 + 0.75 * size, 1.8 + 0.5 * size), layout="constrained")
    FigureCanvasAgg(figure)
    ladder, matrix = figure.subplots(1, 2, width_ratios=(1.0, 1.15))
    _draw_ladder(ladder, ratings)
    _draw_matrix(matrix, ordered, points, counts)
    with atomic_path(path) as unfinished:
        figure.savefig(unfinished, dpi=150)


def _draw_ladder(panel: Any, ratings: Sequence[Rating]) -> None:
    for place, rating in enumerate(ratings):
        colour = BOUND_COLOUR if rating.is_bound else DOT_COLOUR
        panel.plot((rating.low, rating.high), (place, place), color=colour, linewidth=2.2)
        panel.plot(rating.elo, place, "o", color=colour, markersize=6)
    panel.set_yticks(range(len(ratings)), [rating.name for rating in ratings])
    panel.invert_yaxis()
    zero = ANCHOR if any(rating.name == ANCHOR for rating in ratings) else "mean"
    panel.set(title="Rating with 95 % interval", xlabel=f"Elo ({zero} = 0)")
    panel.axvline(0.0, color="black", linewidth=0.8, alpha=0.5)
    panel.grid(axis="x", alpha=0.25)
    panel.spines[["top", "right", "left"]].set_visible(False)
    panel.tick_params(axis="y", length=0)
    if any(rating.is_bound for rating in ratings):
        panel.annotate(
            "orange: won or lost every game,\nthe number is a bound",
            (0.98, 0.03),
            xycoords="axes fraction",
            ha="right",
            fontsize=7.5,
            color=BOUND_COLOUR,
        )


def _draw_matrix(
    panel: Any, ordered: Sequence[str], points: NDArray[np.float64], counts: NDArray[np.int64]
) -> None:
    shares = np.where(counts > 0, points / np.maximum(counts, 1), np.nan)
    panel.imshow(shares, cmap="PuOr", vmin=0.0, vmax=1.0, aspect="auto")
    for row, column in np.argwhere(counts > 0):
        share = shares[row, column]
        ink = "white" if abs(share - 0.5) > 0.33 else "black"
        panel.text(
            column, row, f"{100 * share:.0f}", ha="center", va="center", color=ink, fontsize=9
        )
    panel.set_xticks(range(len(ordered)), ordered, rotation=38, ha="right")
    panel.set_yticks(range(len(ordered)), ordered)
    number = int(counts.max())
    panel.set(title=f"Score of the row against the column, % ({number} games a pair)")
    panel.spines[:].set_visible(False)
    panel.tick_params(length=0)
