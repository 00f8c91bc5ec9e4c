"""Games of matches and leagues are recorded as they are played, and play as without."""

import contextlib
import sqlite3
from types import SimpleNamespace

import numpy as np
import pytest

from marl_cair.games import GAMES
from marl_cair.games.replays import read_replays, replay_steps
from marl_cair.league.agents.foreign import ForeignAgent
from marl_cair.league.league import LeagueConfig, play_league
from marl_cair.league.play.match import play_match
from marl_cair.league.play.recording import Recording
from marl_cair.league.play.sequential import SequentialTest, play_sequentially
from marl_cair.league.play.solo import play_alone
from tests.games import last_standing

LINES = GAMES["deep_line_wars"]


@pytest.fixture(scope="module")
def scenario():
    return LINES.scenario("11x11", max_ticks=1_500)


def read_all(folder):
    files = sorted(folder.rglob("*.replay"))
    return [replay for path in files for replay in read_replays(path)]


def bots(scenario, *names):
    return [LINES.bot(name, scenario) for name in names]


def test_each_game_of_a_match_is_recorded(scenario, tmp_path):
    agents = bots(scenario, "random", "turtle")
    record = Recording(tmp_path, ("runs/a/latest", "turtle"))
    match = play_match(*agents, LINES, scenario, 6, 3, record=record)
    assert match == play_match(*agents, LINES, scenario, 6, 3)
    replays = read_all(tmp_path)
    assert len(replays) == 6
    for replay, result in zip(replays, match.results, strict=True):
        assert replay.is_complete
        assert replay.extra == {"block": result.block, "game": result.first_seat}
        assert replay.players.index("runs/a/latest") == result.first_seat
        assert len(replay.actions) == result.decisions
        assert (-1 if replay.winner is None else replay.winner) == result.winner
        *_, last = replay_steps(replay)  # compares all hashes
        assert last.winner[0] == result.winner
    assert len({replay.map_seed for replay in replays}) == 3
    assert min(tmp_path.iterdir()).name.startswith("runs_a_latest-v-turtle-0000-")


def test_games_of_other_scenarios_lie_beside_them(scenario, tmp_path):
    agents, record = bots(scenario, "random", "turtle"), Recording(tmp_path, ("a", "b"))
    for played in (scenario, LINES.scenario("11x11", max_ticks=300), scenario):
        play_match(*agents, LINES, played, 2, 3, record=record)
    assert len(read_all(tmp_path)) == 4


def test_the_first_blocks_alone_are_recorded(scenario, tmp_path):
    record = Recording(tmp_path, ("a", "b"), num_blocks=1)
    play_match(*bots(scenario, "random", "turtle"), LINES, scenario, 6, 3, record=record)
    assert [replay.extra["block"] for replay in read_all(tmp_path)] == [0, 0]


def test_games_for_one_and_sequential_tests_are_recorded(scenario, tmp_path):
    maze = GAMES["deep_maze"]
    chosen = maze.scenario("7x7-full_deterministic")
    record = Recording(tmp_path / "alone", ("oracle",))
    result = play_alone(maze.bot("oracle", chosen), maze, chosen, 3, 0, record=record)
    steps = [len(replay.actions) for replay in read_all(tmp_path / "alone")]
    assert steps == [game.decisions for game in result.results]
    record = Recording(tmp_path / "test", ("random", "turtle"))
    agents = tuple(bots(scenario, "random", "turtle"))
    played = play_sequentially(agents, LINES, scenario, SequentialTest(0, 400), 8, 0, record=record)
    assert len(read_all(tmp_path / "test")) >= played.match.games > 0


def give_up_in(step):
    """An agent that forfeits in its `step`-th step, from 0."""
    calls = []

    def act(observation, mask):
        calls.append(len(mask))
        return np.full(len(mask), 7 if len(calls) > step else 0)

    spec = last_standing.GAME.make_spec(last_standing.GAME.scenario("duel"))
    return ForeignAgent(SimpleNamespace(act=act), "mine", spec, "print")


def test_a_forfeited_game_has_the_winner_that_is_left(tmp_path, monkeypatch):
    game = last_standing.GAME
    last_standing.register(monkeypatch)
    idle = game.bots["idle"](None, None)
    record = Recording(tmp_path, ("mine", "idle"))
    match = play_match(give_up_in(2), idle, game, game.scenario("duel"), 2, 0, record=record)
    assert len(match.forfeits) == 2
    for replay, result in zip(read_all(tmp_path), match.results, strict=True):
        assert replay.players[replay.winner] == "idle"
        assert replay.winner == result.winner
        assert len(replay.actions) == result.decisions + 1  # with that in which it gave up
        assert sum(1 for _ in replay_steps(replay)) == len(replay.actions) + 1


@pytest.mark.parametrize("workers", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_a_league_records_the_games_that_it_plays(tmp_path, workers):
    config = LeagueConfig(
        ("random", "turtle", "rusher"),
        scenario="11x11",
        scenario_options={"max_ticks": 300},
        games_per_pair=8,
        out=str(tmp_path / "league"),
        workers=workers,
        record=str(tmp_path / "games"),
    )
    play_league(config, show_progress=False)
    replays = read_all(tmp_path / "games")
    assert len(replays) == 24
    assert {name for replay in replays for name in replay.players} == set(config.agents)
    with contextlib.closing(sqlite3.connect(tmp_path / "league" / "league.sqlite")) as database:
        decisions = [row[0] for row in database.execute("SELECT decisions FROM game")]
    assert sorted(len(replay.actions) for replay in replays) == sorted(decisions)
    for replay in replays:
        *_, last = replay_steps(replay)
        assert last.terminated[0] | last.truncated[0]
