"""Games to watch: the right ones, played again, and shown only if they are the same."""

import contextlib
import dataclasses
import itertools
import json
import re
import shutil
import sqlite3

import numpy as np
import pytest

from marl_cair.cli import main
from marl_cair.games import GAMES
from marl_cair.games.engine import BatchedEngine
from marl_cair.league.agents.load import describe_training, shorten_paths
from marl_cair.league.league import LeagueConfig, run_league
from marl_cair.league.play.playing import map_seeds
from marl_cair.league.ratings.games import Games
from marl_cair.league.ratings.rate import Rating
from marl_cair.league.report import replays
from marl_cair.league.report.background import read_background
from marl_cair.league.report.replays import FOLDER, choose_games
from marl_cair.league.report.report import report_stored
from marl_cair.league.store.schema import AgentRecord
from marl_cair.league.store.store import LeagueStore, StoredGames
from marl_cair.outside import ALLOWED
from marl_cair.viewer.page import read_game
from tests.league.players import save_network

OPTIONS = {"max_ticks": 300}  # 30 decisions


def play(folder, *agents, **changes):
    config = LeagueConfig(
        agents or ("random", "economist", "turtle"),
        scenario="11x11",
        scenario_options=OPTIONS,
        games_per_pair=8,
        out=str(folder),
        **changes,
    )
    return run_league(config, show_progress=False)


def read_page(folder):
    return (folder / "report.html").read_text("utf-8")


def shown(folder):
    return sorted((folder / FOLDER).glob("*.html"))


@pytest.fixture(scope="module")
def league(tmp_path_factory):
    folder = tmp_path_factory.mktemp("replays") / "league"
    play(folder)
    return folder


def stored(agents, ranks, decisions, reasons=None, is_repeat=None):
    """Games of two teams, one to a block."""
    number = len(agents)
    places, nothing = np.arange(number), np.zeros(number, np.bool_)
    return StoredGames(
        agents=np.array(agents),
        points=2.0 - np.array(ranks),
        ranks=np.array(ranks, float),
        blocks=places,
        numbers=places,
        turns=np.zeros(number, np.int64),
        map_seeds=places.astype(np.uint64),
        line_ups=places,
        is_repeat=nothing if is_repeat is None else np.array(is_repeat),
        is_truncated=nothing,
        has_forfeited=np.zeros((number, 2), np.bool_),
        decisions=np.array(decisions),
        reasons=tuple(reasons or [""] * number),
        trajectories=tuple(map(str, places)),
    )


RATINGS = [
    Rating(name, elo, elo, elo, 9, 0.5, "", 0)
    for name, elo in (("a", 400.0), ("b", 200.0), ("c", 0.0))
]
IDS = {7: "c", 8: "a", 9: "b"}
WON, LOST, DRAWN = (1, 2), (2, 1), (1.5, 1.5)
DIFFERS = "The replay differs from the game"


def places(games, ratings=RATINGS):
    return {choice.title: choice.place for choice in choose_games(games, IDS, ratings)}


def test_the_best_two_the_greatest_upset_and_the_longest_are_chosen():
    games = stored(
        [(7, 9), (9, 8), (8, 9), (8, 7), (9, 7), (7, 8)],
        [WON, LOST, WON, LOST, WON, DRAWN],
        [5, 5, 5, 5, 9, 8],
    )
    assert places(games) == {
        "The best two": 1,  # the first between them
        "The greatest upset": 3,  # c won against a; in game 0 against b
        "The longest game": 4,
    }
    (choice,) = [c for c in choose_games(games, IDS, RATINGS) if c.place == 3]
    assert choice.why == "c won it, to which the ratings give a chance of 9.1%."


def test_no_game_is_shown_twice_and_none_that_was_forfeited_or_repeated():
    games = stored(
        [(8, 9), (8, 9), (8, 9), (8, 9)],
        [LOST, LOST, WON, WON],
        [99, 50, 70, 60],
        ["b crashed", "", "", ""],
        [False, True, False, False],
    )
    assert places(games) == {"The best two": 2, "The longest game": 3}


def test_without_ratings_the_longest_game_is_shown():
    assert places(stored([(8, 9), (8, 7)], [WON, WON], [5, 6]), []) == {"The longest game": 1}
    assert places(stored([(8, 9)], [WON], [5], ["crashed"]), []) == {}


