"""The report model: sections of sentences, tables and charts; every format is rendered from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from marl_cair.league.ratings.payoffs import Share
from marl_cair.league.report import wording
from marl_cair.league.report.background import Background, Curve, describe_training, find_curves
from marl_cair.league.report.replays import ShownGame
from marl_cair.league.report.table import LeagueTable

NO_GAMES = ("There are no games.",)


@dataclass(frozen=True)
class Table:
    """Cells of text, of one or more lines; the first `num_words` columns are words, all others
    numbers.
    """

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    num_words: int = 1
    title: str = ""


@dataclass(frozen=True)
class Section:
    """One part of the report, in the order of its fields."""

    key: str
    title: str
    words: Sequence[str] = ()
    chart: str = ""  # its name in `charts`; "": none
    tables: Sequence[Table] = ()
    items: Sequence[str] = ()  # a list of sentences
    replays: Sequence[ShownGame] = ()
    notes: Sequence[str] = ()
    in_text: bool = True  # whether a terminal shows it


@dataclass(frozen=True)
class Report:
    """A report, and the numbers that its charts and CSV files are made from."""

    table: LeagueTable
    background: Background
    curves: tuple[Curve, ...]
    headline: str
    summary: Sequence[str]
    facts: tuple[tuple[str, str], ...]  # name and number
    sections: tuple[Section, ...]


def make_report(table: LeagueTable, background: Background | None = None) -> Report:
    """The report of a league's numbers."""
    background = background or Background()
    curves = tuple(find_curves(table.ratings, background.records))
    no_replays = (background.replay_words,) if background.replay_words else ()
    sections = (
        _make_ladder(table),
        _make_differences(table),
        _make_matrix(table),
        _make_training(table, curves),
        _make_shares(table, background),
        _make_fit(table),
        *_make_averages(table),
        _make_errors(table),
        Section("replays", "Replays", no_replays, replays=background.replays, in_text=False),
        _make_settings(table, background),
        Section(
            "limits", "Limits of the intervals", wording.LIMITS, in_text=table.ladder is not None
        ),
    )
    facts = (
        ("agents", f"{len(table.names):,}"),
        ("games", f"{table.num_games:,}"),
        ("forfeits", f"{sum(count for *_, count in table.forfeits):,}"),
        ("ended by the time limit", f"{background.num_truncated:,}"),
    )
    headline, summary = wording.write_headline(table), wording.write_summary(table)
    return Report(table, background, curves, headline, summary, facts, sections)


def _make_ladder(table: LeagueTable) -> Section:
    if table.ladder is None:
        return Section("ladder", "Ladder", (wording.explain_no_ladder(table),))
    words = (
        f"Elo ({table.zero}) with 95 % confidence intervals about that zero; first: share of the "
        "resamples in which the agent ranks first. " + wording.describe_resampling(table.ladder)
    )
    rows: list[Sequence[str]] = []
    for place, rating in enumerate(table.ratings):
        if place and rating.group != table.ratings[place - 1].group:
            rows.append(("", "(lower group)", *[""] * 5))
        rows.append((str(place + 1), rating.name, *wording.format_rating(rating)))
    shown = Table(("", "agent", "Elo", "95 %", "first", "score", "games"), rows, 2)
    notes = wording.explain_bounds(table.ratings)
    return Section("ladder", "Ladder", (words,), "ladder", (shown,), notes=notes)


def _make_differences(table: LeagueTable) -> Section:
    words = (
        "Elo with the 95 % confidence interval of the difference, which is narrower than the two "
        "ratings' intervals suggest: neighbours, and all pairs whose ratings do not differ "
        "significantly."
    )
    if not (items := wording.compare_pairs(table)):
        words = "There are no two rated agents to compare."
    return Section("differences", "Differences", (words,), items=items)


def _make_matrix(table: LeagueTable) -> Section:
    title = "Score matrix"
    if not table.num_games:
        return Section("matrix", title, NO_GAMES)
    what = "score of the row's agent against the column's, draws count half"
    if table.num_teams > 2:
        what = "how often the row's agent came in above the column's, ties count half"
    words = f"In %: {what}; 95 % confidence interval; number of games."
    places = range(len(table.names))
    cells = [[_format_share(table.payoffs.pair(row, at), "\n") for at in places] for row in places]
    header = ["", "agent", *(str(place + 1) for place in places)]
    rows = [[header[2 + row], table.names[row], *cells[row]] for row in places]
    shown = Table(header, rows, 2)
    notes = wording.describe_repeats(table)
    return Section("matrix", title, (words,), "matrix", (shown,), notes=notes)


