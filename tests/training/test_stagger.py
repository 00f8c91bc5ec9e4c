"""The first games of a run begin at different times, and the rated weights collect."""

import dataclasses

import numpy as np
import pytest

from marl_cair.games import GAMES
from marl_cair.games.torchrl_env import BatchedGameEnv
from marl_cair.training.collecting.stagger import stagger_starts
from marl_cair.training.run import TrainingRun
from marl_cair.training.settings.learner import LearnerSettings
from tests.training.runs import small, tiny

TICKS_PER_STEP = GAMES["deep_line_wars"].scenario("11x11").ticks_per_step


def start(num_worlds=64, num_steps=100, seed=3):
    env = BatchedGameEnv("deep_line_wars", "11x11", num_worlds, seed=5)
    env.reset()
    stagger_starts(env, num_steps, seed)
    return env


def test_games_begin_evenly_over_the_steps():
    ages = start().engine.state_dict()["world.tick"].ravel() / TICKS_PER_STEP
    assert ages.min() < 15
    assert 35 < np.median(ages) < 65
    assert 85 < ages.max() < 100


def test_equal_seeds_give_equal_games_and_others_differ():
    first, same, other = start(), start(), start(seed=4)
    for name, value in first.game_state()["engine"].items():
        assert np.array_equal(value, same.game_state()["engine"][name]), name
    assert np.array_equal(first.seeds.episodes, same.seeds.episodes)
    ages = [env.engine.state_dict()["world.tick"] for env in (first, other)]
    assert not np.array_equal(*ages)


def test_the_first_batch_is_of_the_staggered_games(tmp_path):
    config = tiny(tmp_path / "run")
    run = TrainingRun(config)
    shown = run.env.current()["player", "observation"].clone()
    first = next(iter(run.collector))["player", "observation"][:, 0]
    run.close()
    assert (first == shown).all()
    at_once = dataclasses.replace(config.collector, stagger_steps=0)
    run = TrainingRun(dataclasses.replace(config, out=str(tmp_path / "other"), collector=at_once))
    assert not run.env.engine.state_dict()["world.tick"].any()
    run.close()


@pytest.mark.parametrize("behaviour", ["averaged", "newest"])
def test_the_chosen_weights_collect(test_game, tmp_path, behaviour):
    run = TrainingRun(small(tmp_path, "duel", learner=LearnerSettings(behaviour=behaviour)))
    names = {"averaged": run.learner.average, "newest": run.learner.network}
    collecting, wanted = run.own.answer.network.parameters(), names[behaviour].parameters()
    for weight, other in zip(collecting, wanted, strict=True):
        assert weight is other
    run.close()
