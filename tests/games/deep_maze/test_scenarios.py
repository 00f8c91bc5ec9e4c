"""Scenarios that are named can be played, and settings that cannot be are refused in words."""

import dataclasses
import re

import numpy as np
import pytest

from marl_cair.games import GAMES, make_engine
from marl_cair.games.checks.scenario import change_scenario
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


CHASE = {"num_players": 2, "contest": "chase"}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"rows": 4}, "rows is 4, it must be a whole number in 5..127"),
        ({"columns": 128}, "columns is 128, it must be a whole number in 5..127"),
        ({"rows": 9.0}, "rows is 9.0, it must be a whole number in 5..127"),
        ({"density": 1.5, "generator": "growth"}, "density is 1.5, it must be a number in 0..1"),
        ({"complexity": "a"}, "complexity is 'a', it must be a number in 0..1"),
        ({"density": 0.5}, "density is 0.5, but generator='prim' does not use it; leave it at 1.0"),
        ({"num_players": 0}, "num_players is 0, it must be a whole number in 1..4"),
        ({"num_players": 5}, "num_players is 5, it must be a whole number in 1..4"),
        ({"contest": "chase"}, "the contest chase needs 2 to 4 players, num_players is 1"),
        ({"vision": 0}, "vision is 0, it must be a whole number in 1..127"),
        ({"preview_moves": 5}, "preview_moves is 5, but visibility='full' does not use it"),
        ({"vision": 5}, "vision is 5, but visibility='full' does not use it; leave it at 3"),
        ({"remembers": False}, "remembers is False, but visibility='full' does not use it"),
        (
            {"maze_seed": 5},
            "maze_seed is 5, but mode='stochastic' does not use it; leave it at",
        ),
        ({"mode": "sequence"}, "the mode sequence needs num_mazes of at least 2, it is 1"),
        ({"num_mazes": 3}, "num_mazes is 3, but the mode stochastic plays one maze"),
        (
            {"mode": "sequence", "num_mazes": 2, "num_players": 2},
            "the mode sequence is for 1",
        ),
        (
            {"reward": "beyond_optimal", "num_players": 2},
            "the reward beyond_optimal is for 1",
        ),
        ({"reward": "distance", **CHASE}, "the reward distance does not fit the hunter of a chase"),
        ({"places": "corners", **CHASE}, "all players of a chase would start in one corner"),
        ({"shaping_discount": 0.0}, "shaping_discount is 0.0, it must be above 0 and at most 1"),
        ({"mask_walls": 1}, "mask_walls is 1, it must be True or False"),
        ({"remembers": "no"}, "remembers is 'no', it must be True or False"),
        ({"max_ticks": -1}, "max_ticks is -1, it must be a whole number in 0..1000000"),
        ({"maze_seed": -1}, "maze_seed is -1, it must be a whole number in 0.."),
        ({"cell_pixels": 33}, "cell_pixels is 33, it must be a whole number in 0..32"),
    ],
)
def test_settings_that_cannot_be_played_are_refused(options, message):
    with pytest.raises(ValueError, match=re.escape(f"deep_maze: {message}")):
        Scenario(**options)


@pytest.mark.parametrize(
    ("option", "value", "nearest"),
    [
        ("generator", "prims", "prim"),
        ("mode", "stochastik", "stochastic"),
        ("visibility", "sqare", "square"),
        ("contest", "races", "race"),
        ("reward", "clasic", "classic"),
        ("places", "corner", "corners"),
    ],
)
def test_unknown_names_are_answered_with_the_nearest(option, value, nearest):
    with pytest.raises(UnknownNameError, match=f"deep_maze {option} '{value}'.*'{nearest}'"):
        Scenario(**{option: value})


# --- the time limit ------------------------------------------------------------------------------

LIMITS = {7: 200, 9: 300, 11: 400, 13: 500, 15: 600, 19: 800, 25: 1_000, 35: 2_000, 55: 5_000}


@pytest.mark.parametrize(("size", "limit"), LIMITS.items())
def test_named_scenarios_have_the_time_limit_of_their_size(size, limit):
    named = {name: one for name, one in SCENARIOS.items() if one.rows == size}
    assert len(named) >= 3
    for name, scenario in named.items():
        assert scenario.max_ticks == limit * (3 if "sequence" in name else 1), name


