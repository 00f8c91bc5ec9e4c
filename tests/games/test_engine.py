"""The engine's contract: what it offers, and what it answers to wrong input."""

import re

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.compiled import is_compiling
from marl_cair.games.engine import BatchedEngine, Snapshot
from marl_cair.games.game import NO_CELL, NO_WINNER
from marl_cair.lookup import UnknownNameError
from tests.games.cases import Luck, choose_actions, replace_kernels

SEEDS = np.zeros(3, np.uint64)


@pytest.fixture
def engine(game_name) -> BatchedEngine:
    """Three worlds that have been reset."""
    made = make_engine(game_name, num_worlds=3)
    made.reset(np.arange(3, dtype=np.uint64))
    return made


def noops(engine: BatchedEngine) -> np.ndarray:
    shape = (engine.num_worlds, engine.num_players)
    return np.full(shape, engine.spec.noop_action, np.int32)


# --- what the specification promises ---------------------------------------------------------


def test_every_action_has_its_own_name_and_a_group(case):
    spec = case.engine().spec
    assert len(set(spec.action_names)) == spec.num_actions == len(spec.action_groups)
    assert spec.action_groups.dtype == np.int16
    assert set(spec.action_groups.tolist()) == set(range(len(spec.action_group_names)))
    assert len(spec.action_cells) == spec.num_actions
    assert spec.action_cells.min() >= NO_CELL
    assert spec.action_names[spec.noop_action] == "noop"


def test_representations_have_the_shape_and_type_that_they_promise(game_name):
    engine = make_engine(game_name, num_worlds=1)
    engine.reset(0)
    for name, representation in engine.spec.representations.items():
        seen = engine.observe(name)
        assert representation.name == name
        assert seen.shape == (1, engine.num_players, *representation.shape)
        assert seen.dtype == representation.dtype
        assert len(representation.plane_names) == representation.shape[0]


def test_uniform_planes_hold_one_value_and_static_ones_do_not_change(case):
    engine = case.engine(2)
    engine.reset(np.arange(2, dtype=np.uint64))
    num_uniform = engine.representation("planes").num_uniform
    static = list(engine.spec.static_planes)
    first = engine.observe("planes")
    for numbers in Luck.draw(40, 2, engine.num_players).numbers:
        engine.step(choose_actions(engine, numbers))
        seen = engine.observe("planes")
        uniform = seen[:, :, -num_uniform:]
        assert (uniform == uniform[..., :1, :1]).all()
        np.testing.assert_array_equal(seen[:, :, static], first[:, :, static])
        for group in engine.spec.exclusive_planes:
            assert ((seen[:, :, list(group)] > 0).sum(axis=2) <= 1).all()


def test_rewards_stay_within_their_bound_and_the_noop_is_always_legal(case):
    engine = case.engine(2)
    engine.reset(np.arange(2, dtype=np.uint64))
    for numbers in Luck.draw(40, 2, engine.num_players, seed=2).numbers:
        engine.step(choose_actions(engine, numbers))
        assert np.abs(engine.rewards).max() <= engine.spec.reward_bound
        assert engine.action_mask()[..., engine.spec.noop_action].all()


def test_observe_and_mask_write_into_the_given_array(engine):
    seen, masks = engine.observe("planes"), engine.action_mask()
    other_seen, other_masks = np.empty_like(seen), np.empty_like(masks)
    assert engine.observe("planes", out=other_seen) is other_seen
    assert engine.action_mask(out=other_masks) is other_masks
    np.testing.assert_array_equal(other_seen, seen)
    np.testing.assert_array_equal(other_masks, masks)


def test_some_worlds_are_seen_as_among_all(engine):
    seen, legal = engine.observe("planes"), engine.action_mask()
    for rows in ([1, 0], [1], []):
        assert np.array_equal(engine.observe("planes", worlds=rows), seen[rows])
        assert np.array_equal(engine.action_mask(worlds=rows), legal[rows])
    out = np.empty_like(seen[:1])
    assert engine.observe("planes", out, [1]) is out
    assert np.array_equal(out[0], seen[1])
    with pytest.raises(ValueError, match=r"worlds \[9\] must be a list of indices"):
        engine.observe("planes", worlds=[9])


