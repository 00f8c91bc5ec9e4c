"""The perfect generator of the study of generated data, beside the engine of Deep Maze."""

import numpy as np
import pytest
import torch

from benchmarks._perfect_maze import PerfectMazeGenerator
from marl_cair import make_engine
from marl_cair.games.deep_maze.observation import TIME_LEFT
from marl_cair.games.randomness import episode_seeds
from marl_cair.generative.settings import GeneratorConfig, GeneratorSpec
from tests.generative.plane_game import pack_rows

NUM_WORLDS, NUM_MOVES = 64, 500


@pytest.fixture(scope="module")
def rows():
    """Real transitions of random legal moves, with a hundred mazes solved or more."""
    engine = make_engine("deep_maze", "7x7-stochastic", num_worlds=NUM_WORLDS)
    random, worlds = np.random.default_rng(0), np.arange(NUM_WORLDS)
    episodes, steps = np.zeros(NUM_WORLDS, np.int64), []
    engine.reset(episode_seeds(0, worlds, episodes))
    for _ in range(NUM_MOVES):
        now, mask = engine.observe("planes").copy(), engine.action_mask().copy()
        actions = np.where(mask, random.random(mask.shape), -1.0).argmax(-1)
        engine.step(actions.astype(np.int32))
        later, next_mask = engine.observe("planes").copy(), engine.action_mask().copy()
        arrays = now, actions, later, engine.rewards.copy(), engine.terminated[:, None].copy()
        masks = torch.from_numpy(mask[:, 0]), torch.from_numpy(next_mask[:, 0])
        steps.append(pack_rows(*(torch.from_numpy(array)[:, 0] for array in arrays), masks))
        done = engine.terminated | engine.truncated
        steps[-1] = steps[-1][~torch.from_numpy(engine.truncated)]
        episodes[done] += 1
        engine.reset(episode_seeds(0, worlds, episodes), done)
    found = torch.cat(steps)
    found["index"] = torch.arange(len(found))
    assert found["next", "terminated"].sum() >= 100
    return found


def make(rows):
    shape, num_actions = tuple(rows["observation"].shape[1:]), rows["action_mask"].shape[1]
    spec = GeneratorSpec(shape, num_actions, num_uniform=4, noop_action=num_actions - 1)
    generator = PerfectMazeGenerator(GeneratorConfig(), spec)
    generator.observe(rows)
    generator.evaluate()
    return generator


def test_its_transitions_are_those_of_the_engine(rows):
    made, accepted = make(rows).predict(rows)
    assert accepted.all()
    for key in ("reward", "terminated", "action_mask"):
        torch.testing.assert_close(made["next", key], rows["next", key])
    guess, real = made["next", "observation"].int(), rows["next", "observation"].int()
    for planes in (guess, real):
        planes[:, TIME_LEFT] -= rows["observation"][:, TIME_LEFT].int()
    falls = [float(-planes[:, TIME_LEFT].float().mean()) for planes in (guess, real)]
    assert falls[0] == pytest.approx(falls[1], abs=0.02)
    guess[:, TIME_LEFT] = real[:, TIME_LEFT] = 0
    torch.testing.assert_close(guess, real)


def test_it_generates_other_legal_actions_once_its_gate_is_open(rows):
    generator = make(rows)
    made = generator.generate(rows, 1000)
    assert len(made) == 1000
    assert made["is_generated"].all()
    assert made["action_mask"].gather(1, made["action"][:, None]).all()
    assert len(make(rows[:100]).generate(rows, 10)) == 0


def test_it_refuses_other_observations():
    spec = GeneratorSpec((3, 9, 9), 5, num_uniform=0, noop_action=4)
    with pytest.raises(ValueError, match=r"\(3, 9, 9\).*game=deep_maze"):
        PerfectMazeGenerator(GeneratorConfig(), spec)
