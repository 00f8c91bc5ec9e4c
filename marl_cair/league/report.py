"""The report of a league: ladder and matrix of scores, as text, CSV and a picture."""

from __future__ import annotations

import csv
import io
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.files import write_atomically
from marl_cair.league.beyond import (
    Beyond,
    describe_beyond,
    list_averages,
    list_cycles,
    list_fit,
    look_beyond,
)
from marl_cair.league.groups import SWEEP_PROBABILITY
from marl_cair.league.likelihood import PRIOR_ELO
from marl_cair.league.payoffs import find_payoffs
from marl_cair.league.ratings import ANCHOR, Estimate, Games, Ladder, Rating

BOUND_SIGNS = {"": "", "lower": ">=", "upper": "<="}
CAVEAT = (
    "Intervals (95 %) of ratings are against the mean of all agents (of the group, where a line\n"
    "parts groups), by resampling map seeds; `first` is how often an agent came first in them.\n"
    f"Prior: normal, standard deviation {PRIOR_ELO:.0f} Elo about that mean. All is about these\n"
    "very agents and games and says nothing of how another training run would turn out."
)
LINE_WIDTH = 100
FILES = (
    "ladder.txt",
    "league.png",
    "league.pdf",
    "ladder.csv",
    "differences.csv",
    "winrates.csv",
    "averages.csv",
    "cycles.csv",
    "fit.csv",
)


@dataclass(frozen=True)
class LeagueTable:
    """All that a report shows of n agents, best first."""

    ladder: Ladder
    points: NDArray[np.float64]  # [n, n], how often the row came in above the column, ties half
    counts: NDArray[np.int64]  # [n, n] games of both
    repeats: NDArray[np.int64]  # [n, n] games of both that are not counted: the same as another
    low: NDArray[np.float64]  # [n, n] 95 % interval of points / counts, wide without games
    high: NDArray[np.float64]
    beyond: Beyond  # agents there as in `make_table`, not in the order of the ladder
    forfeits: tuple[tuple[str, int], ...]  # reasons, and in how many games
    num_teams: int

    @property
    def ratings(self) -> tuple[Rating, ...]:
        """Best first."""
        return self.ladder.ratings

    @property
    def names(self) -> list[str]:
        """In the order of the ladder."""
        return [rating.name for rating in self.ratings]

    @property
    def numbered_names(self) -> list[str]:
        """In the order of the numbers of `beyond`."""
        return [
            name for _, name in sorted(zip(self.beyond.order.tolist(), self.names, strict=True))
        ]

    @property
    def zero(self) -> str:
        """What is rated 0."""
        if ANCHOR in self.names:
            return f"{ANCHOR} = 0"
        return "mean = 0" if self.ratings[-1].group == 0 else "mean of the unmarked = 0"


def make_table(
    names: Sequence[str],
    games: Games,
    ladder: Ladder,
    forfeits: Sequence[tuple[str, int]] = (),
    seed: int = 0,
    with_alpha_rank: bool = False,
) -> LeagueTable:
    """The table of `ladder`; games as in `rate`, agents there by index in `names`.

    Raises:
        ValueError: alpha-Rank is asked for, and OpenSpiel is not installed.
    """
    order = np.array([list(names).index(rating.name) for rating in ladder.ratings], np.int64)
    payoffs = find_payoffs(len(names), games, seed)
    beyond = look_beyond(games, payoffs, order, seed, with_alpha_rank)
    shown = payoffs.reorder(order)
    return LeagueTable(
        ladder,
        shown.points,
        shown.counts,
        shown.repeats,
        shown.low,
        shown.high,
        beyond,
        tuple(forfeits),
        games.agents.shape[1],
    )


