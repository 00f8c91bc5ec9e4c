"""The report model: sections of sentences, tables and charts; every format is rendered from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from marl_cair.league.ratings.payoffs import Share
from marl_cair.league.report.background import Background, Curve, describe_training, find_curves
from marl_cair.league.report.replays import Replay
from marl_cair.league.report.table import LeagueTable
from marl_cair.league.report.wording import (
    LIMITS,
    compare_pairs,
    describe_cycles,
    describe_fit,
    describe_repeats,
    describe_resampling,
    describe_seats,
    explain_bounds,
    explain_no_ladder,
    format_rating,
    write_headline,
    write_summary,
)

NO_GAMES = ("There are no games.",)


@dataclass(frozen=True)
class Table:
    """Cells of text, of one or more lines; the first `num_words` columns are words, all others
    numbers.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    num_words: int = 1
    title: str = ""


@dataclass(frozen=True)
class Section:
    """One part of the report, in the order of its fields."""

    key: str
    title: str
    words: tuple[str, ...] = ()
    chart: str = ""  # its name in `charts`; "": none
    tables: tuple[Table, ...] = ()
    items: tuple[str, ...] = ()  # a list of sentences
    replays: tuple[Replay, ...] = ()
    notes: tuple[str, ...] = ()
    in_text: bool = True  # whether a terminal shows it


@dataclass(frozen=True)
class Report:
    """A report, and the numbers that its charts and CSV files are made from."""

    table: LeagueTable
    background: Background
    curves: tuple[Curve, ...]
    headline: str
    summary: tuple[str, ...]
    facts: tuple[tuple[str, str], ...]  # what is counted, and the number
    sections: tuple[Section, ...]


def make_report(table: LeagueTable, background: Background | None = None) -> Report:
    """The report of a league's numbers."""
    background = background or Background()
    curves = tuple(find_curves(table.ratings, background.records))
    sections = (
        _make_ladder(table),
        _make_differences(table),
        _make_matrix(table),
        _make_training(table, curves),
        _make_shares(table, background),
        _make_fit(table),
        *_make_averages(table),
        _make_errors(table),
        Section(
            "replays",
            "Replays",
            (background.replay_words,) if background.replay_words else (),
            replays=background.replays,
            in_text=False,
        ),
        _make_settings(table, background),
        Section(
            "limits", "Limits of the intervals", tuple(LIMITS), in_text=table.ladder is not None
        ),
    )
    facts = (
        ("agents", f"{len(table.names):,}"),
        ("games", f"{table.num_games:,}"),
        ("forfeits", f"{sum(count for _, count in table.forfeits):,}"),
        ("ended by the time limit", f"{background.num_truncated:,}"),
    )
    summary = tuple(write_summary(table))
    return Report(table, background, curves, write_headline(table), summary, facts, sections)


def _make_ladder(table: LeagueTable) -> Section:
    if table.ladder is None:
        return Section("ladder", "Ladder", (explain_no_ladder(table),))
    words = (
        f"Elo ({table.zero}) with 95 % confidence intervals about that zero; first: share of the "
        f"resamples in which the agent ranks first. {describe_resampling(table.ladder)}"
    )
    rows: list[tuple[str, ...]] = []
    for place, rating in enumerate(table.ratings):
        if place and rating.group != table.ratings[place - 1].group:
            rows.append(("", "--------", *[""] * 5))
        rows.append((str(place + 1), rating.name, *format_rating(rating)))
    header = ("", "agent", "Elo", "95 %", "first", "score", "games")
    notes = tuple(explain_bounds(table.ratings))
    tables = (Table(header, tuple(rows), 2),)
    return Section("ladder", "Ladder", (words,), "ladder", tables, notes=notes)


def _make_differences(table: LeagueTable) -> Section:
    title, lines = "Differences", compare_pairs(table)
    if not lines:
        return Section("differences", title, ("There are no two rated agents to compare.",))
    words = (
        "Elo with the 95 % confidence interval of the difference, which is narrower than the two "
        "ratings' intervals suggest: neighbours, and all pairs without a significant difference."
    )
    return Section("differences", title, (words,), items=tuple(lines))


def _make_matrix(table: LeagueTable) -> Section:
    title = "Score matrix"
    if not table.num_games:
        return Section("matrix", title, NO_GAMES)
    what = "score of the row's agent against the column's, draws count half"
    if table.num_teams > 2:
        what = "how often the row's agent came in above the column's, ties count half"
    words = f"In %: {what}; 95 % confidence interval; number of games."
    rows = [
        (
            str(row + 1),
            name,
            *(_format_share(table.pair(row, at), "\n") for at in range(len(table.names))),
        )
        for row, name in enumerate(table.names)
    ]
    header = ("", "agent", *(row[0] for row in rows))
    tables = (Table(header, tuple(rows), 2),)
    return Section("matrix", title, (words,), "matrix", tables, notes=(*describe_repeats(table),))


