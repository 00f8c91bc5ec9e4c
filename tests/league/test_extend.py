"""`marl-cair league add`: new agents meet those of a league, which do not play each other again."""

import csv
import dataclasses
import sqlite3
from contextlib import closing

import pytest

from marl_cair.cli import main
from marl_cair.cli.league_members import make_add_parser
from marl_cair.league.extend import plan_extension
from marl_cair.league.league import LeagueConfig, play_league
from marl_cair.league.store.store import STORE_FILE, LeagueStore, LeagueStoreError
from tests.games import last_standing
from tests.league.leagues import count_games
from tests.league.players import GAME, save_network


@pytest.fixture(scope="module")
def league(tmp_path_factory):
    folder = tmp_path_factory.mktemp("extend") / "league"
    words = ["random", "turtle", "--scenario", "11x11", "--games", "4", "--seed", "3"]
    words += ["--set", "max_ticks=40"]
    assert main(["league", *words, "--out", str(folder)]) == 0
    return folder


def list_names(folder):
    with closing(LeagueStore(folder / STORE_FILE)) as store:
        return sorted(agent.name for agent in store.read_agents().values())


def test_the_file_has_all_settings(league):
    plan = plan_extension(league, ["rusher"])
    assert (plan.agents, set(plan.ladder)) == (("rusher",), {"random", "turtle"})
    assert (plan.seed, plan.games_per_pair, plan.seating) == (3, 8, "all")  # chunks are whole
    scenario = GAME.scenario("11x11", reward=GAME.rated_reward, max_ticks=40)
    assert plan.scenario_options == dataclasses.asdict(scenario)


def test_games_per_pair_count_pairs_and_not_line_ups(tmp_path, monkeypatch):
    last_standing.register(monkeypatch)
    config = LeagueConfig(
        agents=("random", "finisher", "idle", "quitter"),
        game=last_standing.NAME,
        scenario="ffa-3",
        games_per_pair=24,
        out=str(tmp_path),
        replays=False,
    )
    play_league(config, show_progress=False)
    # Each of the four line-ups has 12 games, each pair is in two of them.
    assert plan_extension(tmp_path, ["scorer"]).games_per_pair == 24


@pytest.mark.slow
def test_a_league_resumes_with_another_limit(tmp_path):
    """A function has the same fingerprint with and without a limit."""
    source = "tests.league.players:make_first_legal"
    words = ["random", source, "--scenario", "11x11", "--games", "2", "--no-replays"]
    out = ["--out", str(tmp_path)]
    assert main(["league", *words, *out, "--answer-seconds", "0"]) == 0
    before = count_games(tmp_path), list_names(tmp_path)
    assert main(["league", *words, *out]) == 0
    assert (count_games(tmp_path), list_names(tmp_path)) == before
    allowed = frozenset({source})
    assert source in plan_extension(tmp_path, ["turtle"], allow_code=allowed).ladder


@pytest.mark.slow
def test_a_new_agent_meets_all_others(league, capsys):
    before = count_games(league)
    assert main(["league", "add", "economist", "--games", "4", "--out", str(league)]) == 0
    assert list_names(league) == ["economist", "random", "turtle"]
    assert count_games(league) == before + 2 * 8
    assert "economist" in capsys.readouterr().out


def test_an_agent_needs_others_to_meet(league, capsys):
    assert main(["league", "add", *list_names(league), "--out", str(league)]) == 2
    assert "are given, so there is none to meet" in capsys.readouterr().err


@pytest.mark.slow
def test_a_new_agent_is_rated_as_narrowly_as_asked(tmp_path, capsys):
    words = ["random", "turtle", "--scenario", "11x11", "--games", "40", "--set", "max_ticks=200"]
    assert main(["league", *words, "--out", str(tmp_path), "--no-replays"]) == 0
    added = ["league", "add", "rusher", "--out", str(tmp_path), "--no-replays"]
    assert main([*added, "--ci", "150", "--zero", "random"]) == 0
    assert "All intervals are within 150 Elo either way (--ci)" in capsys.readouterr().out
    ladder = csv.DictReader((tmp_path / "ladder.csv").read_text("utf-8").splitlines())
    (zero,) = (row for row in ladder if row["agent"] == "random")
    assert float(zero["elo"]) == 0
    assert main([*added, "--games", "0"]) == 2
    assert "it must be 1 or more" in capsys.readouterr().err


@pytest.mark.slow
def test_an_agent_that_has_begun_plays_on(tmp_path):
    """`league add` was interrupted, or is to have more games."""
    words = ["random", "turtle", "--scenario", "11x11", "--games", "4", "--set", "max_ticks=40"]
    assert main(["league", *words, "--out", str(tmp_path)]) == 0
    added = ["league", "add", "rusher", "--out", str(tmp_path), "--games"]
    assert main([*added, "8"]) == 0
    before = count_games(tmp_path)
    assert main([*added, "8"]) == 0
    assert count_games(tmp_path) == before
    assert main([*added, "16"]) == 0
    assert count_games(tmp_path) == before + 2 * 8
    assert list_names(tmp_path) == ["random", "rusher", "turtle"]


@pytest.mark.slow
def test_an_agent_that_has_changed_is_refused(tmp_path):
    net = save_network(tmp_path / "net", seed=0)
    words = ["random", net, "--games", "2", "--out", str(tmp_path / "league")]
    assert main(["league", *words]) == 0
    assert plan_extension(tmp_path / "league", ["turtle"]).ladder.count(net) == 1
    save_network(tmp_path / "net", seed=1)
    with pytest.raises(LeagueStoreError, match="no longer the agent that has played") as refused:
        plan_extension(tmp_path / "league", ["turtle"])
    assert f"`marl-cair league AGENT AGENT ... --out {tmp_path / 'league'}`" in str(refused.value)
    # That adds the agent that is there now, with the same name.
    assert main(["league", "turtle", *words]) == 0
    assert list_names(tmp_path / "league").count("net") == 2


def test_a_league_without_sources_is_refused(league, tmp_path):
    with closing(sqlite3.connect(league / STORE_FILE)) as old:
        old.execute("VACUUM INTO ?", (str(tmp_path / STORE_FILE),))
    with closing(sqlite3.connect(tmp_path / STORE_FILE)) as new, new:
        new.execute("UPDATE agent SET configuration = '{}'")
    with pytest.raises(LeagueStoreError, match="does not say where .* is from"):
        plan_extension(tmp_path, ["rusher"])


def test_no_league_is_refused(tmp_path, capsys):
    assert main(["league", "add", "random", "--out", str(tmp_path)]) == 2
    assert "is not there" in capsys.readouterr().err


def test_help_describes_each_option_with_its_default():
    for action in make_add_parser()._actions:
        assert action.help
        if action.option_strings and action.dest != "help":
            assert "default: " in action.help
