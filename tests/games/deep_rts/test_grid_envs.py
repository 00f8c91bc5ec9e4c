"""`grid` at every door: the libraries' own checks, equality with the engine, and bad input."""

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
from torchrl.envs import ActionMask, PettingZooWrapper, TransformedEnv
from torchrl.envs.utils import check_env_specs

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
    from pettingzoo.test import parallel_api_test, parallel_seed_test

SCENARIOS = ["1v1-15x15", "Skirmish-15x15-fog", "FFA-3-15x15"]
SHAPE = (15, 15)
BRIEF = {"actions": "grid", "max_ticks": 100}

every_scenario = pytest.mark.parametrize("scenario", SCENARIOS)


def make_parallel(scenario: str = SCENARIOS[0], **options: Any) -> GameParallelEnv:
    return GameParallelEnv("deep_rts", scenario, **(BRIEF | options))


def make_torchrl(scenario: str = SCENARIOS[0], num_worlds: int = 1, **options: Any):
    return BatchedGameEnv("deep_rts", scenario, num_worlds, seed=0, **(BRIEF | options))


# --- PettingZoo ----------------------------------------------------------------------------------


@every_scenario
@pytest.mark.parametrize("with_mask", [False, True])
def test_pettingzoo_accepts_the_grid(scenario, with_mask):
    parallel_api_test(make_parallel(scenario, mask_in_observation=with_mask), num_cycles=20)
    parallel_seed_test(lambda: make_parallel(scenario), num_cycles=5)


@every_scenario
def test_the_parallel_game_equals_the_engines(scenario):
    env = make_parallel(scenario)
    engine = make_engine("deep_rts", scenario, **BRIEF)
    luck = np.random.default_rng(0)
    _, infos = env.reset(seed=3)
    engine.restore(env.engine.snapshot())
    while env.agents:
        masks = engine.action_mask()[0]
        for seat, agent in enumerate(env.possible_agents):
            if agent in env.agents:
                shown = infos[agent]["action_mask"]
                assert shown.dtype == np.int8
                np.testing.assert_array_equal(shown, masks[seat])
        actions = draw_actions(engine, luck)
        *_, infos = env.step(dict(zip(env.possible_agents, actions[0], strict=True)))
        engine.step(actions)
        for name, value in engine.state_dict().items():
            np.testing.assert_array_equal(value, env.engine.state_dict()[name])


def test_the_mask_samples_legal_orders_for_all_units_at_once():
    env = make_parallel()
    _, infos = env.reset(seed=0)
    space = env.action_space("player_0")
    assert isinstance(space, spaces.MultiDiscrete)
    assert space.shape == SHAPE
    assert set(space.nvec.ravel().tolist()) == {NUM_GRID}
    space.seed(0)
    mask = infos["player_0"]["action_mask"]
    for _ in range(20):
        orders = space.sample(mask)
        assert space.contains(orders)
        assert np.take_along_axis(mask, orders[..., None], axis=-1).all()
    tuples = tuple(tuple(row) for row in mask)  # Gymnasium's own way
    orders = space.sample(tuples)
    assert np.take_along_axis(mask, orders[..., None], axis=-1).all()


def test_a_seat_that_is_out_needs_no_orders():
    env = make_parallel("FFA-3-15x15")
    env.reset(seed=0)
    env.engine._worlds.players[0, 1, [IS_ALIVE, IS_OUT]] = 0, 1
    noop = np.zeros(SHAPE, np.int64)
    env.step(dict.fromkeys(env.agents, noop))
    assert env.agents == ["player_0", "player_2"]
    env.step(dict.fromkeys(env.agents, noop))


# --- Gymnasium -----------------------------------------------------------------------------------


@every_scenario
@pytest.mark.parametrize("opponent", ["random", FirstLegalAgent()], ids=["random", "first legal"])
def test_gymnasium_accepts_the_grid(scenario, opponent):
    env = GameEnv("deep_rts", scenario, opponent=opponent, mask_in_observation=True, **BRIEF)
    check_env(env, skip_render_check=True)


