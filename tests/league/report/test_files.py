"""Bounds, open intervals, repeats and forfeits are in the text and in the CSV files."""

import csv
import dataclasses
import io

import pytest
from PIL import Image

from marl_cair.league.ratings.fit import check_fit
from marl_cair.league.report.files import write_report
from marl_cair.league.report.render import render_text
from marl_cair.league.report.sections import make_report
from marl_cair.league.report.table import make_table
from marl_cair.league.report.wording import describe_fit
from tests.league.leagues import EDGES, NAMES, make
from tests.league.paper_games import from_rows, simulate


def describe_league(table):
    return " ".join(render_text(make_report(table)).split())


def read_cells(folder, name):
    return list(csv.DictReader(io.StringIO((folder / name).read_text("utf-8"))))


def test_bounds_are_marked_in_the_text():
    text = render_text(make_report(make()))
    ladder = text[text.index("   agent") : text.index("Differences")].splitlines()
    lines = {line.split()[1]: line for line in ladder if line[:1].isdigit()}
    assert "<= " in lines["rusher"]
    assert "<= " in lines["random"]
    assert "<=" not in lines["turtle"]
    assert text.isascii()  # consoles of every code page can print it


def test_a_league_without_bounds_does_not_explain_them():
    assert "<=" not in describe_league(make(dict.fromkeys(EDGES, 25)))


@pytest.mark.slow
def test_half_points_reach_the_intervals(tmp_path):
    table = make({(0, 1): 0}, ["a", "random"], draws=1)  # half a point in 40 games
    write_report(tmp_path, make_report(table))
    cells = {row["agent"]: row for row in read_cells(tmp_path, "winrates.csv")}
    assert float(cells["a"]["score"]) == 0.0125
    assert 0.0 < float(cells["a"]["low"]) < 0.0125 < float(cells["a"]["high"])
    mirrored = 1.0 - float(cells["random"]["high"])
    assert float(cells["a"]["low"]) == pytest.approx(mirrored, abs=1e-4)


@pytest.mark.slow
def test_wins_draws_and_losses_of_each_pair_are_written(tmp_path):
    table = make({(0, 1): 25, (0, 2): 30, (1, 2): 0}, ["a", "b", "random"], draws=3)
    write_report(tmp_path, make_report(table))
    rows = {(r["agent"], r["opponent"]): r for r in read_cells(tmp_path, "winrates.csv")}
    found = {
        pair: [int(row[name]) for name in ("wins", "draws", "losses", "games")]
        for pair, row in rows.items()
    }
    assert found["a", "b"] == [25, 3, 12, 40]
    assert found["b", "a"] == [12, 3, 25, 40]
    assert found["b", "random"] == [0, 3, 37, 40]


def test_repeated_games_are_listed():
    text = describe_league(make(dict.fromkeys(EDGES, 25), repeats=6))
    assert "rusher v random 6 of 40" in text


def test_forfeits_are_listed_with_their_reasons():
    text = describe_league(make(forfeits=((NAMES[0], "mine crashed in act: KeyError: 3", 4),)))
    assert f"{NAMES[0]} mine crashed in act: KeyError: 3 4" in text
    assert f"{NAMES[0]} forfeited 4 of its 120 games" in text
    assert "forfeited" not in describe_league(make())


def test_differences_are_described():
    text = describe_league(make({**dict.fromkeys(EDGES, 30), (0, 1): 20}))
    assert "do not differ significantly: +0 [-" in text
    assert "is stronger than rusher: +" in text


def test_a_cycle_is_described():
    surplus = [[0.0, 9.0, -2.0], [-9.0, 0.0, 9.0], [2.0, -9.0, 0.0]]
    games = simulate([0.0] * 3, 20, seed=0, surplus=surplus)
    table = make_table(["paper", "rock", "scissors"], games)
    assert table.cycles == (("paper", "rock", "scissors", 0.825),)
    assert table.fit.p_value == pytest.approx(1 / 300)
    text = describe_league(table)
    assert "p < 0.004" in text
    assert "paper beats rock, rock beats scissors, and scissors beats paper" in text
    assert "82%" in text
    teams = dataclasses.replace(table, num_teams=4)
    assert "paper comes in above rock" in describe_league(teams)


def test_few_games_do_not_decide():
    few = check_fit(4, simulate([0.0, 0.2, 0.5, 1.0], 2, seed=0))
    assert "too few games" in describe_fit(few)
    many = describe_fit(dataclasses.replace(few, p_value=0.4, power=0.95))
    assert "p = 0.400" in many
    assert "95%" in many


@pytest.mark.slow
def test_a_clean_sweep_of_one_map_seed_is_not_significant(tmp_path):
    games = from_rows([(0, 1, 0, 1.0), (1, 0, 0, 0.0)])
    table = make_table(["a", "b"], games)
    assert "a and b do not differ significantly: -291 or more" in describe_league(table)
    assert "strongest" not in make_report(table).headline
    write_report(tmp_path, make_report(table))
    bounds = {row["agent"]: row["bound"] for row in read_cells(tmp_path, "differences.csv")}
    assert bounds == {"a": "lower", "b": "upper"}


@pytest.mark.slow
def test_bounds_and_differences_of_all_pairs_are_written(tmp_path):
    write_report(tmp_path, make_report(make()))
    bounds = {row["agent"]: row["bound"] for row in read_cells(tmp_path, "ladder.csv")}
    assert bounds == {"turtle": "", "economist": "", "rusher": "upper", "random": "upper"}
    rows = {(r["agent"], r["opponent"]): r for r in read_cells(tmp_path, "differences.csv")}
    assert len(rows) == 12
    assert rows["turtle", "random"]["bound"] == "lower"
    assert rows["random", "turtle"]["bound"] == "upper"
    assert float(rows["turtle", "economist"]["elo"]) == -float(rows["economist", "turtle"]["elo"])


def test_no_number_of_the_report_is_infinite():
    table = make({(0, 1): 39, (0, 2): 40, (1, 2): 20}, ["a", "b", "random"])
    text = describe_league(table)
    assert "inf" not in text
    assert ">+" in text  # an end that only the prior holds


LONG = ["process:" + "python3 bots/a.py " * 9, "b" * 60, "c", "random"]


@pytest.mark.slow
@pytest.mark.parametrize(("number", "wins"), [(2, 25), (4, 25), (4, 40)])
def test_the_pictures_of_agents_with_long_names_are_drawn(tmp_path, number, wins):
    pairs = {pair: wins for pair in EDGES if max(pair) < number}
    write_report(tmp_path, make_report(make(pairs, LONG[:number])))
    with Image.open(tmp_path / "league.png") as picture:
        assert picture.size[0] >= 2_000
    assert (tmp_path / "league.pdf").read_bytes().startswith(b"%PDF")
    assert not list(tmp_path.glob(".*"))