def _make_training(table: LeagueTable, curves: Sequence[Curve]) -> Section:
    title = "Learning curves"
    rows = [
        (curve.run, f"{point.frames:,}", point.rating.name, *format_rating(point.rating)[:2])
        for curve in curves
        for point in curve.points
    ]
    if not rows:
        words = "No run has two rated snapshots of different age: add `RUN/snapshots` to the league"
        return Section("training", title, (f"{words}.",))
    words = (
        f"Elo ({table.zero}) of each run's snapshots by environment steps of training, with 95 % "
        "confidence intervals. One run is one training seed."
    )
    tables = (Table(("run", "steps", "agent", "Elo", "95 %"), tuple(rows)),)
    return Section("training", title, (words,), "training", tables)


def _make_shares(table: LeagueTable, background: Background) -> Section:
    title = "Score by seat and map"
    if not table.num_games:
        return Section("shares", title, NO_GAMES)
    seats, teams = "seat" if table.num_teams == 2 else "team", range(table.num_teams)
    header = ("agent", *(f"{seats} {team + 1}" for team in teams))
    rows = [
        (name, *(_format_share(table.team_shares.get((name, team))) for team in teams))
        for name in table.names
    ]
    tables = [Table(header, tuple(rows), title=f"By {seats}")]
    shares = background.map_shares
    if shares:
        rows = [
            (played, *(_format_share(shares.get((name, played))) for name in table.names))
            for played in sorted({name for _, name in shares})
        ]
        tables.append(Table(("map", *table.names), tuple(rows), title="By map"))
    words = ["Share of points in % (a draw is half), 95 % confidence interval, number of games."]
    if table.ladder is not None:
        words.append(describe_seats(table))
    notes = (background.map_words,)
    return Section("shares", title, tuple(words), tables=tuple(tables), notes=notes)


def _format_share(share: Share | None, gap: str = " ") -> str:
    if share is None:
        return ""
    low, high = (f"{100 * end:.0f}" for end in (share.low, share.high))
    interval = f"[{low}-{high}]" if gap == " " else f"{low}-{high}"
    return gap.join((f"{100 * share.share:.1f}", interval, str(share.games)))


def _make_fit(table: LeagueTable) -> Section:
    title = "Is one number per agent enough?"
    found = table.diagnostics
    if found is None:
        return Section("fit", title, NO_GAMES)
    cycles = describe_cycles(found.cycles, table.numbered_names, table.num_teams)
    return Section("fit", title, (describe_fit(found.fit), cycles))


def _make_averages(table: LeagueTable) -> list[Section]:
    sections = []
    place = {name: number for number, name in enumerate(table.numbered_names)}
    for title, found in (table.diagnostics.averages if table.diagnostics else {}).items():
        rows = []
        for name in table.names:
            at = place[name]
            weights = f"[{found.low[at]:.1%}, {found.high[at]:.1%}]"
            scores = f"[{found.skill_low[at]:.1%}, {found.skill_high[at]:.1%}]"
            rows.append(
                (name, f"{found.weights[at]:.1%}", weights, f"{found.skills[at]:.1%}", scores)
            )
        words = ("Weight of each agent in the mixture, and its score against the mixture.",)
        tables = (Table(("agent", "weight", "95 %", "score", "95 %"), tuple(rows)),)
        sections.append(Section("averages", title, words, tables=tables))
    return sections


def _make_errors(table: LeagueTable) -> Section:
    title = "Errors and forfeits"
    if not table.forfeits:
        return Section("errors", title, ("No game was forfeited.",), in_text=False)
    rows = tuple((reason, str(count)) for reason, count in table.forfeits)
    words = ("Forfeited games count as lost.",)
    return Section("errors", title, words, tables=(Table(("reason", "games"), rows),))


def _make_settings(table: LeagueTable, background: Background) -> Section:
    tables = []
    rows = tuple(
        (name, record.kind, record.evaluation_policy, describe_training(record), record.fingerprint)
        for name in table.names
        if (record := background.records.get(name))
    )
    if rows:
        header = ("agent", "kind", "policy", "training", "fingerprint")
        tables.append(Table(header, rows, 5, "Agents"))
    if background.settings:
        tables.append(Table(("setting", "value"), background.settings, 2, "League"))
    words = () if tables else ("The settings of these games are unknown.",)
    return Section("settings", "Settings", words, tables=tuple(tables), in_text=False)
