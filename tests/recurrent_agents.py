"""Recurrent agents for the tests: one that counts its steps, and networks of random weights."""

import numpy as np

from marl_cair.policies.actor import PolicyActor
from marl_cair.policies.q_network import QNetworkConfig, make_q_network

TICK = 2  # its place in the vector of the game `last_standing`


class Counting:
    """Plays the first and the second legal action in turn, by its number of steps in the game: an
    agent that is not reset, or that loses a state, plays another one.

    `calls` has the numbers [N] of each call and the observations.
    """

    name, representation, state_size = "counting", "vector", 2

    def __init__(self):
        self.calls = []

    def act(self, observation, action_mask, state):
        steps = state[:, 0].copy()
        self.calls.append((steps, observation.copy()))
        assert (state[:, 1] == -3 * steps).all()
        return choose_in_turn(steps, action_mask), np.add(state, [1, -3])

    def seed(self, seed):
        """There is nothing to seed."""

    def state_dict(self):
        return {}

    def load_state_dict(self, state):
        """There is nothing to load."""


def choose_in_turn(steps, action_mask):
    """The actions of `Counting` [N] after `steps` [N] of the game."""
    wanted = 1 + np.minimum(steps % 2, action_mask.sum(1) - 1)
    return (action_mask.cumsum(1) == wanted[:, None]).argmax(1)


def require_ticks(agent):
    """Assert that a `Counting` has had its number of steps right in all its games, of
    `last_standing`; returns the number of calls.
    """
    for steps, seen in agent.calls:
        assert steps.tolist() == seen[:, TICK].tolist()
    return len(agent.calls)


def make_counting(scenario, spec):
    """For `module:function`."""
    return Counting()


def make_actor(shape, num_actions, memory="lstm", representation="vector", epsilon=0.0):
    """A network of random weights, whose values depend on the past as much as on the present."""
    config = QNetworkConfig(body="mlp", hidden_width=16, memory=memory, memory_width=8)
    network = make_q_network(config, shape, num_actions, seed=0)
    for weight in network.memory.parameters():
        weight.data *= 4
    return PolicyActor(network.eval(), "recurrent", representation, None, epsilon)


def make_recurrent(scenario, spec):
    """For `module:function`."""
    return make_actor(spec.representations["vector"].shape, spec.num_actions)
