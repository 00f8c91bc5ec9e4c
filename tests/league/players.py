"""Agents for the tests: a failing one, and checkpoints of untrained networks."""

from multiprocessing import parent_process

from benchmarks import _networks
from marl_cair.games import GAMES
from marl_cair.league.agents.load import load_agent
from marl_cair.policies.q_network import QNetworkConfig

GAME = GAMES["deep_line_wars"]


class InterruptedLeagueError(Exception):
    """Stands for a kill in the middle of a match."""


class FailingAgent:
    """Plays as the agent it wraps until it has acted `calls` times."""

    def __init__(self, agent, calls):
        self.agent, self.left = agent, calls
        self.name, self.representation = agent.name, agent.representation

    def seed(self, seed):
        self.agent.seed(seed)

    def act(self, observation, action_mask):
        self.left -= 1
        if self.left < 0:
            raise InterruptedLeagueError
        return self.agent.act(observation, action_mask)

    def state_dict(self):
        return self.agent.state_dict()

    def load_state_dict(self, state):
        self.agent.load_state_dict(state)


class FirstLegal:
    """Somebody's own agent: the first legal action."""

    representation = "vector"

    def act(self, observation, action_mask):
        return action_mask.argmax(1)


def make_first_legal(scenario, spec):
    """As `module:function` of a league."""
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
