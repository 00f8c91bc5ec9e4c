"""The Gymnasium door: its library's own checks, and the vector form equal to single games."""

import copy
from functools import partial
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode

from marl_cair.games import GAMES
from marl_cair.games.gymnasium_env import GameEnv, GameVectorEnv
from marl_cair.games.players.mixed_agent import MixedAgent
from tests.games.cases import IN_PROCESS, REPRESENTATIONS, FirstLegalAgent, choose_action, ticks_of

IDS = sorted(name for name in gymnasium.registry if name.startswith("marl_cair/"))
MAX_DECISIONS = 8  # a game lasts at most so long
NUM_WORLDS = 3
FORMS = [{}, {"mask_in_observation": True}, {"vector": True}]
MODES = [mode.value for mode in AutoresetMode]


def last_seat(game: str) -> int:
    """The last seat of a game's default scenario."""
    chosen = GAMES[game]
    return chosen.make_spec(chosen.scenario()).num_players - 1


def make_single(game: str, **options: Any) -> GameEnv:
    max_ticks = ticks_of(game, MAX_DECISIONS)
    return GameEnv(game, opponent=FirstLegalAgent(), max_ticks=max_ticks, **options)


def make_vector(game: str, mode: AutoresetMode, **options: Any) -> GameVectorEnv:
    return GameVectorEnv(
        game,
        num_envs=NUM_WORLDS,
        opponent=FirstLegalAgent(),
        autoreset_mode=mode,
        max_ticks=ticks_of(game, MAX_DECISIONS),
        **options,
    )


def first_id(game: str) -> str:
    """The id of a game's default scenario."""
    chosen = GAMES[game]
    return f"marl_cair/{chosen.gymnasium_prefix}-{chosen.default_scenario}-v0"


def choose(env: GameVectorEnv, numbers: np.ndarray) -> np.ndarray:
    chosen = [
        choose_action(env.engine.spec, mask, *pair)
        for mask, pair in zip(env.action_masks(), numbers, strict=True)
    ]
    return np.array(chosen)


# --- the library's checks --------------------------------------------------------------------


def test_every_scenario_has_its_id():
    expected = [
        f"marl_cair/{game.gymnasium_prefix}-{scenario}-v0"
        for game in GAMES.values()
        for scenario in game.scenarios
    ]
    assert sorted(expected) == IDS


@pytest.mark.parametrize("env_id", [name for name in IDS if "/Flash-" not in name])
def test_gymnasium_accepts_every_registered_environment(env_id):
    env = gymnasium.make(env_id)
    check_env(env.unwrapped, skip_render_check=True)  # which needs an environment for each mode


def test_gymnasium_accepts_the_pictures(game_name):
    env_id = next(name for name in IDS if GAMES[game_name].gymnasium_prefix in name)
    check_env(gymnasium.make(env_id, render_mode="rgb_array").unwrapped)


@pytest.mark.parametrize(("game", "representation"), REPRESENTATIONS)
@pytest.mark.parametrize("form", FORMS, ids=str)
def test_gymnasium_accepts_every_representation_and_form(game, representation, form):
    env = make_single(game, representation=representation, **form)
    check_env(env, skip_render_check=True)


@pytest.mark.parametrize("env_id", IDS)
def test_gymnasium_makes_vectors_of_every_registered_environment(env_id):
    env = gymnasium.make_vec(env_id, num_envs=2, render_mode=None)
    assert isinstance(env.unwrapped, GameVectorEnv)
    env.reset(seed=0)
    env.action_space.seed(0)
    observations, rewards, *_ = env.step(env.action_space.sample())
    assert env.observation_space.contains(observations)
    assert rewards.shape == (2,)


# --- equality with Gymnasium's own vector environment ----------------------------------------


def assert_same_infos(own: dict[str, Any], other: dict[str, Any], worlds: np.ndarray) -> None:
    """Infos of these worlds are equal; `final_info` and `final_obs` where games have ended."""
    assert set(own) == set(other)
    for name, values in own.items():
        if name == "final_info":
            assert_same_infos(values, other[name], own["_final_info"])
        elif name == "final_obs":
            for world in np.flatnonzero(own["_final_obs"]):
                assert data_equivalence(values[world], other[name][world])
            assert [seen is None for seen in values] == [seen is None for seen in other[name]]
        else:
            np.testing.assert_array_equal(values[worlds], other[name][worlds])


