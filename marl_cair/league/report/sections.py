"""The report as sections of words and tables: what the page and the Markdown file are made from."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable
from dataclasses import dataclass

from marl_cair.league.ratings.diagnostics import tell_cycles, tell_fit
from marl_cair.league.ratings.likelihood import PRIOR_ELO
from marl_cair.league.ratings.shares import Share
from marl_cair.league.report.background import Background, Curve, find_curves, tell_training
from marl_cair.league.report.summary import tell_headline, tell_verdict
from marl_cair.league.report.table import LeagueTable
from marl_cair.league.report.wording import (
    LINE_WIDTH,
    compare_pairs,
    explain_bounds,
    format_rating,
    tell_no_ladder,
    tell_resampling,
    tell_seats,
    warn_of_repeats,
)

LIMITS = (
    "The intervals are about these very agents: how their ratings would come out if the same "
    "agents played more games, on other map seeds of the same scenario.\n"
    "They do not cover training variance: the same algorithm trained again from another seed gives "
    "another agent, often one of quite another strength. To compare algorithms, train several "
    "seeds of each, let all of them play, and compare the spread between seeds.\n"
    "Nor do they cover other scenarios, other maps, or opponents that nobody here resembles. "
    "`marl-cair league exploit AGENT` trains opponents against one agent and tells how much it "
    "can be made to lose.\n"
    f"Ratings have a normal prior, of standard deviation {PRIOR_ELO:,.0f} Elo about their "
    "mean: it moves a rating where points are few."
)


_MORE = ("training", "shares")  # sections that a terminal shows as tables


@dataclass(frozen=True)
class Table:
    """Cells of text; the first `num_words` columns are words, all others numbers."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    num_words: int = 1
    title: str = ""


@dataclass(frozen=True)
class Section:
    """One part of the report; `key` tells the page which drawing goes with it."""

    key: str
    title: str
    words: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    items: tuple[str, ...] = ()  # a list of sentences
    notes: tuple[str, ...] = ()  # below all of it


@dataclass(frozen=True)
class Report:
    """A whole report: its sections, and the numbers that drawings are made from."""

    table: LeagueTable
    background: Background
    curves: tuple[Curve, ...]
    headline: str
    verdict: tuple[str, ...]
    facts: tuple[tuple[str, str], ...]  # a few numbers with what they count
    sections: tuple[Section, ...]


def make_report(table: LeagueTable, background: Background | None = None) -> Report:
    """All that there is to say about the games, in the order in which it is read."""
    background = background or Background()
    curves = tuple(find_curves(table.ratings, background.records))
    sections = (
        _tell_ladder(table),
        _tell_differences(table),
        _tell_matrix(table),
        _tell_training(table, curves),
        _tell_shares(table, background),
        _tell_enough(table),
        *_tell_averages(table),
        _tell_errors(table),
        _tell_replays(background),
        _tell_agents(table, background),
        Section("limits", "What the intervals do not cover", tuple(LIMITS.split("\n"))),
    )
    return Report(
        table,
        background,
        curves,
        tell_headline(table),
        tuple(tell_verdict(table)),
        _count(table, background),
        sections,
    )


def describe_more(report: Report) -> list[str]:
    """As text for a terminal what `wording.describe_league` does not tell: tables of snapshots,
    seats and maps. One that is wider than a terminal is named by its file.
    """
    told = []
    for section in report.sections:
        for table in section.tables if section.key in _MORE else ():
            title = table.title or section.title
            text = format_table(table)
            if max(map(len, text.split("\n"))) > LINE_WIDTH:
                text = f"Too wide for a terminal: see {section.title!r} in report.md."
            words = textwrap.fill(f"{title}: {section.words[0]}", LINE_WIDTH)
            told.append(f"{words}\n{text}")
    return told


def format_table(table: Table) -> str:
    """Columns of equal width: words from the left, numbers from the right."""
    rows = [table.header, *table.rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        cells = [
            cell.ljust(width) if place < table.num_words else cell.rjust(width)
            for place, (cell, width) in enumerate(zip(row, widths, strict=True))
        ]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)


def _count(table: LeagueTable, background: Background) -> tuple[tuple[str, str], ...]:
    forfeits = sum(count for _, count in table.forfeits)
    return (
        ("agents", f"{len(table.names):,}"),
        ("games", f"{table.num_games:,}"),
        ("forfeits", f"{forfeits:,}"),
        ("ended by the time limit", f"{background.num_truncated:,}"),
    )


def _tell_ladder(table: LeagueTable) -> Section:
    if table.ladder is None:
        return Section("ladder", "Ladder", (tell_no_ladder(table),))
    words = (
        f"Elo, {table.zero}. Bars are 95 % intervals about that zero, by resampling map seeds; "
        f"first is how often an agent came first in them. {tell_resampling(table.ladder)}"
    )
    header = ("", "agent", "Elo", "95 %", "first", "score", "games")
    rows = [
        (str(place), rating.name, *format_rating(rating))
        for place, rating in enumerate(table.ratings, start=1)
    ]
    notes = tuple(explain_bounds(table.ratings))
    return Section("ladder", "Ladder", (words,), (Table(header, tuple(rows), 2),), notes=notes)


def _tell_differences(table: LeagueTable) -> Section:
    title = "Differences"
    lines = compare_pairs(table)
    if not lines:
        return Section("differences", title, ("There are no two rated agents to compare.",))
    words = (
        "Elo with 95 % intervals of the difference itself, which are narrower than two ratings' "
        "suggest: of neighbours, and of all who cannot be told apart."
    )
    return Section("differences", title, (words,), items=tuple(lines))


