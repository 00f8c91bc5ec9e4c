"""What the doors of all games have in common, and what they answer to wrong arguments."""

import dataclasses
import re
import sys

import gymnasium
import numpy as np
import pytest

from marl_cair.games import GAMES, make_engine
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.gymnasium_env import GameEnv, GameVectorEnv
from marl_cair.games.parallel_env import GameParallelEnv
from marl_cair.games.players.mixed_agent import MixedAgent
from marl_cair.games.torchrl_env import BatchedGameEnv
from tests.games import last_standing
from tests.games.cases import FirstLegalAgent

DUEL = "marl_cair/DeepRTS-1v1-15x15-v0"


def refuses(text: str):
    return pytest.raises(ValueError, match=re.escape(text))


# --- numbers of the game ---------------------------------------------------------------------


def test_numbers_of_a_games_own_are_given_for_each_seat(game_name):
    engine = make_engine(game_name, num_worlds=2)
    engine.reset(np.arange(2, dtype=np.uint64))
    for numbers in engine.info().values():
        assert numbers.shape == (2, engine.num_players)


def test_what_an_engine_tells_is_fresh_arrays(game_name):
    """It would else change with the worlds after it was told."""
    engine = make_engine(game_name, num_worlds=2)
    engine.reset(np.arange(2, dtype=np.uint64))
    told = [*engine.info().values(), engine.action_mask(), engine.public_state(0)]
    told += [engine.observe(name) for name in engine.spec.representations]
    assert len(told) >= 4
    for array in told:
        assert not any(np.shares_memory(array, field) for field in engine._worlds)


def test_pictures_are_shown_at_the_speed_of_the_game(game_name):
    env = GameEnv(game_name)
    spec = env.engine.spec
    speed = spec.ticks_per_second / spec.ticks_per_step
    assert env.metadata["render_fps"] == max(10, round(speed))


def test_pictures_are_shown_no_slower_than_ten_a_second():
    slower = {"pipe_gap": 200, "ticks_per_step": 2}
    for make in (GameEnv, GameVectorEnv, GameParallelEnv):
        assert make("flappy_bird", **slower).metadata["render_fps"] == 15
        assert make("flappy_bird").metadata["render_fps"] == 30
        assert make("deep_rts", ticks_per_step=100).metadata["render_fps"] == 10


# --- seeds -----------------------------------------------------------------------------------


def make_doors():
    return [
        GameParallelEnv("deep_line_wars"),
        GameEnv("deep_line_wars"),
        GameVectorEnv("deep_line_wars", num_envs=2),
        GameEnv("flappy_bird"),
    ]


@pytest.mark.parametrize("seed", [3, np.int64(3), np.uint8(3), np.array(3), -1])
def test_whole_numbers_of_any_type_are_seeds(seed):
    for env, other in zip(make_doors(), make_doors(), strict=True):
        env.reset(seed=seed)
        other.reset(seed=int(seed))
        np.testing.assert_array_equal(env.engine.observe("planes"), other.engine.observe("planes"))
    learned, again = (BatchedGameEnv("flappy_bird", seed=one) for one in (seed, int(seed)))
    first = again.reset()
    assert (learned.reset() == first).all()
    learned.set_seed(seed)
    assert (learned.reset() == first).all()


@pytest.mark.parametrize("seed", ["a", "3", (1, 2), 1.5, np.array([1, 2])], ids=str)
def test_what_is_no_whole_number_is_no_seed(seed):
    for env in make_doors():
        message = f"{env.engine.game.name}: seed is {seed!r}, it must be a whole number"
        with refuses(message):
            env.reset(seed=seed)
    with refuses(f"flappy_bird: seed is {seed!r}, it must be a whole number"):
        BatchedGameEnv("flappy_bird", seed=seed)
    with refuses(f"flappy_bird: seed is {seed!r}, it must be a whole number"):
        BatchedGameEnv("flappy_bird").set_seed(seed)
    bot = GAMES["deep_line_wars"].bot("random", GAMES["deep_line_wars"].scenario())
    for agent in (bot, MixedAgent([bot], [1.0], "random")):
        with refuses(f"random: seed is {seed!r}, it must be a whole number"):
            agent.seed(seed)


def test_a_mixture_takes_any_whole_number_for_its_seed():
    for seed in (np.int64(3), -1, 2**64 + 3):
        MixedAgent([FirstLegalAgent()], [1.0]).seed(seed)


def test_a_seed_seeds_the_vector_environment_too():
    env = GameVectorEnv("flappy_bird", num_envs=2)
    env.reset(seed=5)
    assert env.np_random_seed == 5
    first = env.np_random.random()
    env.reset(seed=5)
    assert env.np_random.random() == first


# --- seats and opponents ---------------------------------------------------------------------