def play_both(env_id: str, mode: str, seed: Any, **options: Any) -> int:
    """Play `make_vec`'s two forms with the same legal actions; returns how many games ended."""
    ours = gymnasium.make_vec(env_id, NUM_WORLDS, autoreset_mode=mode, **options)
    kwargs = {"vectorization_mode": "sync", "vector_kwargs": {"autoreset_mode": mode}}
    theirs = gymnasium.make_vec(env_id, NUM_WORLDS, **kwargs, **options)
    assert ours.autoreset_mode is theirs.autoreset_mode is AutoresetMode(mode)
    everywhere, num_ended = np.ones(NUM_WORLDS, np.bool_), 0
    (seen, infos), (other, other_infos) = ours.reset(seed=seed), theirs.reset(seed=seed)
    for step, numbers in enumerate(np.random.default_rng(3).random((30, NUM_WORLDS, 2))):
        assert data_equivalence(seen, other)
        assert_same_infos(infos, other_infos, everywhere)
        actions = choose(ours, numbers)
        seen, *outcome, infos = ours.step(actions)
        other, *other_outcome, other_infos = theirs.step(actions)
        np.testing.assert_array_equal(outcome, other_outcome)
        ended = outcome[1] | outcome[2]
        num_ended += int(ended.sum())
        if mode == "Disabled" and (ended.any() or step == 5):
            # Step 5: so that the worlds do not all end together.
            chosen = ended if ended.any() else np.array([False, True, False])
            again = [None, 11, 12]
            seen, _ = ours.reset(seed=again, options={"reset_mask": chosen.copy()})
            other, _ = theirs.reset(seed=again, options={"reset_mask": chosen.copy()})
            infos = other_infos = {}
    return num_ended


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(
    ("seed", "form"),
    [(5, {}), ([9, 2, 4], {"seat": "last"}), *((3, form) for form in FORMS[1:])],
    ids=str,
)
def test_both_forms_of_make_vec_play_the_same_games(game_name, mode, seed, form):
    """The default opponent draws at random: it draws the same in both."""
    seat = {"seat": last_seat(game_name)} if "seat" in form else {}
    limit = ticks_of(game_name, MAX_DECISIONS)
    options = {"max_ticks": limit, **form, **seat}
    assert play_both(first_id(game_name), mode, seed, **options) >= 2 * NUM_WORLDS


@pytest.mark.parametrize("mode", MODES)
def test_a_limit_of_decisions_ends_games_in_both_forms_alike(game_name, mode):
    assert play_both(first_id(game_name), mode, 1, max_episode_steps=4) >= 5 * NUM_WORLDS


@pytest.mark.parametrize(
    "game", [game for game in IN_PROCESS if "race-2" not in GAMES[game].scenarios]
)
def test_both_forms_draw_the_same_members_of_a_mixture(game):
    scenario = GAMES[game].scenario()
    bots = [GAMES[game].bot(name, scenario) for name in list(GAMES[game].bots)[:3]]
    mixture = MixedAgent([*bots, FirstLegalAgent()], [1.0] * (len(bots) + 1))
    limit = ticks_of(game, MAX_DECISIONS)
    assert play_both(first_id(game), "SameStep", 7, max_ticks=limit, opponent=mixture)


# --- our promises ----------------------------------------------------------------------------


@pytest.mark.parametrize("make", [make_single, partial(make_vector, mode=AutoresetMode.NEXT_STEP)])
def test_the_mask_is_in_one_place(game_name, make):
    """Clients that find it in both break: TorchRL's wrapper does."""
    env = make(game_name)
    assert "action_mask" in env.reset(seed=0)[1]
    env = make(game_name, mask_in_observation=True)
    seen, infos = env.reset(seed=0)
    later, *_, more = env.step(np.zeros(env.action_space.shape, np.int64))
    assert "action_mask" in seen
    assert "action_mask" in later
    assert not {"action_mask", "_action_mask"} & {*infos, *more}


