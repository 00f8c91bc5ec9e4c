"""Mixed batches: an exact number of generated rows, labelled, and none while the gate is closed."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from marl_cair.replay.buffer import ReplayConfig, make_replay_buffer
from marl_cair.replay.generated import GeneratedReplay
from marl_cair.replay.mixed import MixedReplay
from marl_cair.replay.transition import NO_INDEX, NO_OPPONENT, TransitionSpec, check_transitions
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
    return MixedReplay(FILLED.real, FILLED.generated, fraction, **settings)


@given(fraction=st.floats(0.0, 0.9), batch_size=st.integers(1, 300))
def test_every_batch_holds_its_share_rounded_up_or_down(fraction, batch_size):
    rows = mix(fraction).sample(batch_size)
    assert len(rows) == batch_size
    assert abs(int(rows["is_generated"].sum()) - batch_size * fraction) < 1


def test_the_share_is_exact_in_the_mean():
    mixture = make_mixture(0.2)
    counts = [int(mixture.sample(8)["is_generated"].sum()) for _ in range(1_000)]
    assert set(counts) == {1, 2}
    assert np.mean(counts) == pytest.approx(8 * 0.2, abs=0.06)  # four standard errors
    assert {int(mixture.sample(20)["is_generated"].sum()) for _ in range(50)} == {4}
    assert len(mixture.sample()) == 16  # the real buffer's batch size


def test_real_rows_come_first_and_every_row_is_labelled():
    rows = mix(0.25).sample(16)
    check_transitions(rows, SMALL)
    assert rows["is_generated"].flatten().tolist() == [False] * 12 + [True] * 4
    assert (rows["index"][:12] >= 0).all()
    assert (rows["index"][12:] == NO_INDEX).all()
    assert (rows["opponent"][12:] == NO_OPPONENT).all()
    assert (rows["steps_to_next_obs"][12:] == 1).all()


def test_batches_are_all_real_while_the_gate_is_closed_or_nothing_was_generated():
    closed = mix(0.5, generated_open=False)
    for mixture in (closed, make_mixture(0.5, num_generated=0)):
        rows = mixture.sample(10)
        assert len(rows) == 10
        assert not rows["is_generated"].any()
    closed.generated_open = True
    assert int(closed.sample(10)["is_generated"].sum()) == 5


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"fraction": -0.1}, r"fraction is -0.1, expected 0\.\.1"),
        ({"fraction": 1.05}, "fraction is 1.05"),
        ({"fraction": float("nan")}, "fraction is nan"),
    ],
)
def test_settings_out_of_range_are_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        mix(**settings)


def test_a_resumed_mixture_continues_with_the_same_bits(tmp_path):
    whole = make_mixture()
    for _ in range(7):
        whole.sample(9)
    resumed = make_mixture(num_generated=5)
    whole.save(tmp_path / "mixture")
    resumed.load(tmp_path / "mixture")
    for step in range(10):
        assert_same_rows(whole.sample(9), resumed.sample(9))
        if step == 4:
            new = make_transitions(np.random.default_rng(step), 7)
            whole.generated.extend(new)
            resumed.generated.extend(new.clone())


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
    else:
        with pytest.raises(RuntimeError, match="no generated transition to sample yet"):
            ring.sample(1)


def test_a_generated_row_is_stored_whole():
    ring = GeneratedReplay(SMALL, capacity=9)
    rows = make_transitions(np.random.default_rng(0), 1)
    rows["steps_to_next_obs"] = torch.tensor([[3]])
    ring.extend(rows)
    drawn = ring.sample(1)
    for key in rows.keys(include_nested=True, leaves_only=True):
        assert torch.equal(drawn[key], rows[key])


def test_generated_rows_with_an_illegal_action_are_refused():
    ring = GeneratedReplay(SMALL, capacity=9)
    rows = make_transitions(np.random.default_rng(0), 4)
    rows["action_mask"][1, rows["action"][1]] = False
    with pytest.raises(ValueError, match="row 1: action .* is not legal"):
        ring.extend(rows)
    assert len(ring) == 0


def test_a_generated_ring_of_another_layout_or_size_is_refused(tmp_path):
    GeneratedReplay(SMALL, capacity=9).save(tmp_path / "ring")
    with pytest.raises(ValueError, match="saved generated replay has capacity 9, this one has 8"):
        GeneratedReplay(SMALL, capacity=8).load(tmp_path / "ring")
    with pytest.raises(ValueError, match="has num_actions 11, this one has 12"):
        GeneratedReplay(TransitionSpec((5, 2, 3), 12), capacity=9).load(tmp_path / "ring")
    with pytest.raises(ValueError, match="capacity is 0, expected 1 or more"):
        GeneratedReplay(SMALL, capacity=0)


def test_generated_rows_weigh_less_in_the_loss_where_that_is_asked_for():
    rows = mix(0.25, weight=0.5).sample(16)
    assert rows["priority_weight"].tolist() == [1.0] * 12 + [0.5] * 4
    assert "priority_weight" not in mix(0.25).sample(16)


def test_with_a_fraction_of_1_all_rows_are_generated_and_without_them_there_is_no_batch():
    rows = mix(1.0).sample(16)
    assert len(rows) == 16
    assert rows["is_generated"].all()
    assert mix(1.0).can_sample
    assert not mix(1.0, generated_open=False).can_sample
    assert not make_mixture(1.0, 0).can_sample
    assert mix(0.9, generated_open=False).can_sample  # of real rows


def test_a_cleared_ring_is_empty_and_fills_again():
    mixture = make_mixture()
    mixture.generated.clear()
    assert len(mixture.generated) == 0
    assert not mixture.sample(16)["is_generated"].any()
    mixture.generated.extend(make_transitions(np.random.default_rng(1), 3))
    assert len(mixture.generated) == 3


def test_a_batch_may_round_to_generated_rows_alone():
    mixture = make_mixture(0.99, weight=0.5)
    batches = (mixture.sample(32) for _ in range(100))
    rows = next(batch for batch in batches if batch["is_generated"].all())
    assert "priority_weight" not in rows or rows["priority_weight"].isfinite().all()


def test_with_a_fraction_of_1_a_shut_gate_gives_no_batch():
    mixture = make_mixture(1.0, generated_open=False)
    with pytest.raises(RuntimeError, match="there are none yet"):
        mixture.sample(8)