def _tell_matrix(table: LeagueTable) -> Section:
    title = "Who beats whom"
    if not table.num_games:
        return Section("matrix", title, ("There are no games.",))
    what = "score of the row's agent against the column's, draws count half"
    if table.num_teams > 2:
        what = "how often the row's agent came in above the column's, ties count half"
    words = (
        f"In %: {what}. With each its 95 % interval and the number of games; bold: clear of 50 %."
    )
    numbers = [str(place) for place in range(1, len(table.names) + 1)]
    rows = [
        (number, name, *(_format_share(table.pair(row, at)) for at in range(len(table.names))))
        for row, (number, name) in enumerate(zip(numbers, table.names, strict=True))
    ]
    matrix = Table(("", "agent", *numbers), tuple(rows), 2)
    return Section("matrix", title, (words,), (matrix,), notes=tuple(warn_of_repeats(table)))


def _tell_training(table: LeagueTable, curves: Iterable[Curve]) -> Section:
    title = "Rating against training"
    rows = [
        (curve.run, f"{point.frames:,}", point.rating.name, *format_rating(point.rating)[:2])
        for curve in curves
        for point in curve.points
    ]
    if not rows:
        words = "No run has two rated snapshots of different age here, so there is no curve to draw"
        return Section("training", title, (f"{words}: add some of `RUN/snapshots` to the league.",))
    words = (
        f"Elo ({table.zero}) of each run's snapshots by the decisions that they were trained for; "
        "bars are 95 % intervals. One run is one training seed."
    )
    header = ("run", "decisions", "agent", "Elo", "95 %")
    return Section("training", title, (words,), (Table(header, tuple(rows), 1),))


def _tell_shares(table: LeagueTable, background: Background) -> Section:
    title = "Score by seat and map"
    if not table.num_games:
        return Section("shares", title, ("There are no games.",))
    seats = "seat" if table.num_teams == 2 else "team"
    header = ("agent", *(f"{seats} {team + 1}" for team in range(table.num_teams)))
    rows = [
        (
            name,
            *(
                _format_share(table.team_shares.get((name, team)))
                for team in range(table.num_teams)
            ),
        )
        for name in table.names
    ]
    tables = [Table(header, tuple(rows), title=f"By {seats}")]
    shares = background.map_shares
    if shares:
        maps = sorted({name for _, name in shares})
        rows = [
            (played, *(_format_share(shares.get((name, played))) for name in table.names))
            for played in maps
        ]
        tables.append(Table(("map", *table.names), tuple(rows), title="By map"))
    words = ["Share of points in % (a win 1, a draw shared), 95 % interval, games."]
    if table.ladder is not None:
        words.append(f"{tell_seats(table)}.")
    return Section("shares", title, tuple(words), tuple(tables), notes=(background.map_words,))


def _format_share(share: Share | None) -> str:
    if share is None:
        return ""
    return f"{100 * share.share:.1f} [{100 * share.low:.0f}-{100 * share.high:.0f}] {share.games}"


def _tell_enough(table: LeagueTable) -> Section:
    title = "Is one number per agent enough?"
    if table.beyond is None:
        return Section("fit", title, ("There are no games.",))
    cycles = tell_cycles(table.beyond.cycles, table.numbered_names, table.num_teams)
    return Section("fit", title, (tell_fit(table.beyond.fit), cycles))


def _tell_averages(table: LeagueTable) -> list[Section]:
    sections = []
    for title, found in (table.beyond.averages if table.beyond else {}).items():
        place = {name: number for number, name in enumerate(table.numbered_names)}
        rows = []
        for name in table.names:
            at = place[name]
            weights = f"[{found.low[at]:.1%}, {found.high[at]:.1%}]"
            scores = f"[{found.skill_low[at]:.1%}, {found.skill_high[at]:.1%}]"
            rows.append(
                (name, f"{found.weights[at]:.1%}", weights, f"{found.skills[at]:.1%}", scores)
            )
        words = (
            "What is played by the weights, and each agent's score against that; 95 % intervals."
        )
        header = ("agent", "weight", "95 %", "score", "95 %")
        sections.append(Section("averages", title, (words,), (Table(header, tuple(rows)),)))
    return sections


def _tell_errors(table: LeagueTable) -> Section:
    title = "Errors and forfeits"
    if not table.forfeits:
        return Section("errors", title, ("No game was forfeited.",))
    rows = tuple((reason, str(count)) for reason, count in table.forfeits)
    words = ("Games that were forfeited count as lost.",)
    return Section("errors", title, words, (Table(("why", "games"), rows),))


def _tell_replays(background: Background) -> Section:
    words = (background.replay_words,) if background.replay_words else ()
    return Section("replays", "Games to watch", words)


def _tell_agents(table: LeagueTable, background: Background) -> Section:
    tables = []
    records = [
        (name, background.records[name]) for name in table.names if name in background.records
    ]
    if records:
        rows = tuple(
            (name, record.kind, record.evaluation_policy, tell_training(record), record.fingerprint)
            for name, record in records
        )
        header = ("agent", "kind", "plays", "trained for", "fingerprint")
        tables.append(Table(header, rows, 5, "Agents"))
    if background.settings:
        tables.append(Table(("setting", "value"), background.settings, 2, "League"))
    words = () if tables else ("Nothing is known of how these games were played.",)
    return Section("settings", "Settings", words, tuple(tables))
