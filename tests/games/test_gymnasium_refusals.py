"""Gymnasium environments refuse bad input with an error that says what is allowed."""

import re

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from marl_cair.games.gymnasium_env import GameEnv, GameVectorEnv
from marl_cair.lookup import UnknownNameError
from tests.games.cases import FirstLegalAgent
from tests.games.test_gymnasium_env import NUM_WORLDS, make_single, make_vector, seat_of


@pytest.mark.parametrize("which_seat", ["before the first", "behind the last"])
def test_a_seat_that_does_not_exist_is_refused(game_name, which_seat):
    last = seat_of(game_name, "last")
    seat = -1 if which_seat == "before the first" else last + 1
    message = re.escape(f"{game_name}: seat is {seat}, allowed are 0..{last}")
    with pytest.raises(ValueError, match=message):
        make_single(game_name, seat=seat)


@pytest.mark.parametrize("make", [GameEnv, GameVectorEnv])
def test_unknown_names_are_answered(game_name, make):
    agent = FirstLegalAgent()
    with pytest.raises(UnknownNameError, match=f"unknown {game_name} bot 'nobody'"):
        make(game_name, opponent="nobody")
    with pytest.raises(UnknownNameError, match=f"unknown {game_name} representation 'plane'"):
        make(game_name, opponent=agent, representation="plane")
    with pytest.raises(UnknownNameError, match=f"unknown {game_name} option 'max_tick'"):
        make(game_name, opponent=agent, max_tick=3)
    with pytest.raises(ValueError, match="render_mode is 'human', allowed are None and rgb_array"):
        make(game_name, opponent=agent, render_mode="human")


@pytest.mark.parametrize("action", [-1, 100_000, 2**32])
def test_an_action_outside_the_space_is_refused(game_name, action):
    env = make_single(game_name)
    env.reset(seed=0)
    message = f"action {action} of player 0 in world 0 is outside 0..{env.engine.num_actions - 1}"
    with pytest.raises(ValueError, match=message):
        env.step(action)


@pytest.mark.parametrize(
    ("actions", "described"),
    [
        (np.zeros(1, np.int64), "int64 [1]"),
        (np.int64(0), "int64 []"),
        (np.zeros(NUM_WORLDS), "float64 [3]"),
        (np.zeros((NUM_WORLDS, 2), np.int64), "int64 [3, 2]"),
    ],
)
def test_actions_of_a_wrong_shape_or_type_are_described(game_name, actions, described):
    env = make_vector(game_name, AutoresetMode.NEXT_STEP)
    env.reset(seed=0)
    message = f"the learner's actions are {described}, they must be integers [3] (worlds)"
    with pytest.raises(ValueError, match=re.escape(message)):
        env.step(actions)


def test_a_step_before_reset_is_refused(game_name):
    with pytest.raises(RuntimeError, match="step before reset"):
        make_single(game_name).step(0)


def test_seeds_that_are_not_one_for_each_world_are_refused(game_name):
    env = make_vector(game_name, AutoresetMode.NEXT_STEP)
    message = f"{game_name}: seed is a list of 2, it must be one of 3 (worlds), or one whole number"
    with pytest.raises(ValueError, match=re.escape(message)):
        env.reset(seed=[1, 2])
    with pytest.raises(ValueError, match=f"{game_name}: seed is 'a', it must be a whole number"):
        env.reset(seed=[1, "a", 2])


def test_a_reset_mask_without_a_world_is_refused(game_name):
    env = make_vector(game_name, AutoresetMode.DISABLED)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=f"{game_name}: reset_mask has no world"):
        env.reset(options={"reset_mask": np.zeros(NUM_WORLDS, np.bool_)})


def test_without_autoreset_an_ended_game_is_to_be_restarted_first(game_name):
    env = make_vector(game_name, AutoresetMode.DISABLED, max_episode_steps=2)
    env.reset(seed=0)
    noops = np.full(NUM_WORLDS, env.engine.spec.noop_action)
    env.step(noops)
    env.reset(options={"reset_mask": np.array([False, True, False])})
    env.step(noops)
    message = f"{game_name}: step where the games of the worlds [0, 2] have ended; call reset("
    with pytest.raises(RuntimeError, match=re.escape(message)):
        env.step(noops)


@pytest.mark.parametrize("limit", ["4", 0])
def test_a_limit_of_decisions_that_is_none_is_refused(game_name, limit):
    message = f"{game_name}: max_episode_steps is {limit!r}, it must be at least 1"
    with pytest.raises(ValueError, match=re.escape(message)):
        make_vector(game_name, AutoresetMode.NEXT_STEP, max_episode_steps=limit)


@pytest.mark.parametrize(
    ("mask", "described"), [(np.ones(2, np.bool_), "bool [2]"), (np.ones(3), "float64 [3]")]
)
def test_a_wrong_reset_mask_is_described(game_name, mask, described):
    env = make_vector(game_name, AutoresetMode.DISABLED)
    env.reset(seed=0)
    before = [seeds.state_dict() for seeds in env._table.seeds]
    message = f"{game_name}: reset_mask is {described}, it must be bool [3] (worlds)"
    with pytest.raises(ValueError, match=re.escape(message)):
        env.reset(options={"reset_mask": mask})
    assert [seeds.state_dict() for seeds in env._table.seeds] == before


def test_an_unknown_autoreset_mode_is_refused(game_name):
    with pytest.raises(ValueError, match="'sometimes' is not a valid AutoresetMode"):
        make_vector(game_name, "sometimes")
