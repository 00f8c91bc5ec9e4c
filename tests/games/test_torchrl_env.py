"""The TorchRL environment: the library's checks, and equality with its PettingZoo wrapper."""

import gc
import re

import numpy as np
import pytest
import torch
from tensordict import TensorDict
from torchrl.collectors import Collector
from torchrl.envs import (
    ActionMask,
    Compose,
    PettingZooWrapper,
    RewardSum,
    StepCounter,
    TransformedEnv,
)
from torchrl.envs.utils import check_env_specs

import marl_cair
from marl_cair.games import torchrl_env
from marl_cair.games.parallel_env import GameParallelEnv
from marl_cair.games.torchrl_env import GROUP, MAX_SPARE, ArrayPool, BatchedGameEnv
from tests.games.cases import REPRESENTATIONS, Case, Luck, choose_actions, ticks_of

MAX_DECISIONS = 30


def max_ticks(case: Case) -> int:
    return ticks_of(case.game, MAX_DECISIONS, case.scenario)


def make_env(case: Case, num_worlds: int = 1, **options) -> BatchedGameEnv:
    arguments = dict(case.options) | {"max_ticks": max_ticks(case), "seed": 0} | options
    return BatchedGameEnv(case.game, case.scenario, num_worlds, **arguments)


def with_actions(seen: TensorDict, env: BatchedGameEnv, numbers: np.ndarray) -> TensorDict:
    """What `step` takes: a container of its own, because `step` writes into it."""
    actions = torch.from_numpy(choose_actions(env.engine, numbers)).long()
    return seen.copy().set((GROUP, "action"), actions)


def luck_for(env: BatchedGameEnv, num_decisions: int) -> np.ndarray:
    return Luck.draw(num_decisions, env.engine.num_worlds, env.engine.num_players).numbers


# --- the library's checks --------------------------------------------------------------------


def test_torchrl_accepts_every_scenario(case):
    check_env_specs(make_env(case, 3), seed=0)


@pytest.mark.parametrize(("game", "representation"), REPRESENTATIONS)
def test_torchrl_accepts_every_representation(game, representation):
    extra = ("vector",) if representation != "vector" else ("planes",)
    env = BatchedGameEnv(
        game, num_worlds=2, representation=representation, extra_representations=extra, seed=0
    )
    check_env_specs(env, seed=0)


@pytest.mark.parametrize("num_worlds", [1, 3])
def test_torchrl_accepts_its_transforms_around_it(game_name, num_worlds):
    limit = ticks_of(game_name, MAX_DECISIONS)
    env = marl_cair.make_torchrl_env(game_name, num_worlds=num_worlds, max_ticks=limit)
    check_env_specs(TransformedEnv(env, StepCounter()), seed=0)


# --- equality with the wrapped PettingZoo environment ----------------------------------------


def wrapped(case: Case) -> PettingZooWrapper:
    env = GameParallelEnv(case.game, case.scenario, max_ticks=max_ticks(case), **dict(case.options))
    return PettingZooWrapper(env)


def leaves(seen: TensorDict) -> dict[tuple[str, ...], torch.Tensor]:
    found = seen.items(include_nested=True, leaves_only=True)
    return {key if isinstance(key, tuple) else (key,): value for key, value in found}


def assert_equal(native: TensorDict, wrapper: TensorDict, *, except_for: set = frozenset()) -> None:
    """Equal keys, types and numbers; the native one has the batch of one world in front."""
    own, reference = leaves(native), leaves(wrapper)
    assert set(own) == set(reference)
    for key, value in reference.items():
        assert own[key].shape == (1, *value.shape), key
        assert own[key].dtype == value.dtype, key
        if key not in except_for:
            assert torch.equal(own[key][0], value), key


def test_the_native_environment_equals_the_wrapped_one_for_a_whole_game(case):
    """One entry differs, at the end: the wrapper leaves the mask of an ended game all True.

    PettingZoo has no agents then. Ours keeps the legal actions, on which a truncated game
    bootstraps.
    """
    native, wrapper = make_env(case), wrapped(case)
    native.set_seed(6)
    # Its `set_seed` resets as well, so that its `reset` would begin the seed's second game.
    own, reference = native.reset(), wrapper.reset(seed=6)
    assert native.group_map == wrapper.group_map
    assert_equal(own, reference)
    for numbers in luck_for(native, 100):
        own = with_actions(own, native, numbers)
        acted = reference.copy().set((GROUP, "action"), own[GROUP, "action"][0])
        own, reference = native.step(own), wrapper.step(acted)
        ended = own["next", GROUP, "done"][0, :, 0]
        if ended.any():
            break
        assert_equal(own, reference)
        own, reference = own["next"], reference["next"]
    mask = ("next", GROUP, "action_mask")
    # The wrapper ends the world with the first seat that is out, ours with the last.
    only_some = set() if ended.all() else {("next", "done"), ("next", "terminated")}
    assert_equal(own, reference, except_for={mask, *only_some})
    assert reference[mask][ended].all()
    np.testing.assert_array_equal(own[mask].numpy(), native.engine.action_mask())
    assert not own[mask].all()


