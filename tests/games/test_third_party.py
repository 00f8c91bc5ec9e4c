"""Wrappers and learners of other libraries take our environments as they are."""

import warnings

import gymnasium
import numpy as np
import pytest
import supersuit
from gymnasium.wrappers import FrameStackObservation, RecordEpisodeStatistics

from marl_cair.games import deep_line_wars, deep_rts

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # PettingZoo's own, of its example games
    from pettingzoo.test import parallel_api_test

WRAPPERS = {
    "dtype": lambda env: supersuit.dtype_v0(env, np.float32),
    "normalize": lambda env: supersuit.normalize_obs_v0(supersuit.dtype_v0(env, np.float32)),
    "flatten": supersuit.flatten_v0,
    "frame_stack": lambda env: supersuit.frame_stack_v1(env, 3),
    "frame_skip": lambda env: supersuit.frame_skip_v0(env, 2),
    "clip_reward": supersuit.clip_reward_v0,
    "agent_indicator": lambda env: supersuit.agent_indicator_v0(
        supersuit.dtype_v0(env, np.float32), type_only=False
    ),
    "black_death": supersuit.black_death_v3,
}


def make_env(game, **options):
    if game is deep_rts:
        options = {"scenario": "FFA-3-15x15", "max_ticks": 400, **options}
    return game.parallel_env(**options)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("wrapper", WRAPPERS)
@pytest.mark.parametrize("game", [deep_line_wars, deep_rts], ids=lambda game: game.__name__[16:])
def test_supersuits_wrappers_keep_to_pettingzoos_contract(game, wrapper):
    parallel_api_test(WRAPPERS[wrapper](make_env(game, representation="vector")), num_cycles=40)


def test_supersuit_stacks_the_frames_that_were_seen():
    plain, stacked = make_env(deep_line_wars), supersuit.frame_stack_v1(make_env(deep_line_wars), 2)
    # SuperSuit stacks along the last axis.
    last = plain.reset(seed=3)[0]["player_0"]
    stacked.reset(seed=3)
    for _ in range(5):
        actions = dict.fromkeys(plain.agents, 1)
        now = plain.step(actions)[0]["player_0"]
        seen = stacked.step(actions)[0]["player_0"]
        columns = now.shape[-1]
        assert (seen[..., :columns] == last).all()
        assert (seen[..., columns:] == now).all()
        last = now


def test_many_pettingzoo_games_become_one_vector_environment():
    env = supersuit.pettingzoo_env_to_vec_env_v1(make_env(deep_line_wars, max_ticks=200))
    many = supersuit.concat_vec_envs_v1(env, 3, num_cpus=0, base_class="gymnasium")
    observation, _ = many.reset(seed=0)
    assert observation.shape == (6, *make_env(deep_line_wars).observation_space("player_0").shape)
    for _ in range(40):
        observation, rewards, *_ = many.step(np.zeros(6, np.int64))
    assert rewards.shape == (6,)


def test_gymnasiums_own_wrappers_stack_frames_and_count_returns():
    env = gymnasium.make("marl_cair/DeepLineWars-10x15-v0", opponent="random", max_ticks=300)
    env = RecordEpisodeStatistics(FrameStackObservation(env, 4))
    observation, _ = env.reset(seed=0)
    assert observation.shape == (4, *env.unwrapped.observation_space.shape)
    done = False
    while not done:
        observation, _, terminated, truncated, info = env.step(0)
        done = terminated or truncated
    assert info["episode"]["l"] == 30


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_stable_baselines3_learns_on_a_gymnasium_scenario():
    """An army of soldiers is paid step by step: what PPO has learned beats what it began with."""
    from stable_baselines3 import PPO
    from stable_baselines3.common.evaluation import evaluate_policy

    env = gymnasium.make(
        "marl_cair/DeepRTS-GoldCollect-15x15-v0", representation="vector", actions="classic"
    )
    model = PPO("MlpPolicy", env, n_steps=512, seed=0, device="cpu")
    before, _ = evaluate_policy(model, env, 10, deterministic=False)
    model.learn(20_000)
    after, _ = evaluate_policy(model, env, 10, deterministic=False)
    assert after > before + 0.1


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_stable_baselines3_learns_on_a_pettingzoo_game_through_supersuit():
    from stable_baselines3 import DQN

    env = make_env(deep_line_wars, representation="vector", max_ticks=500)
    env = supersuit.pettingzoo_env_to_vec_env_v1(env)
    many = supersuit.concat_vec_envs_v1(env, 4, num_cpus=0, base_class="stable_baselines3")
    # Without a seed: SuperSuit 3.11 lacks the `seed` that Stable-Baselines3 then calls.
    model = DQN("MlpPolicy", many, learning_starts=200, device="cpu")
    before = [parameter.clone() for parameter in model.q_net.parameters()]
    model.learn(4_000)
    assert model.num_timesteps >= 4_000
    changed = [
        bool((old != new).any()) for old, new in zip(before, model.q_net.parameters(), strict=True)
    ]
    assert all(changed)
