"""Names that are bytes in a league file: SQLite takes them, and each command shows them as text."""

import json
import sqlite3
from contextlib import closing

import pytest

from marl_cair.cli import main
from marl_cair.league.league import LeagueConfig, run_league
from tests.games import last_standing


@pytest.fixture(scope="module")
def league(tmp_path_factory):
    out = tmp_path_factory.mktemp("league")
    with pytest.MonkeyPatch.context() as patch:
        last_standing.register(patch)
        bots = ("last_standing/idle", "last_standing/scorer")
        settings = {"scenario": "duel", "games_per_pair": 2, "replays": False, "out": str(out)}
        run_league(LeagueConfig(bots, game="last_standing", **settings), show_progress=False)
        with closing(sqlite3.connect(out / "league.sqlite")) as database, database:
            database.execute("UPDATE agent SET name = x'ff0061' WHERE name = 'idle'")
        yield out


@pytest.mark.parametrize("command", ["report", "status"])
def test_commands_show_them(league, command, capsys):
    assert main(["league", command, str(league)]) == 0
    told = capsys.readouterr()
    assert told.err == ""
    text = told.out if command == "status" else (league / "report.md").read_text("utf-8")
    assert "xff" in text


@pytest.mark.parametrize("file_format", ["csv", "json", "parquet"])
def test_exports_hold_them_as_text(league, file_format, capsys):
    assert main(["league", "export", str(league), "--format", file_format]) == 0
    if file_format == "json":
        agents = json.loads((league / "export" / "agents.json").read_text("utf-8"))
        assert r"b'\xff\x00a'" in {agent["name"] for agent in agents}
