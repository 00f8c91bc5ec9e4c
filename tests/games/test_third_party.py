"""Wrappers and learners of other libraries take our environments as they are."""

import re
import warnings
from functools import partial
from pathlib import Path

import gymnasium
import numpy as np
import pytest
import supersuit
from gymnasium.spaces import Box
from gymnasium.wrappers import FrameStackObservation, GrayscaleObservation, RecordEpisodeStatistics
from sb3_contrib import MaskablePPO
from stable_baselines3 import DQN, PPO
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import VecTransposeImage

from marl_cair.games import deep_line_wars, deep_maze, deep_rts, flappy_bird

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # PettingZoo's own, of its example games
    from pettingzoo.test import parallel_api_test

WRAPPERS = {
    "dtype": lambda env: supersuit.dtype_v0(env, np.float32),
    "normalize": lambda env: supersuit.normalize_obs_v0(supersuit.dtype_v0(env, np.float32)),
    "flatten": supersuit.flatten_v0,
    "frame_stack": lambda env: supersuit.frame_stack_v1(env, 3),
    "frame_skip": lambda env: supersuit.frame_skip_v0(env, 2),
    "max_observation": lambda env: supersuit.max_observation_v0(env, 2),
    "sticky_actions": lambda env: supersuit.sticky_actions_v0(env, 0.25),
    "delay_observations": lambda env: supersuit.delay_observations_v0(env, 2),
    "clip_reward": supersuit.clip_reward_v0,
    "reward_lambda": lambda env: supersuit.reward_lambda_v0(env, lambda reward: 2.0 * reward),
    "pad_observations": supersuit.pad_observations_v0,
    "pad_action_space": supersuit.pad_action_space_v0,
    "agent_indicator": lambda env: supersuit.agent_indicator_v0(
        supersuit.dtype_v0(env, np.float32), type_only=False
    ),
    "black_death": supersuit.black_death_v3,
}


def make_env(game, **options):
    if game is deep_rts:
        options = {"scenario": "FFA-3-15x15", "max_ticks": 400, **options}
    return game.parallel_env(**options)


NUMBERS = {
    "deep_line_wars": partial(make_env, deep_line_wars, representation="vector"),
    "deep_rts": partial(make_env, deep_rts, representation="vector"),
}
MAZE = partial(make_env, deep_maze, scenario="15x15-race-2p", max_ticks=30)
FLIGHT = partial(make_env, flappy_bird, scenario="race-2", max_ticks=60)
PICTURES = {
    "maze gray": partial(MAZE, representation="gray"),
    "maze image": partial(MAZE, representation="image", cell_pixels=2),
    "flight gray": partial(FLIGHT, representation="gray"),
    "flight gray_stack": partial(FLIGHT, representation="gray_stack"),
}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("wrapper", WRAPPERS)
@pytest.mark.parametrize("shown", [*NUMBERS, *PICTURES])
def test_supersuits_wrappers_keep_to_pettingzoos_contract(shown, wrapper):
    make = {**NUMBERS, **PICTURES}[shown]
    parallel_api_test(WRAPPERS[wrapper](make()), num_cycles=40)


def test_normalised_numbers_are_distinguished():
    """Each number has bounds of its own, so that none vanishes beside a large one."""
    for game in (deep_line_wars, deep_maze, deep_rts):
        env = supersuit.normalize_obs_v0(make_env(game, representation="vector"))
        seen = env.reset(seed=0)[0][env.agents[0]]
        assert seen.min() >= 0.0
        assert (seen > 0.01).sum() >= 5
        assert seen.max() <= 1.0


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


@pytest.mark.parametrize("picture", PICTURES)
def test_races_become_one_vector_environment_that_shows_pictures(picture):
    """Where seats go out before others, `black_death` keeps their rows."""
    plain = PICTURES[picture]()
    env = supersuit.pettingzoo_env_to_vec_env_v1(supersuit.black_death_v3(plain))
    many = supersuit.concat_vec_envs_v1(env, 2, num_cpus=0, base_class="gymnasium")
    observation, _ = many.reset(seed=0)
    shape = plain.observation_space("player_0").shape
    assert observation.dtype == np.uint8
    num_ended = 0
    for _ in range(70):
        observation, _, terminated, truncated, _ = many.step(np.zeros(4, np.int64))
        assert observation.shape == (4, *shape)
        num_ended += int((terminated | truncated).sum())
    assert num_ended >= 4


# --- pictures with their channels last -----------------------------------------------------------


def said_in_readme(game, call):
    """The code of a game's page that begins with `call`, as the page has it."""
    page = Path(game.__file__).with_name("README.md").read_text("utf-8")
    (code,) = re.findall(f"`({re.escape(call)}.*?)`", page)
    return code


@pytest.mark.parametrize("game", [deep_maze, flappy_bird], ids=lambda game: game.__name__[16:])
def test_supersuit_shrinks_and_greys_pictures_as_the_page_says(game):
    scenario = "15x15-race-2p" if game is deep_maze else "race-2"
    plain = game.parallel_env(scenario=scenario, representation="image")
    code = said_in_readme(game, "supersuit.observation_lambda_v0(")
    env = eval(code, {"supersuit": supersuit, "np": np, "env": plain})  # noqa: S307  # our own page's
    red, height, width = plain.observation_space("player_0").shape
    assert env.observation_space("player_0").shape == (height, width, red)
    seen = env.reset(seed=3)[0]["player_0"]
    np.testing.assert_array_equal(seen[..., 1], plain.engine.observe("image")[0, 0, 1])
    small = supersuit.resize_v1(supersuit.color_reduction_v0(env, mode="full"), 84, 84)
    assert small.reset(seed=3)[0]["player_0"].shape == (84, 84)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # PettingZoo's about its own wrapper
        parallel_api_test(small, num_cycles=5)


