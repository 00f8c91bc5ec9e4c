"""The trained agents that come with the sources: they load, and play as well as is said."""

from pathlib import Path

import numpy as np
import pytest
import torch

from marl_cair.checkpoint import load_network, load_tensors, read_description
from marl_cair.games import GAMES
from marl_cair.league.agents.load import load_agent
from marl_cair.league.play.match import play_match
from marl_cair.league.play.solo import play_alone
from tests.games.flash.browser.flash_files import need_flash

AGENTS = Path(__file__).parents[1] / "agents"
GAMES_EACH = 24
# The least score against one bot, and the least mean over all: what each has in many games, less
# three standard errors of these.
LEAST = {
    "deep_line_wars_10x15": (0.79, 0.92),  # 94 %, 98 %
    "deep_line_wars_10x15_mixture": (0.33, 0.8),  # 64 %, 90 %
    "deep_rts_1v1_15x15": (0.64, 0.85),  # 90 %, 94 %: both games of a map often end alike
    "flash_duel": (0.87, 0.87),  # 97.5 %
}
BOTS = {"flash_duel": ("duelist",)}  # others play them all
# Games alone: how many, options, a number of each game and its least mean, as above.
ALONE = {
    "deep_maze_9x9": (200, {}, "solved", 0.97),  # 100 %
    "flash_multitask": (16, {}, "score", 900.0),  # 1,798; random play has 58
    "flappy_bird": (24, {"max_ticks": 6_000}, "pipes_passed", 80.0),  # 116
}


def test_the_page_names_all():
    page = (AGENTS / "README.md").read_text("utf-8")
    assert {path.name for path in AGENTS.iterdir() if path.is_dir()} == {*LEAST, *ALONE}
    for name in (*LEAST, *ALONE):
        assert f"`{name}`" in page


def test_they_are_small():
    files = [path for path in AGENTS.rglob("*") if path.is_file()]
    assert sum(path.stat().st_size for path in files) < 15e6


# Saved by the code of commit dfe3df4: a small capsule network with random weights, whose settings
# and description lack what came later. Below, its first values there, of random observations.
OLD = Path(__file__).parent / "data" / "agent_of_2026_11_23"
OLD_VALUES = (
    (-0.4950242, -0.1653158, -0.7182301, -0.8601860),
    (-0.4800467, -0.1475441, -0.6981204, -0.8277428),
)


def test_an_agent_of_an_earlier_version_loads_and_plays():
    agent, about = load_agent(OLD), read_description(OLD)
    seen = np.random.default_rng(0).integers(0, 256, (4, *about.observation_shape), np.uint8)
    values = agent.values(seen, np.ones((4, len(about.action_names)), np.bool_))
    np.testing.assert_allclose(values[:2, :4], OLD_VALUES, atol=1e-5)
    assert values.argmax(1).tolist() == [76] * 4
    game = GAMES[about.game]
    scenario = game.scenario(about.scenario, **about.scenario_options)
    match = play_match(agent, game.bot("random", scenario), game, scenario, 4, 0)
    assert not match.forfeits
    assert match.distinct_games == 4


def test_weights_are_half_as_exact_and_play_in_full_precision():
    weights = load_tensors(AGENTS / "deep_line_wars_10x15" / "weights.pt")
    assert {value.dtype for value in weights.values()} == {torch.float16}
    network, _ = load_network(AGENTS / "deep_line_wars_10x15")
    assert {value.dtype for value in network.parameters()} == {torch.float32}


@pytest.mark.slow
@pytest.mark.parametrize("name", LEAST)
def test_it_plays_as_well_as_the_page_says(name):
    folder = AGENTS / name
    one = folder if (folder / "agent.json").exists() else folder / "members" / "00"
    about = read_description(one)
    game = GAMES[about.game]
    scenario = game.scenario(about.scenario, **about.scenario_options)
    if about.game == "flash":
        need_flash()
    agent = load_agent(folder)
    points = []
    for bot in BOTS.get(name, game.bots):
        match = play_match(agent, game.bot(bot, scenario), game, scenario, GAMES_EACH, 0)
        points.append(match.score)
    least, mean = LEAST[name]
    assert min(points) >= least
    assert sum(points) / len(points) >= mean


@pytest.mark.slow
@pytest.mark.parametrize("name", ALONE)
def test_alone_it_plays_as_well_as_the_page_says(name):
    num_games, options, number, least = ALONE[name]
    about = read_description(AGENTS / name)
    if about.game == "flash":
        need_flash()
    game = GAMES[about.game]
    scenario = game.scenario(about.scenario, **{**about.scenario_options, **options})
    games = play_alone(load_agent(AGENTS / name), game, scenario, num_games, 0).results
    reached = [one.numbers.get(number, not one.is_truncated) for one in games]
    assert np.mean(reached) >= least
