"""`marl-cair league` and `marl-cair evaluate`: output, and refusals in one line."""

import csv
import dataclasses
import json
import sqlite3
from contextlib import closing
from types import SimpleNamespace

import pytest

from marl_cair.checkpoint import DESCRIPTION_FILE
from marl_cair.cli import evaluate, league, main
from marl_cair.games import GAMES
from marl_cair.league.agents import load as agents
from marl_cair.league.agents.load import find_scenario, load_agent
from marl_cair.league.league import LeagueConfig, run_league
from tests.damage import forget_checksums
from tests.games import last_standing
from tests.league.players import GAME, save_network
from tests.refusals import assert_refused


@pytest.mark.parametrize("command", [league, evaluate])
def test_help_describes_each_option_with_its_default(command):
    parser = command.make_parser()
    text = " ".join(parser.format_help().split())
    assert "None" not in text
    for action in parser._actions:
        assert action.help, action.dest
        if action.option_strings and action.dest != "help":
            assert "default: " in action.help, action.dest
    assert "games" in text


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["league", "random", "rushr"], "nearest are 'rusher'"),
        (["league", "random", "rusher", "--seed", "-1"], "seed is -1, it must be 0 or more"),
        (["league", "random", "rusher", "--time", "0s"], "--time is '0s', it must be a number"),
        (["league", "random", "rusher", "--time", "10"], "--time is '10', it must be a number"),
        (["league", "random", "rusher", "--time", "m"], "--time is 'm', it must be a number"),
        (["league", "random", "rusher", "--workers", "0"], "workers is 0, it must be 1 or more"),
        (["league", "random", "turtle", "--games", "5"], "games_per_pair (--games) is 5"),
        (["league", "random", "turtle", "--scenario", "9x9"], "unknown deep_line_wars scenario"),
        (["league", "random", "{net}"], "unknown game 'chess'"),
        (["league", "random", "{net}", "--game", "deep_line_wars"], "was trained on chess, it"),
        (["evaluate", "rushr"], "nearest are 'rusher'"),
        (["evaluate", "turtle", "--against", "random", "random"], "random is given twice"),
        (["evaluate", "turtle", "--out", "{folder}"], "is a folder: give the name of a CSV file"),
        (["evaluate", "{net}", "--game", "deep_line_wars"], "was trained on chess"),
    ],
)
def test_bad_input_is_refused_in_one_line(tmp_path, capsys, words, message):
    net = save_network(tmp_path / "net", game="chess")
    words = [word.format(net=net, folder=tmp_path) for word in words]
    out = ["--out", str(tmp_path / "league")] if words[0] == "league" else []
    assert_refused(capsys, message, *words, *out)
    assert not (tmp_path / "league").exists()


def test_solo_agents_are_rated_by_score_and_by_the_numbers_of_the_game(tmp_path, capsys):
    table = tmp_path / "table.csv"
    words = ["deep_maze/oracle", "--against", "random", "--games", "12", "--out", str(table)]
    assert main(["evaluate", *words, "--set", "max_ticks=8"]) == 0
    with table.open(newline="") as file:
        rows = {(row["agent"], row["number"]): row for row in csv.DictReader(file)}
    numbers = ["ended", "score", "optimal_steps", "step_count", "extra_steps"]
    agents = ["deep_maze/oracle", "random"]
    assert list(rows) == [(agent, number) for agent in agents for number in numbers]
    own = {number: float(rows["deep_maze/oracle", number]["mean"]) for number in numbers}
    assert 0 < own["ended"] < 1  # some goals are more than eight moves away
    assert own["extra_steps"] == 0
    assert own["ended"] > float(rows["random", "ended"]["mean"])
    steps = rows["deep_maze/oracle", "step_count"]
    assert float(steps["median_low"]) <= float(steps["median"]) <= float(steps["median_high"]) == 8
    assert f"{own['ended']:.1%} [" in capsys.readouterr().out


def test_a_field_that_the_scenario_does_not_have_is_refused(capsys):
    assert main(["evaluate", "deep_maze/oracle", "--set", "max_tick=8"]) == 2
    assert "nearest are 'max_ticks'" in capsys.readouterr().err


