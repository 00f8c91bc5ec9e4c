"""Values of agents are those that they give at each step, with the memory that they then have."""

import dataclasses
from types import SimpleNamespace

import numpy as np

from marl_cair.viewer.values import ACTION_VALUES, add_values
from tests.viewer.recorded import record


class Counting:
    """Values an action by its number, and by the steps that it remembers."""

    representation, state_size, name = "vector", 1, "counting"

    def values(self, observation, mask, state):
        return np.where(mask, np.arange(mask.shape[1]) + 1000 * state, -np.inf)

    def act(self, observation, mask, state):
        return np.zeros(len(mask), np.int64), state + 1


def test_values_are_asked_for_at_each_step(tmp_path):
    options = {"game": "deep_line_wars", "scenario": "11x11", "bots": ("random", "random")}
    replay = record(tmp_path / "a.replay", steps=4, **options)
    bot = SimpleNamespace(representation="vector")
    valued = add_values(replay, {0: bot, 1: Counting()}).values[ACTION_VALUES]
    assert valued.shape == (4, 2, replay.spec.num_actions)
    assert np.isnan(valued[:, 0]).all()
    assert valued[:, 1, replay.spec.noop_action].tolist() == [
        replay.spec.noop_action + 1000 * step for step in range(4)
    ]
    assert np.isneginf(valued[:, 1]).any()  # an illegal action
    assert add_values(replay, {0: bot}) is replay
    held = np.full_like(valued, np.nan)
    held[:, 1] = 7  # as played, with one decision for several steps
    recorded = dataclasses.replace(replay, values={ACTION_VALUES: held})
    assert add_values(recorded, {1: Counting()}).values is recorded.values
