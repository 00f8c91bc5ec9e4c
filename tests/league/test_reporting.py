"""From stored games to a report: agents of one name are told apart, and `random` stays the zero."""

import contextlib
import sqlite3

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
