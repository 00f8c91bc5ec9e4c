"""The environments of all libraries: common behaviour, and errors for wrong arguments."""

import dataclasses
import re
import sys

import gymnasium
import numpy as np
import pytest
import torch

from marl_cair.games import GAMES, make_engine
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.gymnasium_env import GameEnv, GameVectorEnv
from marl_cair.games.parallel_env import GameParallelEnv
from marl_cair.games.players.mixed_agent import MixedAgent
from marl_cair.games.torchrl_env import GROUP, BatchedGameEnv
from marl_cair.lookup import UnknownNameError
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


def test_an_engine_returns_fresh_arrays(game_name):
    """Later steps must not change arrays that were returned."""
    engine = make_engine(game_name, num_worlds=2)
    engine.reset(np.arange(2, dtype=np.uint64))
    shown = [*engine.info().values(), engine.action_mask(), engine.public_state(0)]
    shown += [engine.observe(name) for name in engine.spec.representations]
    assert len(shown) >= 4
    for array in shown:
        assert not any(np.shares_memory(array, field) for field in engine._worlds)


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


def test_where_the_learner_plays_alone_no_opponent_is_asked(monkeypatch):
    class NeverAsked(FirstLegalAgent):
        def act(self, observation, action_mask):
            pytest.fail("there is no other seat")

    env = GameEnv("flappy_bird", opponent=NeverAsked(), representation="vector")
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


@pytest.mark.parametrize("seat", ["1", 0.5, None, 2, -1])
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
    shown = f"is {number!r}, it must be at least 1, and a whole number"
    with refuses(f"deep_rts: num_envs {shown}"):
        GameVectorEnv("deep_rts", num_envs=number)
    with refuses(f"deep_rts: num_worlds {shown}"):
        BatchedGameEnv("deep_rts", num_worlds=number)
    with refuses(f"deep_rts: max_cycles {shown}"):
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


# --- names, modes and actions --------------------------------------------------------------------

MAKERS = (GameParallelEnv, GameEnv, GameVectorEnv, BatchedGameEnv)


@pytest.mark.parametrize("make", MAKERS)
def test_unknown_names_are_answered_with_the_nearest(game_name, make):
    misspelt = GAMES[game_name].default_scenario[:-1] + "6"
    for options, kind in (
        ({"scenario": misspelt}, f"scenario '{misspelt}': nearest are"),
        ({"representation": "plane"}, "representation 'plane': nearest are"),
        ({"max_tick": 5}, "option 'max_tick': nearest are 'max_ticks'"),
    ):
        with pytest.raises(UnknownNameError, match=re.escape(f"unknown {game_name} {kind}")):
            make(game_name, **options)
    with pytest.raises(UnknownNameError, match="unknown game 'deep_line_war': nearest are"):
        make("deep_line_war")
    if make in (GameEnv, GameVectorEnv):
        with pytest.raises(UnknownNameError, match=f"unknown {game_name} bot 'missing'"):
            make(game_name, opponent="missing")
    if make is not BatchedGameEnv:
        with refuses(f"{game_name}: render_mode is 'human', allowed are None and rgb_array"):
            make(game_name, render_mode="human")


def act(env, action):
    """A step in which the last seat (the learner, or player_<last>) plays `action`."""
    last, shape = env.engine.num_players - 1, (env.engine.num_worlds, env.engine.num_players)
    if isinstance(env, GameParallelEnv):
        return env.step(dict.fromkeys(env.possible_agents, 0) | {f"player_{last}": action})
    if isinstance(env, BatchedGameEnv):
        actions = torch.zeros(shape, dtype=torch.int64)
        actions[-1, last] = action
        return env._step(env.fake_tensordict().set((GROUP, "action"), actions))
    return env.step(action if isinstance(env, GameEnv) else np.array([0, action]))


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("action", [-1, 100_000, 2**32, 2**40])
def test_an_action_outside_the_space_names_player_and_world(game_name, make, action):
    worlds = {GameVectorEnv: {"num_envs": 2}, BatchedGameEnv: {"num_worlds": 2}}.get(make, {})
    engine = make_engine(game_name)
    last = engine.num_players - 1
    seat = {"seat": last} if make in (GameEnv, GameVectorEnv) else {}
    env = make(game_name, **worlds, **seat)
    env.reset()
    place = f"of player {last} in world {env.engine.num_worlds - 1}"
    with refuses(f"action {action} {place} is outside 0..{engine.num_actions - 1}"):
        act(env, action)


@pytest.mark.parametrize("make", MAKERS[:3])
def test_a_step_before_reset_is_refused(game_name, make):
    env = make(game_name, **({"num_envs": 2} if make is GameVectorEnv else {}))
    with pytest.raises(RuntimeError, match="step before reset"):
        act(env, env.engine.spec.noop_action)


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


# --- vector environments ---------------------------------------------------------------------


def make_vector(mode="NextStep", **options):
    env = GameVectorEnv("deep_line_wars", num_envs=3, autoreset_mode=mode, **options)
    env.reset(seed=0)
    return env


@pytest.mark.parametrize(
    ("actions", "described"),
    [
        (np.zeros(1, np.int64), "int64 [1]"),
        (np.int64(0), "int64 []"),
        (np.zeros(3), "float64 [3]"),
        (np.zeros((3, 2), np.int64), "int64 [3, 2]"),
    ],
)
def test_actions_of_a_wrong_shape_or_type_are_described(actions, described):
    with refuses(f"the learner's actions are {described}, they must be integers [3] (worlds)"):
        make_vector().step(actions)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            {"seed": [1, 2]},
            "seed is a list of 2, it must be one of 3 (worlds), or one whole number",
        ),
        ({"seed": [1, "a", 2]}, "seed is 'a', it must be a whole number"),
        ({"options": {"reset_mask": np.zeros(3, np.bool_)}}, "reset_mask has no world"),
        ({"options": {"reset_mask": np.ones(2, np.bool_)}}, "reset_mask is bool [2], it must be"),
        ({"options": {"reset_mask": np.ones(3)}}, "reset_mask is float64 [3], it must be bool [3]"),
    ],
)
def test_a_wrong_reset_is_described_and_changes_nothing(words, message):
    env = make_vector("Disabled")
    before = [seeds.state_dict() for seeds in env._table.seeds]
    with refuses(f"deep_line_wars: {message}"):
        env.reset(**words)
    assert [seeds.state_dict() for seeds in env._table.seeds] == before


def test_without_autoreset_an_ended_game_is_to_be_restarted_first():
    env = make_vector("Disabled", max_episode_steps=2)
    noops = np.full(3, env.engine.spec.noop_action)
    env.step(noops)
    env.reset(options={"reset_mask": np.array([False, True, False])})
    env.step(noops)
    message = "step where the games of the worlds [0, 2] have ended; call reset("
    with pytest.raises(RuntimeError, match=re.escape(message)):
        env.step(noops)


def test_unknown_modes_and_limits_of_a_vector_are_refused():
    with refuses("'sometimes' is not a valid AutoresetMode"):
        make_vector("sometimes")
    for limit in ("4", 0):
        with refuses(f"deep_line_wars: max_episode_steps is {limit!r}, it must be at least 1"):
            make_vector(max_episode_steps=limit)
