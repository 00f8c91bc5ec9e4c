"""The PettingZoo environment: its library's own checks on every game, and further properties."""

import warnings
from importlib import import_module

import numpy as np
import pytest
from gymnasium import spaces

from marl_cair.games.parallel_env import GameParallelEnv, make_aec_env
from tests.games.cases import IN_PROCESS, REPRESENTATIONS, Case, Luck, choose_actions

with warnings.catch_warnings():
    warnings.simplefilter("ignore", DeprecationWarning)  # it imports games of its own the old way
    from pettingzoo.test import (
        api_test,
        parallel_api_test,
        parallel_seed_test,
        seed_test,
    )
    from pettingzoo.test.state_test import state_test

FORMS = {
    "mask in infos": {},
    "mask in observation": {"mask_in_observation": True},
    "vector": {"vector": True},
    "mask and vector": {"mask_in_observation": True, "vector": True},
}
SEED_CYCLES = 20


@pytest.fixture(params=FORMS, ids=lambda form: form.replace(" ", "-"))
def form(request) -> dict[str, bool]:
    """How the mask and the economy are handed over."""
    return FORMS[request.param]


def make_env(case: Case, **options) -> GameParallelEnv:
    return GameParallelEnv(case.game, case.scenario, **dict(case.options), **options)


def luck_for(env: GameParallelEnv, num_decisions: int, seed: int = 0) -> np.ndarray:
    return Luck.draw(num_decisions, 1, env.engine.num_players, seed).numbers


def choose(env: GameParallelEnv, numbers: np.ndarray) -> dict[str, int]:
    chosen = choose_actions(env.engine, numbers)[0].tolist()
    return dict(zip(env.possible_agents, chosen, strict=True))


# --- the library's checks --------------------------------------------------------------------


def test_pettingzoo_accepts_the_parallel_api_of_every_scenario(case):
    parallel_api_test(make_env(case, max_cycles=12), num_cycles=30)


@pytest.mark.plain_python
def test_pettingzoo_accepts_every_form_of_observation(game_name, form):
    parallel_api_test(GameParallelEnv(game_name, max_cycles=12, **form), num_cycles=30)


@pytest.mark.parametrize(("game", "representation"), REPRESENTATIONS)
def test_pettingzoo_accepts_every_representation(game, representation):
    env = GameParallelEnv(game, representation=representation, max_cycles=3)
    parallel_api_test(env, num_cycles=5)


def test_pettingzoo_finds_the_same_game_for_the_same_seed(case):
    parallel_seed_test(lambda: make_env(case), num_cycles=SEED_CYCLES)


@pytest.mark.filterwarnings(  # what it says of a Dict, although it knows masks in one
    "ignore:Observation space for each agent probably should be",
    "ignore:Observation is not a NumPy array",
    "ignore:Observations between agents are different classes",
)
def test_pettingzoo_accepts_the_turn_by_turn_game(game_name, form):
    env = make_aec_env(game_name, max_cycles=12, **form)
    api_test(env, num_cycles=30)
    seed_test(lambda: make_aec_env(game_name, max_cycles=12, **form), num_cycles=SEED_CYCLES)


def test_pettingzoo_accepts_the_state(case):
    turn_by_turn = make_aec_env(case.game, case.scenario, **dict(case.options))
    state_test(turn_by_turn, make_env(case))


# --- our promises ----------------------------------------------------------------------------


def test_the_game_equals_the_engines(case):
    """The door adds nothing: same numbers as the engine behind it, step by step."""
    env = make_env(case, max_cycles=40)
    engine = case.engine(max_ticks=40 * env.engine.spec.ticks_per_step)
    observations, infos = env.reset(seed=3)
    engine.restore(env.engine.snapshot())
    seats = {agent: seat for seat, agent in enumerate(env.possible_agents)}
    live = env.agents
    for numbers in luck_for(env, 40):
        if not env.agents:
            break
        live = env.agents
        seen, masks = engine.observe("planes")[0], engine.action_mask()[0]
        for agent in live:
            np.testing.assert_array_equal(observations[agent], seen[seats[agent]])
            np.testing.assert_array_equal(infos[agent]["action_mask"], masks[seats[agent]])
        actions = choose(env, numbers)
        observations, rewards, terminations, truncations, infos = env.step(actions)
        engine.step(np.array([[actions[agent] for agent in env.possible_agents]]))
        for agent in live:
            is_over = engine.terminated[0] | engine.eliminated[0, seats[agent]]
            assert rewards[agent] == engine.rewards[0, seats[agent]]
            assert terminations[agent] == bool(is_over)
        assert set(truncations.values()) == {bool(engine.truncated[0])}
    assert env.agents == []
    assert set(infos) == set(observations) == set(live)


@pytest.mark.parametrize("seed", [0, 1, 2**63 + 5, -1])
def test_any_seed_gives_its_game_again(game_name, seed):
    games = []
    for env in (GameParallelEnv(game_name), GameParallelEnv(game_name)):
        env.reset(seed=seed)
        for numbers in luck_for(env, 30):
            env.step(choose(env, numbers))
        games.append(env.state())
    np.testing.assert_array_equal(*games)


