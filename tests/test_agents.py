"""The trained agents that come with the sources: they load, and play as well as is said."""

from pathlib import Path

import pytest

from marl_cair.checkpoint import read_description
from marl_cair.games import GAMES
from marl_cair.league.agents import load_agent
from marl_cair.league.match import play_match

FOLDERS = sorted(path.parent for path in Path(__file__).parents[1].glob("agents/*/agent.json"))


def test_there_are_some_and_the_page_names_them():
    page = (Path(__file__).parents[1] / "agents" / "README.md").read_text("utf-8")
    assert FOLDERS
    for folder in FOLDERS:
        assert f"`{folder.name}`" in page


@pytest.mark.parametrize("folder", FOLDERS, ids=lambda folder: folder.name)
def test_no_bot_beats_it_on_balance(folder):
    about = read_description(folder)
    game = GAMES[about.game]
    scenario = game.scenario(about.scenario, **about.scenario_options)
    agent = load_agent(folder)
    points = []
    for bot in game.bots:
        match = play_match(agent, game.bot(bot, scenario), game, scenario, 40, 0)
        points.append(match.score)
    assert min(points) > 0.4  # one half at least, of 40 games
    assert sum(points) / len(points) > 0.75
