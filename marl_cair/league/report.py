"""The report of a league: ladder and matrix of scores, as text, CSV and a picture."""

from __future__ import annotations

import csv
import io
import math
import textwrap
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.files import write_atomically
from marl_cair.league.groups import SWEEP_PROBABILITY
from marl_cair.league.intervals import block_interval
from marl_cair.league.ratings import ANCHOR, Games, Rating, score_matrix

BOUND_SIGNS = {"": "", "lower": ">=", "upper": "<="}
CAVEAT = (
    "Intervals (95 %) of ratings are against the mean of all agents (of the group, where a line\n"
    "parts groups), by resampling map seeds. They are about these very agents on these games and\n"
    "say nothing of how another training run would turn out."
)
LINE_WIDTH = 100


@dataclass(frozen=True)
class LeagueTable:
    """All that a report shows of n agents, best first."""

    ratings: tuple[Rating, ...]  # n
    points: NDArray[np.float64]  # [n, n], of the row's agent against the column's
    counts: NDArray[np.int64]  # [n, n] games
    distinct: NDArray[np.int64]  # [n, n] games that differ in an action
    low: NDArray[np.float64]  # [n, n] 95 % interval of the share of points; NaN without games
    high: NDArray[np.float64]

    @property
    def names(self) -> list[str]:
        """In the order of the ladder."""
        return [rating.name for rating in self.ratings]

    @property
    def zero(self) -> str:
        """What is rated 0."""
        if ANCHOR in self.names:
            return f"{ANCHOR} = 0"
        return "mean = 0" if self.ratings[-1].group == 0 else "mean of the unmarked = 0"


def make_table(
    names: Sequence[str], games: Games, ratings: Sequence[Rating], distinct: NDArray[np.int64]
) -> LeagueTable:
    """The table of `ratings`; games [N, 4] as in `rate`, agents there and in `distinct` [n, n] by
    index in `names`.
    """
    order = [list(names).index(rating.name) for rating in ratings]
    grid = np.ix_(order, order)
    points, counts = score_matrix(len(names), games)
    low = np.full((len(names), len(names)), math.nan)
    high = low.copy()
    place = np.argsort(order)
    for first, second, scores in _block_scores(games):
        row, column = place[first], place[second]
        low[row, column], high[row, column] = block_interval(scores)
        low[column, row], high[column, row] = 1.0 - high[row, column], 1.0 - low[row, column]
    return LeagueTable(tuple(ratings), points[grid], counts[grid], distinct[grid], low, high)


def _block_scores(games: Games) -> Iterator[tuple[int, int, NDArray[np.float64]]]:
    """The first agent's mean score in each block, [K], of each pair."""
    for first, second in np.unique(games[:, :2], axis=0).astype(int).tolist():
        own = games[(games[:, 0] == first) & (games[:, 1] == second)]
        _, block_of_game, sizes = np.unique(own[:, 2], return_inverse=True, return_counts=True)
        yield first, second, np.bincount(block_of_game, own[:, 3]) / sizes


def describe_league(table: LeagueTable) -> str:
    """Ladder, matrix and a sentence for each pair of neighbours, as text; ASCII but for names."""
    parts = [
        _describe_ladder(table),
        *_explain_bounds(table.ratings),
        _describe_matrix(table),
        _compare_neighbours(table),
        *_warn_of_repeats(table),
        CAVEAT,
    ]
    return "\n\n".join(parts) + "\n"


def write_report(folder: Path, table: LeagueTable, text: str) -> None:
    """Write ladder.txt, ladder.csv, winrates.csv, league.png and .pdf to `folder`, each whole."""
    from marl_cair.league.picture import draw_league  # noqa: PLC0415  # matplotlib only from here

    write_atomically(folder / "ladder.txt", text)
    write_atomically(folder / "ladder.csv", _ladder_csv(table.ratings))
    write_atomically(folder / "winrates.csv", _matrix_csv(table))
    for name in ("league.png", "league.pdf"):
        draw_league(folder / name, table)