def describe_league(table: LeagueTable) -> str:
    """Ladder, matrix, differences and what is amiss, as text; ASCII but for names."""
    parts = [
        _describe_ladder(table),
        *_explain_bounds(table.ratings),
        _describe_matrix(table),
        describe_beyond(table.beyond, table.numbered_names, table.num_teams),
        _compare_pairs(table),
        _describe_seats(table),
        *_warn_of_repeats(table),
        *_tell_forfeits(table),
        CAVEAT,
    ]
    return "\n\n".join(parts) + "\n"


def write_report(folder: Path, table: LeagueTable, text: str) -> None:
    """Write all of FILES to `folder`, each whole."""
    from marl_cair.league.picture import draw_league  # noqa: PLC0415  # matplotlib only from here

    write_atomically(folder / "ladder.txt", text)
    write_atomically(folder / "ladder.csv", _ladder_csv(table.ratings))
    write_atomically(folder / "winrates.csv", _matrix_csv(table))
    write_atomically(folder / "differences.csv", _differences_csv(table))
    names, beyond = table.numbered_names, table.beyond
    scores = ("weight", "low", "high", "score", "score_low", "score_high")
    for name, header, rows in (
        ("averages", ("method", "agent", *scores), list_averages(beyond, names)),
        ("cycles", ("first", "second", "third", "share"), list_cycles(beyond, names)),
        ("fit", ("number", "value"), list_fit(beyond)),
    ):
        write_atomically(folder / f"{name}.csv", _as_csv(header, rows))
    for name in ("league.png", "league.pdf"):
        draw_league(folder / name, table)


