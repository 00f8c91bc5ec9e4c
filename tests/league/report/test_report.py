"""From stored games to a report: names, the zero, locks; numbers do not depend on names."""

import contextlib
import dataclasses
import sqlite3
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from marl_cair.files import OutputFolderError
from marl_cair.games import GAMES
from marl_cair.league.league import LeagueConfig, _short_names, play_league, run_league
from marl_cair.league.report.report import _count_forfeits, name_agents, report_stored
from marl_cair.league.store.schema import AgentRecord
from marl_cair.league.store.store import STORE_FILE

GAME = GAMES["deep_line_wars"]


def name(*agents):
    """The names of agents (name, kind) that have the ids 1, 2, ..."""
    records = [AgentRecord(f"{n}", *about, "any", "1", "{}") for n, about in enumerate(agents)]
    return list(name_agents(dict(enumerate(records, start=1))).values())


@pytest.mark.parametrize(
    ("agents", "names"),
    [
        ("a network, random bot, a network, b bot", ["a (1)", "random", "a (3)", "b"]),
        ("random network, random bot, random foreign", ["random (1)", "random", "random (3)"]),
    ],
)
def test_agents_of_one_name_have_ids_beside_it_but_for_a_bot(agents, names):
    assert name(*(agent.split() for agent in agents.split(", "))) == names


def test_no_name_with_an_id_is_that_of_another():
    agents = [("a", "bot"), ("a", "network"), ("a (2)", "network")]
    assert name(*agents) == ["a", "a (2) (2)", "a (2) (3)"]


def test_forfeits_are_counted_once_for_each_agent_of_a_game():
    """A game has one reason; an agent may hold several seats, and several may fail at once."""
    games = SimpleNamespace(
        agents=np.array([[7, 8, 7], [8, 7, 7], [8, 7, 7], [7, 8, 7]]),
        has_forfeited=np.array([[True, False, True], [True, True, False], [False] * 3, [True] * 3]),
        reasons=("a crashed", "b was late", "", "a crashed"),
    )
    assert _count_forfeits(games, {7: "a", 8: "b"}) == [
        ("a", "a crashed", 2),
        ("a", "in the same step as b", 1),
        ("b", "b was late", 1),
        ("b", "in the same step as a", 1),
    ]


@pytest.mark.slow
def test_no_number_depends_on_what_agents_are_called(tmp_path):
    """Resampled by name, intervals of three of these four moved by up to 20 Elo."""
    agents = ("random", "turtle", "rusher", "economist")
    config = LeagueConfig(agents, scenario="11x11", games_per_pair=8, out=str(tmp_path))
    played = run_league(config, show_progress=False)
    new = {"random": "z", "turtle": "a", "rusher": "m", "economist": "random"}
    with contextlib.closing(sqlite3.connect(tmp_path / STORE_FILE)) as database, database:
        for fingerprint, name in database.execute("SELECT fingerprint, name FROM agent").fetchall():
            database.execute(
                "UPDATE agent SET name = ? WHERE fingerprint = ?", (new[name], fingerprint)
            )
    renamed = report_stored(tmp_path, with_replays=False)
    rows = {new[r.name]: dataclasses.replace(r, name=new[r.name]) for r in played.ratings}
    assert rows == {r.name: r for r in renamed.ratings}
    files = [tmp_path / "fit.csv", tmp_path / "averages.csv"]
    before = [path.read_text("utf-8") for path in files]
    run_league(config, show_progress=False)
    after = [path.read_text("utf-8") for path in files]
    assert before[0] == after[0]
    numbers = [[line.split(",")[2:] for line in text.split()] for text in (before[1], after[1])]
    assert numbers[0] == numbers[1]


def test_a_bot_and_a_command_of_its_name_are_distinguished(tmp_path):
    command = f"process:{sys.executable} tests/league/process_bot.py"
    assert _short_names(("rusher", "process:rusher"), GAME) == ["rusher", "process:rusher"]
    assert _short_names(("process:rusher", "turtle"), GAME) == ["process:rusher", "turtle"]
    assert _short_names(("deep_line_wars/rusher", "process:x"), GAME) == ["rusher", "x"]
    assert _short_names((command,), GAME) == [command.removeprefix("process:")]


@pytest.mark.slow
def test_the_zero_that_is_named_is_shown_and_one_that_is_not_there_is_refused(tmp_path):
    agents = ("rusher", "turtle", "economist")
    config = LeagueConfig(agents, scenario="11x11", games_per_pair=16, out=str(tmp_path))
    play_league(config, show_progress=False)
    with pytest.raises(ValueError, match="--zero is 'rushr', the league has no such agent: give"):
        report_stored(tmp_path, with_replays=False, zero="rushr")
    text = report_stored(tmp_path, with_replays=False, zero="rusher").text
    ratings = report_stored(tmp_path, with_replays=False).ratings
    limited = [r.name for r in ratings if not r.is_bound]
    assert ("Elo (rusher = 0)" in text) == ("rusher" in limited and len(limited) > 1)


HOLD = """
import sys
from marl_cair.files import locked_folder
with locked_folder(sys.argv[1]):
    print("held", flush=True)
    sys.stdin.read()
"""


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_league_file_alone_is_enough_for_a_report(tmp_path):
    config = LeagueConfig(
        ("random", "turtle"), scenario="11x11", games_per_pair=2, out=str(tmp_path / "a")
    )
    play_league(config, show_progress=False)
    (tmp_path / "b").mkdir()
    (tmp_path / "a" / STORE_FILE).rename(tmp_path / "b" / STORE_FILE)
    assert len(report_stored(tmp_path / "b", with_replays=False).ratings) == 2
