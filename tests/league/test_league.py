"""Leagues: repeatable, extensible, and the same after an interruption."""

import csv
import dataclasses
import os
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from marl_cair.checkpoint import CheckpointError
from marl_cair.files import OutputFolderError
from marl_cair.league.agents.load import find_fingerprint, find_scenario, load_agent
from marl_cair.league.league import LeagueConfig, run_league
from marl_cair.league.store.store import LeagueStoreError
from tests.league import players
from tests.league.players import GAME, FailingAgent, save_network

ROOT = Path(__file__).parents[2]
TABLES = ("ladder.csv", "winrates.csv", "differences.csv", "ladder.txt")


def make_config(folder, **changes):
    config = LeagueConfig(
        ("random", "economist", "turtle"),
        scenario="11x11",
        scenario_options={"max_ticks": 800},
        games_per_pair=4,
        out=str(folder),
        replays=False,
    )
    return dataclasses.replace(config, **changes)


def play(folder, **changes):
    return run_league(make_config(folder, **changes), show_progress=False)


def read(folder):
    return [(folder / name).read_text("utf-8") for name in TABLES]


def read_games(folder):
    """All stored games by the agents' fingerprints."""
    query = (
        "SELECT b.number, g.number, trajectory, decisions, t.team, a.fingerprint, t.points "
        "FROM team t JOIN game g ON g.id = t.game JOIN block b ON b.id = g.block "
        "JOIN agent a ON a.id = t.agent ORDER BY trajectory, b.number, g.number, t.team"
    )
    # Read-only, as otherwise it is created before the league does.
    path = f"file:{folder / 'league.sqlite'}?mode=ro"
    with closing(sqlite3.connect(path, uri=True)) as database:
        return database.execute(query).fetchall()


def assert_same(one, two, note=None):
    assert read(one) == read(two), note
    assert read_games(one) == read_games(two), note


@pytest.mark.slow
def test_a_league_writes_tables_and_a_picture(tmp_path):
    result = play(tmp_path / "league")
    assert {rating.name for rating in result.ratings} == {"random", "economist", "turtle"}
    assert result.ratings[0].name == "economist"
    with (tmp_path / "league" / "winrates.csv").open() as file:
        cells = list(csv.DictReader(file))
    assert len(cells) == 6
    assert all(int(cell["games"]) == 4 for cell in cells)
    with Image.open(tmp_path / "league" / "league.png") as picture:
        width, height = picture.size
    assert width > 800
    assert height > 300
    assert "Ladder" in result.text


@pytest.mark.slow
def test_the_order_of_the_agents_changes_nothing(tmp_path):
    tables, games = set(), set()
    first = ("random", "rusher", "turtle")
    for number, agents in enumerate((first, first[::-1], first[1:] + first[:1])):
        play(tmp_path / str(number), agents=agents)
        tables.add(tuple(read(tmp_path / str(number))))
        games.add(tuple(read_games(tmp_path / str(number))))
    assert len(tables) == len(games) == 1


@pytest.mark.slow
@pytest.mark.parametrize("steps", [(4, 8), (2, 10, 20), (8, 18)])
def test_an_extended_league_is_a_fresh_one_of_its_size(tmp_path, steps):
    for games in steps:
        play(tmp_path / "extended", games_per_pair=games)
    play(tmp_path / "fresh", games_per_pair=steps[-1])
    assert_same(tmp_path / "extended", tmp_path / "fresh")


@pytest.mark.slow
def test_a_league_cut_short_shows_the_games_of_a_short_one(tmp_path):
    play(tmp_path / "a", games_per_pair=20)
    play(tmp_path / "a", games_per_pair=4)
    play(tmp_path / "b", games_per_pair=4)
    assert read(tmp_path / "a") == read(tmp_path / "b")


@pytest.mark.slow
def test_an_agent_that_joins_later_changes_no_game_of_the_others(tmp_path):
    play(tmp_path / "a", agents=("random", "turtle"))
    before = read_games(tmp_path / "a")
    play(tmp_path / "a")
    play(tmp_path / "b")
    assert set(before) < set(read_games(tmp_path / "a"))
    assert read(tmp_path / "a") == read(tmp_path / "b")


@pytest.mark.parametrize(
    "calls", [40, *(pytest.param(calls, marks=pytest.mark.slow) for calls in (0, 80))]
)
def test_an_interrupted_league_resumes_to_the_same_tables(tmp_path, calls):
    def load_failing(source, **options):
        agent = load_agent(source, **options)
        return FailingAgent(agent, calls) if source == "turtle" else agent

    with pytest.raises(players.InterruptedLeagueError):
        run_league(make_config(tmp_path / "a"), load_failing, show_progress=False)
    assert not (tmp_path / "a" / "ladder.csv").exists()
    play(tmp_path / "a")
    play(tmp_path / "b")
    assert read(tmp_path / "a") == read(tmp_path / "b")