def _make_training(table: LeagueTable, curves: Sequence[Curve]) -> Section:
    if not curves:
        words = "No run has two rated snapshots of different age: name a run of self-play"
        return Section("training", "Learning curves", (f"{words}.",))
    words = (
        f"Elo ({table.zero}) of each run's snapshots by environment steps of training, with 95 % "
        "confidence intervals. One run is one training seed."
    )
    rows = [
        (curve.run, f"{steps:,}", rating.name, *wording.format_rating(rating)[:2])
        for curve in curves
        for steps, rating in curve.points
    ]
    shown = Table(("run", "steps", "agent", "Elo", "95 %"), rows)
    return Section("training", "Learning curves", (words,), "training", (shown,))


def _make_shares(table: LeagueTable, background: Background) -> Section:
    title = "Score by seat and map"
    if not table.num_games:
        return Section("shares", title, NO_GAMES)
    seats, teams = "seat" if table.num_teams == 2 else "team", range(table.num_teams)
    names, shares, by_map = table.names, table.team_shares, background.map_shares
    header = ["agent", *(f"{seats} {team}" for team in teams)]
    rows = [[name, *(_format_share(shares.get((name, team))) for team in teams)] for name in names]
    tables = [Table(header, rows, title=f"By {seats}")]
    if by_map:
        rows = [
            [played, *(_format_share(by_map.get((name, played))) for name in names)]
            for played in sorted({played for _, played in by_map})
        ]
        tables.append(Table(["map", *names], rows, title="By map"))
    words = ["Share of points in % (a draw is half), 95 % confidence interval, number of games."]
    if table.ladder is not None:
        words.append(wording.describe_seats(table))
    return Section("shares", title, words, tables=tables, notes=(background.map_words,))


def _format_share(share: Share | None, gap: str = " ") -> str:
    if share is None:
        return ""
    interval = f"{100 * share.low:.0f}-{100 * share.high:.0f}"
    interval = f"[{interval}]" if gap == " " else interval
    return gap.join((f"{100 * share.share:.1f}", interval, str(share.games)))


def _make_fit(table: LeagueTable) -> Section:
    words = wording.describe_fit(table.fit), wording.describe_cycles(table)
    return Section("fit", "Is one number per agent enough?", words if table.num_games else NO_GAMES)


def _make_averages(table: LeagueTable) -> list[Section]:
    words = ("Weight of each agent in the mixture, and its score against the mixture.",)
    sections = []
    for title, found in table.averages.items():
        rows = []
        for name, *numbers in zip(table.names, *vars(found).values(), strict=True):
            weight, low, high, skill, skill_low, skill_high = (f"{one:.1%}" for one in numbers)
            rows.append((name, weight, f"[{low}, {high}]", skill, f"[{skill_low}, {skill_high}]"))
        shown = Table(("agent", "weight", "95 %", "score", "95 %"), rows)
        sections.append(Section("averages", title, words, tables=(shown,)))
    return sections


def _make_errors(table: LeagueTable) -> Section:
    title = "Errors and forfeits"
    if not table.forfeits:
        return Section("errors", title, ("No game was forfeited.",), in_text=False)
    rows = [(name, why, str(count)) for name, why, count in table.forfeits]
    shown = Table(("agent", "reason", "games"), rows, 2)
    words = "Forfeited games count as lost, or as drawn where all that were left forfeit at once."
    return Section("errors", title, (words,), tables=(shown,))


def _make_settings(table: LeagueTable, background: Background) -> Section:
    tables = []
    rows = [
        (name, record.kind, record.evaluation_policy, describe_training(record), record.fingerprint)
        for name in table.names
        if (record := background.records.get(name))
    ]
    if rows:
        header = ("agent", "kind", "policy", "training", "fingerprint")
        tables.append(Table(header, rows, 5, "Agents"))
    if background.settings:
        tables.append(Table(("setting", "value"), background.settings, 2, "League"))
    words = () if tables else ("The settings of these games are unknown.",)
    return Section("settings", "Settings", words, tables=tables, in_text=False)
