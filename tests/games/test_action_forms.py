"""The forms of actions: numbers and masks of the factored form, and environments with it."""

import dataclasses
import re
import warnings

import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

from marl_cair.games import GAMES, make_engine
from marl_cair.games.action_forms import (
    ContinuousActions,
    FactoredActions,
    FlatActions,
    make_action_form,
)
from marl_cair.games.game import NO_CELL
from marl_cair.games.gymnasium_env import GameEnv, GameVectorEnv
from marl_cair.games.parallel_env import GameParallelEnv
from marl_cair.lookup import UnknownNameError
from tests.games.cases import FirstLegalAgent, Luck, choose_actions, ticks_of

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # it imports games of its own the old way
    from pettingzoo.test import parallel_api_test, parallel_seed_test

MAX_TICKS = 200
GRID = (2, 3)  # an action shape


@pytest.fixture
def spec():
    """Seven actions: three without a cell, two kinds on the cells of a board of 2x3."""
    game = GAMES["deep_line_wars"]
    whole = game.make_spec(game.scenario())
    planes = dataclasses.replace(whole.representations["planes"], shape=(1, 2, 3))
    return dataclasses.replace(
        whole,
        action_names=("noop", "stop", "go_0", "go_1", "go_5", "hit_4", "hit_5"),
        action_groups=np.array([0, 1, 2, 2, 2, 3, 3], np.int16),
        action_group_names=("noop", "stop", "go", "hit"),
        action_cells=np.array([NO_CELL, NO_CELL, 0, 1, 5, 4, 5], np.int32),
        noop_action=0,
        representations={"planes": planes},
    )


# --- the factored form ---------------------------------------------------------------------------


def test_kind_and_cell_name_the_flat_action(spec):
    form = FactoredActions("toy", spec)
    assert form.sizes.tolist() == [4, 6]
    every = np.indices((4, 6)).reshape(2, -1).T
    expected = [[0] * 6, [1] * 6, [2, 3, 0, 0, 0, 4], [0, 0, 0, 0, 5, 6]]
    np.testing.assert_array_equal(form.to_engine(every, 0), np.ravel(expected))


def test_the_mask_has_cells_given_the_kind(spec):
    form = FactoredActions("toy", spec)
    flat = np.array([[1, 0, 1, 0, 1, 1, 0], [1, 1, 0, 0, 0, 0, 0]], np.bool_)
    mask = form.shape_mask(flat)
    assert mask.dtype == np.int8
    assert mask.tolist() == [
        [[1] * 6, [0] * 6, [1, 0, 0, 0, 0, 1], [0, 0, 0, 0, 1, 0]],
        [[1] * 6, [1] * 6, [0] * 6, [0] * 6],
    ]
    assert mask.any(axis=-1).tolist() == [[True, False, True, True], [True, True, False, False]]


def test_draws_are_legal_and_reach_everything(spec):
    form = FactoredActions("toy", spec)
    mask = form.shape_mask(np.array([1, 0, 1, 0, 1, 1, 0], np.bool_))
    rng = np.random.default_rng(0)
    drawn = np.array([form.draw(mask, rng) for _ in range(600)])
    assert mask[drawn[:, 0], drawn[:, 1]].all()
    assert {tuple(pair) for pair in drawn.tolist()} == {
        tuple(pair) for pair in np.argwhere(mask).tolist()
    }
    kinds = np.bincount(drawn[:, 0])
    assert kinds[[0, 2, 3]].min() > 150  # a kind with more cells is not drawn more often


def test_without_cells_there_is_one(spec):
    plain = dataclasses.replace(
        spec,
        action_names=("noop", "stop"),
        action_groups=np.array([0, 1], np.int16),
        action_group_names=("noop", "stop"),
        action_cells=np.full(2, NO_CELL, np.int32),
    )
    form = FactoredActions("toy", plain)
    assert form.mask_shape == (2, 1)
    assert form.to_engine(np.array([[1, 0]]), 0).tolist() == [1]


