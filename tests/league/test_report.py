"""The report says what is a bound, what is unsure, and what is repeated."""

import csv
import io

import numpy as np
import pytest
from PIL import Image

from marl_cair.league.ratings import rate
from marl_cair.league.report import describe_league, make_table, write_report

NAMES = ["turtle", "economist", "rusher", "random"]
EDGES = {(0, 1): 25, (0, 2): 40, (0, 3): 40, (1, 2): 40, (1, 3): 40, (2, 3): 30}


def make(results=EDGES, names=NAMES, distinct=40, draws=0):
    rows = []
    for (first, second), wins in results.items():
        scores = [1.0] * wins + [0.5] * draws + [0.0] * (40 - wins - draws)
        rows += [(first, second, game // 2, score) for game, score in enumerate(scores)]
    games = np.array(rows)
    size = len(names)
    return make_table(names, games, rate(names, games), np.full((size, size), distinct))


def read_cells(folder, name):
    return list(csv.DictReader(io.StringIO((folder / name).read_text("utf-8"))))


def test_bounds_are_marked_in_the_text():
    text = describe_league(make())
    lines = {line.split()[1]: line for line in text.splitlines()[2:7] if "---" not in line}
    assert ">=" in lines["turtle"]
    assert ">=" in lines["economist"]
    assert ">=" not in lines["random"]
    assert "nobody below it took a single point off anybody above it" in text
    assert text.isascii()  # consoles of every code page can print it


def test_a_league_without_bounds_does_not_speak_of_them():
    text = describe_league(make(dict.fromkeys(EDGES, 25)))
    assert ">=" not in text
    assert "parts groups: nobody" not in text


def test_bounds_are_marked_in_the_csv(tmp_path):
    write_report(tmp_path, make(), "")
    bounds = {row["agent"]: row["bound"] for row in read_cells(tmp_path, "ladder.csv")}
    assert bounds == {"turtle": "lower", "economist": "lower", "rusher": "", "random": ""}


def test_half_points_reach_the_intervals(tmp_path):
    table = make({(0, 1): 0}, ["a", "random"], draws=1)  # half a point in 40 games
    write_report(tmp_path, table, "")
    cells = {row["agent"]: row for row in read_cells(tmp_path, "winrates.csv")}
    assert float(cells["a"]["score"]) == 0.0125
    assert 0.0 < float(cells["a"]["low"]) < 0.0125 < float(cells["a"]["high"])
    mirrored = 1.0 - float(cells["random"]["high"])
    assert float(cells["a"]["low"]) == pytest.approx(mirrored, abs=1e-4)


def test_repeated_games_are_told():
    assert "rusher v random 2 of 40" in describe_league(make(distinct=2)).replace("\n", " ")
    assert "Games that differ" not in describe_league(make())


@pytest.mark.parametrize("results", [EDGES, dict.fromkeys(EDGES, 40)])
def test_the_pictures_are_drawn(tmp_path, results):
    write_report(tmp_path, make(results), "")
    with Image.open(tmp_path / "league.png") as picture:
        assert picture.size[0] >= 2_000
    assert (tmp_path / "league.pdf").read_bytes().startswith(b"%PDF")
    assert not list(tmp_path.glob(".*"))
