"""More than two players: who is out leaves, the others play on, the last one wins."""

import warnings

import numpy as np
import pytest

with warnings.catch_warnings():  # pettingzoo's tests import an environment the old way
    warnings.simplefilter("ignore", DeprecationWarning)
    from pettingzoo.test import parallel_api_test

from marl_cair.games import deep_rts, make_engine

ARMY = {"army": (0, 3, 2, 1), "max_ticks": 6_000}


def play(env, seed):
    """Play a game at random; yields what each step returns."""
    luck = np.random.default_rng(seed)
    _, infos = env.reset(seed=seed)
    while env.agents:
        legal = {agent: np.flatnonzero(infos[agent]["action_mask"]) for agent in env.agents}
        live = list(env.agents)
        told = env.step({agent: int(luck.choice(legal[agent])) for agent in live})
        infos = told[4]
        yield live, told


@pytest.mark.parametrize("seed", [0, 1])
def test_players_leave_one_by_one_and_the_last_one_is_paid(seed):
    env = deep_rts.parallel_env(scenario="FFA-4-15x15", **ARMY)
    returns = dict.fromkeys(env.possible_agents, 0.0)
    lives = []
    for live, (observations, rewards, terminations, truncations, infos) in play(env, seed):
        lives.append(len(live))
        for told in (observations, rewards, terminations, truncations, infos):
            assert list(told) == live
        for agent in live:
            returns[agent] += rewards[agent]
            assert (rewards[agent] != 0.0) == terminations[agent]
        assert [agent for agent in live if not terminations[agent]] == env.agents
    assert len(set(lives)) > 1
    winner = f"player_{env.engine.winner[0]}"
    assert returns == {agent: 1.0 if agent == winner else -1.0 for agent in returns}


def test_a_player_whose_ally_fights_on_is_not_out():
    env = deep_rts.parallel_env(scenario="Teams-2v2-15x15", **ARMY)
    for live, (_, rewards, *_) in play(env, 0):
        if len(live) == 4 and not env.agents:
            teams = env.engine.scenario.teams
            paid = {
                team: {rewards[f"player_{s}"] for s in range(4) if teams[s] == team}
                for team in (0, 1)
            }
            assert sorted(paid.values(), key=min) == [{-1.0}, {1.0}]


def test_only_the_no_op_is_legal_for_who_is_out():
    engine = make_engine("deep_rts", "FFA-3-15x15", **ARMY)
    luck = np.random.default_rng(0)
    engine.reset(3)
    while not engine.eliminated.any():
        masks = engine.action_mask()[0]
        chosen = [int(luck.choice(np.flatnonzero(mask))) for mask in masks]
        engine.step(np.array([chosen], np.int32))
    out = int(np.flatnonzero(engine.eliminated[0])[0])
    assert np.flatnonzero(engine.action_mask()[0, out]).tolist() == [engine.spec.noop_action]


def test_pettingzoo_accepts_games_that_players_leave():
    parallel_api_test(deep_rts.parallel_env(scenario="FFA-3-15x15", **ARMY), num_cycles=100)