@pytest.mark.parametrize(
    ("options", "limit"),
    [
        ({"rows": 5, "columns": 5}, 200),
        ({"rows": 8, "columns": 8}, 247),  # 64 cells of 49 to 81
        ({"rows": 45, "columns": 45}, 3_333),  # 2,025 cells of 1,225 to 3,025
        ({"rows": 55, "columns": 55}, 5_000),
        ({"rows": 127, "columns": 127}, 26_660),
        ({"rows": 9, "columns": 25}, 600),  # as many cells as 15x15
        ({"rows": 55, "columns": 55, "max_ticks": 0}, 5_000),
        ({"rows": 55, "columns": 55, "max_ticks": 300}, 300),
        ({"mode": "sequence", "num_mazes": 10}, 3_000),
        ({"mode": "sequence", "num_mazes": 100, "rows": 127, "columns": 127}, 1_000_000),
    ],
)
def test_the_time_limit_follows_the_board_unless_it_is_given(options, limit):
    engine = make_engine("deep_maze", **options)
    assert engine.scenario.max_ticks == engine.spec.max_ticks == limit
    assert engine.spec.representations["vector"].high[12] == limit


def test_a_time_limit_of_ones_own_stays_when_the_board_changes():
    assert make_engine("deep_maze", "25x25-stochastic", rows=55).spec.max_ticks == 2_250
    own = dataclasses.replace(SCENARIOS["25x25-stochastic"], max_ticks=77)
    assert change_scenario("deep_maze", own, {"rows": 55}).max_ticks == 77


def test_a_scenario_is_made_again_from_its_fields():
    """As agents and leagues keep them; those from before the limit followed the board too."""
    for scenario in SCENARIOS.values():
        assert GAMES["deep_maze"].scenario(None, **dataclasses.asdict(scenario)) == scenario
    fields = dataclasses.asdict(SCENARIOS["9x9-stochastic"]) | {"rows": 55, "columns": 55}
    assert GAMES["deep_maze"].scenario("9x9-stochastic", **fields).max_ticks == 300


@pytest.mark.slow
def test_the_time_limit_is_above_the_number_of_cells_of_any_board():
    """No shortest way has more moves, whatever the maze."""
    for rows in range(5, 128):
        for columns in range(5, 128):
            scenario = Scenario(rows=rows, columns=columns)
            assert scenario.max_ticks > scenario.num_cells


@pytest.mark.parametrize("generator", ["prim", "growth"])
@pytest.mark.parametrize("size", [55, 90, 127])
def test_every_shortest_way_of_a_large_board_can_be_gone_in_time(size, generator):
    engine = make_engine("deep_maze", rows=size, columns=size, generator=generator)
    for seed in range(3):
        engine.reset(seed)
        assert 50 < engine._worlds.distance.max() < engine.spec.max_ticks


@pytest.mark.parametrize(
    ("scenario", "pays"),
    [
        ("9x9-stochastic", "+1 at the goal, -0.01 a move"),
        ("15x15-race-3p", "+1 win, -1 loss, -0.01 a move"),
        ("15x15-chase-3p", "+1 win, -1 loss, -0.01 a move of the hunter"),
    ],
)
def test_the_spec_describes_the_rewards(scenario, pays):
    engine = make_engine("deep_maze", scenario)
    assert engine.spec.pays == pays
    engine.reset(0)
    engine.step(np.full((1, engine.num_players), 4))
    own, *others = engine.rewards[0].tolist()
    assert own == pytest.approx(-0.01)
    assert others == pytest.approx([0.0 if "chase" in scenario else -0.01] * len(others))


@pytest.mark.parametrize("reward", ["classic", "beyond_optimal", "distance"])
def test_no_reward_is_larger_than_its_bound(reward):
    assert GAMES["deep_maze"].rated_reward == "classic"
    engine = make_engine("deep_maze", "9x9-sequence", reward=reward, max_ticks=200)
    rng = np.random.default_rng(0)
    for seed in range(3):
        engine.reset(seed)
        for _ in range(200):
            engine.step(rng.integers(5, size=(1, 1)))
            assert abs(engine.rewards[0, 0]) <= engine.spec.reward_bound
