"""Text from outside is shown without control characters, in every kind of output."""

import csv
import io
import json
import sqlite3
import unicodedata

import pytest

from marl_cair.cli import main
from marl_cair.league.store.export import QUERIES
from marl_cair.text import clean_cell, clean_lines, clean_text
from tests.league.leagues import play_bots

HOSTILE = "\x1b[31mred\u202egnp\r\n\u200b\u2066end\x00\x9b"
CLEAN = r"\x1b[31mred\u202egnp \u200b\u2066end\x00\x9b"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("net/frames_1", "net/frames_1"),
        ("Müller 圍棋 🙂", "Müller 圍棋 🙂"),
        ("  two\n lines\t", "two lines"),
        (HOSTILE, CLEAN),
        ("a\u00adb\ufeff", r"a\xadb\ufeff"),
        ("\ud800", r"\ud800"),
        ("a\u2028b\u00a0c", "a b c"),
    ],
)
def test_text_is_one_line_of_what_can_be_seen(text, shown):
    assert clean_text(text) == shown


def test_lines_stay_lines():
    assert clean_lines("a   b\n\x1b[0m\n") == "a   b\n" + r"\x1b[0m" + "\n"


def test_numbers_and_words_stay_in_cells_and_no_cell_is_a_formula():
    for value in ("-12.5", "+3", "-inf", "1e-5", 7, -2.5, None, "plain", ""):
        assert clean_cell(value) == value
    for text in (
        "=1+1",
        "+cmd|' /C calc'!A0",
        "-2+3",
        "@SUM(A1)",
        "\t=1+1",
        "\r=1",
        "\uff1d1",
        "-",
    ):
        assert clean_cell(text).startswith("'"), text


@pytest.fixture(scope="module")
def league(tmp_path_factory):
    """A played league whose agents have hostile names, kinds and reasons."""
    folder = tmp_path_factory.mktemp("hostile") / "league"
    play_bots(folder, "random", "rusher")
    database = sqlite3.connect(folder / "league.sqlite")
    with database:
        printed = json.dumps(
            {
                "training": {
                    "run": HOSTILE,
                    "name": HOSTILE,
                    "seed": 1,
                    "frames": 5,
                    "frames_total": 5,
                }
            }
        )
        database.execute(
            "UPDATE agent SET name = ?, evaluation_policy = ?, kind = 'network', "
            "configuration = ? WHERE name = 'rusher'",
            (f"=cmd{HOSTILE}", HOSTILE, printed),
        )
        database.execute("UPDATE agent SET name = ? WHERE name = 'random'", (HOSTILE,))
        database.execute(
            "UPDATE game SET reason = ?, status = 'forfeit' WHERE id = 1", (f"@{HOSTILE}",)
        )
        database.execute("UPDATE team SET has_forfeited = 1 WHERE game = 1 AND team = 0")
        database.execute(
            "INSERT OR REPLACE INTO meta VALUES ('commands', ?)", (json.dumps([HOSTILE]),)
        )
    database.close()
    return folder


def assert_clean(text):
    bad = {c for c in text if unicodedata.category(c) in ("Cc", "Cf", "Cs") and c != "\n"}
    assert not bad


@pytest.mark.slow
@pytest.mark.parametrize("command", ["report", "status"])
def test_the_terminal_shows_names_and_reasons_clean(league, capsys, command):
    words = ["--no-replays"] if command == "report" else []
    assert main(["league", command, str(league), *words]) == 0
    printed = capsys.readouterr().out
    assert_clean(printed)
    assert CLEAN in printed


@pytest.mark.slow
def test_all_files_of_a_report_are_clean(league):
    assert main(["league", "report", str(league), "--no-replays"]) == 0
    for name in ("report.html", "report.md", "ladder.txt"):
        assert_clean((league / name).read_text("utf-8"))
    tables = sorted(league.glob("*.csv"))
    assert len(tables) == 10
    for path in tables:
        assert_cells(path.read_text("utf-8"))
    assert "'=cmd" in (league / "ladder.csv").read_text("utf-8")
    assert f"'@{CLEAN}" in (league / "forfeits.csv").read_text("utf-8")


def test_exported_tables_are_clean(league, tmp_path):
    assert main(["league", "export", str(league), "--to", str(tmp_path)]) == 0
    for name in QUERIES:
        assert_cells((tmp_path / f"{name}.csv").read_text("utf-8"))
    text = (tmp_path / "games.csv").read_text("utf-8")
    assert f"'@{CLEAN}" in text
    assert main(["league", "export", str(league), "--to", str(tmp_path), "--format", "json"]) == 0
    agents = json.loads((tmp_path / "agents.json").read_text("utf-8"))
    assert HOSTILE in [one["name"] for one in agents]  # data stays what it is


def assert_cells(text):
    assert_clean(text)
    for row in csv.reader(io.StringIO(text)):
        for cell in row:
            is_number = cell.lstrip("+-").replace(".", "").replace("e", "").isalnum()
            assert not cell.startswith(("=", "@")), cell
            assert not cell.startswith(("+", "-")) or is_number, cell


def test_errors_of_commands_are_one_clean_line(tmp_path, capsys):
    assert main(["league", "report", str(tmp_path / HOSTILE.replace("\x00", ""))]) == 2
    printed = capsys.readouterr().err
    assert_clean(printed)
    assert printed.count("\n") == 1
