"""`BatchedGameEnv.step_and_maybe_reset` against TorchRL's own implementation."""

import pytest
import torch
from tensordict import TensorDict, lazy_stack
from torchrl.envs import EnvBase

import marl_cair
from marl_cair.games import torchrl_env
from marl_cair.games.torchrl_env import GROUP, BatchedGameEnv
from tests.games.cases import IN_PROCESS, Case
from tests.games.test_torchrl_env import leaves, luck_for, make_env, with_actions

NUM_WORLDS, NUM_STEPS = 5, 200


CASES = [Case(name, marl_cair.GAMES[name].default_scenario) for name in IN_PROCESS]
CASES += [Case("flappy_bird", "race-4-windy"), Case("deep_rts", "FFA-3-15x15")]  # seats go out


def assert_same(own: TensorDict, reference: TensorDict) -> None:
    """Equal keys, shapes, types and numbers."""
    ours, theirs = leaves(own), leaves(reference)
    assert set(ours) == set(theirs)
    for key, value in theirs.items():
        assert ours[key].dtype == value.dtype, key
        assert torch.equal(ours[key], value), key


def describe(seen: TensorDict) -> dict:
    """Type, batch size and device of the containers, whether entries are contiguous."""
    return {
        key: (type(value), value.batch_size, value.device)
        if isinstance(value, TensorDict)
        else value.is_contiguous()
        for key, value in (*seen.items(include_nested=True), (None, seen))
    }


def restart(env: BatchedGameEnv, seen: TensorDict, world: int) -> TensorDict:
    asked = torch.arange(NUM_WORLDS).unsqueeze(-1) == world
    return env.reset(seen.copy().set("_reset", asked))


def write(seen: TensorDict, number: int) -> TensorDict:
    """What policies and collectors leave in a step, and what TorchRL drops."""
    shape = (NUM_WORLDS, seen[GROUP].batch_size[1])
    seen[GROUP, "values"] = torch.full(shape, number)
    seen["collector", "traj_ids"] = torch.full((NUM_WORLDS,), number)
    seen["action"] = seen["reward"] = torch.full((NUM_WORLDS,), number)
    return seen.set_non_tensor("note", str(number))


@pytest.mark.parametrize(
    "whole", [True, pytest.param(False, marks=pytest.mark.slow)], ids=["whole", "rows"]
)
@pytest.mark.parametrize("case", CASES, ids=str)
def test_it_equals_torchrls_own(case, whole, monkeypatch):
    monkeypatch.setattr(torchrl_env, "SMALL", torchrl_env.SMALL if whole else 0)
    own, reference = make_env(case, NUM_WORLDS), make_env(case, NUM_WORLDS)
    seen, shown = own.reset(), reference.reset()
    kept = []
    for number, numbers in enumerate(luck_for(own, NUM_STEPS)):
        if number < NUM_WORLDS:  # so that games end at different times
            seen, shown = restart(own, seen, number), restart(reference, shown, number)
        if number % 7 == 3:
            write(seen, number), write(shown, number)
        chosen = with_actions(seen, own, numbers)
        stepped, seen = own.step_and_maybe_reset(chosen)
        chosen = with_actions(shown, reference, numbers)
        expected, shown = EnvBase.step_and_maybe_reset(reference, chosen)
        assert_same(stepped, expected)
        assert_same(seen, shown)
        if number % 20 == 0:
            assert describe(stepped) == describe(expected)
            assert describe(seen) == describe(shown)
            kept.append((stepped, expected.clone()))
    for stepped, expected in kept:  # later steps have not written to these
        assert_same(stepped, expected)
    assert own.seeds.episodes.tolist() == reference.seeds.episodes.tolist()
    assert own.seeds.episodes.min() > 2


def default_env(**options) -> BatchedGameEnv:
    game = "flappy_bird"
    return make_env(Case(game, marl_cair.GAMES[game].default_scenario), NUM_WORLDS, **options)


def preset(seen: TensorDict) -> TensorDict:
    return seen.set(("next", "mine"), torch.ones(NUM_WORLDS))


def partial(seen: TensorDict) -> TensorDict:
    return seen.set("_step", torch.zeros(NUM_WORLDS, dtype=torch.bool))


def without_device(seen: TensorDict) -> TensorDict:
    return seen.copy().clear_device_()


def stack(seen: TensorDict) -> TensorDict:
    return lazy_stack(list(seen.unbind(0)))


@pytest.mark.parametrize("change", [preset, partial, without_device, stack])
def test_special_inputs_are_treated_as_by_torchrl(change):
    own, reference = default_env(), default_env()
    numbers = luck_for(own, 1)[0]
    got = own.step_and_maybe_reset(change(with_actions(own.reset(), own, numbers)))
    chosen = change(with_actions(reference.reset(), reference, numbers))
    for result, expected in zip(got, EnvBase.step_and_maybe_reset(reference, chosen), strict=True):
        assert (result == expected).all()
        assert set(leaves(result)) == set(leaves(expected))


def test_a_wrong_batch_size_is_refused_by_torchrl():
    env = default_env()
    chosen = with_actions(env.reset(), env, luck_for(env, 1)[0])
    with pytest.raises(RuntimeError, match="Expected a tensordict with shape==env.batch_size"):
        env.step_and_maybe_reset(chosen[:2])


def test_closing_frees_the_worlds(monkeypatch):
    env, closed = BatchedGameEnv("deep_line_wars", "11x11", 1), []
    monkeypatch.setattr(env.engine, "close", lambda: closed.append(True))
    env.close()
    assert closed == [True]
