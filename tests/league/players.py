"""Agents for the tests: failing, foreign and changed ones, and untrained networks."""

from multiprocessing import parent_process

from benchmarks import _networks
from marl_cair.games import GAMES
from marl_cair.league.agents.load import load_agent
from marl_cair.policies.q_network import QNetworkConfig

GAME = GAMES["deep_line_wars"]


class InterruptedLeagueError(Exception):
    """In place of a kill in the middle of a match."""


class FailingAgent:
    """Acts as its agent `calls` times, then raises."""

    def __init__(self, agent, calls):
        self.agent, self.left = agent, calls

    def __getattr__(self, name):
        return getattr(self.agent, name)

    def act(self, observation, action_mask):
        self.left -= 1
        if self.left < 0:
            raise InterruptedLeagueError
        return self.agent.act(observation, action_mask)


class FirstLegal:
    """A foreign agent that plays the first legal action."""

    representation = "vector"

    def act(self, observation, action_mask):
        return action_mask.argmax(1)


def make_first_legal(scenario, spec):
    """For `module:function`."""
    return FirstLegal()


def load_changed(source, **options):
    """As `load_agent`, but in worker processes the rusher is another agent."""
    is_worker = parent_process() is not None
    return load_agent("zigzag" if is_worker and source == "rusher" else source, **options)


def save_network(folder, name="net", seed=0, game=GAME.name, **options):
    """A checkpoint of an untrained network for 11x11 boards; returns its folder as a string."""
    config = QNetworkConfig(body="mlp", hidden_width=8)
    changes = {"name": name, "seed": seed, "game": game, "options": options}
    return _networks.save_network(folder, "11x11", "vector", config, **changes)
