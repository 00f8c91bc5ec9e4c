"""Recurrent agents: how they are called, as opponents of Gymnasium's environments, in mixtures."""

import re

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from marl_cair.games.gymnasium_env import GameEnv, GameVectorEnv
from marl_cair.games.players.learner_seat import OpponentError
from marl_cair.games.players.mixed_agent import MixedAgent
from marl_cair.games.players.recurrent import call_agent, find_state_size, widen_states
from tests.games import last_standing
from tests.games.cases import FirstLegalAgent
from tests.games.last_standing import LEAVE, NOOP, SCORE
from tests.recurrent_agents import Counting, make_actor, require_ticks


class Answering(FirstLegalAgent):
    """Its next states are `answer`."""

    name, state_size = "answering", 2

    def __init__(self, answer):
        self.answer = answer

    def act(self, observation, action_mask, state):
        return action_mask.argmax(1), self.answer


@pytest.fixture
def test_game(monkeypatch):
    last_standing.register(monkeypatch)


def ask(agent, states, places, num_rows):
    rows = np.zeros((num_rows, 4), np.float32), np.ones((num_rows, 3), np.bool_)
    return call_agent(agent, states, places, *rows).tolist()


# --- how they are called -------------------------------------------------------------------------


def test_only_the_states_of_its_seats_change():
    states, agent = np.zeros((3, 2, 5), np.float32), Counting()
    seats = np.array([[True, False], [False, False], [True, True]])
    assert ask(agent, states, seats, 3) == [0, 0, 0]
    assert ask(agent, states, (np.array([2, 1]), 1), 2) == [1, 0]
    assert states[..., 0].tolist() == [[1, 0], [0, 1], [1, 2]]
    assert states[..., 1].tolist() == [[-3, 0], [0, -3], [-3, -6]]
    assert not states[..., 2:].any()


def test_an_agent_without_a_state_is_called_as_before():
    states = np.zeros((2, 0), np.float32)
    assert ask(FirstLegalAgent(), states, np.array([True, True]), 2) == [0, 0]


@pytest.mark.parametrize(
    ("answer", "cause"),
    [
        (np.zeros((2, 3)), "a state of shape [2, 3], it must be [2, 2]"),
        (np.zeros(2), "a state of shape [2], it must be [2, 2]"),
        (None, "a state of shape [], it must be [2, 2]"),
        ([[1.0, 2.0], [3.0, np.nan]], "a state that is not finite"),
        ([[1.0, 2.0], [3.0, 1e300]], "a state that is not finite"),
        ([[1.0, 2.0], [3.0, 10**400]], "a state that is no array of numbers"),
        ([[1.0, 2.0], [3.0]], "a state that is no array of numbers"),
        ("much", "a state that is no array of numbers"),
    ],
    ids=str,
)
def test_a_wrong_state_is_refused_and_changes_nothing(answer, cause):
    states = np.zeros((2, 2), np.float32)
    with pytest.raises(ValueError, match=re.escape(f"returned {cause}")):
        ask(Answering(answer), states, np.array([True, True]), 2)
    assert not states.any()


@pytest.mark.parametrize("size", [-1, 2.0, True, None, 70_000, "2"])
def test_a_wrong_state_size_is_refused_when_an_environment_is_made(size):
    agent = Counting()
    agent.state_size = size
    message = f"counting has the state_size {size!r}, it must be a whole number in 0..65536"
    with pytest.raises(ValueError, match=re.escape(message)):
        GameEnv("deep_line_wars", opponent=agent)
    agent.state_size = 3
    assert find_state_size(FirstLegalAgent(), agent) == 3
    assert find_state_size() == 0


def test_states_widen_with_zeros():
    states = np.ones((2, 3, 1), np.float32)
    wide = widen_states(states, 4)
    assert wide.tolist() == [[[1, 0, 0, 0]] * 3] * 2
    assert widen_states(wide, 2) is wide


# --- opponents of Gymnasium's environments -------------------------------------------------------


