"""Agents for the tests: a failing one, and checkpoints of untrained networks."""

import dataclasses
from multiprocessing import parent_process

from marl_cair.checkpoint import AgentDescription, save_agent
from marl_cair.games import GAMES
from marl_cair.league.agents import load_agent
from marl_cair.policies.q_network import QNetworkConfig, make_q_network

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
    scenario = GAME.scenario("11x11", **options)
    spec = GAME.make_spec(scenario)
    config = QNetworkConfig(body="mlp", hidden_width=8)
    shape = spec.representations["vector"].shape
    about = AgentDescription(
        name=name,
        game=game,
        game_version=GAME.version,
        scenario="11x11",
        scenario_options=dataclasses.asdict(scenario),
        representation="vector",
        observation_shape=shape,
        action_names=spec.action_names,
        network=config.to_dict(),
        frames=0,
        updates=0,
        seed=seed,
    )
    save_agent(folder, make_q_network(config, shape, spec.num_actions, seed=seed), about)
    return str(folder)
