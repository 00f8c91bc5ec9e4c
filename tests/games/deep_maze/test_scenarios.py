"""Scenarios that are named can be played, and settings that cannot be are refused in words."""

import re

import numpy as np
import pytest

from marl_cair.games import GAMES, make_engine
from marl_cair.games.deep_maze.scenarios import SCENARIOS, Scenario
from marl_cair.lookup import UnknownNameError

pytestmark = pytest.mark.plain_python


def test_the_thesiss_sizes_are_there_in_all_modes():
    for size in (7, 9, 11, 13, 15, 19, 25, 35, 55):
        for mode in ("deterministic", "full_deterministic", "stochastic"):
            scenario = SCENARIOS[f"{size}x{size}-{mode}"]
            assert (scenario.rows, scenario.columns, scenario.mode) == (size, size, mode)


@pytest.mark.parametrize("size", [5, 6, 8, 10, 33, 54, 55])
@pytest.mark.parametrize("generator", ["prim", "growth"])
def test_any_size_can_be_played(size, generator):
    engine = make_engine("deep_maze", rows=size, columns=size + 1, generator=generator)
    engine.reset(1)
    engine.step(np.array([[4]]))
    assert engine.observe("classic").shape == (1, 1, 1, size, size + 1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rows": 4}, "rows is 4, it must be a whole number in 5..127"),
        ({"columns": 128}, "columns is 128, it must be a whole number in 5..127"),
        ({"rows": 9.0}, "rows is 9.0, it must be a whole number in 5..127"),
        ({"density": 1.5, "generator": "growth"}, "density is 1.5, it must be a number in 0..1"),
        ({"complexity": "a"}, "complexity is 'a', it must be a number in 0..1"),
        ({"density": 0.5}, "density is 0.5, but the generator prim has no density; leave it at"),
        ({"num_players": 0}, "num_players is 0, it must be a whole number in 1..4"),
        ({"num_players": 5}, "num_players is 5, it must be a whole number in 1..4"),
        ({"contest": "chase"}, "the contest chase needs 2 to 4 players, num_players is 1"),
        ({"vision": 0}, "vision is 0, it must be a whole number in 1..127"),
        ({"preview_moves": 5}, "preview_moves is 5, but the visibility is full all the time"),
        ({"mode": "sequence"}, "the mode sequence needs num_mazes of at least 2, it is 1"),
        ({"num_mazes": 3}, "num_mazes is 3, but the mode stochastic plays one maze"),
        (
            {"mode": "sequence", "num_mazes": 2, "num_players": 2},
            "the mode sequence is for 1 player, num_players is 2",
        ),
        (
            {"reward": "beyond_optimal", "num_players": 2},
            (
                "the reward beyond_optimal is for 1 player, num_players is 2; choose 'classic' or "
                "'distance'"
            ),
        ),
        (
            {"reward": "distance", "num_players": 2, "contest": "chase"},
            "the reward distance leads everybody to the goal",
        ),
        (
            {"places": "corners", "num_players": 2, "contest": "chase"},
            "a chase cannot start in the corners",
        ),
        ({"shaping_discount": 0.0}, "shaping_discount is 0.0, it must be above 0 and at most 1"),
        ({"mask_walls": 1}, "mask_walls is 1, it must be True or False"),
        ({"remembers": "no"}, "remembers is 'no', it must be True or False"),
        ({"max_ticks": 0}, "max_ticks is 0, it must be a whole number in 1..1000000"),
        ({"maze_seed": -1}, "maze_seed is -1, it must be a whole number in 0.."),
        ({"cell_pixels": 33}, "cell_pixels is 33, it must be a whole number in 0..32"),
    ],
)
def test_what_cannot_be_played_is_refused(options, message):
    with pytest.raises(ValueError, match=re.escape(f"deep_maze: {message}")):
        Scenario(**options)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"generator": "prims"}, "unknown deep_maze generator 'prims': nearest are 'prim'"),
        ({"mode": "static"}, "unknown deep_maze mode 'static'"),
        ({"visibility": "sqare"}, "unknown deep_maze visibility 'sqare': nearest are 'square'"),
        ({"contest": "races"}, "unknown deep_maze contest 'races': nearest are 'race'"),
        ({"reward": "clasic"}, "unknown deep_maze reward 'clasic': nearest are 'classic'"),
        ({"places": "corner"}, "unknown deep_maze places 'corner': nearest are 'corners'"),
    ],
)
def test_unknown_names_are_answered(options, message):
    with pytest.raises(UnknownNameError, match=re.escape(message)):
        Scenario(**options)


def test_the_first_reward_rates_play():
    assert GAMES["deep_maze"].rated_reward == "classic"


@pytest.mark.parametrize("reward", ["classic", "beyond_optimal", "distance"])
def test_no_reward_is_larger_than_its_bound(reward):
    engine = make_engine("deep_maze", "9x9-sequence", reward=reward, max_ticks=200)
    rng = np.random.default_rng(0)
    for seed in range(3):
        engine.reset(seed)
        for _ in range(200):
            engine.step(rng.integers(5, size=(1, 1)))
            assert abs(engine.rewards[0, 0]) <= engine.spec.reward_bound