def test_an_integer_seeds_a_single_world(game_name):
    by_integer, by_array = make_engine(game_name), make_engine(game_name)
    by_integer.reset(5)
    by_array.reset(np.array([5], np.uint64))
    np.testing.assert_equal(by_integer.state_dict(), by_array.state_dict())


def test_outcomes_begin_empty_and_are_written_in_place(engine):
    rewards, winner = engine.rewards, engine.winner
    assert not engine.terminated.any()
    assert not engine.truncated.any()
    assert (winner == NO_WINNER).all()
    engine.step(noops(engine))
    assert engine.rewards is rewards
    assert engine.winner is winner


def test_reset_clears_the_outcome_of_its_worlds(game_name):
    engine = make_engine(game_name, num_worlds=2, max_ticks=100)
    engine.reset(np.zeros(2, np.uint64))
    while not (engine.terminated | engine.truncated).all():
        engine.step(noops(engine))
    engine.reset(np.zeros(2, np.uint64), np.array([False, True]))
    assert (engine.terminated | engine.truncated).tolist() == [True, False]


# --- bad input -------------------------------------------------------------------------------


def refuses(error: type[Exception], text: str):
    return pytest.raises(error, match=re.escape(text))


def test_unknown_scenarios_options_bots_and_representations_are_named(engine):
    game = engine.game
    for name in ("nowhere", 7):
        with refuses(UnknownNameError, f"unknown {game.name} scenario {name!r}"):
            make_engine(game.name, name)
    with refuses(UnknownNameError, f"unknown {game.name} option 'max_tick': nearest are"):
        make_engine(game.name, max_tick=5)
    with refuses(UnknownNameError, f"unknown {game.name} bot 'missing'"):
        game.bot("missing", engine.scenario)
    with refuses(UnknownNameError, f"unknown {game.name} representation 'plane': nearest are"):
        engine.observe("plane")


@pytest.mark.parametrize("name", ["num_worlds", "num_threads"])
@pytest.mark.parametrize("value", [0, -3, "4", 4.5, None])
def test_counts_below_one_or_that_are_not_whole_are_refused(game_name, name, value):
    message = f"{game_name}: {name} is {value!r}, it must be at least 1, and a whole number"
    with refuses(ValueError, message):
        make_engine(game_name, **{name: value})


def test_the_first_reset_and_the_first_restore_are_of_all_worlds(engine):
    """The worlds that are left out would play on arrays that hold no game."""
    fresh = make_engine(engine.game.name, num_worlds=3)
    message = f"{engine.game.name}: the engine begins with 1 of its 3 worlds, the others would"
    with refuses(ValueError, message):
        fresh.reset(np.zeros(3, np.uint64), np.array([False, True, False]))
    with refuses(ValueError, message):
        fresh.restore(engine.snapshot([2]), [2])
    with refuses(RuntimeError, "step before reset"):
        fresh.step(noops(engine))
    fresh.restore(engine.snapshot())
    fresh.restore(engine.snapshot([2]), [1])
    fresh.reset(np.zeros(3, np.uint64), np.array([False, True, False]))


@pytest.mark.parametrize(
    ("seeds", "mask", "message"),
    [
        (np.zeros(2, np.uint64), None, "seeds are uint64 [2], they must be uint64 [3]"),
        (np.zeros(3, np.int64), None, "seeds are int64 [3], they must be uint64 [3]"),
        (np.zeros((3, 1), np.uint64), None, "seeds are uint64 [3, 1], they must be uint64 [3]"),
        (5, None, "seeds are int64 [], they must be uint64 [3]"),
        (SEEDS, np.ones(2, np.bool_), "the reset mask is bool [2], it must be bool [3]"),
        (SEEDS, np.ones(3, np.int8), "the reset mask is int8 [3], it must be bool [3]"),
        (SEEDS, [1, 0, 1], "the reset mask is int64 [3], it must be bool [3]"),
    ],
)
def test_wrong_seeds_and_reset_masks_are_described(engine, seeds, mask, message):
    with refuses(ValueError, message):
        engine.reset(seeds, mask)