def change_database(folder, *statements):
    with contextlib.closing(sqlite3.connect(folder / "league.sqlite")) as database, database:
        for statement in statements:
            database.execute(statement)


def report_again(folder):
    """The page of a new report, for which no game is there."""
    for path in shown(folder):
        path.unlink()
    report_stored(folder)
    return read_page(folder)


@pytest.mark.slow
def test_the_report_of_a_league_plays_games_which_are_not_packed_again(league):
    paths = shown(league)
    assert 2 <= len(paths) <= 3
    page = read_page(league)
    games = re.findall(r'<script type="application/json">(.*?)</script>', page)
    assert sorted(games) == sorted(read_game(path) for path in paths)
    for game in map(json.loads, games):
        assert game["steps"] > 5
        assert [view["seat"] for view in game["views"]] == [None, 0, 1]
    markdown = (league / "report.md").read_text("utf-8")
    assert all(f"({FOLDER}/{path.name})" in markdown for path in paths)
    before = [path.stat().st_mtime_ns for path in paths]
    report_stored(league)
    assert [path.stat().st_mtime_ns for path in shown(league)] == before
    assert read_page(league) == page


@pytest.mark.slow
def test_a_damaged_page_of_a_game_is_packed_again(league, tmp_path):
    shutil.copytree(league, tmp_path / "league")
    page, path = read_page(league), shown(tmp_path / "league")[0]
    path.write_text("<script>alert(1)</script>", "utf-8")
    report_stored(tmp_path / "league")
    assert read_page(tmp_path / "league") == page
    assert path.read_bytes() == shown(league)[0].read_bytes()


@pytest.mark.slow
def test_a_replay_that_differs_from_the_game_is_noted_and_not_shown(tmp_path):
    play(tmp_path, "random", "turtle", replays=False)
    assert "were left out (--no-replays)" in read_page(tmp_path)
    change_database(tmp_path, "UPDATE game SET trajectory = 'other ' || id")
    for _ in range(2):  # the second time it is not played
        assert DIFFERS in report_again(tmp_path)
        assert shown(tmp_path) == []
    assert list((tmp_path / FOLDER).glob("*.differs"))


@pytest.mark.slow
def test_a_network_is_shown_while_it_is_the_same(tmp_path):
    net, out = save_network(tmp_path / "run" / "latest"), tmp_path / "league"
    play(out, net, "turtle")
    games = [json.loads(read_game(path)) for path in shown(out)]
    assert {tuple(one["name"] for one in game["values"]) for game in games} == {("action values",)}
    assert DIFFERS not in read_page(out)
    save_network(tmp_path / "run" / "latest", seed=1)
    assert "run is no longer the agent that has played." in report_again(out)
    (tmp_path / "run" / "latest" / "weights.pt").unlink()
    assert "run cannot be loaded any more" in report_again(out)
    assert shown(out) == []


@pytest.mark.slow
def test_foreign_code_runs_where_games_are_played_and_not_in_a_report(tmp_path, monkeypatch):
    play(tmp_path, "tests.league.players:make_first_legal", "turtle")
    assert shown(tmp_path)
    monkeypatch.setenv(ALLOWED, "")  # as in another process
    assert "is foreign code" in report_again(tmp_path)
    assert shown(tmp_path) == []


@pytest.mark.slow
def test_the_command_leaves_replays_out_and_stands_in_the_settings(tmp_path, capsys):
    words = ["league", "random", "turtle", "--scenario", "11x11", "--games", "8", "--no-replays"]
    assert main([*words, "--out", str(tmp_path)]) == 0
    assert str(tmp_path / "report.html") in capsys.readouterr().out
    assert not (tmp_path / FOLDER).exists()
    page = read_page(tmp_path)
    assert "marl-cair league random turtle --scenario 11x11 --games 8 --no-replays" in page
    assert "League seed" in page
    assert main(["league", "report", str(tmp_path), "--no-replays"]) == 0
    assert read_page(tmp_path) == page