def _describe_ladder(table: LeagueTable) -> str:
    width = max(len("agent"), *map(len, table.names))
    head = f"{'':>3} {'agent':{width}} {'Elo':>9} {'95 % v the mean':>18}"
    lines = [
        f"Ladder (Elo, {table.zero})",
        f"{head} {'first':>6} {'score':>7} {'games':>6}",
    ]
    for place, rating in enumerate(table.ratings, start=1):
        if place > 1 and rating.group != table.ratings[place - 2].group:
            lines.append("    " + "-" * (width + 51))
        elo = f"{BOUND_SIGNS[rating.bound]} {rating.elo:+.0f}"
        alone = rating.low == rating.high
        ends = (
            f"{'<' if rating.open_low else ''}{rating.low:+.0f}",
            f"{'>' if rating.open_high else ''}{rating.high:+.0f}",
        )
        interval = "" if alone else f"[{', '.join(ends)}]"
        lines.append(
            f"{place:>3} {rating.name:{width}} {elo:>9} {interval:>18} "
            f"{rating.probability_first:6.0%} {rating.score:7.1%} {rating.games:>6}"
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
    if any(rating.open_low or rating.open_high for rating in ratings):
        told.append(
            "< and >: an end that only the prior holds, as that agent's distance to the others "
            "rests on a few single games (in more than 2.5 % of the resamples it took no point off "
            "them, or they none off it): play more."
        )
    return [textwrap.fill(text, LINE_WIDTH) for text in told]


def _describe_matrix(table: LeagueTable) -> str:
    """Shares, below them their intervals, and the games where they differ from pair to pair."""
    width = max(map(len, table.names))
    head = " " * (width + 4) + "".join(f"{place + 1:>8}" for place in range(len(table.names)))
    what = "Score of the row's agent" if table.num_teams == 2 else "Row came in above column"
    played = set(table.counts[table.counts > 0].tolist())
    games = f"; {played.pop()} games each" if len(played) == 1 else "; games"
    lines = [f"{what} in %, draws count half; 95 % interval{games}\n{head}"]
    for row, name in enumerate(table.names):
        counts = table.counts[row]
        shares = 100.0 * table.points[row] / np.maximum(counts, 1)
        ends = zip(100.0 * table.low[row], 100.0 * table.high[row], strict=True)
        rows = [
            (f"{row + 1:>2}  {name:{width}}", [f"{share:.1f}" for share in shares]),
            (" " * (width + 4), [f"{low:.0f}-{high:.0f}" for low, high in ends]),
        ]
        if played:
            rows.append((" " * (width + 4), [str(count) for count in counts]))
        for place, (start, cells) in enumerate(rows):
            shown = [
                cell if count else ("" if place else "-")
                for cell, count in zip(cells, counts, strict=True)
            ]
            lines.append((start + "".join(f"{cell:>8}" for cell in shown)).rstrip())
    return "\n".join(lines)


def _compare_pairs(table: LeagueTable) -> str:
    """A sentence for each pair of neighbours, and for others that cannot be told apart."""
    lines = ["Differences (Elo, 95 %)"]
    for above, below in combinations(range(len(table.names)), 2):
        gap = table.ladder.differences[above][below]
        if below == above + 1 or (gap is not None and gap.low <= 0.0):
            lines.append(compare_in_words(table.ratings[above], table.ratings[below], gap))
    return "\n".join(lines)


def compare_in_words(above: Rating, below: Rating, gap: Estimate | None) -> str:
    """Who of the two is stronger, and by how much; `above` has the higher rating."""
    if gap is None:
        return (
            f"{above.name} is stronger than {below.name}: {above.elo - below.elo:+.0f} or more "
            "(no point went the other way)"
        )
    numbers = f"{gap.elo:+.0f} [{gap.low:+.0f}, {gap.high:+.0f}]"
    if gap.low > 0.0:
        return f"{above.name} is stronger than {below.name}: {numbers}"
    return f"{above.name} and {below.name} cannot be told apart: {numbers}"


def _describe_seats(table: LeagueTable) -> str:
    seats = "seat" if table.num_teams == 2 else "team"
    told = ", ".join(
        f"{seats} {number} {seat.elo:+.0f} [{seat.low:+.0f}, {seat.high:+.0f}]"
        for number, seat in enumerate(table.ladder.seats, start=1)
    )
    return textwrap.fill(f"What a {seats} adds to a rating (Elo, 95 %): {told}", LINE_WIDTH)


def _warn_of_repeats(table: LeagueTable) -> list[str]:
    """Which pairs played some games more than once; nothing where none did."""
    repeats = [
        f"{table.names[row]} v {table.names[column]} {table.repeats[row, column]} of "
        f"{table.repeats[row, column] + table.counts[row, column]}"
        for row, column in np.argwhere(np.triu(table.repeats) > 0).tolist()
    ]
    if not repeats:
        return []
    text = (
        "Games that were the same as another, move by move and in the same seats, and are not "
        f"counted: {', '.join(repeats)}."
    )
    return [textwrap.fill(text, LINE_WIDTH)]


def _tell_forfeits(table: LeagueTable) -> list[str]:
    lines = [f"  {count}: {reason}" for reason, count in table.forfeits]
    return ["\n".join(["Games forfeited, which count as lost", *lines])] if lines else []


def _ladder_csv(ratings: Sequence[Rating]) -> str:
    return _as_csv(
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
                table.repeats[row, column],
            )
        )
    header = ("agent", "opponent", "score", "low", "high", "games", "repeated_games")
    return _as_csv(header, rows)


def _differences_csv(table: LeagueTable) -> str:
    rows = []
    for row, column in np.argwhere(~np.eye(len(table.names), dtype=np.bool_)).tolist():
        gap = table.ladder.differences[row][column]
        own, other = table.ratings[row], table.ratings[column]
        elo = own.elo - other.elo
        ends = ("", "") if gap is None else (f"{gap.low:.2f}", f"{gap.high:.2f}")
        bound = "" if gap else "lower" if elo > 0.0 else "upper"
        rows.append((own.name, other.name, f"{elo:.2f}", *ends, bound))
    return _as_csv(("agent", "opponent", "elo", "low", "high", "bound"), rows)


def _as_csv(header: Sequence[str], rows: Sequence[Sequence[Any]]) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(rows)
    return text.getvalue()
