"""Matches and leagues: balanced, repeatable, and none the worse for an interruption."""

import csv
import dataclasses

import numpy as np
import pytest
from PIL import Image

from marl_cair.checkpoint import CheckpointError
from marl_cair.games import GAMES
from marl_cair.league.agents import load_agent
from marl_cair.league.film import save_film
from marl_cair.league.league import LeagueConfig, run_league
from marl_cair.league.match import play_match, record_game
from marl_cair.league.store import LeagueStoreError
from marl_cair.lookup import UnknownNameError

GAME = GAMES["deep_line_wars"]
SHORT = {"max_ticks": 1_500}


@pytest.fixture(scope="module")
def scenario():
    return GAME.scenario("11x11", **SHORT)


def bot(name, scenario):
    return GAME.bot(name, scenario)


def test_the_same_seed_gives_the_same_match(scenario):
    matches = [
        play_match(bot("random", scenario), bot("rusher", scenario), GAME, scenario, 8, 3)
        for _ in range(2)
    ]
    assert matches[0] == matches[1]
    assert matches[0].distinct_games == 8


def test_another_seed_gives_another_match(scenario):
    matches = [
        play_match(bot("random", scenario), bot("rusher", scenario), GAME, scenario, 8, seed)
        for seed in (3, 4)
    ]
    assert matches[0] != matches[1]


def test_each_seed_is_played_once_in_each_seat(scenario):
    match = play_match(bot("random", scenario), bot("turtle", scenario), GAME, scenario, 6, 0)
    assert [(r.block, r.first_seat) for r in match.results] == [
        (0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1),
    ]  # fmt: skip
    assert match.wins + match.draws + match.losses == match.games == 6


def test_an_odd_number_of_games_is_refused(scenario):
    with pytest.raises(ValueError, match="num_games is 5, it must be even"):
        play_match(bot("random", scenario), bot("turtle", scenario), GAME, scenario, 5, 0)


def test_a_recorded_game_replays_to_the_same_end(scenario):
    actions = record_game(bot("economist", scenario), bot("random", scenario), GAME, scenario, 7)
    again = record_game(bot("economist", scenario), bot("random", scenario), GAME, scenario, 7)
    assert np.array_equal(actions, again)
    assert actions.shape[1] == 2


def make_config(folder, **changes):
    config = LeagueConfig(
        ("random", "economist", "turtle"), scenario="11x11", games_per_pair=4, out=str(folder)
    )
    return dataclasses.replace(config, **changes)


def read(folder, name):
    return (folder / name).read_text("utf-8")


def test_a_league_writes_tables_and_a_picture(tmp_path):
    result = run_league(make_config(tmp_path / "league"), show_progress=False)
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


def test_the_order_of_the_agents_changes_nothing(tmp_path):
    run_league(make_config(tmp_path / "a"), show_progress=False)
    turned = ("turtle", "random", "economist")
    run_league(make_config(tmp_path / "b", agents=turned), show_progress=False)
    for name in ("ladder.csv", "winrates.csv", "ladder.txt"):
        assert read(tmp_path / "a", name) == read(tmp_path / "b", name)


class InterruptedLeagueError(Exception):
    """Stands for a kill between two matches."""


class FailingAgent:
    """Plays as the agent it wraps until it has been seeded `matches` times."""

    def __init__(self, agent, matches):
        self.agent, self.left = agent, matches
        self.name, self.representation = agent.name, agent.representation

    def seed(self, seed):
        self.left -= 1
        if self.left < 0:
            raise InterruptedLeagueError
        self.agent.seed(seed)

    def act(self, observation, action_mask):
        return self.agent.act(observation, action_mask)


def test_an_interrupted_league_goes_on_to_the_same_tables(tmp_path):
    def load_failing(source, **options):
        agent = load_agent(source, **options)
        return FailingAgent(agent, 1) if source == "turtle" else agent

    with pytest.raises(InterruptedLeagueError):
        run_league(make_config(tmp_path / "a"), load_failing, show_progress=False)
    assert not (tmp_path / "a" / "ladder.csv").exists()
    run_league(make_config(tmp_path / "a"), show_progress=False)
    run_league(make_config(tmp_path / "b"), show_progress=False)
    assert read(tmp_path / "a", "ladder.csv") == read(tmp_path / "b", "ladder.csv")


def test_a_league_of_other_settings_is_not_mixed_in(tmp_path):
    run_league(make_config(tmp_path / "a"), show_progress=False)
    with pytest.raises(ValueError, match="holds league run"):
        run_league(make_config(tmp_path / "a", seed=1), show_progress=False)


def test_a_damaged_league_file_is_named(tmp_path):
    run_league(make_config(tmp_path / "a"), show_progress=False)
    (tmp_path / "a" / "league.sqlite").write_bytes(b"no database" * 1_000)
    for leftover in (tmp_path / "a").glob("league.sqlite-*"):
        leftover.unlink()
    with pytest.raises(LeagueStoreError, match="is no league file, or is damaged"):
        run_league(make_config(tmp_path / "a"), show_progress=False)


def test_an_unknown_agent_stops_the_league_before_any_game(tmp_path):
    with pytest.raises(UnknownNameError, match="'rushr': nearest are 'rusher'"):
        run_league(make_config(tmp_path / "a", agents=("random", "rushr")), show_progress=False)
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"agents": ("random",)}, "a league needs two or more"),
        ({"agents": ("random", "random")}, "random is given twice"),
        ({"games_per_pair": 3}, "games_per_pair is 3, it must be even"),
    ],
)
def test_bad_settings_are_refused(tmp_path, changes, message):
    with pytest.raises(ValueError, match=message):
        make_config(tmp_path, **changes)


def test_a_path_without_a_checkpoint_is_refused(tmp_path):
    with pytest.raises(CheckpointError, match="neither a folder with a checkpoint nor a bot"):
        load_agent(tmp_path / "missing" / "latest")
    with pytest.raises(CheckpointError, match=r"it holds no agent.json"):
        load_agent(tmp_path)


def test_a_game_is_filmed(tmp_path):
    scenario = GAME.scenario("11x11", max_ticks=300)
    first, second = bot("economist", scenario), bot("turtle", scenario)
    frames = save_film(first, second, GAME, scenario, 0, tmp_path / "game.gif")
    with Image.open(tmp_path / "game.gif") as film:
        assert film.format == "GIF"
        assert 2 <= film.n_frames <= frames == 31