def test_every_action_of_every_scenario_has_its_kind_and_cell(case):
    spec = case.engine().spec
    if spec.action_shape:
        shape = re.escape(f"{case.game}: actions of shape {list(spec.action_shape)}")
        with pytest.raises(ValueError, match=f"{shape} cannot .* MultiDiscrete as they are"):
            FactoredActions(case.game, spec)
        return
    form = FactoredActions(case.game, spec)
    every = np.indices(form.mask_shape).reshape(2, -1).T
    actions = form.to_engine(every, 0)
    assert set(actions.tolist()) == set(range(spec.num_actions))
    legal = form.shape_mask(np.ones(spec.num_actions, np.bool_)).ravel() == 1
    np.testing.assert_array_equal(spec.action_groups[actions[legal]], every[legal, 0])
    assert (actions[~legal] == spec.noop_action).all()


@pytest.mark.parametrize(
    "change",
    [{"action_cells": [-1, -1, 0, 0, 5, 4, 5]}, {"action_groups": [0, 0, 2, 2, 2, 3, 3]}],
    ids=str,
)
def test_kinds_with_several_actions_at_one_place_are_refused(spec, change):
    wrong = dataclasses.replace(spec, **{name: np.array(v) for name, v in change.items()})
    with pytest.raises(ValueError, match="toy: actions cannot be factored by kind and cell, the"):
        FactoredActions("toy", wrong)


@pytest.mark.parametrize(
    ("action", "named"), [([4, 0], "kind 4"), ([-1, 0], "kind -1"), ([0, 6], "cell 6")]
)
def test_numbers_outside_name_player_and_world(spec, action, named):
    last = 3 if "kind" in named else 5
    message = f"toy: the {named} of player 1 in world 2 is outside 0..{last}"
    with pytest.raises(ValueError, match=re.escape(message)):
        FactoredActions("toy", spec).to_engine(np.array([[0, 0], [1, 1], action]), 1)


def test_an_unknown_form_is_answered_with_the_nearest(spec):
    with pytest.raises(UnknownNameError, match="unknown toy action form 'factor': nearest are"):
        make_action_form("factor", "toy", spec)
    with pytest.raises(UnknownNameError, match="unknown deep_line_wars action form"):
        GameParallelEnv("deep_line_wars", action_form="multi")


# --- the continuous form --------------------------------------------------------------------------


def test_a_point_names_kind_row_and_column(spec):
    form = ContinuousActions("toy", spec)
    assert form.mask_shape == (4, 6)
    points = [[-1, 0.3, 0.3], [-0.3, -1, 1], [0.1, -0.1, -1], [0.1, 1, 1], [1, 1, 0.2], [1, -1, 0]]
    expected = [0, 1, 2, 4, 5, 0]
    np.testing.assert_array_equal(form.to_engine(np.array(points), 0), expected)


def test_drawn_points_are_legal_and_reach_everything(spec):
    form, rng = ContinuousActions("toy", spec), np.random.default_rng(0)
    mask = form.shape_mask(np.array([1, 0, 1, 0, 1, 1, 0], np.bool_))
    drawn = np.array([form.draw(mask, rng) for _ in range(200)])
    assert drawn.dtype == np.float32
    assert set(form.to_engine(drawn, 0).tolist()) == {0, 2, 4, 5}


@pytest.mark.parametrize(
    ("point", "named"),
    [([1.5, 0, 0], "kind 1.5"), ([0, -2, 0], "row -2.0"), ([0, 0, np.nan], "column nan")],
)
def test_points_outside_name_player_and_world(spec, point, named):
    message = f"toy: the {named} of player 1 in world 1 is outside -1..1"
    with pytest.raises(ValueError, match=re.escape(message)):
        ContinuousActions("toy", spec).to_engine(np.array([[0.0, 0, 0], point]), 1)