def test_the_specs_equal_the_wrapped_ones(case):
    native, wrapper = make_env(case), wrapped(case)
    for own, reference in (
        (native.observation_spec, wrapper.observation_spec),
        (native.reward_spec, wrapper.reward_spec),
        (native.done_spec, wrapper.done_spec),
    ):
        assert set(own.keys(True, True)) == set(reference.keys(True, True))
        for key in reference.keys(True, True):
            assert own[key].shape == (1, *reference[key].shape), key
            assert own[key].dtype == reference[key].dtype, key
    engine = native.engine
    shape = (1, engine.num_players, *engine.spec.action_shape)
    assert native.full_action_spec[GROUP, "action"].shape == shape


# --- our promises ----------------------------------------------------------------------------


def test_a_batch_equals_its_worlds_played_alone(game_name):
    case = Case(game_name, marl_cair.GAMES[game_name].default_scenario)
    batch = make_env(case, 3)
    luck = luck_for(batch, 20)
    seen, stored = batch.reset(), []
    for numbers in luck:
        stored.append(batch.step(with_actions(seen, batch, numbers)))
        seen = stored[-1]["next"]
    for world in range(3):
        alone = make_env(case)
        alone.seeds._worlds = np.array([world])  # the world that it is in the batch
        seen = alone.reset()
        for step, numbers in enumerate(luck[:, [world]]):
            result = alone.step(with_actions(seen, alone, numbers))
            assert_equal(result, stored[step][world])
            seen = result["next"]


def test_rollouts_share_no_memory_with_the_engine(game_name):
    case = Case(game_name, marl_cair.GAMES[game_name].default_scenario)
    env = make_env(case, 2)
    seen = env.reset()
    first = env.step(with_actions(seen, env, luck_for(env, 1)[0]))
    kept = first.clone()
    seen = first["next"]
    for numbers in luck_for(env, 10):
        seen = env.step(with_actions(seen, env, numbers))["next"]
    for key, value in leaves(kept).items():
        assert torch.equal(leaves(first)[key], value), key


@pytest.mark.parametrize("key", ["_reset", (GROUP, "_reset")])
def test_a_partial_reset_restarts_its_worlds_only_and_shows_all(game_name, key):
    case = Case(game_name, marl_cair.GAMES[game_name].default_scenario)
    env = make_env(case, 3)
    seen = env.reset()
    for numbers in luck_for(env, 20):
        seen = env.step(with_actions(seen, env, numbers))["next"]
    before = env.engine.state_dict()
    shape = (3, 1) if key == "_reset" else (3, env.engine.num_players, 1)
    asked = torch.zeros(shape, dtype=torch.bool)
    asked[1, ..., -1:] = True
    final = seen.clone()
    if key == "_reset":
        shown = env.reset(seen.copy().set(key, asked))[GROUP]
        assert np.array_equal(shown["observation"].numpy(), env.engine.observe("planes"))
        assert np.array_equal(shown["action_mask"].numpy(), env.engine.action_mask())
        assert not torch.equal(shown["observation"][1], final[GROUP, "observation"][1])
    else:
        env._reset(TensorDict({}, batch_size=[3]).set(key, asked))
    for name, value in env.engine.state_dict().items():
        np.testing.assert_array_equal(value[[0, 2]], before[name][[0, 2]])
    assert env.seeds.episodes.tolist() == [1, 2, 1]


def test_a_partial_reset_shows_all_worlds_of_large_boards_too(monkeypatch):
    """Transforms that normalise read them, before TorchRL takes those that were reset."""
    monkeypatch.setattr(torchrl_env, "SMALL", 0)
    env = BatchedGameEnv("deep_line_wars", "11x11", 3)
    env.reset()
    asked = torch.tensor([[False], [True], [False]])
    shown = env._reset(TensorDict({"_reset": asked}, batch_size=[3]))
    observed = env.engine.observe("planes")
    np.testing.assert_array_equal(shown[GROUP, "observation"].numpy(), observed)