def test_where_the_learner_plays_alone_nobody_else_is_asked(monkeypatch):
    class Nobody(FirstLegalAgent):
        def act(self, observation, action_mask):
            pytest.fail("there is no other seat")

    env = GameEnv("flappy_bird", opponent=Nobody(), representation="vector")
    env.reset(seed=0)
    looks = []
    seen = type(env.engine).observe
    monkeypatch.setattr(
        type(env.engine), "observe", lambda *words: looks.append(words[1]) or seen(*words)
    )
    env.step(0)
    assert looks == ["vector"]


def test_a_game_for_one_needs_no_bot(monkeypatch):
    alone = dataclasses.replace(
        last_standing.GAME, bots={}, scenarios={"one": last_standing.Scenario(num_players=1)}
    )
    monkeypatch.setattr(last_standing, "GAME", alone)
    monkeypatch.setitem(GAMES.modules, alone.name, sys.modules[last_standing.__name__])
    for opponent in ({}, {"opponent": None}):
        env = GameEnv(alone.name, "one", **opponent)
        env.reset(seed=0)
        env.step(last_standing.SCORE)
    with refuses(f"unknown {alone.name} bot 'greedy': known are 'random'"):
        GameEnv(alone.name, "one", opponent="greedy")


@pytest.mark.parametrize("make", [GameEnv, GameVectorEnv])
@pytest.mark.parametrize("opponent", [None, 5, len], ids=str)
def test_an_opponent_that_is_none_is_refused(make, opponent):
    message = f"deep_line_wars: opponent is {opponent!r}, it must be the name of a bot (known are "
    with refuses(message):
        make("deep_line_wars", opponent=opponent)


@pytest.mark.parametrize("seat", ["1", 0.5, None, 2])
def test_a_seat_that_is_none_is_refused(seat):
    with refuses(f"deep_line_wars: seat is {seat!r}, allowed are 0..1"):
        GameEnv("deep_line_wars", seat=seat)
    assert GameEnv("deep_line_wars", seat=np.int64(1)).reset(seed=0)


# --- numbers of worlds and decisions ---------------------------------------------------------


def test_one_world_is_not_made_several():
    message = "deep_rts: num_worlds is 4, this environment has 1; take"
    with refuses(f"{message} marl_cair.make_torchrl_env or make_engine for several"):
        GameParallelEnv("deep_rts", num_worlds=4)
    with refuses(f"{message} gymnasium.make_vec"):
        gymnasium.make(DUEL, num_worlds=4)
    with refuses("deep_rts: num_worlds is 4, this environment has 2; give num_envs"):
        gymnasium.make_vec(DUEL, 2, num_worlds=4)
    assert GameParallelEnv("deep_rts", num_worlds=1).engine.num_worlds == 1
    assert gymnasium.make_vec(DUEL, 2, num_worlds=2).num_envs == 2


@pytest.mark.parametrize("number", ["4", 4.5, 0])
def test_numbers_that_are_not_whole_are_refused_by_their_names(number):
    told = f"is {number!r}, it must be at least 1, and a whole number"
    with refuses(f"deep_rts: num_envs {told}"):
        GameVectorEnv("deep_rts", num_envs=number)
    with refuses(f"deep_rts: num_worlds {told}"):
        BatchedGameEnv("deep_rts", num_worlds=number)
    with refuses(f"deep_rts: max_cycles {told}"):
        GameParallelEnv("deep_rts", max_cycles=number)


def test_numpys_numbers_of_worlds_will_do():
    assert BatchedEngine(last_standing.GAME, last_standing.Scenario(), np.int64(2)).num_worlds == 2
    assert BatchedGameEnv("flappy_bird", num_worlds=np.int64(2)).batch_size == (2,)
    assert GameVectorEnv("flappy_bird", num_envs=np.int64(2)).num_envs == 2


def test_one_extra_representation_may_stand_alone():
    env = BatchedGameEnv("flappy_bird", extra_representations="vector", seed=0)
    assert env.key_of("vector") == "vector"


def test_a_refused_first_reset_of_some_worlds_draws_no_seeds():
    env = GameVectorEnv("deep_line_wars", num_envs=3, autoreset_mode="Disabled")
    with refuses("deep_line_wars: the engine begins with 1 of its 3 worlds"):
        env.reset(seed=1, options={"reset_mask": np.array([True, False, False])})
    assert not any(seeds.episodes[0] for seeds in env._table.seeds)
    env.reset(seed=1)
    env.reset(options={"reset_mask": np.array([True, False, False])})


# --- actions ---------------------------------------------------------------------------------


@pytest.mark.parametrize("action", [1.7, "0", None, np.array([1])], ids=str)
def test_an_action_that_is_no_whole_number_names_its_agent(action):
    env = GameParallelEnv("deep_line_wars")
    env.reset(seed=0)
    last = env.engine.num_actions - 1
    message = f"the action of player_1 is {action!r}, it must be a whole number in 0..{last}"
    with refuses(f"deep_line_wars: {message}"):
        env.step({"player_0": 0, "player_1": action})


def test_actions_may_be_numpys_numbers():
    env = GameParallelEnv("deep_line_wars")
    env.reset(seed=0)
    env.step({"player_0": np.int32(0), "player_1": np.array(0)})