@pytest.mark.parametrize("where", ["infos", "observation"])
def test_action_masks_are_the_mask(game_name, where):
    env = make_single(game_name, mask_in_observation=where == "observation")
    vector = make_vector(game_name, AutoresetMode.NEXT_STEP)
    seen, info = env.reset(seed=0)
    masks = env.action_masks()
    shown = seen if where == "observation" else info
    assert masks.dtype == np.bool_
    np.testing.assert_array_equal(masks, shown["action_mask"])
    _, infos = vector.reset(seed=0)
    np.testing.assert_array_equal(vector.action_masks(), infos["action_mask"])
    np.testing.assert_array_equal(vector.action_masks()[0], masks)


def test_action_masks_of_factored_actions_are_refused():
    env = GameEnv("deep_line_wars", action_form="factored")
    env.reset(seed=0)
    with pytest.raises(ValueError, match="this form's mask holds pairs of kind and cell"):
        env.action_masks()


def test_worlds_that_play_on_have_no_last_observation(game_name):
    env = make_vector(game_name, AutoresetMode.SAME_STEP)
    env.reset(seed=0)
    env.step(np.zeros(NUM_WORLDS, np.int64))
    env.reset(options={"reset_mask": np.array([True, False, True])})
    truncated = np.zeros(NUM_WORLDS, np.bool_)
    while not truncated.any():
        *_, truncated, infos = env.step(np.zeros(NUM_WORLDS, np.int64))
    assert truncated.tolist() == [False, True, False]
    assert [seen is None for seen in infos["final_obs"]] == [True, False, True]
    assert not infos["final_info"]["action_mask"][0].any()
    assert infos["_final_obs"].tolist() == [False, True, False]


def test_results_of_a_step_are_fresh_arrays(game_name):
    env = make_vector(game_name, AutoresetMode.NEXT_STEP, mask_in_observation=True)
    _, infos = env.reset(seed=0)
    shown = []
    for numbers in np.random.default_rng(0).random((10, NUM_WORLDS, 2)):
        observations, *outcome, infos = env.step(choose(env, numbers))
        printed = [*observations.values(), *outcome, *infos.values()]
        own = [*env.engine._worlds, *env.engine._outcome]
        assert not any(np.shares_memory(value, array) for value in printed for array in own)
        shown.append((printed, copy.deepcopy(printed)))
    for printed, kept in shown:
        for value, copied in zip(printed, kept, strict=True):
            np.testing.assert_array_equal(value, copied)


@pytest.mark.parametrize("is_last", [False, True])
def test_the_learner_plays_its_seat_and_is_rewarded_for_it(game_name, is_last):
    seat = last_seat(game_name) if is_last else 0
    env = make_single(game_name, seat=seat)
    seen, info = env.reset(seed=0)
    np.testing.assert_array_equal(seen, env.engine.observe("planes")[0, seat])
    np.testing.assert_array_equal(info["action_mask"], env.engine.action_mask()[0, seat])
    _, reward, *_ = env.step(env.engine.spec.noop_action)
    assert reward == env.engine.rewards[0, seat]


def play_idly(game: str, bot: str, seed: int) -> bytes:
    """What a learner sees that only plays the no-op."""
    env = GameEnv(game, opponent=bot, max_ticks=200)
    env.reset(seed=seed)
    noop = env.engine.spec.noop_action
    return b"".join(env.step(noop)[0].tobytes() for _ in range(20))


@pytest.mark.parametrize(
    ("game", "bot"), [(game, bot) for game in IN_PROCESS for bot in GAMES[game].bots]
)
def test_the_same_seed_gives_the_same_game_against_every_bot(game, bot):
    assert play_idly(game, bot, seed=0) == play_idly(game, bot, seed=0)


def test_another_seed_gives_another_game(game_name):
    assert play_idly(game_name, "random", seed=0) != play_idly(game_name, "random", seed=1)


def test_pictures_come_only_in_the_mode_that_asks_for_them(game_name):
    env, vector = make_single(game_name), make_vector(game_name, AutoresetMode.DISABLED)
    env.reset(seed=0)
    vector.reset(seed=0)
    assert env.render() is None
    assert vector.render() is None
    shown = make_vector(game_name, AutoresetMode.DISABLED, render_mode="rgb_array")
    shown.reset(seed=0)
    pictures = shown.render()
    assert len(pictures) == NUM_WORLDS
    assert pictures[0].dtype == np.uint8
    assert pictures[0].shape[2] == 3