@pytest.mark.slow
def test_a_league_without_games_has_a_report(tmp_path):
    play(tmp_path, "random", "turtle", replays=False)
    change_database(tmp_path, "DELETE FROM team", "DELETE FROM game", "DELETE FROM block")
    result = report_stored(tmp_path)
    assert result.ratings == ()
    assert "there are no games to rate" in result.text
    assert "There is no finished game to show" in read_page(tmp_path)


@pytest.mark.slow
def test_games_that_are_too_large_have_fewer_pictures(league, tmp_path, monkeypatch):
    monkeypatch.setattr(replays, "MAX_BYTES", 40_000)
    shutil.copytree(league, tmp_path / "league")
    report_again(tmp_path / "league")
    assert shown(tmp_path / "league")
    sizes = [len(read_game(path)) for path in shown(tmp_path / "league")]
    assert max(sizes) <= 40_000 < max(len(read_game(path)) for path in shown(league))


@pytest.mark.slow
def test_a_game_too_long_for_the_memory_is_not_shown(league, tmp_path, monkeypatch):
    monkeypatch.setattr(replays, "MAX_ACTION_BYTES", 64)
    shutil.copytree(league, tmp_path / "league")
    assert "too long to be shown" in report_again(tmp_path / "league")
    assert shown(tmp_path / "league") == []


def test_snapshots_know_their_run_and_their_age(tmp_path):
    for shelf in ("snapshots/frames_01", "latest"):
        folder = tmp_path / "run" / shelf
        save_network(folder, name="run@5" if "frames" in shelf else "run")
        about = describe_training(folder)
        assert about == {
            "run": str(tmp_path / "run"),
            "name": "run",
            "seed": 0,
            "frames": 0,
            "frames_total": 0,
        }
    player = tmp_path / "shared" / "players" / "main_0-001-0000000007"
    save_network(player)
    assert describe_training(player)["name"] == "main_0-001"
    assert describe_training(tmp_path / "nothing") == {}


def test_paths_are_as_short_as_they_can_be():
    paths = ["/x/a/latest", "/x/b/latest", "/y/a/latest"]
    assert list(shorten_paths(paths).values()) == ["x/a", "x/b", "y/a"]
    assert shorten_paths(["/x/rusher"], ["rusher"]) == {"/x/rusher": "x/rusher"}
    ages = ["/x/a/latest", "/x/a/snapshots/frames_1", "/x/b/snapshots/frames_1"]
    assert list(shorten_paths(ages).values()) == ["a", "a/frames_1", "b/frames_1"]


def test_the_maps_of_games_are_those_of_their_seeds(tmp_path):
    game = GAMES["deep_rts"]
    scenario = game.scenario("1v1-15x15", map="train-10x10-2p")
    settings = {"game": game.name, "game_version": game.version, "seed": 5, "seating": "all"}
    settings |= {"scenario": dataclasses.asdict(scenario), "team_of_seat": [0, 1]}
    store = LeagueStore(tmp_path / "league.sqlite", settings)
    records = [AgentRecord(name, name, "bot", "scripted", "1", "{}") for name in "ab"]
    ids = [store.add_agent(one) for one in records]
    seeds = map_seeds(5, np.array([0, 1, 2, 3, 0, 1]))
    played = stored([ids] * 6, [WON] * 6, [5] * 6)
    played = StoredGames(**{**vars(played), "map_seeds": seeds})
    games = Games(
        np.array([[0, 1]] * 6), played.points, played.ranks, played.blocks, np.zeros(6, bool)
    )
    background = read_background(store, played, dict(zip(ids, "ab", strict=True)), games, (), "")
    store.close()
    engine = BatchedEngine(game, scenario, 6)
    engine.reset(seeds)
    boards = [engine.render(world).tobytes() for world in range(6)]
    names = engine.map_names()
    assert len(set(names)) > 1
    for one, two in itertools.combinations(range(6), 2):
        assert (names[one] == names[two]) == (boards[one] == boards[two])
    counts = {key: share.games for key, share in background.map_shares.items()}
    assert counts == {(agent, name): names.count(name) for agent in "ab" for name in names}
    assert f"on {len(set(names))} maps" in background.map_words
    assert background.map_shares["a", names[0]].share == 1.0


def test_a_game_without_maps_by_name_says_so(league):
    assert "Deep Line Wars has no named maps" in read_page(league)