def test_the_last_observation_of_a_game_outlasts_the_reset(game_name):
    """`next` of the last step keeps what was seen then, whatever the new game shows."""
    limit = ticks_of(game_name, 5)
    env = marl_cair.make_torchrl_env(game_name, num_worlds=3, seed=0, max_ticks=limit)
    state = env.reset()
    for numbers in luck_for(env, 12):
        before = env.engine.snapshot()
        stepped, state = env.step_and_maybe_reset(with_actions(state, env, numbers))
        replayed = marl_cair.make_engine(game_name, num_worlds=3, max_ticks=limit)
        replayed.restore(before)
        replayed.step(stepped[GROUP, "action"].numpy())
        shown = stepped["next", GROUP, "observation"].numpy()
        assert np.array_equal(shown, replayed.observe("planes"))
        assert np.array_equal(state[GROUP, "observation"].numpy(), env.engine.observe("planes"))
    assert env.seeds.episodes.min() >= 2


KEYS = {"action_key": (GROUP, "action"), "mask_key": (GROUP, "action_mask")}
WRAPPERS = {
    "none": lambda env: env,
    "StepCounter": lambda env: TransformedEnv(env, StepCounter()),
    "two": lambda env: TransformedEnv(env, Compose(RewardSum(), StepCounter())),
    "ActionMask": lambda env: TransformedEnv(env, ActionMask(**KEYS)),
}


@pytest.mark.parametrize("collects", [False, True], ids=["rollout", "collector"])
@pytest.mark.parametrize("wrapper", WRAPPERS)
def test_random_actions_are_legal(game_name, wrapper, collects):
    """Also after games have ended."""
    limit = ticks_of(game_name, MAX_DECISIONS)
    plain = marl_cair.make_torchrl_env(game_name, num_worlds=2, seed=0, max_ticks=limit)
    env = WRAPPERS[wrapper](plain)
    torch.manual_seed(0)
    if collects:
        (stored,) = Collector(env, None, frames_per_batch=80, total_frames=80)
    else:
        stored = env.rollout(40, break_when_any_done=False)
    chosen = stored[GROUP, "action_mask"].gather(-1, stored[GROUP, "action"].unsqueeze(-1))
    assert chosen.numel() >= 80
    assert chosen.all()
    assert plain.seeds.episodes.min() >= 2
    assert not plain.engine.illegal_actions.any()


def test_random_actions_are_uniform_over_the_legal_ones():
    env = marl_cair.make_torchrl_env("deep_maze", num_worlds=600, seed=0)
    torch.manual_seed(0)
    mask = env.reset()[GROUP, "action_mask"][:, 0]
    drawn = torch.stack([env.rand_action()[GROUP, "action"][:, 0] for _ in range(20)])
    counts = torch.nn.functional.one_hot(drawn, mask.shape[-1]).sum(0)
    shares = counts * mask.sum(-1, keepdim=True) / 20
    assert 0.95 < shares[mask].mean() < 1.05
    assert (counts[~mask] == 0).all()
    assert env.rand_action()[GROUP, "action"].dtype == torch.int64


def test_the_same_seed_gives_the_same_games(case):
    def play(seed: int) -> TensorDict:
        env = make_env(case, 2, seed=None)
        env.set_seed(seed)
        seen, steps = env.reset(), []
        for numbers in luck_for(env, 35):
            _, seen = env.step_and_maybe_reset(with_actions(seen, env, numbers))
            steps.append(seen)
        return torch.stack(steps)

    scenario = make_env(case).engine.scenario
    first, again, other = play(0), play(0), play(1)
    assert (first == again).all()
    # A scenario may be one game whatever the seed; the same actions then make it the same.
    assert (first == other).all() == (getattr(scenario, "mode", "") == "full_deterministic")


def test_the_game_state_continues_in_another_environment(case):
    env, other = make_env(case, 2), make_env(case, 2, seed=99)
    seen = env.reset()
    for numbers in luck_for(env, 10):
        seen = env.step(with_actions(seen, env, numbers))["next"]
    other.load_game_state(env.game_state())
    drawn, there = other.rand_action()[GROUP, "action"], other.current()
    assert there[GROUP, "action_mask"].gather(-1, drawn.unsqueeze(-1)).all()
    for numbers in luck_for(env, 35):
        _, seen = env.step_and_maybe_reset(with_actions(seen, env, numbers))
        _, there = other.step_and_maybe_reset(with_actions(there, other, numbers))
        assert (seen.select(GROUP) == there.select(GROUP)).all()
    for own, copied in zip(env.last, other.last, strict=True):
        np.testing.assert_array_equal(own, copied)