def test_a_vector_of_games_equals_single_ones():
    vector = GameVectorEnv(
        "deep_rts",
        num_envs=2,
        opponent=FirstLegalAgent(),
        autoreset_mode=AutoresetMode.SAME_STEP,
        **BRIEF,
    )
    singles = [GameEnv("deep_rts", opponent=FirstLegalAgent(), **BRIEF) for _ in range(2)]
    _, infos = vector.reset(seed=4)
    for world, env in enumerate(singles):
        env.reset(seed=4 + world)
    luck = np.random.default_rng(0)
    num_ended = 0
    for _ in range(25):
        masks = infos["action_mask"]
        assert masks.shape == (2, *SHAPE, NUM_GRID)
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


# --- TorchRL -------------------------------------------------------------------------------------


@every_scenario
def test_torchrl_accepts_the_grid(scenario):
    env = make_torchrl(scenario, 2)
    check_env_specs(env, seed=0)
    players = env.engine.num_players
    assert env.full_action_spec[GROUP, "action"].shape == (2, players, *SHAPE)
    mask = env.observation_spec[GROUP, "action_mask"]
    assert mask.shape == (2, players, *SHAPE, NUM_GRID)


def test_random_orders_are_legal_through_torchrls_action_mask():
    plain = make_torchrl(num_worlds=2)
    keys = {"action_key": (GROUP, "action"), "mask_key": (GROUP, "action_mask")}
    env = TransformedEnv(plain, ActionMask(**keys))
    torch.manual_seed(0)
    stored = env.rollout(8, break_when_any_done=False)
    chosen = stored[GROUP, "action_mask"].gather(-1, stored[GROUP, "action"].unsqueeze(-1))
    assert chosen.all()
    assert (stored[GROUP, "action"] > 0).any()
    assert not plain.engine.illegal_actions.any()


def test_the_native_environment_equals_the_wrapped_one():
    native, wrapper = make_torchrl(), PettingZooWrapper(make_parallel())
    native.set_seed(6)
    own, reference = native.reset(), wrapper.reset(seed=6)
    luck = np.random.default_rng(1)
    for _ in range(9):
        for key in ("observation", "action_mask"):
            assert torch.equal(own[GROUP, key][0], reference[GROUP, key])
        actions = torch.from_numpy(draw_actions(native.engine, luck)).long()
        own = native.step(own.copy().set((GROUP, "action"), actions))["next"]
        reference = wrapper.step(reference.copy().set((GROUP, "action"), actions[0]))["next"]


# --- bad input -----------------------------------------------------------------------------------


def refuses(text: str):
    return pytest.raises(ValueError, match=re.escape(text))


def test_an_order_outside_the_space_names_world_player_and_place():
    engine = make_engine("deep_rts", num_worlds=2, actions="grid")
    engine.reset(np.zeros(2, np.uint64))
    actions = np.zeros((2, 2, *SHAPE), np.int32)
    actions[1, 0, 3, 14] = NUM_GRID
    message = "deep_rts: action 102 of player 0 in world 1 at place [3, 14] is outside 0..101"
    with refuses(message):
        engine.step(actions)


@pytest.mark.parametrize("shape", [(2, 2), (2, 2, 15), (2, 2, 225), (2, 15, 15)])
def test_orders_of_a_wrong_shape_are_described(shape):
    engine = make_engine("deep_rts", num_worlds=2, actions="grid")
    engine.reset(np.zeros(2, np.uint64))
    message = (
        f"deep_rts: actions are int32 {list(shape)}, they must be integers [2, 2, 15, 15] "
        "(worlds, players, action shape)"
    )
    with refuses(message):
        engine.step(np.zeros(shape, np.int32))


def test_the_doors_describe_wrong_orders():
    env = make_parallel()
    env.reset(seed=0)
    actions = {"player_0": np.zeros(SHAPE, np.int64), "player_1": np.zeros((15, 14), np.int64)}
    with refuses("the action of player_1 is int64 [15, 14], it must be integers [15, 15]"):
        env.step(actions)
    actions["player_1"] = np.full(SHAPE, -1)
    with refuses("action -1 of player 1 in world 0 at place [0, 0] is outside 0..101"):
        env.step(actions)
    single = GameEnv("deep_rts", **BRIEF)
    single.reset(seed=0)
    message = (
        "actions are int64 [1], they must be integers [1, 15, 15] (worlds, shape of an action)"
    )
    with refuses(message):
        single.step(0)


def test_the_grid_is_not_factored():
    with refuses("deep_rts: actions of shape [15, 15] cannot be factored by kind and cell"):
        make_parallel(action_form="factored")