def test_games_without_cells_have_no_points():
    with pytest.raises(ValueError, match="flappy_bird: none of the actions points at a cell"):
        GameParallelEnv("flappy_bird", action_form="continuous")


@pytest.mark.filterwarnings("ignore:.*A Box action space maximum and minimum values")
def test_environments_of_points():
    options = {"action_form": "continuous", "max_ticks": MAX_TICKS}
    parallel_api_test(GameParallelEnv("deep_line_wars", **options), num_cycles=100)
    env = GameEnv("deep_line_wars", **options)
    assert env.action_space == spaces.Box(-1.0, 1.0, (3,), np.float32)
    check_env(env, skip_render_check=True)
    _, info = env.reset(seed=1)
    for _ in range(40):
        point = env.action_space.sample(info["action_mask"])
        assert env.action_space.contains(point)
        _, _, _, _, info = env.step(point)
    assert env.engine.illegal_actions.sum() == 0
    with pytest.raises(
        ValueError, match=r"are int64 \[1, 3\], they must be numbers in -1..1 \[1, 3"
    ):
        env.step([0, 0, 0])
    vector = GameVectorEnv("deep_line_wars", num_envs=3, **options)
    vector.reset(seed=1)
    vector.step(vector.action_space.sample())


# --- the flat form -------------------------------------------------------------------------------


def test_the_flat_form_changes_nothing_and_draws_at_each_place(spec):
    form = FlatActions("toy", dataclasses.replace(spec, action_shape=GRID))
    assert form.sizes.tolist() == [[7] * 3] * 2
    assert form.mask_shape == (2, 3, 7)
    mask = np.random.default_rng(1).random((2, 3, 7)) < 0.5
    mask[..., 0] = True
    shaped = form.shape_mask(mask)
    np.testing.assert_array_equal(shaped, mask)
    rng = np.random.default_rng(2)
    seen = np.zeros(mask.shape, np.bool_)
    for _ in range(200):
        np.put_along_axis(seen, form.draw(shaped, rng)[..., None], True, axis=-1)
    np.testing.assert_array_equal(seen, mask)


# --- the environments ----------------------------------------------------------------------------


def make_parallel(game: str, **options) -> GameParallelEnv:
    return GameParallelEnv(game, action_form="factored", max_ticks=MAX_TICKS, **options)


@pytest.mark.parametrize("with_mask", [False, True])
def test_pettingzoo_and_gymnasium_accept_factored_actions(game_name, with_mask):
    parallel_api_test(make_parallel(game_name, mask_in_observation=with_mask), num_cycles=30)
    parallel_seed_test(lambda: make_parallel(game_name), num_cycles=10)
    form = {"action_form": "factored", "mask_in_observation": with_mask}
    check_env(GameEnv(game_name, max_ticks=MAX_TICKS, **form), skip_render_check=True)


def test_the_factored_game_is_the_flat_one(game_name):
    factored, flat = make_parallel(game_name), GameParallelEnv(game_name, max_ticks=MAX_TICKS)
    spec = flat.engine.spec
    form = FactoredActions(game_name, spec)
    cells = np.maximum(spec.action_cells, 0)
    (seen, infos), (expected, _) = factored.reset(seed=1), flat.reset(seed=1)
    for numbers in Luck.draw(20, 1, flat.engine.num_players).numbers:
        mask = flat.engine.action_mask()[0]
        chosen = choose_actions(flat.engine, numbers)[0]
        for seat, agent in enumerate(flat.agents):
            np.testing.assert_array_equal(seen[agent], expected[agent])
            shown = infos[agent]["action_mask"]
            np.testing.assert_array_equal(shown, form.shape_mask(mask[seat]))
            action = chosen[seat]
            assert shown[spec.action_groups[action], cells[action]] == mask[seat, action]
        pairs = np.stack([spec.action_groups[chosen], cells[chosen]], axis=-1)
        seen, *_, infos = factored.step(dict(zip(factored.agents, pairs, strict=True)))
        expected, *_ = flat.step(dict(zip(flat.agents, chosen, strict=True)))
    np.testing.assert_array_equal(factored.engine.illegal_actions, flat.engine.illegal_actions)


