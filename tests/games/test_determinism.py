"""A world's game depends on its seed and actions alone: not on place, threads or history."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from marl_cair import games
from marl_cair.games import GAMES
from marl_cair.games.compiled import is_compiling
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.randomness import episode_seeds
from tests.games.cases import (
    DEFAULT_CASES,
    QUICK_CASES,
    SCENARIOS,
    Case,
    Luck,
    choose_actions,
    play,
    replace_kernels,
)

NUM_WORLDS = 5
NUM_DECISIONS = 60


def seeds_of(num_worlds: int, seed: int = 0) -> np.ndarray:
    return episode_seeds(seed, np.arange(num_worlds), np.zeros(num_worlds, np.int64))


def luck_of(engine: BatchedEngine, num_decisions: int = NUM_DECISIONS) -> Luck:
    return Luck.draw(num_decisions, engine.num_worlds, engine.num_players)


def play_from_reset(engine: BatchedEngine, luck: Luck, seeds: np.ndarray) -> list[str]:
    engine.reset(seeds)
    return play(engine, luck)


def assert_worlds_are_independent(engine: BatchedEngine) -> None:
    """Each world plays the same game alone, at place 0, as at its place in the batch."""
    luck, seeds = luck_of(engine), seeds_of(engine.num_worlds)
    together = play_from_reset(engine, luck, seeds)
    assert len(set(together)) == engine.num_worlds
    alone = BatchedEngine(engine.game, engine.scenario)
    for world in range(engine.num_worlds):
        digest = play_from_reset(alone, luck.of_worlds([world]), seeds[[world]])
        assert digest == [together[world]], f"world {world}"


def test_a_world_plays_the_same_alone_as_in_a_batch(case):
    assert_worlds_are_independent(case.engine(NUM_WORLDS))


@pytest.mark.parametrize("case", DEFAULT_CASES, ids=str)
def test_an_engine_that_reads_world_0_for_all_fails_the_independence_test(case):
    whole = case.engine(NUM_WORLDS)

    def step_by_the_actions_of_world_0(worlds, rules, actions, outcome, first, last):
        same = np.repeat(actions[:1], len(actions), axis=0)
        whole.game.step(worlds, rules, same, outcome, first, last)

    with pytest.raises(AssertionError, match="world 1"):
        assert_worlds_are_independent(replace_kernels(whole, step=step_by_the_actions_of_world_0))


def test_threads_do_not_change_the_game(case):
    """More threads than worlds are not started."""
    single = case.engine(NUM_WORLDS)
    luck, seeds = luck_of(single), seeds_of(NUM_WORLDS)
    expected = play_from_reset(single, luck, seeds)
    for num_threads in (2, 8):
        several = case.engine(NUM_WORLDS, num_threads)
        assert several.num_threads == min(num_threads, NUM_WORLDS)
        assert play_from_reset(several, luck, seeds) == expected


def test_a_restored_world_goes_on_the_same_in_another_slot(case):
    """Whatever was played since the snapshot."""
    engine, other = case.engine(NUM_WORLDS), case.engine(NUM_WORLDS)
    luck, seeds = luck_of(engine), seeds_of(NUM_WORLDS)
    engine.reset(seeds)
    play(engine, luck)
    saved = engine.snapshot([1, 3])
    rest = Luck.draw(NUM_DECISIONS, NUM_WORLDS, engine.num_players, seed=1)
    expected = play(engine, rest)

    other.reset(seeds_of(NUM_WORLDS, seed=9))
    other.restore(saved, [4, 0])
    moved = play(other, rest.of_worlds([3, 0, 2, 4, 1]))
    assert (moved[4], moved[0]) == (expected[1], expected[3])


def test_a_state_dict_continues_in_a_fresh_engine(case):
    engine, fresh = case.engine(3), case.engine(3)
    luck = luck_of(engine)
    engine.reset(seeds_of(3))
    play(engine, luck)
    fresh.load_state_dict(engine.state_dict())
    assert play(fresh, luck) == play(engine, luck)


def test_the_same_seed_gives_the_same_game_whatever_was_played_before(case):
    engine, fresh = case.engine(2), case.engine(2)
    luck = luck_of(engine)
    play_from_reset(engine, luck, seeds_of(2, seed=5))
    again = play_from_reset(engine, luck, seeds_of(2, seed=0))
    assert again == play_from_reset(fresh, luck, seeds_of(2, seed=0))


def test_different_seeds_give_different_games(case):
    engine = case.engine(1)
    luck = luck_of(engine)
    games = {play_from_reset(engine, luck, seeds_of(1, seed))[0] for seed in range(4)}
    assert len(games) == 4


def test_reset_restarts_only_the_masked_worlds(case):
    engine = case.engine(3)
    luck = luck_of(engine, 10)
    engine.reset(seeds_of(3))
    play(engine, luck)
    before = engine.state_dict()
    engine.reset(seeds_of(3, seed=1), np.array([False, True, False]))
    after = engine.state_dict()
    for name, value in after.items():
        np.testing.assert_array_equal(value[[0, 2]], before[name][[0, 2]])
    fresh = case.engine(3)
    fresh.reset(seeds_of(3, seed=1))
    for name, value in fresh.state_dict().items():
        np.testing.assert_array_equal(after[name][1], value[1])


@pytest.mark.parametrize("case", DEFAULT_CASES, ids=str)
def test_observing_and_masking_change_nothing(case):
    engine = case.engine(2)
    engine.reset(seeds_of(2))
    play(engine, luck_of(engine, 10))
    before = engine.state_dict()
    engine.action_mask()
    engine.public_state(0)
    for name in engine.spec.representations:
        first, second = engine.observe(name), engine.observe(name)
        np.testing.assert_array_equal(first, second)
        assert not np.shares_memory(first, second)
    for name, value in engine.state_dict().items():
        np.testing.assert_array_equal(value, before[name])


@pytest.mark.slow
@pytest.mark.plain_python
def test_planes_written_in_place_are_those_written_again(case):
    """Whatever happened to the worlds since they were written last; as one read-only array."""
    engine = case.engine(3)
    engine.reset(seeds_of(3))
    seen = engine.observe_in_place("planes")
    with pytest.raises(ValueError, match="read-only"):
        seen[:] = 0
    saved = engine.snapshot([0])
    num_decisions = NUM_DECISIONS if is_compiling() else 12
    for decision, numbers in enumerate(luck_of(engine, num_decisions).numbers):
        engine.step(choose_actions(engine, numbers))
        if decision % 7 == 3:
            engine.reset(seeds_of(3, seed=decision), np.array([False, True, False]))
        if decision % 11 == 5:
            engine.restore(saved, [2])
            saved = engine.snapshot([0])
        for name in ("planes", "vector"):
            expected = engine.observe(name, worlds=[0, 1, 2])
            np.testing.assert_array_equal(engine.observe_in_place(name), expected)
            np.testing.assert_array_equal(engine.observe(name), expected)
    assert engine.observe_in_place("planes") is seen


@pytest.mark.parametrize("case", DEFAULT_CASES, ids=str)
def test_a_whole_game_ends_and_then_stands_still(case):
    engine = case.engine(2, max_ticks=15 * case.engine().spec.ticks_per_step)
    engine.reset(seeds_of(2))
    play(engine, luck_of(engine, 15))
    assert (engine.terminated | engine.truncated).all()
    before = engine.state_dict()
    numbers = luck_of(engine, 3)
    play(engine, numbers)
    before["outcome.rewards"][:] = 0.0
    for name, value in engine.state_dict().items():
        np.testing.assert_array_equal(value, before[name], err_msg=name)


# All action spaces of each default scenario, and a scenario of each goal.
_BY_GOAL = {
    (case.game, getattr(GAMES[case.game].scenario(case.scenario), "goal", "")): case
    for case in QUICK_CASES
}
PLAIN_CASES = list(dict.fromkeys([*DEFAULT_CASES, *_BY_GOAL.values()]))
PLAIN_DECISIONS = 50
PRINT_DIGESTS = """
from tests.games.test_determinism import *
for case in PLAIN_CASES:
    engine = case.engine(2)
    print(*play_from_reset(engine, luck_of(engine, PLAIN_DECISIONS), seeds_of(2)))
"""


def run_plain_python() -> list[str]:
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": os.pathsep.join(sys.path)}
    done = subprocess.run(
        [sys.executable, "-c", PRINT_DIGESTS],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.splitlines()


@pytest.mark.slow
def test_plain_python_plays_the_same_bits_as_compiled_code():
    expected = []
    for case in PLAIN_CASES:
        engine = case.engine(2)
        luck = luck_of(engine, PLAIN_DECISIONS)
        expected.append(" ".join(play_from_reset(engine, luck, seeds_of(2))))
    assert run_plain_python() == expected


def test_every_game_is_covered():
    found = Path(games.__file__).parent.glob("*/definition.py")
    folders = {path.parent.name for path in found} - {"flash"}  # tests/games/flash/test_game.py
    assert {case.game for case in SCENARIOS} == folders
    assert {case.game for case in QUICK_CASES} == folders
    assert Case("deep_line_wars", "30x11", (("actions", "classic"),)) in SCENARIOS
