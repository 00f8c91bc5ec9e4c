"""Matches of recurrent agents: each seat of each game has a state of its own."""

import numpy as np
import pytest

from benchmarks import _networks
from marl_cair.games.players.mixed_agent import MixedAgent
from marl_cair.league.agents.load import load_agent
from marl_cair.league.play.match import play_chunks, play_match
from marl_cair.league.play.solo import play_alone
from marl_cair.policies.q_network import QNetworkConfig
from tests.games import last_standing
from tests.league.players import GAME
from tests.recurrent_agents import Counting, require_ticks

SCENARIO = GAME.scenario("11x11", max_ticks=300)


@pytest.fixture
def network(tmp_path):
    """A recurrent checkpoint of Deep Line Wars."""
    config = QNetworkConfig(body="mlp", hidden_width=16, memory="lstm")
    options = {"max_ticks": 300}
    folder = _networks.save_network(tmp_path / "net", "11x11", "vector", config, options=options)
    return load_agent(folder)


@pytest.mark.parametrize("scenario", ["duel", "ffa-3", "teams", "uneven"])
def test_an_agent_counts_its_steps_in_each_seat_of_each_game(scenario):
    """Its opponents leave at times, which shrinks its batches."""
    agent, game = Counting(), last_standing.GAME
    random = game.bots["random"](None, None)
    for first, second in ((agent, random), (random, agent), (agent, agent)):
        num_teams = game.make_spec(game.scenario(scenario)).num_teams
        play_match(first, second, game, game.scenario(scenario), 6 * num_teams, 3)
    assert require_ticks(agent) > 20
    assert max(steps.max() for steps, _ in agent.calls) >= 2


def test_an_agent_alone_counts_its_steps_in_each_game():
    agent, game = Counting(), last_standing.GAME
    play_alone(agent, game, game.scenario("alone"), 9, 3)
    assert require_ticks(agent) >= 12


def test_each_member_of_a_mixture_counts_its_steps():
    members, game = [Counting(), Counting()], last_standing.GAME
    idle = game.bots["idle"](None, None)
    play_match(MixedAgent(members, [1, 2]), idle, game, game.scenario("duel"), 40, 3)
    for member in members:
        assert require_ticks(member) >= 12


def test_games_of_a_recurrent_network_do_not_depend_on_the_games_played_with_them(network):
    bot = GAME.bot("random", SCENARIO)
    whole = play_chunks(network, bot, GAME, SCENARIO, 5, (0, 1, 2)).results
    parts = [play_chunks(network, bot, GAME, SCENARIO, 5, (number,)) for number in (2, 1, 0)]
    assert sorted(whole, key=repr) == sorted((r for part in parts for r in part.results), key=repr)
    assert play_match(network, bot, GAME, SCENARIO, 24, 5).results == whole


def test_a_network_that_forgets_plays_other_games(network):
    bot = GAME.bot("random", SCENARIO)
    remembering = play_match(network, bot, GAME, SCENARIO, 4, 5)
    act = network.act
    network.act = lambda seen, mask, state: (act(seen, mask, state)[0], np.zeros_like(state))
    forgetting = play_match(network, bot, GAME, SCENARIO, 4, 5)
    assert {r.fingerprint for r in remembering.results}.isdisjoint(
        r.fingerprint for r in forgetting.results
    )
