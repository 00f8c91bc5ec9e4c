"""TorchRL's wrappers around the Gymnasium and PettingZoo environments."""

import gymnasium
import numpy as np
import pytest
import torch
from torchrl.envs import (
    ActionMask,
    GymEnv,
    GymWrapper,
    PettingZooWrapper,
    TransformedEnv,
)
from torchrl.envs.utils import check_env_specs

import marl_cair
from marl_cair.games import GAMES
from marl_cair.games.gymnasium_env import GameEnv, GameVectorEnv
from marl_cair.games.parallel_env import GameParallelEnv
from marl_cair.games.registry import gymnasium_id
from marl_cair.games.torchrl_env import GROUP, BatchedGameEnv
from tests.games.cases import QUICK_CASES, ticks_of
from tests.games.test_torchrl_env import MAX_DECISIONS

IDS = sorted(
    {
        gymnasium_id(GAMES[case.game].gymnasium_prefix, case.scenario)
        for case in QUICK_CASES
        if case.scenario in GAMES[case.game].scenarios
    }
)


@pytest.mark.parametrize("env_id", IDS)
def test_gym_env_takes_every_id(env_id):
    check_env_specs(GymEnv(env_id), seed=0)


@pytest.mark.parametrize("categorical", [False, True], ids=["one-hot", "categorical"])
@pytest.mark.parametrize("form", ["flat", "factored"])
def test_gym_env_draws_legal_actions_by_the_mask_in_the_observation(game_name, categorical, form):
    chosen = GAMES[game_name]
    env_id = gymnasium_id(chosen.gymnasium_prefix, chosen.default_scenario)
    settings = {"mask_in_observation": True, "action_form": form}
    plain = GymEnv(env_id, categorical_action_encoding=categorical, **settings)
    env = TransformedEnv(plain, ActionMask())
    check_env_specs(env, seed=0)
    torch.manual_seed(0)
    stored = env.rollout(60, break_when_any_done=False)
    actions = stored["action"] if categorical else stored["action"].int().argmax(-1)
    masks = stored["action_mask"].flatten(1)
    assert masks.gather(-1, actions.unsqueeze(-1)).all()
    assert not plain.unwrapped.engine.illegal_actions.any()


def test_one_number_is_an_index_into_the_factored_mask(game_name):
    settings = {"mask_in_observation": True, "action_form": "factored", "seat": 0}
    by_index, by_pair = GameEnv(game_name, **settings), GameEnv(game_name, **settings)
    seen, _ = by_index.reset(seed=0)
    by_pair.reset(seed=0)
    kind, cell = np.argwhere(seen["action_mask"])[-1]
    index = np.ravel_multi_index((kind, cell), seen["action_mask"].shape)
    got, expected = by_index.step(index), by_pair.step([kind, cell])
    np.testing.assert_array_equal(got[0]["observation"], expected[0]["observation"])
    for wrong in (-1, seen["action_mask"].size):
        with pytest.raises(ValueError, match="the kind .* is outside"):
            by_index.step(wrong)


@pytest.mark.parametrize("mode", ["SameStep", "Disabled"])
def test_gym_wrapper_takes_vectors(game_name, mode):
    chosen = GAMES[game_name]
    env_id = gymnasium_id(chosen.gymnasium_prefix, chosen.default_scenario)
    vector = gymnasium.make_vec(env_id, 3, autoreset_mode=mode, max_episode_steps=5)
    env = GymWrapper(vector, categorical_action_encoding=True)
    assert env.batch_size == (3,)
    check_env_specs(env, seed=0)
    stored = env.rollout(12, break_when_any_done=False)
    assert stored["next", "done"].sum() >= 6


def test_torchrls_pettingzoo_wrapper_takes_the_mask_in_the_observation(game_name):
    limit = ticks_of(game_name, MAX_DECISIONS)
    env = PettingZooWrapper(GameParallelEnv(game_name, mask_in_observation=True, max_ticks=limit))
    check_env_specs(env, seed=0)
    masks = env.rollout(8)[GROUP, "action_mask"]
    assert not masks.all()


def test_an_unknown_option_is_an_unexpected_keyword_argument(game_name):
    message = r"unknown \w+ option 'frameskip'.*\(unexpected keyword argument 'frameskip'\)"
    for make in (GameParallelEnv, GameEnv, GameVectorEnv, BatchedGameEnv, marl_cair.make_engine):
        with pytest.raises(TypeError, match=message) as raised:
            make(game_name, frameskip=4)
        assert isinstance(raised.value, ValueError)