@pytest.mark.slow
@pytest.mark.parametrize(("kills", "games"), [(2, 120), (20, 2_000)])
def test_a_league_that_is_killed_again_and_again_resumes_to_the_same_tables(tmp_path, kills, games):
    words = ["league", "random", "economist", "turtle", "--scenario", "11x11"]
    words += ["--games", str(games), "--out", str(tmp_path / "a")]
    words += ["--no-replays"] if kills < 20 else []  # the slow case may die among films too
    code = (
        "import sys; from marl_cair.cli import main; from marl_cair.league.ratings import rate; "
        f"rate.MOST_RESAMPLES = rate.LEAST_RESAMPLES; sys.exit(main({words!r}))"
    )
    moments = np.random.default_rng(time.time_ns()).uniform(0.0, 0.4, kills).tolist()
    pipes = {"stderr": subprocess.PIPE, "text": True}
    pipes["env"] = {**os.environ, "PYTHONPATH": str(ROOT)}

    def start():
        return subprocess.Popen([sys.executable, "-c", code], **pipes)

    held = 0
    for moment in moments:
        process = start()
        while process.poll() is None and _count_games(tmp_path / "a") <= held:
            time.sleep(0.005)
        time.sleep(moment)
        process.kill()
        process.communicate()
        held = _count_games(tmp_path / "a")
        assert held % 8 == 0, moments  # whole chunks
    again = start()
    _, errors = again.communicate()
    assert again.returncode == 0, (moments, errors)
    play(tmp_path / "b", games_per_pair=games, scenario_options={})
    assert_same(tmp_path / "a", tmp_path / "b", moments)


@pytest.mark.slow
@pytest.mark.parametrize("changes", [{}, {"half_width_elo": 120.0, "games_per_pair": 60}])
def test_the_number_of_workers_changes_nothing(tmp_path, changes):
    play(tmp_path / "a", workers=2, **{"games_per_pair": 40, **changes})
    play(tmp_path / "b", **{"games_per_pair": 40, **changes})
    assert_same(tmp_path / "a", tmp_path / "b")


@pytest.mark.slow
def test_an_agent_that_is_another_in_the_workers_is_refused(tmp_path):
    config = make_config(tmp_path / "a", agents=("random", "rusher", "turtle"), workers=2)
    with pytest.raises(OSError, match=r"^rusher changed while the league was starting its work"):
        run_league(config, players.load_changed, show_progress=False)
    assert read_games(tmp_path / "a") == []


def _count_games(folder):
    try:
        return len(read_games(folder)) // 2
    except sqlite3.OperationalError:  # not there yet, or without tables
        return 0


@pytest.mark.slow
def test_a_league_of_other_settings_is_not_mixed_in(tmp_path):
    play(tmp_path / "a")
    with pytest.raises(OutputFolderError, match="a league run with other settings .seed is 0"):
        play(tmp_path / "a", seed=1)
    with pytest.raises(OutputFolderError, match="scenario.max_ticks is 800 there, 500 here"):
        play(tmp_path / "a", scenario_options={"max_ticks": 500})
    play(tmp_path / "b", seed=1)
    (tmp_path / "a" / "league.sqlite").replace(tmp_path / "b" / "league.sqlite")
    with pytest.raises(LeagueStoreError, match="a league with seed = 0, this one has 1: their"):
        play(tmp_path / "b", seed=1)


def test_a_folder_of_something_else_is_refused(tmp_path):
    (tmp_path / "notes.txt").write_text("mine", "utf-8")
    with pytest.raises(OutputFolderError, match="holds files of no run"):
        play(tmp_path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"agents": ("random",)}, "a league needs two or more"),
        ({"agents": ("random", "random")}, "random is given twice"),
        ({"games_per_pair": 3}, r"games_per_pair \(--games\) is 3, it must be even"),
        ({"games_per_pair": 0}, r"games_per_pair \(--games\) is 0, it must be 1 or more"),
        ({"workers": 0}, "workers is 0, it must be 1 or more"),
        ({"half_width_elo": -5.0}, r"half_width_elo \(--ci\) is -5.0, it must be a finite number"),
        ({"max_seconds": float("nan")}, r"max_seconds \(--time\) is nan, it must be a finite"),
        ({"agents": ("random",), "ladder": ("random",)}, "random is given twice"),
        ({"agents": (), "ladder": ("random", "turtle")}, "all agents are on the ladder"),
        ({"zero": "randm"}, r"unknown agent \(--zero\) 'randm': nearest are 'random'"),
        ({"seating": "square"}, "seating is 'square', it must be one of ring, all"),
    ],
)
def test_bad_settings_are_refused(tmp_path, changes, message):
    with pytest.raises(ValueError, match=message):
        play(tmp_path / "league", **changes)