@pytest.mark.parametrize(
    ("shape", "dtype"),
    [((2, 0), np.int32), ((3,), np.int32), ((3, 0), np.float64), ((3, 0), np.bool_)],
)
def test_actions_of_a_wrong_shape_or_type_are_described(engine, shape, dtype):
    """In `shape`, 0 stands for the number of players."""
    players = engine.num_players
    actions = np.zeros([size or players for size in shape], dtype)
    described = f"{actions.dtype} {list(actions.shape)}"
    expected = f"they must be integers [3, {players}] (worlds, players)"
    with refuses(ValueError, f"actions are {described}, {expected}"):
        engine.step(actions)


def test_an_action_outside_the_space_names_world_and_player_and_changes_nothing(engine):
    before, last = engine.state_dict(), engine.num_players - 1
    for action in (-1, 1_000_000, 2**32):
        actions = noops(engine).astype(np.int64)
        actions[2, -1] = action
        place = f"action {action} of player {last} in world 2"
        with refuses(ValueError, f"{place} is outside 0..{engine.num_actions - 1}"):
            engine.step(actions)
    np.testing.assert_equal(engine.state_dict(), before)


def test_an_output_array_that_does_not_fit_is_described(engine):
    shape = list(engine.observe("planes").shape)
    with refuses(ValueError, f"observe cannot write to float32 {shape}, `out` must be contiguous"):
        engine.observe("planes", out=np.empty(shape, np.float32))
    with refuses(
        ValueError, "observe cannot write to uint8 [3, 2], `out` must be contiguous uint8"
    ):
        engine.observe("planes", out=np.empty((3, 2), np.uint8))
    masks = np.empty((engine.num_actions, 2, 3), np.bool_).T
    described = [3, 2, engine.num_actions]
    message = f"action_mask cannot write to bool {described}, `out` must be contiguous bool"
    with refuses(ValueError, message):
        engine.action_mask(out=masks)
    view = engine.action_mask()
    view.flags.writeable = False
    with refuses(ValueError, f"contiguous bool {list(view.shape)} that can be written to"):
        engine.action_mask(out=view)


def test_seeds_and_masks_need_not_lie_side_by_side(game_name):
    """Kernels take all arrays for contiguous ones."""
    plain, spread = make_engine(game_name, num_worlds=3), make_engine(game_name, num_worlds=3)
    seeds, mask = np.arange(6, dtype=np.uint64), np.array([1, 0, 0, 0, 1, 0], bool)
    for engine, given in ((plain, seeds[::2].copy()), (spread, seeds[::2])):
        engine.reset(given)
    plain.reset(seeds[1::2].copy(), mask[::2].copy())
    spread.reset(seeds[1::2], mask[::2])
    np.testing.assert_equal(spread.state_dict(), plain.state_dict())


@pytest.mark.parametrize(
    "worlds", [[3], [-1], np.array([True, False, True]), [[0]], [0.0]], ids=str
)
def test_worlds_that_do_not_exist_are_refused(engine, worlds):
    listed = np.asarray(worlds).tolist()
    with refuses(ValueError, f"worlds {listed} must be a list of indices in 0..2"):
        engine.snapshot(worlds)
    engine.restore(engine.snapshot([]), [])  # an empty list is one


def test_a_snapshot_of_another_scenario_is_refused(engine):
    other = make_engine(engine.game.name, num_worlds=3, max_ticks=500)
    other.reset(np.zeros(3, np.uint64))
    with refuses(ValueError, f"{engine.game.name}: the snapshot is of {other.scenario}, this"):
        engine.restore(other.snapshot())


def test_a_snapshot_of_another_number_of_worlds_is_refused(engine):
    with refuses(ValueError, "restore into the same scenario and as many worlds as were saved"):
        engine.restore(engine.snapshot([0, 1]))
    state, outcome = engine.snapshot().world, engine.snapshot([0]).outcome
    shape = [1, engine.num_players]
    with refuses(ValueError, f"the saved rewards is float32 {shape}, this engine needs float32"):
        engine.restore(Snapshot(engine.scenario, state, outcome))


