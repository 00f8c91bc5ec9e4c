"""A league's numbers as text for a terminal, and as sentences for every kind of report."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from itertools import combinations

import numpy as np

from marl_cair.league.ratings.diagnostics import describe_beyond
from marl_cair.league.ratings.groups import SWEEP_PROBABILITY
from marl_cair.league.ratings.likelihood import PRIOR_ELO
from marl_cair.league.ratings.rate import Estimate, Ladder, Rating, is_stronger
from marl_cair.league.report.table import LeagueTable

BOUND_SIGNS = {"": "", "lower": ">=", "upper": "<="}
CAVEAT = (
    "Intervals (95 %) of ratings are about the same zero as the ratings, by resampling map seeds,\n"
    "with half a won and half a lost block for each rating; `first` is how often an agent came\n"
    "first in them.\n"
    f"Prior: normal, standard deviation {PRIOR_ELO:.0f} Elo about the mean. All is about these\n"
    "very agents and games and says nothing of how another training run would turn out."
)
LINE_WIDTH = 100


def describe_league(table: LeagueTable, more: Sequence[str] = ()) -> str:
    """Ladder, matrix, differences, `more` and what is amiss, as text; ASCII but for names."""
    ladder, beyond = table.ladder, table.beyond
    parts = [
        _describe_ladder(table) if ladder else _fill(tell_no_ladder(table)),
        *map(_fill, explain_bounds(table.ratings)),
        *([_describe_matrix(table)] if table.num_games else []),
        *([describe_beyond(beyond, table.numbered_names, table.num_teams)] if beyond else []),
        *(["\n".join(["Differences (Elo, 95 %)", *compare_pairs(table)])] if ladder else []),
        *([_fill(tell_seats(table))] if ladder else []),
        *more,
        *map(_fill, warn_of_repeats(table)),
        *_tell_forfeits(table),
        *([_fill(tell_resampling(ladder)), CAVEAT] if ladder else []),
    ]
    return "\n\n".join(parts) + "\n"


def tell_no_ladder(table: LeagueTable) -> str:
    """Why nobody is rated."""
    return f"No ladder: {table.why_unrated}."


def _fill(text: str) -> str:
    return textwrap.fill(text, LINE_WIDTH)


def _describe_ladder(table: LeagueTable) -> str:
    width = max(len("agent"), *map(len, table.names))
    head = f"{'':>3} {'agent':{width}} {'Elo':>9} {'95 %':>18}"
    lines = [
        f"Ladder (Elo, {table.zero})",
        f"{head} {'first':>6} {'score':>7} {'games':>6}",
    ]
    for place, rating in enumerate(table.ratings, start=1):
        if place > 1 and rating.group != table.ratings[place - 2].group:
            lines.append("    " + "-" * (width + 51))
        elo, interval, first, score, games = format_rating(rating)
        lines.append(
            f"{place:>3} {rating.name:{width}} {elo:>9} {interval:>18} "
            f"{first:>6} {score:>7} {games:>6}"
        )
    return "\n".join(lines)


def format_rating(rating: Rating) -> tuple[str, str, str, str, str]:
    """Elo, interval, chance to be first, score and games."""
    elo = f"{BOUND_SIGNS[rating.bound]} {rating.elo:+.0f}".strip()
    ends = (
        f"{'<' if rating.open_low else ''}{rating.low:+.0f}",
        f"{'>' if rating.open_high else ''}{rating.high:+.0f}",
    )
    interval = "" if rating.low == rating.high else f"[{', '.join(ends)}]"
    first, score = f"{rating.probability_first:.0%}", f"{rating.score:.1%}"
    return elo, interval, first, score, str(rating.games)


def tell_resampling(ladder: Ladder) -> str:
    """How many resamples intervals are from, and how much that leaves to chance."""
    return (
        f"Intervals of ratings are from {ladder.num_resamples:,} resamples: another seed of the "
        f"resampling moves their ends by {ladder.move:.1f} Elo at most (95 %; ends with < and > "
        "by more)."
    )


def set_signs(text: str) -> str:
    """`text` with the signs of bounds that terminals of every code page can not show."""
    return text.replace(">=", "\u2265").replace("<=", "\u2264")


def explain_bounds(ratings: Sequence[Rating]) -> list[str]:
    """What the marks of the ladder mean; nothing where there are none."""
    told = []
    if any(rating.is_bound for rating in ratings):
        told.append(
            "A line parts groups: nobody below it took a single point off anybody above it, so "
            "these games do not limit how far apart they are. The zero is in the largest group. >= "
            "and <= mark bounds, which have no interval: a group's ratings may all be larger "
            "(smaller) by the same unknown number. Shown is the smallest distance at which so "
            f"clean a sweep has a chance of {SWEEP_PROBABILITY:.1%}."
        )
    if any(rating.open_low or rating.open_high for rating in ratings):
        told.append(
            "< and >: an end that only the prior holds, as that agent's distance to the others "
            "rests on a few single games (in more than 2.5 % of the resamples it took no point off "
            "them, or they none off it): play more."
        )
    return told


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


def compare_pairs(table: LeagueTable) -> list[str]:
    """A sentence for each pair of neighbours, and for others that cannot be told apart."""
    lines: list[str] = []
    if table.ladder is None:
        return lines
    for above, below in combinations(range(len(table.names)), 2):
        gap = table.ladder.differences[above][below]
        if below == above + 1 or not table.tells_apart(above, below):
            lines.append(compare_in_words(table.ratings[above], table.ratings[below], gap))
    return lines


def compare_in_words(above: Rating, below: Rating, gap: Estimate | None) -> str:
    """Who of the two is stronger, and by how much; `above` has the higher rating."""
    numbers = f"{above.elo - below.elo:+.0f} or more (no point went the other way)"
    if gap is not None:
        numbers = f"{gap.elo:+.0f} [{gap.low:+.0f}, {gap.high:+.0f}]"
    if is_stronger(above, below, gap):
        return f"{above.name} is stronger than {below.name}: {numbers}"
    return f"{above.name} and {below.name} cannot be told apart: {numbers}"


def tell_seats(table: LeagueTable) -> str:
    """What each seat adds to a rating."""
    seats = "seat" if table.num_teams == 2 else "team"
    told = ", ".join(
        f"{seats} {number} {seat.elo:+.0f} [{seat.low:+.0f}, {seat.high:+.0f}]"
        for number, seat in enumerate(table.ladder.seats if table.ladder else (), start=1)
    )
    return f"What a {seats} adds to a rating (Elo, 95 %): {told}"


def warn_of_repeats(table: LeagueTable) -> list[str]:
    """Which pairs played some games more than once; nothing where none did."""
    repeats = [
        f"{table.names[row]} v {table.names[column]} {table.repeats[row, column]} of "
        f"{table.repeats[row, column] + table.counts[row, column]}"
        for row, column in np.argwhere(np.triu(table.repeats) > 0).tolist()
    ]
    if not repeats:
        return []
    return [
        (
            "Games that were the same as another, move by move and in the same seats, and are not "
            f"counted: {', '.join(repeats)}."
        )
    ]


def _tell_forfeits(table: LeagueTable) -> list[str]:
    lines = [f"  {count}: {reason}" for reason, count in table.forfeits]
    return ["\n".join(["Games forfeited, which count as lost", *lines])] if lines else []