def test_the_last_step_is_kept_beyond_a_reset(game_name):
    limit = ticks_of(game_name, 10)
    env = marl_cair.make_torchrl_env(game_name, num_worlds=2, seed=0, max_ticks=limit)
    seen = env.reset()
    for numbers in luck_for(env, 10):
        assert not env.last.ended.any()
        _, seen = env.step_and_maybe_reset(with_actions(seen, env, numbers))
    assert env.last.ended.all()
    assert not env.engine.truncated.any()


def test_extra_representations_have_their_own_keys(game_name):
    env = BatchedGameEnv(game_name, representation="vector", extra_representations=("planes",))
    seen = env.reset()
    assert env.key_of("vector") == "observation"
    assert env.key_of("planes") == "planes"
    np.testing.assert_array_equal(seen[GROUP, "planes"].numpy(), env.engine.observe("planes"))
    np.testing.assert_array_equal(seen[GROUP, "observation"].numpy(), env.engine.observe("vector"))


# --- memory that is reused ----------------------------------------------------------------------


def address(array: np.ndarray) -> int:
    return array.__array_interface__["data"][0]


@pytest.mark.slow
def test_memory_returns_when_the_last_view_is_gone():
    pool = ArrayPool()
    array = pool.take((3, 4), np.uint8)
    first = address(array)
    tensor = torch.from_numpy(array)[1:]
    del array
    gc.collect()
    other = pool.take((3, 4), np.uint8)
    assert address(other) != first
    tensor[:] = 7
    other[:] = 1
    assert tensor.eq(7).all()
    del tensor
    gc.collect()
    assert address(pool.take((3, 4), np.uint8)) == first


def test_shapes_and_types_are_kept_apart():
    pool = ArrayPool()
    for shape, dtype in (((2, 3), np.uint8), ((3, 2), np.uint8), ((2, 3), np.bool_)):
        array = pool.take(shape, dtype)
        assert array.shape == shape
        assert array.dtype == dtype


@pytest.mark.slow
def test_no_more_than_a_bounded_number_is_kept():
    pool = ArrayPool()
    held = [pool.take((2,), np.uint8) for _ in range(MAX_SPARE + 5)]
    held.clear()
    gc.collect()
    assert [len(spare) for spare in pool._spare.values()] == [MAX_SPARE]


# --- bad input -------------------------------------------------------------------------------


def test_a_representation_that_was_not_asked_for_is_refused(game_name):
    message = f"{game_name}: this environment does not give 'vector'; name it in `extra_rep"
    with pytest.raises(ValueError, match=re.escape(message)):
        BatchedGameEnv(game_name).key_of("vector")


@pytest.mark.parametrize(
    ("part", "name", "value", "message"),
    [
        ("last", "rewards", np.zeros((1, 2), np.float32), "rewards is float32 [1, 2]"),
        ("last", "rewards", np.full((2, 2), np.nan, np.float32), "rewards[0] of world 0 is nan"),
        ("last", "ended", np.zeros(2, np.int64), "ended is int64 [2]"),
        ("last", "winner", np.array([0, 2], np.int8), "winner of world 1 is 2"),
        ("last", "winner", np.array([[0, 0]], np.int8), "winner is int8 [1, 2]"),
        ("seeds", "episodes", np.array([0, -1]), "episodes of world 1 is -1"),
        ("seeds", "episodes", np.zeros(10**6, np.int64), "episodes is int64 [1000000]"),
        ("seeds", "seed", "x", "seed"),
    ],
)
def test_damaged_game_states_are_refused_before_they_change_anything(part, name, value, message):
    env = BatchedGameEnv("deep_line_wars", "11x11", 2, seed=0)
    env.step(with_actions(env.reset(), env, luck_for(env, 1)[0]))
    state, before = env.game_state(), env.game_state()
    state[part][name] = value
    other = BatchedGameEnv("deep_line_wars", "11x11", 2, seed=1)
    other.reset()
    state["engine"] = other.game_state()["engine"]
    with pytest.raises(ValueError, match=re.escape(message)):
        env.load_game_state(state)
    for part_name, was in before.items():
        for key, now in env.game_state()[part_name].items():
            np.testing.assert_equal(now, was[key])