def test_a_refused_restore_changes_nothing(engine):
    before = engine.state_dict()
    broken = {**before, "outcome.winner": np.zeros(3, np.int64)}
    broken["world." + engine._worlds._fields[0]] = before["world." + engine._worlds._fields[0]] + 1
    with refuses(ValueError, "the saved winner is int64 [3], this engine needs int8 [3]"):
        engine.load_state_dict(broken)
    np.testing.assert_equal(engine.state_dict(), before)


def test_a_snapshot_that_was_changed_is_refused_by_field_world_value_and_range(engine):
    """`restore`, `load_state_dict` and copies of an engine check what the rules would trust."""
    last = engine.spec.max_ticks
    name = "clock[0] (TICK)" if hasattr(engine._worlds, "clock") else "tick"
    said = f"{engine.game.name}: the saved state is damaged: {name} of world 1 is {last + 1}, "
    snapshot = engine.snapshot()
    tick = snapshot.world[engine._worlds._fields.index(name.partition("[")[0])]
    tick[1, 0] = last + 1
    with refuses(ValueError, f"{said}allowed are 0..{last}"):
        engine.restore(snapshot)
    state = engine.state_dict()
    state[f"world.{name.partition('[')[0]}"][1, 0] = last + 1
    with refuses(ValueError, said):
        engine.load_state_dict(state)


@pytest.mark.parametrize(
    ("name", "value"), [("rewards", np.nan), ("rewards", np.inf), ("winner", -2), ("winner", 100)]
)
def test_outcomes_that_no_step_reports_are_refused(engine, name, value):
    state = engine.state_dict()
    state[f"outcome.{name}"][2] = value
    with refuses(ValueError, f"{engine.game.name}: the saved state is damaged: {name}"):
        engine.load_state_dict(state)


def test_a_game_without_limits_checks_shapes_and_types_alone(engine):
    plain = replace_kernels(engine, state_limits=None)
    snapshot = engine.snapshot()
    snapshot.world[0][:] = -1
    plain.restore(snapshot)
    assert (plain.snapshot().world[0] == -1).all()


# --- one type of array for each kernel -----------------------------------------------------------


@pytest.mark.skipif(not is_compiling(), reason="plain Python compiles nothing")
def test_read_only_and_strided_input_compiles_no_kernel_again(game_name):
    first = make_engine(game_name, num_worlds=2)
    first.reset(np.arange(2, dtype=np.uint64))
    first.step(noops(first))
    num_known = [len(rule.entry.overloads) for rule in (first.game.reset, first.game.step)]
    engine = make_engine(game_name, num_worlds=2)
    seeds, mask, actions = np.arange(2, dtype=np.uint64), np.ones(2, np.bool_), noops(engine)
    for array in (seeds, mask, actions):
        array.flags.writeable = False  # as arrays of JAX are
    engine.reset(seeds, mask)
    engine.step(actions)
    again = make_engine(game_name, num_worlds=2)
    again.reset(np.arange(4, dtype=np.uint64)[::2], np.ones(4, np.bool_)[::2])
    again.step(np.broadcast_to(actions[:1], actions.shape))
    known = [len(rule.entry.overloads) for rule in (engine.game.reset, engine.game.step)]
    assert known == num_known
    assert not actions.flags.writeable


def test_a_state_dict_that_lacks_fields_is_refused(engine):
    state = engine.state_dict()
    del state["outcome.rewards"], state["outcome.winner"]
    message = f"{engine.game.name}: the engine state has no outcome.rewards, outcome.winner"
    with refuses(ValueError, message):
        engine.load_state_dict(state)


def test_a_picture_is_an_rgb_array_of_one_world(engine):
    players = engine.num_players
    for player in (None, *range(players)):
        picture = engine.render(1, player)
        assert picture.dtype == np.uint8
        assert picture.shape[2:] == (3,)
    with refuses(ValueError, "world 3 does not exist, allowed are 0..2"):
        engine.render(3)
    with refuses(ValueError, f"player {players} does not exist, allowed are 0..{players - 1}"):
        engine.render(0, players)