@pytest.mark.usefixtures("test_game")
@pytest.mark.parametrize("mode", list(AutoresetMode), ids=str)
def test_an_opponent_begins_each_game_of_each_world_with_a_fresh_state(mode):
    agent, luck = Counting(), np.random.default_rng(0)
    env = GameVectorEnv("last_standing", "ffa-3", num_envs=4, opponent=agent, autoreset_mode=mode)
    _, _ = env.reset(seed=0)
    ends = 0
    for _ in range(60):
        leaves = luck.random(4) < 0.2
        *_, terminated, truncated, _ = env.step(np.where(leaves, LEAVE, NOOP))
        over = terminated | truncated
        ends += int(over.sum())
        if mode == AutoresetMode.DISABLED and over.any():
            env.reset(options={"reset_mask": over})
    assert ends > 20
    assert require_ticks(agent) >= 60
    assert max(steps.max() for steps, _ in agent.calls) > 3


@pytest.mark.slow
@pytest.mark.parametrize("epsilon", [0.0, 0.3])
def test_a_recurrent_network_plays_in_many_worlds_as_in_one(epsilon):
    """Batches of one and of three, also where it explores with each world's own random stream."""
    options = {"representation": "vector", "max_ticks": 60, "scenario": "11x11"}

    def make_opponent():
        env = GameEnv("deep_line_wars", **options)
        return make_actor(env.observation_space.shape, env.engine.num_actions, epsilon=epsilon)

    env = GameVectorEnv("deep_line_wars", num_envs=3, opponent=make_opponent(), **options)
    singles = [GameEnv("deep_line_wars", opponent=make_opponent(), **options) for _ in range(3)]
    seen, _ = env.reset(seed=7)
    for world, single in enumerate(singles):
        np.testing.assert_array_equal(single.reset(seed=7 + world)[0], seen[world])
    luck, over = np.random.default_rng(1), np.zeros(3, np.bool_)
    for _ in range(40):
        masks = env.action_masks()
        actions = (luck.random(masks.shape) * masks).argmax(1)
        seen, _, terminated, truncated, _ = env.step(actions)
        for world, single in enumerate(singles):
            if over[world]:
                shown, _ = single.reset()
            else:
                shown, *_ = single.step(int(actions[world]))
            np.testing.assert_array_equal(shown, seen[world])
        over = terminated | truncated


def test_a_wrong_state_of_an_opponent_has_its_cause():
    env = GameEnv("deep_line_wars", opponent=Answering(np.zeros(2)))
    env.reset(seed=0)
    cause = "'answering', player 1 in world 0, crashed in act: ValueError: returned a state of"
    with pytest.raises(OpponentError, match=cause):
        env.step(0)


# --- mixtures ------------------------------------------------------------------------------------


class Long(Counting):
    """Another counting agent, with a larger state."""

    state_size = 4

    def act(self, observation, action_mask, state):
        assert (state[:, 2:] == 7 * state[:, :1]).all()
        actions, after = super().act(observation, action_mask, state[:, :2])
        return actions, np.concatenate([after, state[:, 2:] + 7], 1)


def test_members_of_a_mixture_have_states_of_their_own_sizes():
    members = Counting(), last_standing.Bot("scorer", SCORE), Long()
    members[1].representation = "vector"
    agent = MixedAgent(members, [1, 1, 1])
    assert agent.state_size == 4
    playing = np.array([0, 1, 2, 2, 0])
    rows = np.zeros((5, 4, 1, 1), np.float32), np.ones((5, 3), np.bool_)
    first, state = agent.act_as(playing, *rows, np.zeros((5, 4), np.float32))
    then, state = agent.act_as(playing, *rows, state)
    assert (first.tolist(), then.tolist()) == ([0, 1, 0, 0, 0], [1, 1, 1, 1, 1])
    short, long = [2, -6, 0, 0], [2, -6, 14, 14]
    assert state.tolist() == [short, [0] * 4, long, long, short]
    actions, after = agent.act(*rows, np.zeros((5, 4), np.float32))
    assert (actions.shape, after.shape) == ((5,), (5, 4))


@pytest.mark.usefixtures("test_game")
def test_a_mixture_is_an_opponent_whose_members_begin_each_game_with_a_fresh_state():
    members = Counting(), Long()
    env = GameVectorEnv("last_standing", "duel", num_envs=5, opponent=MixedAgent(members, [1, 1]))
    env.reset(seed=0)
    for _ in range(80):
        env.step(np.full(5, NOOP))
    for member in members:
        assert require_ticks(member) > 40
