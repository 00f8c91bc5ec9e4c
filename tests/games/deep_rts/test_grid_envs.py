"""`grid` in the environments: the libraries' own checks, sampling by the mask, bad input.

Tests of all games take the space `grid` of the default scenario as a case of their own.
"""

from __future__ import annotations

import re
import warnings
from typing import Any

import numpy as np
import pytest
import torch
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from torchrl.envs import ActionMask, TransformedEnv

from marl_cair.games import make_engine
from marl_cair.games.deep_rts.orders.grid import NUM_GRID
from marl_cair.games.deep_rts.state import IS_ALIVE, IS_OUT
from marl_cair.games.gymnasium_env import GameEnv, GameVectorEnv
from marl_cair.games.parallel_env import GameParallelEnv
from marl_cair.games.torchrl_env import GROUP, BatchedGameEnv
from tests.games.cases import FirstLegalAgent
from tests.games.deep_rts.skirmish import draw_actions

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # it imports games of its own the old way
    from pettingzoo.test import parallel_api_test

SHAPE = (15, 15)
BRIEF = {"actions": "grid", "max_ticks": 100}


def make_parallel(scenario: str = "1v1-15x15", **options: Any) -> GameParallelEnv:
    return GameParallelEnv("deep_rts", scenario, **(BRIEF | options))


@pytest.mark.parametrize("scenario", ["1v1-15x15", "Skirmish-15x15-fog", "FFA-3-15x15"])
def test_pettingzoo_and_gymnasium_accept_the_grid(scenario):
    parallel_api_test(make_parallel(scenario, mask_in_observation=True), num_cycles=20)
    for opponent in ("random", FirstLegalAgent()):
        env = GameEnv("deep_rts", scenario, opponent=opponent, mask_in_observation=True, **BRIEF)
        check_env(env, skip_render_check=True)


def test_mask_samples_legal_orders_for_all_units_at_once():
    env = make_parallel()
    _, infos = env.reset(seed=0)
    space = env.action_space("player_0")
    assert isinstance(space, spaces.MultiDiscrete)
    assert space.shape == SHAPE
    assert set(space.nvec.ravel().tolist()) == {NUM_GRID}
    space.seed(0)
    mask = infos["player_0"]["action_mask"]
    tuples = tuple(tuple(row) for row in mask)  # Gymnasium's own way
    for given in [mask] * 20 + [tuples]:
        orders = space.sample(given)
        assert space.contains(orders)
        assert np.take_along_axis(mask, orders[..., None], axis=-1).all()


def test_seat_that_is_out_needs_no_orders():
    env = make_parallel("FFA-3-15x15")
    env.reset(seed=0)
    env.engine._worlds.players[0, 1, [IS_ALIVE, IS_OUT]] = 0, 1
    noop = np.zeros(SHAPE, np.int64)
    env.step(dict.fromkeys(env.agents, noop))
    assert env.agents == ["player_0", "player_2"]
    env.step(dict.fromkeys(env.agents, noop))


def test_vector_of_games_equals_single_ones():
    options = {"opponent": FirstLegalAgent(), **BRIEF}
    mode = AutoresetMode.SAME_STEP
    vector = GameVectorEnv("deep_rts", num_envs=2, autoreset_mode=mode, **options)
    singles = [GameEnv("deep_rts", **options) for _ in range(2)]
    _, infos = vector.reset(seed=4)
    for world, env in enumerate(singles):
        env.reset(seed=4 + world)
    luck = np.random.default_rng(0)
    num_ended = 0
    for _ in range(25):
        assert infos["action_mask"].shape == (2, *SHAPE, NUM_GRID)
        actions = draw_actions(vector.engine, luck)[:, 0]
        seen, rewards, _, truncated, infos = vector.step(actions)
        for world, env in enumerate(singles):
            single, reward, _, has_ended, info = env.step(actions[world])
            assert (rewards[world], truncated[world]) == (reward, has_ended)
            if has_ended:
                num_ended += 1
                final = infos["final_info"]["action_mask"][world]
                np.testing.assert_array_equal(final, info["action_mask"])
                single, info = env.reset()
            np.testing.assert_array_equal(seen[world], single)
            np.testing.assert_array_equal(infos["action_mask"][world], info["action_mask"])
    assert num_ended == 4
    assert vector.action_space.contains(vector.action_space.sample())


def test_random_orders_are_legal_through_torchrls_action_mask():
    plain = BatchedGameEnv("deep_rts", "1v1-15x15", 2, seed=0, **BRIEF)
    keys = {"action_key": (GROUP, "action"), "mask_key": (GROUP, "action_mask")}
    env = TransformedEnv(plain, ActionMask(**keys))
    torch.manual_seed(0)
    stored = env.rollout(8, break_when_any_done=False)
    chosen = stored[GROUP, "action_mask"].gather(-1, stored[GROUP, "action"].unsqueeze(-1))
    assert chosen.all()
    assert (stored[GROUP, "action"] > 0).any()
    assert not plain.engine.illegal_actions.any()


# --- bad input -----------------------------------------------------------------------------------


def refuses(*parts: object):
    """Raises ValueError with a message that holds the parts in this order."""
    return pytest.raises(ValueError, match=".*".join(re.escape(str(part)) for part in parts))


def test_order_outside_the_space_names_world_player_and_place():
    engine = make_engine("deep_rts", num_worlds=2, actions="grid")
    engine.reset(np.zeros(2, np.uint64))
    actions = np.zeros((2, 2, *SHAPE), np.int32)
    actions[1, 0, 3, 14] = NUM_GRID
    with refuses("action 102 of player 0 in world 1 at place [3, 14]", "0..101"):
        engine.step(actions)


@pytest.mark.parametrize("shape", [(2, 2), (2, 2, 15), (2, 2, 225), (2, 15, 15)])
def test_orders_of_a_wrong_shape_are_described(shape):
    engine = make_engine("deep_rts", num_worlds=2, actions="grid")
    engine.reset(np.zeros(2, np.uint64))
    with refuses(f"int32 {list(shape)}", [2, 2, 15, 15]):
        engine.step(np.zeros(shape, np.int32))


def test_environments_describe_wrong_orders():
    env = make_parallel()
    env.reset(seed=0)
    actions = {"player_0": np.zeros(SHAPE, np.int64), "player_1": np.zeros((15, 14), np.int64)}
    with refuses("player_1 is int64 [15, 14]", [15, 15]):
        env.step(actions)
    actions["player_1"] = np.full(SHAPE, -1)
    with refuses("action -1 of player 1 in world 0 at place [0, 0]", "0..101"):
        env.step(actions)
    single = GameEnv("deep_rts", **BRIEF)
    single.reset(seed=0)
    with refuses("int64 [1]", [1, 15, 15]):
        single.step(0)
    with refuses("[15, 15]", "factored"):
        make_parallel(action_form="factored")