def test_the_mask_samples_legal_factored_actions(game_name):
    env = make_parallel(game_name)
    _, infos = env.reset(seed=0)
    space = env.action_space("player_0")
    assert isinstance(space, spaces.MultiDiscrete)
    space.seed(0)
    while env.agents:
        actions = {}
        for agent in env.agents:
            mask = infos[agent]["action_mask"]
            kind, cell = actions[agent] = env.action_space(agent).sample(mask)
            assert mask[kind, cell] == 1
        *_, infos = env.step(actions)
    assert not env.engine.illegal_actions.any()


def test_gymnasiums_own_way_of_masking_still_samples(game_name):
    space = make_parallel(game_name).action_space("player_0")
    masks = tuple(np.eye(size, dtype=np.int8)[size - 1] for size in space.nvec)
    assert space.sample(masks).tolist() == (space.nvec - 1).tolist()
    assert space.contains(space.sample())


def test_a_vector_of_factored_games_is_the_flat_one(game_name):
    options = {
        "num_envs": 3,
        "opponent": FirstLegalAgent(),
        "max_ticks": ticks_of(game_name, 8),
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }
    flat = GameVectorEnv(game_name, **options)
    factored = GameVectorEnv(game_name, action_form="factored", **options)
    spec = flat.engine.spec
    form = FactoredActions(game_name, spec)
    (_, infos), (_, shown) = flat.reset(seed=2), factored.reset(seed=2)
    num_ended = 0
    for numbers in np.random.default_rng(0).random((25, 3)):
        masks = infos["action_mask"].astype(np.bool_)
        np.testing.assert_array_equal(shown["action_mask"], form.shape_mask(masks))
        legal = [np.flatnonzero(mask) for mask in masks]
        actions = np.array([row[int(n * len(row))] for row, n in zip(legal, numbers, strict=True)])
        pairs = [spec.action_groups[actions], np.maximum(spec.action_cells[actions], 0)]
        seen, rewards, _, truncated, infos = flat.step(actions)
        others = factored.step(np.stack(pairs, axis=-1))
        shown = others[-1]
        np.testing.assert_array_equal(others[0], seen)
        np.testing.assert_array_equal(others[1], rewards)
        if truncated.any():
            num_ended += 1
            final = infos["final_info"]["action_mask"].astype(np.bool_)
            np.testing.assert_array_equal(
                shown["final_info"]["action_mask"], form.shape_mask(final)
            )
    assert num_ended > 0


@pytest.mark.parametrize(
    ("action", "described"),
    [(3, "int64 []"), ([1.0, 2.0], "float64 [2]"), ([1, 2, 3], "int64 [3]")],
)
def test_factored_actions_of_a_wrong_shape_or_type_are_described(game_name, action, described):
    env = make_parallel(game_name)
    env.reset(seed=0)
    message = f"{game_name}: the action of player_0 is {described}, it must be integers [2]"
    with pytest.raises(ValueError, match=re.escape(message)):
        env.step(dict.fromkeys(env.agents, action))
    vector = GameVectorEnv(game_name, opponent=FirstLegalAgent(), action_form="factored")
    vector.reset(seed=0)
    message = "they must be integers [1, 2] (worlds, shape of an action)"
    with pytest.raises(ValueError, match=re.escape(message)):
        vector.step(np.array([action]))


def test_a_number_outside_is_refused_at_every_door(game_name):
    env = make_parallel(game_name)
    env.reset(seed=0)
    last = make_engine(game_name).spec.action_groups.max()
    seat = len(env.agents) - 1
    message = f"{game_name}: the kind 1000 of player {seat} in world 0 is outside 0..{last}"
    with pytest.raises(ValueError, match=re.escape(message)):
        env.step(dict.fromkeys(env.agents, (0, 0)) | {f"player_{seat}": [1000, 0]})
