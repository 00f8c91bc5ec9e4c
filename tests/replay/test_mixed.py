"""Generated rows: an exact number in each batch, labelled, and none while the gate is closed."""

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from marl_cair.replay import (
    NO_INDEX,
    NO_OPPONENT,
    GeneratedReplay,
    MixedReplay,
    ReplayConfig,
    TransitionSpec,
    check_transitions,
    make_replay_buffer,
)
from tests.replay.streams import SMALL, assert_same_rows, make_rollout, make_transitions


def make_mixture(fraction: float = 0.2, num_generated: int = 30, **settings) -> MixedReplay:
    real = make_replay_buffer(ReplayConfig(100, batch_size=16, n_steps=2), SMALL)
    generated = GeneratedReplay(SMALL, capacity=20, seed=3)
    rng = np.random.default_rng(0)
    real.extend_rollout(make_rollout(rng, 20, 3, end_rate=0.1))
    if num_generated:
        generated.extend(make_transitions(rng, num_generated))
    return MixedReplay(real, generated, fraction, **settings)


FILLED = make_mixture()


def mix(fraction: float, **settings) -> MixedReplay:
    """Mix anew, on two rings that are filled already."""
    return MixedReplay(FILLED.real, FILLED.generated, fraction, **settings)


@given(fraction=st.floats(0.0, 0.9), batch_size=st.integers(1, 300))
def test_every_batch_holds_exactly_the_rounded_number(fraction, batch_size):
    rows = mix(fraction).sample(batch_size)
    assert len(rows) == batch_size
    assert int(rows["is_generated"].sum()) == round(batch_size * fraction)


@given(fraction=st.floats(0.0, 0.9), sizes=st.lists(st.integers(1, 70), min_size=1, max_size=20))
def test_a_carried_remainder_makes_the_long_run_share_exact(fraction, sizes):
    mixture = mix(fraction, carry_remainder=True)
    num_rows = num_generated = 0
    for size in sizes:
        drawn = int(mixture.sample(size)["is_generated"].sum())
        assert math.floor(size * fraction) <= drawn <= math.ceil(size * fraction + 1e-6)
        num_rows += size
        num_generated += drawn
        assert num_generated == math.floor(num_rows * fraction + 1e-9)


def test_twenty_percent_of_thirty_two_is_six_each_time_or_carried_to_a_fifth_of_all():
    plain, carried = mix(0.2), mix(0.2, carry_remainder=True)
    counts = [int(plain.sample()["is_generated"].sum()) for _ in range(5)]
    assert counts == [6, 6, 6, 6, 6]
    counts = [int(carried.sample()["is_generated"].sum()) for _ in range(5)]
    assert counts == [6, 6, 7, 6, 7]


def test_real_rows_come_first_and_every_row_is_labelled():
    rows = mix(0.25).sample(16)
    check_transitions(rows, SMALL)
    assert rows["is_generated"].flatten().tolist() == [False] * 12 + [True] * 4
    assert (rows["index"][:12] >= 0).all()
    assert (rows["index"][12:] == NO_INDEX).all()
    assert (rows["opponent"][12:] == NO_OPPONENT).all()
    assert (rows["steps_to_next_obs"][12:] == 1).all()


def test_batches_are_all_real_while_the_generator_is_closed_or_has_made_nothing():
    closed = mix(0.5, generated_open=False)
    empty = make_mixture(0.5, num_generated=0)
    for mixture in (closed, empty):
        rows = mixture.sample(10)
        assert len(rows) == 10
        assert not rows["is_generated"].any()
    closed.generated_open = True
    assert int(closed.sample(10)["is_generated"].sum()) == 5


def test_rows_drawn_while_closed_are_not_made_up_for():
    mixture = mix(0.5, carry_remainder=True, generated_open=False)
    mixture.sample(100)
    mixture.generated_open = True
    assert int(mixture.sample(10)["is_generated"].sum()) == 5


@pytest.mark.parametrize("fraction", [-0.1, 0.95, float("nan")])
def test_a_fraction_out_of_range_is_refused(fraction):
    with pytest.raises(ValueError, match=rf"fraction is {fraction}, expected 0\.\.0\.9"):
        mix(fraction)


def test_a_batch_size_below_one_is_refused():
    with pytest.raises(ValueError, match="batch_size is 0, expected 1 or more"):
        mix(0.2, batch_size=0)


@pytest.mark.parametrize("way", ["state_dict", "folder"])
def test_a_resumed_mixture_goes_on_with_the_same_bits(tmp_path: Path, way):
    whole = make_mixture(carry_remainder=True)
    for _ in range(7):
        whole.sample(9)
    resumed = make_mixture(num_generated=5, carry_remainder=True, generated_open=False)
    if way == "folder":
        whole.save(tmp_path / "mixture")
        resumed.load(tmp_path / "mixture")
    else:
        resumed.load_state_dict(whole.state_dict())
    for step in range(10):
        assert_same_rows(whole.sample(9), resumed.sample(9))
        if step == 4:
            fresh = make_transitions(np.random.default_rng(step), 7)
            whole.generated.extend(fresh)
            resumed.generated.extend(fresh.clone())


@given(sizes=st.lists(st.integers(0, 12), max_size=6))
def test_the_generated_ring_keeps_the_newest_rows(sizes):
    ring = GeneratedReplay(SMALL, capacity=9)
    rng = np.random.default_rng(0)
    rewards: list[float] = []
    for size in sizes:
        rows = make_transitions(rng, size)
        ring.extend(rows)
        rewards += rows["next", "reward"].flatten().tolist()
    assert len(ring) == min(len(rewards), 9)
    if rewards:
        drawn = ring.sample(400)["next", "reward"].flatten().tolist()
        assert set(drawn) == set(rewards[-9:])


def test_a_generated_row_comes_back_whole():
    ring = GeneratedReplay(SMALL, capacity=9)
    rows = make_transitions(np.random.default_rng(0), 1)
    rows["steps_to_next_obs"] = torch.tensor([[3]])
    ring.extend(rows)
    drawn = ring.sample(1)
    for key in rows.keys(include_nested=True, leaves_only=True):
        assert torch.equal(drawn[key], rows[key])


def test_a_cleared_ring_is_empty():
    ring = GeneratedReplay(SMALL, capacity=9)
    ring.extend(make_transitions(np.random.default_rng(0), 4))
    ring.clear()
    assert len(ring) == 0
    with pytest.raises(RuntimeError, match="no generated transition to sample yet"):
        ring.sample(1)


def test_generated_rows_with_an_illegal_action_are_refused():
    ring = GeneratedReplay(SMALL, capacity=9)
    rows = make_transitions(np.random.default_rng(0), 4)
    rows["action_mask"][1, rows["action"][1]] = False
    with pytest.raises(ValueError, match="row 1: action .* is not legal"):
        ring.extend(rows)
    assert len(ring) == 0


def test_a_generated_ring_of_another_layout_or_size_is_refused():
    state = GeneratedReplay(SMALL, capacity=9).state_dict()
    with pytest.raises(ValueError, match="saved generated replay has capacity 9, this one has 8"):
        GeneratedReplay(SMALL, capacity=8).load_state_dict(state)
    with pytest.raises(ValueError, match="has num_actions 11, this one has 12"):
        GeneratedReplay(TransitionSpec((5, 2, 3), 12), capacity=9).load_state_dict(state)
    with pytest.raises(ValueError, match="capacity is 0, expected 1 or more"):
        GeneratedReplay(SMALL, capacity=0)