class TestCheckpoints:
    def test_one_agent_under_two_names_is_refused(self, tmp_path):
        message = "random and deep_line_wars/random are the same agent: name it once"
        with pytest.raises(ValueError, match=message):
            play(tmp_path / "league", agents=("random", "deep_line_wars/random"))
        one = save_network(tmp_path / "a" / "latest", seed=1)
        two = save_network(tmp_path / "b" / "latest", name="copy", seed=1)
        with pytest.raises(ValueError, match="are the same agent"):
            play(tmp_path / "league", agents=(one, two))

    @pytest.mark.slow
    def test_a_moved_checkpoint_keeps_its_games(self, tmp_path):
        one = save_network(tmp_path / "a" / "latest", seed=1)
        play(tmp_path / "league", agents=("random", one))
        before = read_games(tmp_path / "league")
        (tmp_path / "a").rename(tmp_path / "zz")
        moved = str(tmp_path / "zz" / "latest")
        result = play(tmp_path / "league", agents=("random", moved))
        assert {rating.name for rating in result.ratings} == {"random", "zz"}
        assert read_games(tmp_path / "league") == before

    @pytest.mark.slow
    def test_networks_and_foreign_agents_play_the_same_games_in_workers(self, tmp_path):
        networks = [save_network(tmp_path / name, seed=len(name)) for name in ("one", "three")]
        agents = ("random", "tests.league.players:make_first_legal", *networks)
        play(tmp_path / "a", agents=agents, workers=2, games_per_pair=16)
        play(tmp_path / "b", agents=agents, games_per_pair=16)
        assert_same(tmp_path / "a", tmp_path / "b")

    @pytest.mark.slow
    def test_other_weights_play_their_own_games(self, tmp_path):
        one = save_network(tmp_path / "a" / "latest", seed=1)
        play(tmp_path / "league", agents=("random", one))
        before = read_games(tmp_path / "league")
        save_network(tmp_path / "a" / "latest", seed=2)
        play(tmp_path / "league", agents=("random", one))
        assert len(read_games(tmp_path / "league")) == 2 * len(before)

    @pytest.mark.slow
    def test_a_folder_does_not_take_the_name_of_a_bot(self, tmp_path):
        one = save_network(tmp_path / "runs" / "random" / "latest")
        names = {r.name for r in play(tmp_path / "league", agents=(one, "turtle")).ratings}
        assert names == {"runs/random", "turtle"}

    def test_the_scenario_is_the_one_that_the_checkpoints_were_trained_on(self, tmp_path):
        one = save_network(tmp_path / "a", max_ticks=900, reward="shaped")
        two = save_network(tmp_path / "b", max_ticks=900)
        game, name, options = find_scenario(["random", one, two])
        assert (game.name, name) == ("deep_line_wars", "11x11")
        assert (options["max_ticks"], options["reward"]) == (900, "sparse")
        assert find_scenario([one], scenario="10x15")[1:] == ("10x15", {})

    def test_checkpoints_of_two_scenarios_are_refused(self, tmp_path):
        one = save_network(tmp_path / "a", max_ticks=900)
        two = save_network(tmp_path / "b")
        message = "max_ticks = 900, .* on max_ticks = 2500: say by --scenario what all are to play"
        with pytest.raises(CheckpointError, match=message):
            find_scenario([one, two])

    def test_a_fingerprint_is_of_weights_not_of_files(self, tmp_path):
        agents = [
            load_agent(save_network(tmp_path / name, seed=seed))
            for name, seed in (("a", 1), ("b", 1), ("c", 2))
        ]
        same, again, other = (find_fingerprint(agent, GAME) for agent in agents)
        assert same == again != other


def test_a_path_without_a_checkpoint_is_refused(tmp_path):
    with pytest.raises(CheckpointError, match="neither a folder with a checkpoint nor a bot"):
        load_agent(tmp_path / "missing" / "latest")
    with pytest.raises(CheckpointError, match=r"it holds no agent.json"):
        load_agent(tmp_path)
    (tmp_path / "weights.pt").touch()
    with pytest.raises(CheckpointError, match=r"weights.pt is a file: give the folder"):
        load_agent(tmp_path / "weights.pt")


@pytest.mark.slow
def test_networks_play_on_one_torch_thread(tmp_path):
    """Rounding depends on the number of threads."""
    seen = []

    class Noting(FailingAgent):
        def act(self, observation, action_mask):
            seen.append(torch.get_num_threads())
            return super().act(observation, action_mask)

    usual = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        run_league(
            make_config(tmp_path / "league"),
            lambda source, **options: Noting(load_agent(source, **options), 10**9),
            show_progress=False,
        )
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(usual)
    assert set(seen) == {1}
