"""HTML, Markdown and text hold the same numbers and sentences, whatever agents are called."""

import dataclasses
import html.parser
import json
import re

import numpy as np
import pytest

from marl_cair.league.ratings.games import Games
from marl_cair.league.ratings.payoffs import Share
from marl_cair.league.report.background import Background, find_curves
from marl_cair.league.report.files import FILES, write_report
from marl_cair.league.report.render import (
    LINE_WIDTH,
    escape_markdown,
    format_table,
    render_html,
    render_markdown,
    render_text,
    use_unicode_signs,
)
from marl_cair.league.report.replays import ShownGame
from marl_cair.league.report.sections import Table, make_report
from marl_cair.league.report.table import make_table
from marl_cair.league.report.wording import format_rating
from marl_cair.league.store.schema import AgentRecord
from marl_cair.viewer.page import make_element, make_policy, read_script
from tests.league.leagues import EDGES, NAMES, make, make_games, no_games

EVIL = '<script>alert("x")</script>'
EVEN = dict.fromkeys(EDGES, 25)
VOID = {"meta", "img", "wbr", "br", "hr"}


class Page(html.parser.HTMLParser):
    """Elements with their attributes and text, and the rows of tables by the key of a section."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.text, self.rows, self.open = [], {}, {}, []
        self.key, self.cell = "", None
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag == "section":
            self.key = dict(attrs)["data-key"]
        if tag == "tr":
            self.rows.setdefault(self.key, []).append([])
        if tag in ("td", "th"):
            self.cell = []
        if tag == "br" and self.cell is not None:
            self.cell.append(" ")
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag
        if tag in ("td", "th"):
            self.rows[self.key][-1].append(" ".join("".join(self.cell).split()))
            self.cell = None

    def handle_data(self, data):
        self.text[self.key] = self.text.get(self.key, "") + data
        if self.cell is not None:
            self.cell.append(data)


def read_page(table, background=None):
    page = Page(render_html(make_report(table, background)))
    assert page.open == []  # every element is closed
    return page


def record(name, run="", frames=0, seed=0):
    trained = {"run": run, "name": "n", "seed": seed, "frames": frames, "frames_total": frames}
    about = json.dumps({"training": trained} if run else {})
    return AgentRecord(f"print of {name}", name, "network", "greedy", "1", about)


def text_of(table):
    return render_text(make_report(table))


def test_the_ladder_of_the_page_is_that_of_the_text():
    table = make()
    rows = [row for row in read_page(table).rows["ladder"][1:] if row[0]]
    text = text_of(table)
    for rating, row in zip(table.ratings, rows, strict=True):
        elo, *others = format_rating(rating)
        assert row[1:] == [rating.name, use_unicode_signs(elo), *others]
        assert all(word in text for word in (rating.name, elo, *others))


def test_the_matrix_has_share_interval_and_games_of_every_pair():
    table = make(EVEN, repeats=4)
    _, *rows = read_page(table).rows["matrix"]
    assert [row[1] for row in rows] == list(table.names)
    for place, row in enumerate(rows):
        for column, cell in enumerate(row[2:]):
            if place == column:
                assert cell == ""
                continue
            share = 100 * table.payoffs.points[place, column] / table.payoffs.counts[place, column]
            low, high = (
                100 * table.payoffs.low[place, column],
                100 * table.payoffs.high[place, column],
            )
            assert cell == f"{share:.1f} {low:.0f}-{high:.0f} {table.payoffs.counts[place, column]}"


@pytest.mark.parametrize("key", ["ladder", "matrix"])
def test_charts_are_vector_graphics_with_names_as_text(key):
    page = read_page(make(EVEN))
    assert [dict(about)["role"] for tag, about in page.elements if tag == "svg"] == ["img", "img"]
    assert all(page.text[key].count(name) >= 2 for name in NAMES)  # in the chart and in the table


@pytest.mark.parametrize("results", [EDGES, EVEN, dict.fromkeys(EDGES, 20)])
def test_page_and_markdown_have_the_words_of_the_text(results):
    table = make(results, forfeits=((NAMES[0], "mine crashed in act: KeyError: 3", 4),))
    page, markdown = read_page(table), render_markdown(make_report(table))
    text = " ".join(text_of(table).split())
    for section in make_report(table).sections:
        for sentence in section.items:
            assert sentence in text
            assert sentence in page.text[section.key]
            assert escape_markdown(sentence) in markdown
    for sentence in make_report(table).summary:
        assert sentence in page.text[""]
        assert escape_markdown(sentence) in markdown
    assert make_report(table).headline in page.text[""]
    assert [NAMES[0], "mine crashed in act: KeyError: 3", "4"] in page.rows["errors"]


def test_the_tables_of_the_markdown_have_as_many_cells_in_each_row():
    lines = render_markdown(make_report(make(names=["a|b", "c", "d", "random"]))).splitlines()
    rows = [line for line in lines if line.startswith("| ")]
    assert "| 1 | a\\|b |" in "\n".join(rows)
    tables = "\n".join(lines).split("\n\n")
    for table in (part.splitlines() for part in tables if part.startswith("| ")):
        assert len({len(re.findall(r"(?<!\\)\|", row)) for row in table}) == 1
        assert len(table) > 2


def test_names_that_are_code_do_not_run():
    names = [EVIL, '" onmouseover="x', "{{ 7 * 7 }}", "random"]
    background = Background(
        title=EVIL,
        settings=((EVIL, EVIL),),
        records={EVIL: record(EVIL, "/r", 5)},
        map_shares={(EVIL, EVIL): Share(0.5, 0.4, 0.6, 8)},
        map_words=EVIL,
        replays=(ShownGame(EVIL, EVIL, None, EVIL),),
    )
    table = make(EVEN, names, forfeits=((names[0], EVIL, 1),))
    page = read_page(table, background)
    assert {tag for tag, _ in page.elements} & {"script", "iframe", "object", "link"} == set()
    assert not any(key.startswith("on") for _, about in page.elements for key in about)
    assert EVIL in page.text["differences"]
    assert "{{ 7 * 7 }}" in page.text["ladder"]
    assert EVIL not in render_markdown(make_report(table, background))


def test_a_backtick_in_a_name_is_no_code():
    page = read_page(make(EVEN, ["a`b", "c", "d", "random"]))
    assert "a`b" in page.text["differences"]
    assert ("code", {}) in page.elements  # of the command in the limits


def test_the_page_needs_nothing_else():
    text = render_html(make_report(make()))
    page = Page(text)
    for tag, about in page.elements:
        for key in ("src", "href", "data", "srcset"):
            assert str(about.get(key, "data:")).startswith(("data:", "#")), (tag, about)
    assert "@import" not in text
    assert re.findall(r"url\([^#]", text) == []
    (policy,) = [a["content"] for t, a in page.elements if t == "meta" and "http-equiv" in a]
    assert policy.startswith("default-src 'none'")


def headline(results, names=("a", "b", "c")):
    report = make_report(make(results, list(names)))
    return report.headline, report.summary


@pytest.mark.slow
def test_the_headline_names_the_strongest_or_all_who_may_be():
    sure, summary = headline({(0, 1): 35, (0, 2): 38, (1, 2): 35})
    assert sure == "a is the strongest"
    assert summary[0].startswith("a is ")
    close, _ = headline({(0, 1): 20, (0, 2): 38, (1, 2): 38})
    assert {"a", "b"} < set(close.split())
    assert "strongest" not in close
    level, _ = headline({(0, 1): 20, (0, 2): 20, (1, 2): 20})
    assert "2 others" in level
    assert headline({(0, 1): 40}, ("a", "random"))[0] == "a is the strongest"


def runs():
    names = ["old", "new", "other", "random"]
    table = make(EVEN, names)
    records = {
        "old": record("old", "/runs/a", 1_000),
        "new": record("new", "/runs/a", 50_000),
        "other": record("other", "/runs/b", 1_000),
    }
    return table, Background(records=records)


@pytest.mark.slow
def test_a_run_with_two_snapshots_is_a_curve():
    table, background = runs()
    page = read_page(table, background)
    assert [row[1:3] for row in page.rows["training"][1:]] == [["1,000", "old"], ["50,000", "new"]]
    assert sum(tag == "svg" for tag, _ in page.elements) == 3
    bare = read_page(table)
    assert "RUN/snapshots" in bare.text["training"]
    assert sum(tag == "svg" for tag, _ in bare.elements) == 2


def test_runs_of_one_name_are_distinguished():
    table, background = runs()
    records = {
        **background.records,
        "other": record("other", "/runs/a", 1_000, seed=1),
        "random": record("random", "/runs/a", 2_000, seed=1),
    }
    labels = [curve.run for curve in find_curves(table.ratings, records)]
    assert labels == ["n (seed 0)", "n (seed 1)"]


def test_each_agent_has_its_score_in_each_seat():
    head, *rows = read_page(make(EVEN)).rows["shares"]
    assert head == ["agent", "seat 0", "seat 1"]
    games = make_games(EVEN)
    for name, *cells in rows:
        for team, cell in enumerate(cells):
            own = games.agents[:, team] == NAMES.index(name)
            share, interval, number = cell.split()
            assert (float(share), int(number)) == (
                pytest.approx(100 * games.points[own, team].mean(), abs=0.05),
                own.sum(),
            )
            low, high = map(float, interval.strip("[]").split("-"))
            assert low <= float(share) <= high


def test_maps_are_a_table_where_there_are_several():
    shares = {("turtle", "hills"): Share(0.5, 0.4, 0.6, 8), ("rusher", "lake"): Share(1, 0.8, 1, 4)}
    table = make(EVEN)
    page = read_page(table, Background(map_shares=shares, map_words="Two maps."))
    rows = {row[0]: row[1:] for row in page.rows["shares"]}
    place = {name: at for at, name in enumerate(table.names)}
    assert rows["hills"][place["turtle"]] == "50.0 [40-60] 8"
    assert rows["lake"][place["rusher"]] == "100.0 [80-100] 4"
    assert rows["lake"][place["turtle"]] == ""
    assert "Two maps." in page.text["shares"]


def test_a_terminal_shows_the_tables_of_snapshots_seats_and_maps():
    table, background = runs()
    shares = {(table.names[0], "hills"): Share(0.5, 0.4, 0.6, 8)}
    report = make_report(table, dataclasses.replace(background, map_shares=shares))
    lines = render_text(report).splitlines()
    shown = [" ".join(line.split()) for line in lines]
    tables = [part for s in report.sections if s.key in ("training", "shares") for part in s.tables]
    assert len(tables) == 3
    assert {" ".join(" ".join(row).split()) for part in tables for row in part.rows} <= set(shown)
    assert max(map(len, lines)) <= LINE_WIDTH


def test_a_table_that_is_too_wide_for_a_terminal_is_named():
    wide = Table(["an agent of a long name"] * 8, [])
    assert format_table(wide) == "Too wide for a terminal: see report.md."


def test_games_are_within_the_page_and_named_in_the_markdown(tmp_path):
    path = tmp_path / "replays" / "a.html"
    path.parent.mkdir()
    path.write_text(make_element('{"title":"<b>"}'), "utf-8")
    replays = (ShownGame("Best", "a v b", path), ShownGame("Upset", "c v d", None, "It differs."))
    report = make_report(make(), Background(replays=replays, replay_words=""))
    html = render_html(report)
    assert html.count(make_element('{"title":"<b>"}')) == 1
    assert read_script() in html
    assert make_policy(read_script()) in html.replace("&#39;", "'")
    assert "It differs." in Page(html).text["replays"]
    assert "[Play Best](replays/a.html)" in render_markdown(report)


def unrated(names, games):
    table = make_table(names, games)
    assert table.ladder is None
    return table


def write_page(folder, table):
    write_report(folder, make_report(table))
    assert {path.name for path in folder.iterdir()} == set(FILES)
    return Page((folder / "report.html").read_text("utf-8"))


@pytest.mark.parametrize("num_agents", [0, 1, 3])
def test_a_league_without_games_says_so(tmp_path, num_agents):
    page = write_page(tmp_path, unrated(NAMES[:num_agents], no_games()))
    assert "there are no games to rate" in (tmp_path / "ladder.txt").read_text("utf-8")
    for key in ("matrix", "shares", "fit"):
        assert "There are no games." in page.text[key]


@pytest.mark.slow
def test_agents_that_no_games_compare_have_a_matrix_and_no_ladder(tmp_path):
    page = write_page(tmp_path, unrated(NAMES, make_games({(0, 1): 25, (2, 3): 25})))
    for text in (page.text["ladder"], (tmp_path / "ladder.txt").read_text("utf-8")):
        assert "no games compare" in text
    assert any("62.5" in cell for row in page.rows["matrix"] for cell in row)


def test_one_agent_alone_is_reported():
    games = make_games({(0, 0): 25})
    page = read_page(make_table(["a"], games))
    assert "a is the only agent" in page.text[""]
    assert "There are no two rated agents" in page.text["differences"]


def test_a_free_for_all_is_reported_by_teams():
    agents = np.array([[0, 1, 2], [1, 2, 0], [2, 0, 1]] * 8)
    ranks = np.tile([1.0, 2.0, 3.0], (24, 1))
    blocks = np.repeat(np.arange(8), 3)
    games = Games(agents, (ranks == 1.0) * 1.0, ranks, blocks, np.zeros(24, np.bool_))
    names = ["a", "b", "random"]
    page = read_page(make_table(names, games))
    assert page.rows["shares"][0] == ["agent", "team 0", "team 1", "team 2"]
    assert page.rows["shares"][1][1].split()[0] == "100.0"
    assert "ties count half" in page.text["matrix"]


@pytest.mark.slow
def test_a_report_that_fails_leaves_the_old_one_whole(tmp_path, monkeypatch):
    table = make()
    write_report(tmp_path, make_report(table))
    before = (tmp_path / "report.html").read_text("utf-8")
    report = make_report(dataclasses.replace(table, why_unrated="x"))

    def fail(self, data):
        raise OSError("disk")

    monkeypatch.setattr("pathlib.Path.write_bytes", fail)
    with pytest.raises(OSError, match="disk"):
        write_report(tmp_path, report)
    assert (tmp_path / "report.html").read_text("utf-8") == before
    assert not list(tmp_path.glob(".*"))
