"""Engines and environments are copied, here and into other processes, and play on the same."""

import copy
import pickle
import subprocess
import sys
from types import MappingProxyType

import cloudpickle
import numpy as np
import pytest

from marl_cair.games import GAMES, make_engine
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.gymnasium_env import GameEnv, GameVectorEnv
from marl_cair.games.parallel_env import GameParallelEnv
from marl_cair.games.torchrl_env import BatchedGameEnv
from tests.games import last_standing
from tests.games.cases import Luck, play

COPIES = {
    "deepcopy": copy.deepcopy,
    "pickle": lambda held: pickle.loads(pickle.dumps(held)),  # noqa: S301  # its own
    "cloudpickle": lambda held: pickle.loads(cloudpickle.dumps(held)),  # noqa: S301  # its own
}

every_way = pytest.mark.parametrize("way", COPIES)


@every_way
@pytest.mark.parametrize("num_threads", [1, 2])
def test_a_copied_engine_goes_on_as_the_first_and_apart_from_it(game_name, way, num_threads):
    engine = make_engine(game_name, num_worlds=3, num_threads=num_threads)
    engine.reset(np.arange(3, dtype=np.uint64))
    play(engine, Luck.draw(3, 3, engine.num_players))
    engine.observe_in_place("planes")
    copied = COPIES[way](engine)
    assert copied.game is engine.game
    assert copied.num_threads == num_threads
    luck = Luck.draw(3, 3, engine.num_players, seed=1)
    assert play(copied, luck) == play(engine, luck)
    copied.reset(np.arange(3, 6, dtype=np.uint64))
    assert play(copied, luck) != play(engine, luck)


def test_the_copy_of_an_engine_that_has_not_begun_has_not_either():
    copied = copy.deepcopy(make_engine("flappy_bird"))
    with pytest.raises(RuntimeError, match="step before reset"):
        copied.step(np.zeros((1, 1), np.int32))


def look(env, shown):
    """All that an environment shows: numbers of observations, rewards and infos."""
    parts = [np.asarray(part).tobytes() for part in shown[:-1]]
    return [*parts, env.engine.observe("planes").tobytes()]


@every_way
@pytest.mark.parametrize("make", [GameEnv, GameVectorEnv])
def test_a_copied_gymnasium_environment_goes_on_as_the_first(game_name, way, make):
    """With its opponent, whose luck is copied too."""
    env = make(game_name)
    env.reset(seed=3)
    noop = env.engine.spec.noop_action
    action = noop if make is GameEnv else np.array([noop])
    env.step(action)
    copied = COPIES[way](env)
    for _ in range(5):
        assert look(copied, copied.step(action)) == look(env, env.step(action))


@every_way
def test_a_copied_pettingzoo_environment_goes_on_as_the_first(game_name, way):
    env = GameParallelEnv(game_name)
    env.reset(seed=3)
    copied = COPIES[way](env)
    for one in (env, copied):
        one.step(dict.fromkeys(one.agents, 1))
        one.reset()
    np.testing.assert_array_equal(copied.state(), env.state())


def test_a_copied_torchrl_environment_goes_on_as_the_first():
    env = BatchedGameEnv("flappy_bird", num_worlds=2, num_threads=2, seed=0)
    env.reset()
    copied = copy.deepcopy(env)
    assert (copied.reset() == env.reset()).all()


GO_ON = """
import pickle, sys
engine = pickle.load(sys.stdin.buffer)
from tests.games.cases import Luck, play
print(*play(engine, Luck.draw(5, 2, engine.num_players)))
"""


@pytest.mark.slow
def test_an_engine_goes_on_in_another_process_as_here():
    """Vector environments send it there; the other process has the game by its name."""
    engine = make_engine("flappy_bird", num_worlds=2, num_threads=2)
    engine.reset(np.arange(2, dtype=np.uint64))
    sent = pickle.dumps(engine)
    assert b"MappingProxy" not in sent
    done = subprocess.run(
        [sys.executable, "-c", GO_ON], input=sent, capture_output=True, check=True
    )
    assert done.stdout.decode().split() == play(engine, Luck.draw(5, 2, 1))


def test_a_game_that_has_no_name_in_games_is_sent_whole():
    game = last_standing.GAME
    assert game.name not in GAMES
    engine = BatchedEngine(game, game.scenario("ffa-3"), 2)
    engine.reset(np.arange(2, dtype=np.uint64))
    copied, luck = COPIES["cloudpickle"](engine), Luck.draw(3, 2, 3)
    assert play(copied, luck) == play(engine, luck)


def test_games_and_specs_are_their_own_deep_copies(game_name):
    game = GAMES[game_name]
    spec = game.make_spec(game.scenario())
    assert isinstance(game.scenarios, MappingProxyType)
    assert copy.deepcopy([game, spec]) == [game, spec]
    assert copy.deepcopy(spec) is spec
    assert pickle.loads(pickle.dumps(game)) is game  # noqa: S301  # its own