@pytest.mark.parametrize("game", [deep_maze, flappy_bird], ids=lambda game: game.__name__[16:])
def test_supersuit_stacks_grey_frames_as_the_page_says(game):
    page = Path(game.__file__).with_name("README.md").read_text("utf-8")
    assert "`frame_stack_v1`" in page
    scenario = "15x15-race-2p" if game is deep_maze else "race-2"
    plain = game.parallel_env(scenario=scenario, representation="gray")
    assert supersuit.frame_stack_v1(plain, 4).observation_space("player_0").shape == (1, 84, 336)
    code = said_in_readme(game, "supersuit.observation_lambda_v0(")
    env = eval(code, {"supersuit": supersuit, "np": np, "env": plain})  # noqa: S307  # our own page's
    stacked = supersuit.frame_stack_v1(env, 4)
    assert stacked.observation_space("player_0").shape == (84, 84, 4)
    stacked.reset(seed=3)
    for _ in range(4):
        seen = stacked.step(dict.fromkeys(stacked.agents, 0))[0]["player_0"]
    assert seen.shape == (84, 84, 4)
    np.testing.assert_array_equal(seen[..., -1], plain.engine.observe("gray")[0, 0, 0])


@pytest.mark.parametrize(
    "env_id", ["marl_cair/DeepMaze-9x9-stochastic-v0", "marl_cair/FlappyBird-classic-v0"]
)
def test_gymnasium_greys_pictures_as_the_page_says(env_id):
    plain = gymnasium.make(env_id, representation="image")
    game = deep_maze if "Maze" in env_id else flappy_bird
    code = said_in_readme(game, "gymnasium.wrappers.TransformObservation(")
    env = eval(code, {"gymnasium": gymnasium, "np": np, "Box": Box, "env": plain})  # noqa: S307  # our own page's
    seen, _ = env.reset(seed=3)
    assert env.observation_space.contains(seen)
    grey, _ = GrayscaleObservation(env).reset(seed=3)
    assert grey.shape == plain.observation_space.shape[1:]


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


# --- Stable-Baselines3 and sb3-contrib -----------------------------------------------------------


class Body(BaseFeaturesExtractor):
    """Keeps what it was shown."""

    def __init__(self, observation_space):
        super().__init__(observation_space, 1)
        self.space = observation_space
        self.shown = []

    def forward(self, observations):
        self.shown.append(observations)
        return observations.flatten(1)[:, :1]


def learn_from_pictures(env):
    """The body of a policy that has learned from `env` for some steps."""
    policy = {"features_extractor_class": Body}
    model = PPO("CnnPolicy", env, n_steps=8, batch_size=8, policy_kwargs=policy, device="cpu")
    model.learn(8)
    return model.policy.features_extractor


@pytest.mark.slow
@pytest.mark.parametrize("representation", ["planes", "gray", "image"])
@pytest.mark.parametrize("game", [deep_line_wars, deep_maze, deep_rts, flappy_bird])
def test_a_cnn_policy_sees_channels_first_as_our_page_says(game, representation):
    env_id = f"marl_cair/{game.GYMNASIUM_PREFIX}-{game.GAME.default_scenario}-v0"
    options = {"env_kwargs": {"representation": representation}, "seed": 0}
    body = learn_from_pictures(VecTransposeImage(make_vec_env(env_id, **options), skip=True))
    plain = gymnasium.make(env_id, representation=representation)
    assert body.space.shape == plain.observation_space.shape
    first = make_vec_env(env_id, **options).reset()
    np.testing.assert_array_equal((body.shown[0] * 255).round().numpy(), first)
    if representation != "planes":  # then the wrapper is not needed
        body = learn_from_pictures(make_vec_env(env_id, **options))
        assert body.space.shape == plain.observation_space.shape


def test_stable_baselines3_transposes_planes_that_have_more_channels_than_rows():
    """Our page shows how to avoid that; once it is fixed there, the page can go."""
    with pytest.warns(UserWarning, match="Treating image space as channels-last"):
        body = learn_from_pictures(make_vec_env("marl_cair/DeepRTS-1v1-15x15-v0"))
    assert body.space.shape == (15, 43, 15)


@pytest.mark.parametrize("game", [deep_line_wars, deep_maze, deep_rts, flappy_bird])
def test_maskable_ppo_plays_legal_actions_only(game):
    env_id = f"marl_cair/{game.GYMNASIUM_PREFIX}-{game.GAME.default_scenario}-v0"
    env = make_vec_env(env_id, 2, env_kwargs={"representation": "vector"})
    MaskablePPO("MlpPolicy", env, n_steps=32, batch_size=64, device="cpu").learn(64)
    engines = env.get_attr("engine")
    assert len(engines) == 2
    assert not any(engine.illegal_actions.any() for engine in engines)


def test_maskable_ppo_plays_several_actions_in_each_decision():
    """Actions of a shape are one row of masks, as sb3-contrib wants those of MultiDiscrete."""
    env = gymnasium.make("marl_cair/DeepRTS-1v1-15x15-v0", actions="grid")
    env.reset(seed=0)
    assert env.get_wrapper_attr("action_masks")().shape == (env.action_space.nvec.sum(),)
