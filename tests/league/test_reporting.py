"""From stored games to a report: agents of one name are told apart, and `random` stays the zero."""

import contextlib
import sqlite3
import subprocess
import sys

import pytest

from marl_cair.files import OutputFolderError
from marl_cair.league.league import LeagueConfig, play_league
from marl_cair.league.reporting import name_agents, report_stored
from marl_cair.league.store import STORE_FILE, AgentRecord


def name(*agents):
    """The names of agents (name, kind) that have the ids 1, 2, ..."""
    records = [AgentRecord(f"{n}", *about, "any", "1", "{}") for n, about in enumerate(agents)]
    return list(name_agents(dict(enumerate(records, start=1))).values())


def test_only_names_that_are_there_twice_have_ids():
    agents = [("a", "network"), ("random", "bot"), ("a", "network"), ("b", "bot")]
    assert name(*agents) == ["a (1)", "random", "a (3)", "b"]
    assert name(("a", "bot"), ("b", "bot")) == ["a", "b"]


def test_the_bot_that_is_rated_0_keeps_its_name():
    agents = [("random", "network"), ("random", "bot"), ("random", "foreign")]
    assert name(*agents) == ["random (1)", "random", "random (3)"]


def test_no_name_with_an_id_is_that_of_another():
    assert name(("a", "bot"), ("a", "network"), ("a (2)", "network")) == [
        "a (1)",
        "a (2) (2)",
        "a (2) (3)",
    ]


def test_random_is_0_among_agents_of_one_name(tmp_path):
    agents = ("random", "turtle", "rusher")
    config = LeagueConfig(agents, scenario="11x11", games_per_pair=2, out=str(tmp_path))
    play_league(config, show_progress=False)
    with contextlib.closing(sqlite3.connect(tmp_path / STORE_FILE)) as database, database:
        database.execute("UPDATE agent SET name = 'rusher' WHERE name = 'turtle'")
    result = report_stored(tmp_path, with_replays=False)
    elo = {rating.name.partition(" ")[0]: rating.elo for rating in result.ratings}
    assert sorted(elo) == ["random", "rusher"]
    assert elo["random"] == 0.0
    assert "random = 0" in result.text


HOLD = """
import sys
from marl_cair.files import locked_folder
with locked_folder(sys.argv[1]):
    print("held", flush=True)
    sys.stdin.read()
"""


def test_no_report_is_written_while_another_process_writes_there(tmp_path):
    config = LeagueConfig(
        ("random", "turtle"), scenario="11x11", games_per_pair=2, out=str(tmp_path)
    )
    play_league(config, show_progress=False)
    before = sorted(tmp_path.iterdir())
    command = [sys.executable, "-c", HOLD, str(tmp_path)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as other:
        assert other.stdout.readline() == "held\n"
        with pytest.raises(OutputFolderError, match="another process is running in the output fol"):
            report_stored(tmp_path, with_replays=False)
        assert sorted(tmp_path.iterdir()) == before
        other.stdin.close()
    report_stored(tmp_path, with_replays=False)
    assert (tmp_path / "report.html").is_file()


def test_a_league_file_alone_is_enough_for_a_report(tmp_path):
    config = LeagueConfig(
        ("random", "turtle"), scenario="11x11", games_per_pair=2, out=str(tmp_path / "a")
    )
    play_league(config, show_progress=False)
    (tmp_path / "b").mkdir()
    (tmp_path / "a" / STORE_FILE).rename(tmp_path / "b" / STORE_FILE)
    assert len(report_stored(tmp_path / "b", with_replays=False).ratings) == 2