def _describe_ladder(table: LeagueTable) -> str:
    width = max(len("agent"), *map(len, table.names))
    lines = [
        f"Ladder (Elo, {table.zero})",
        f"{'':>3} {'agent':{width}} {'Elo':>9} {'95 % v the mean':>18} {'score':>7} {'games':>6}",
    ]
    for place, rating in enumerate(table.ratings, start=1):
        if place > 1 and rating.group != table.ratings[place - 2].group:
            lines.append("    " + "-" * (width + 44))
        elo = f"{BOUND_SIGNS[rating.bound]} {rating.elo:+.0f}"
        alone = rating.low == rating.high
        interval = "" if alone else f"[{rating.low:+.0f}, {rating.high:+.0f}]"
        lines.append(
            f"{place:>3} {rating.name:{width}} {elo:>9} {interval:>18} "
            f"{rating.score:7.1%} {rating.games:>6}"
        )
    return "\n".join(lines)


def _explain_bounds(ratings: Sequence[Rating]) -> list[str]:
    """What the marks of the ladder mean; nothing where there are none."""
    told = []
    if any(rating.is_bound for rating in ratings):
        told.append(
            "A line parts groups: nobody below it took a single point off anybody above it, so "
            "these games do not limit how far apart they are. >= and <= mark bounds: the group's "
            "ratings may all be larger (smaller) by the same unknown number. Shown is the smallest "
            f"distance at which so clean a sweep has a chance of {SWEEP_PROBABILITY:.1%}."
        )
    if any(math.isinf(rating.low) or math.isinf(rating.high) for rating in ratings):
        told.append(
            "inf: that agent's distance to the others rests on a few single games (in more than "
            "2.5 % of the resamples it took no point off them, or they none off it): play more."
        )
    return [textwrap.fill(text, LINE_WIDTH) for text in told]


def _describe_matrix(table: LeagueTable) -> str:
    width = max(map(len, table.names))
    head = " " * (width + 4) + "".join(f"{place + 1:>6}" for place in range(len(table.names)))
    lines = [f"Score of the row's agent in %, draws count half\n{head}"]
    for row, name in enumerate(table.names):
        cells = [
            f"{100.0 * points / count:6.1f}" if count else "     -"
            for points, count in zip(table.points[row], table.counts[row], strict=True)
        ]
        lines.append(f"{row + 1:>2}  {name:{width}}{''.join(cells)}")
    return "\n".join(lines)


def _compare_neighbours(table: LeagueTable) -> str:
    lines = []
    for above, below in pairwise(range(len(table.names))):
        number = int(table.counts[above, below])
        if not number:
            continue
        low, high = table.low[above, below], table.high[above, below]
        better, worse = table.names[above], table.names[below]
        if low > 0.5:
            verdict = f"{better} is stronger"
        elif high < 0.5:
            verdict = f"{worse} wins their games although it is rated lower"
        else:
            verdict = "they cannot be told apart"
        share = table.points[above, below] / number
        lines.append(
            f"{better} v {worse}: {share:.1%} of the points in {number} games "
            f"[{low:.1%}, {high:.1%}]: {verdict}."
        )
    return "\n".join(lines)


def _warn_of_repeats(table: LeagueTable) -> list[str]:
    """Which pairs played some games more than once; nothing where none did."""
    repeats = [
        f"{table.names[row]} v {table.names[column]} {table.distinct[row, column]} of "
        f"{table.counts[row, column]}"
        for row, column in np.argwhere(np.triu(table.distinct < table.counts)).tolist()
    ]
    if not repeats:
        return []
    text = (
        "Games that differ, where a pair repeated some move by move (their intervals are too "
        f"narrow): {', '.join(repeats)}."
    )
    return [textwrap.fill(text, LINE_WIDTH)]


def _ladder_csv(ratings: Sequence[Rating]) -> str:
    return _as_csv(
        ("agent", "elo", "low", "high", "bound", "group", "score", "games"),
        [
            (
                r.name,
                f"{r.elo:.2f}",
                f"{r.low:.2f}",
                f"{r.high:.2f}",
                r.bound,
                r.group,
                f"{r.score:.4f}",
                r.games,
            )
            for r in ratings
        ],
    )


def _matrix_csv(table: LeagueTable) -> str:
    rows = []
    for row, column in np.argwhere(table.counts > 0).tolist():
        number = int(table.counts[row, column])
        numbers = (
            table.points[row, column] / number,
            table.low[row, column],
            table.high[row, column],
        )
        rows.append(
            (
                table.names[row],
                table.names[column],
                *(f"{value:.4f}" for value in numbers),
                number,
                table.distinct[row, column],
            )
        )
    header = ("agent", "opponent", "score", "low", "high", "games", "distinct_games")
    return _as_csv(header, rows)


def _as_csv(header: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()
