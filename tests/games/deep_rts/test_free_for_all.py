"""More than two players: eliminated players leave, the others play on, the last one wins."""

import warnings

import numpy as np
import pytest

with warnings.catch_warnings():  # pettingzoo's tests import an environment the old way
    warnings.simplefilter("ignore", DeprecationWarning)
    from pettingzoo.test import parallel_api_test

from marl_cair.games import deep_rts

ARMY = {"army": (0, 3, 2, 1), "max_ticks": 6_000}


def play(env, seed):
    """Play a random game; yields the agents of each step and its results."""
    luck = np.random.default_rng(seed)
    _, infos = env.reset(seed=seed)
    while env.agents:
        live = list(env.agents)
        legal = {agent: np.flatnonzero(infos[agent]["action_mask"]) for agent in live}
        results = env.step({agent: int(luck.choice(legal[agent])) for agent in live})
        infos = results[4]
        yield live, results


@pytest.mark.parametrize("seed", [0, 1])
def test_players_leave_one_by_one_and_the_last_one_is_paid(seed):
    env = deep_rts.parallel_env(scenario="FFA-4-15x15", **ARMY)
    returns, lives = dict.fromkeys(env.possible_agents, 0.0), set()
    for live, results in play(env, seed):
        _, rewards, terminations, *_ = results
        lives.add(len(live))
        assert all(list(values) == live for values in results)
        for agent in live:
            returns[agent] += rewards[agent]
            assert (rewards[agent] != 0.0) == terminations[agent]
        assert [agent for agent in live if not terminations[agent]] == env.agents
        for player in np.flatnonzero(env.engine.eliminated[0]):
            legal = np.flatnonzero(env.engine.action_mask()[0, player]).tolist()
            assert legal == [env.engine.spec.noop_action]
    assert len(lives) > 1
    winner = f"player_{env.engine.winner[0]}"
    assert returns == {agent: 1.0 if agent == winner else -1.0 for agent in returns}


def test_player_with_a_living_ally_is_not_out():
    env = deep_rts.parallel_env(scenario="Teams-2v2-15x15", **ARMY)
    teams = env.engine.scenario.teams
    steps = list(play(env, 0))
    assert all(len(live) == 4 for live, _ in steps)
    rewards = steps[-1][1][1]
    paid = [{rewards[f"player_{p}"] for p in range(4) if teams[p] == team} for team in (0, 1)]
    assert sorted(paid, key=min) == [{-1.0}, {1.0}]


def test_pettingzoo_accepts_games_that_players_leave():
    parallel_api_test(deep_rts.parallel_env(scenario="FFA-3-15x15", **ARMY), num_cycles=100)