def test_a_reset_without_seed_begins_the_next_game_of_the_seed(game_name):
    def words(env: GameParallelEnv) -> bytes:
        return b"".join(value.tobytes() for value in env.engine.state_dict().values())

    env, other = GameParallelEnv(game_name), GameParallelEnv(game_name)
    games = []
    for seed in (7, None, None, 7, None):
        env.reset(seed=seed)
        games.append(words(env))
    assert len(set(games[:3])) == 3
    assert games[3:] == games[:2]
    other.reset()
    assert words(other) not in games


def test_observations_are_fresh_arrays(game_name):
    env = GameParallelEnv(game_name, mask_in_observation=True, vector=True)
    first, _ = env.reset(seed=0)
    kept = {name: value.copy() for name, value in first["player_0"].items()}
    for numbers in luck_for(env, 30):
        env.step(choose(env, numbers))
    for name, value in first["player_0"].items():
        np.testing.assert_array_equal(value, kept[name])


def test_every_observation_lies_in_its_space(case, form):
    env = make_env(case, max_cycles=25, **form)
    observations, infos = env.reset(seed=1)
    for numbers in luck_for(env, 25):
        for agent in env.possible_agents:
            assert env.observation_space(agent).contains(observations[agent])
            shown = observations if form.get("mask_in_observation") else infos
            assert shown[agent]["action_mask"].dtype == np.int8
        assert env.state_space.contains(env.state())
        observations, *_, infos = env.step(choose(env, numbers))


def test_spaces_are_the_same_objects_at_every_call(game_name):
    env = GameParallelEnv(game_name)
    for agent in env.possible_agents:
        assert env.observation_space(agent) is env.observation_space(agent)
        assert env.action_space(agent) is env.action_space(agent)
        assert env.observation_spaces[agent] is env.observation_space(agent)
        assert env.action_spaces[agent] is env.action_space(agent)
    assert isinstance(env.observation_space("player_0"), spaces.Box)


def test_dict_forms_hold_what_was_asked_for(game_name):
    env = GameParallelEnv(game_name, mask_in_observation=True, vector=True)
    observations, infos = env.reset(seed=0)
    seat, agent = len(env.agents) - 1, env.agents[-1]
    seen = observations[agent]
    assert set(seen) == {"observation", "action_mask", "vector"}
    np.testing.assert_array_equal(seen["action_mask"], env.engine.action_mask()[0, seat])
    assert "action_mask" not in infos[agent]
    np.testing.assert_array_equal(seen["vector"], env.engine.observe("vector")[0, seat])


def test_the_mask_samples_legal_actions(game_name):
    env = GameParallelEnv(game_name)
    _, infos = env.reset(seed=0)
    env.action_space("player_0").seed(0)
    for _ in range(20):
        mask = infos["player_0"]["action_mask"]
        assert mask[env.action_space("player_0").sample(mask)]


def test_a_finished_game_returns_nothing_until_reset(game_name):
    env = GameParallelEnv(game_name, max_cycles=1)
    env.reset(seed=0)
    noop = dict.fromkeys(env.agents, env.engine.spec.noop_action)
    *_, truncations, _ = env.step(noop)
    assert all(truncations.values())
    assert env.step(noop) == ({}, {}, {}, {}, {})
    env.reset()
    assert env.agents == env.possible_agents


def test_an_illegal_action_is_counted_and_harmless(game_name):
    env, idle = GameParallelEnv(game_name), GameParallelEnv(game_name)
    _, infos = env.reset(seed=0)
    for numbers in luck_for(env, 200):
        illegal = np.flatnonzero(infos["player_0"]["action_mask"] == 0)
        if len(illegal):
            break
        *_, infos = env.step(choose(env, numbers))
    idle.reset(seed=0)
    idle.engine.restore(env.engine.snapshot())
    before, noop = env.engine.illegal_actions.copy(), env.engine.spec.noop_action
    nothing = dict.fromkeys(env.agents, noop)
    env.step(nothing | {"player_0": int(illegal[0])})
    idle.step(nothing)
    expected = [1] + [0] * (env.engine.num_players - 1)
    assert (env.engine.illegal_actions - before).tolist() == [expected]
    np.testing.assert_array_equal(env.engine.observe("planes"), idle.engine.observe("planes"))


def test_a_missing_action_is_named(game_name):
    env = GameParallelEnv(game_name)
    env.reset(seed=0)
    message = f"{game_name}: step has no actions of {env.agents[-1]}; give one for every agent"
    with pytest.raises(ValueError, match=message):
        env.step(dict.fromkeys(env.agents[:-1], 0))


def test_every_game_opens_its_two_doors():
    for name in IN_PROCESS:
        module = import_module(f"marl_cair.games.{name}")
        assert module.parallel_env().metadata["name"].startswith(name)
        turn_by_turn = module.env(render_mode=None)
        turn_by_turn.reset(seed=0)
        assert turn_by_turn.agent_selection == "player_0"


def test_infos_hold_the_games_own_numbers_beside_the_mask(game_name):
    env = GameParallelEnv(game_name)
    _, infos = env.reset(seed=0)
    *_, after = env.step(dict.fromkeys(env.agents, env.engine.spec.noop_action))
    for info in (*infos.values(), *after.values()):
        assert set(info) == {"action_mask", *env.engine.info()}
    if game_name == "deep_maze":
        optimal = int(env.engine.info()["optimal_steps"][0, 0])
        assert infos["player_0"]["optimal_steps"] == optimal
        assert (infos["player_0"]["step_count"], after["player_0"]["step_count"]) == (0, 1)
        assert type(infos["player_0"]["optimal_steps"]) is int