def test_evaluate_plays_on_the_scenario_of_the_checkpoint(tmp_path, capsys):
    net = save_network(tmp_path / "net", max_ticks=300)
    table = tmp_path / "table.csv"
    assert main(["evaluate", net, "--games", "2", "--out", str(table)]) == 0
    assert "on deep_line_wars 11x11" in capsys.readouterr().out
    (row,) = csv.DictReader(table.read_text("utf-8").splitlines())
    assert (row["opponent"], row["games"]) == ("random", "2")
    assert float(row["low"]) <= float(row["share_won"]) <= float(row["high"])


@pytest.mark.slow
def test_an_agent_of_an_unknown_scenario_is_loaded_by_its_fields(tmp_path, capsys):
    """Another process has registered it."""
    net = save_network(tmp_path / "net", max_ticks=300)
    about = tmp_path / "net" / DESCRIPTION_FILE
    held = json.loads(about.read_text("utf-8"))
    about.write_text(json.dumps({**held, "scenario": "mine"}), "utf-8")
    forget_checksums(tmp_path)
    trained = GAME.scenario("11x11", max_ticks=300, reward=GAME.rated_reward)
    game, name, fields = find_scenario([net])
    assert game.scenario(name, **fields) == trained
    assert load_agent(net).name == "net"
    words = ["league", net, "random", "--games", "2", "--no-replays"]
    assert main([*words, "--out", str(tmp_path / "league")]) == 0
    assert "net" in capsys.readouterr().out


def test_an_agent_that_is_older_than_a_field_plays_against_newer_ones(tmp_path):
    old, new = save_network(tmp_path / "old"), save_network(tmp_path / "new")
    about = tmp_path / "old" / DESCRIPTION_FILE
    held = json.loads(about.read_text("utf-8"))
    del held["scenario_options"]["max_ticks"]
    about.write_text(json.dumps(held), "utf-8")
    forget_checksums(tmp_path)
    assert find_scenario([old, new]) == find_scenario([new])
    assert load_agent(old).name == "net"


def test_fields_that_are_lists_in_the_file_are_tuples(tmp_path, monkeypatch):
    game, name = GAMES["deep_rts"], "Teams-2v2-15x15"
    scenario = game.scenario(name, reward=game.rated_reward)
    options = json.loads(json.dumps(dataclasses.asdict(scenario)))
    about = SimpleNamespace(game="deep_rts", scenario=name, scenario_options=options)
    monkeypatch.setattr(agents, "read_description", lambda source: about)
    _, found, fields = find_scenario([str(tmp_path)])
    assert hash(game.scenario(found, **fields)) == hash(scenario)  # a list has none


@pytest.fixture(scope="module")
def bytes_league(tmp_path_factory):
    """SQLite takes bytes as a name."""
    out = tmp_path_factory.mktemp("league")
    with pytest.MonkeyPatch.context() as patch:
        last_standing.register(patch)
        bots = ("last_standing/idle", "last_standing/scorer")
        settings = {"scenario": "duel", "games_per_pair": 2, "replays": False, "out": str(out)}
        run_league(LeagueConfig(bots, game="last_standing", **settings), show_progress=False)
        with closing(sqlite3.connect(out / "league.sqlite")) as database, database:
            database.execute("UPDATE agent SET name = x'ff0061' WHERE name = 'idle'")
        yield out


@pytest.mark.slow
@pytest.mark.parametrize("command", ["report", "status"])
def test_commands_show_names_that_are_bytes(bytes_league, command, capsys):
    assert main(["league", command, str(bytes_league)]) == 0
    shown = capsys.readouterr()
    assert shown.err == ""
    text = shown.out if command == "status" else (bytes_league / "report.md").read_text("utf-8")
    assert "xff" in text


@pytest.mark.parametrize("file_format", ["csv", "json", "parquet"])
def test_exports_hold_names_that_are_bytes_as_text(bytes_league, file_format, capsys):
    assert main(["league", "export", str(bytes_league), "--format", file_format]) == 0
    if file_format == "json":
        agents = json.loads((bytes_league / "export" / "agents.json").read_text("utf-8"))
        assert r"b'\xff\x00a'" in {agent["name"] for agent in agents}
