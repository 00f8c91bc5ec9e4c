"""The ring of steps equals a slow replay on lists, whatever is appended and overwritten."""

import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from marl_cair.files import NotEnoughSpaceError
from marl_cair.replay.rollout import Rollout
from marl_cair.replay.storage import EpisodeStorage
from marl_cair.replay.transition import UNKNOWN_ACTION, TransitionSpec
from tests.replay.streams import SMALL, ListReplay, make_rollout


def make_steps(rewards: list[float], terminated=None, truncated=None) -> Rollout:
    """One stream with the given rewards and ends, all learned."""
    rollout = make_rollout(
        np.random.default_rng(0), len(rewards), 1, end_rate=0.0, learned_rate=1.1
    )
    nowhere = [False] * len(rewards)
    terminated, truncated = terminated or nowhere, truncated or nowhere
    is_final = torch.tensor(truncated) | torch.tensor(terminated)
    final_step = is_final.nonzero().flatten()
    return Rollout(
        **{
            **vars(rollout),
            "reward": torch.tensor(rewards).unsqueeze(1),
            "terminated": torch.tensor(terminated).unsqueeze(1),
            "truncated": torch.tensor(truncated).unsqueeze(1),
            "final_step": final_step,
            "final_observation": rollout.observation[final_step, 0] ^ 255,
            "final_action_mask": ~rollout.action_mask[final_step, 0],
        }
    )


def assert_equals_list_replay(storage: EpisodeStorage, slow: ListReplay) -> None:
    expected = slow.transitions()
    slots = storage.sampleable_slots()
    assert slots.tolist() == sorted(expected)
    assert storage.num_sampleable == len(expected)
    assert storage.num_written == slow.num_written
    if len(slots):
        rows = storage.get(slots)
        for row, slot in enumerate(slots.tolist()):
            for key, value in expected[slot].items():
                assert rows[key].dtype == value.dtype, key
                assert torch.equal(rows[key][row], value), (key, slot)


@pytest.mark.slow
@given(
    seed=st.integers(0, 2**32 - 1),
    capacity=st.integers(2, 40),
    num_streams=st.integers(1, 4),
    n_steps=st.integers(1, 5),
    num_steps=st.lists(st.integers(0, 6), min_size=1, max_size=8),
    end_rate=st.sampled_from([0.0, 0.1, 0.4]),
)
def test_any_history_equals_the_list_replay(
    seed, capacity, num_streams, n_steps, num_steps, end_rate
):
    rng = np.random.default_rng(seed)
    storage = EpisodeStorage(SMALL, capacity, n_steps=n_steps, gamma=0.9)
    slow = ListReplay(capacity, n_steps, 0.9)
    for length in num_steps:
        rollout = make_rollout(rng, length, num_streams, end_rate=end_rate)
        assert storage.append(rollout).tolist() == slow.append(rollout)
        assert_equals_list_replay(storage, slow)


@given(seed=st.integers(0, 2**32 - 1), capacity=st.integers(2, 30))
def test_a_successor_is_always_newer_and_still_there(seed, capacity):
    rng = np.random.default_rng(seed)
    storage = EpisodeStorage(SMALL, capacity, n_steps=3)
    for _ in range(6):
        storage.append(make_rollout(rng, int(rng.integers(0, 8)), 3, end_rate=0.1))
        newest = storage.num_written - 1
        ages = (newest - np.arange(capacity)) % capacity  # 0: the newest entry
        slots = np.flatnonzero(storage._ring.sampleable)
        successors = storage._ring.successor[slots]
        assert (ages[successors] < ages[slots]).all()
        assert (ages[slots] < storage.num_written).all()


def test_an_n_step_reward_is_the_exact_discounted_sum():
    rewards = [0.1, 0.2, 0.3, 0.4, 0.5]
    storage = EpisodeStorage(SMALL, 10, n_steps=3, gamma=0.99)
    storage.append(make_steps(rewards))
    rows = storage.get(torch.tensor([0, 1, 2, 3]))
    r = [float(np.float32(x)) for x in rewards]
    sums = [
        r[0] + 0.99 * r[1] + 0.99**2 * r[2],
        r[1] + 0.99 * r[2] + 0.99**2 * r[3],
        r[2] + 0.99 * r[3],  # the step after has no next observation yet
        r[3],
    ]
    assert rows["next", "reward"].flatten().tolist() == [float(np.float32(x)) for x in sums]
    assert rows["steps_to_next_obs"].flatten().tolist() == [3, 3, 2, 1]


@pytest.mark.parametrize(("terminates", "truncates"), [(True, False), (False, True), (True, True)])
def test_a_chain_stops_at_the_end_and_reaches_its_final_observation(terminates, truncates):
    storage = EpisodeStorage(SMALL, 10, n_steps=3, gamma=0.5)
    steps = make_steps(
        [1.0, 2.0, 4.0, 8.0],
        terminated=[False, terminates, False, False],
        truncated=[False, truncates, False, False],
    )
    assert storage.append(steps).tolist() == [0, 1, 3, 4]  # slot 2 is the tail
    rows = storage.get(torch.tensor([0, 1, 3]))
    assert rows["next", "reward"].flatten().tolist() == [2.0, 2.0, 4.0]
    assert rows["steps_to_next_obs"].flatten().tolist() == [2, 1, 1]
    assert rows["next", "terminated"].flatten().tolist() == [terminates, terminates, False]
    assert rows["next", "done"].flatten().tolist() == [True, True, False]
    for row in (0, 1):
        assert torch.equal(rows["next", "observation"][row], steps.final_observation[0])
        assert torch.equal(rows["next", "action_mask"][row], steps.final_action_mask[0])


@pytest.mark.parametrize("length", [1, 2, 7])
def test_open_slots_are_those_that_wait_for_a_next_step(length):
    storage, rng, passed = EpisodeStorage(SMALL, 2_000), np.random.default_rng(0), []
    assert storage.open_slots().tolist() == []
    for _ in range(20):
        waiting = storage.open_slots()
        slots = torch.cat([waiting, storage.append(make_rollout(rng, length, 3, end_rate=0.2))])
        passed += slots[storage.has_next(slots)].tolist()
    assert sorted(passed) == storage.step_slots().tolist()  # each once


def test_the_others_actions_after_some_steps_are_those_recorded_there():
    spec = dataclasses.replace(SMALL, num_others=2)
    storage = EpisodeStorage(spec, 20, n_steps=3)
    rollout = make_steps([0.0] * 6, terminated=[False, False, False, True, False, False])
    theirs = torch.arange(12).view(6, 1, 2)
    slots = storage.append(Rollout(**{**vars(rollout), "other_actions": theirs}))
    found = storage.find_others_after(slots[[0, 1, 0, 4]], torch.tensor([1, 2, 0, 1]))
    assert found.tolist() == [[2, 3], [6, 7], [0, 1], [10, 11]]
    ended = storage.find_others_after(slots[[3]], torch.tensor([1]))
    assert ended.tolist() == [[UNKNOWN_ACTION] * 2]


def test_vectors_of_floats_are_stored_bit_by_bit():
    spec = TransitionSpec((7,), num_actions=3, observation_dtype=torch.float32)
    storage = EpisodeStorage(spec, 10, n_steps=2)
    rollout = make_rollout(np.random.default_rng(0), 4, 1, spec, end_rate=0.0, learned_rate=1.1)
    storage.append(rollout)
    rows = storage.get(torch.tensor([0]))
    assert torch.equal(rows["observation"][0], rollout.observation[0, 0])
    assert torch.equal(rows["next", "observation"][0], rollout.observation[2, 0])


@pytest.mark.parametrize("num_actions", [1, 8, 9, 185])
def test_masks_of_any_length_are_returned_as_stored(num_actions):
    spec = TransitionSpec((1, 2, 2), num_actions)
    storage = EpisodeStorage(spec, 100)
    rollout = make_rollout(np.random.default_rng(0), 30, 1, spec, end_rate=0.0, learned_rate=1.1)
    storage.append(rollout)
    rows = storage.get(torch.arange(29))
    assert torch.equal(rows["action_mask"], rollout.action_mask[:29, 0])
    assert torch.equal(rows["next", "action_mask"], rollout.action_mask[1:, 0])


@pytest.mark.parametrize("slot", [-1, 2, 3, 10])
def test_a_slot_that_starts_no_transition_is_refused(slot):
    storage = EpisodeStorage(SMALL, 10)
    storage.append(make_steps([1.0, 2.0, 3.0]))
    with pytest.raises(IndexError, match=rf"slot {slot} starts no transition .* 3 entries"):
        storage.get(torch.tensor([0, slot]))


def test_a_step_of_deep_line_wars_takes_2763_bytes():
    storage = EpisodeStorage(TransitionSpec((28, 10, 15), 185, num_uniform=10), 1000)
    assert storage.nbytes_per_step == 18 * 150 + 10 + 24 + 4 + 4 + 1 + 1 + 4 + 2 + 8 + 4 + 1 == 2763


def test_a_ring_on_disk_equals_one_in_memory_and_leaves_no_file(tmp_path: Path):
    scratch = tmp_path / "scratch"
    on_disk = EpisodeStorage(SMALL, 20, n_steps=2, scratch_dir=scratch)
    in_memory = EpisodeStorage(SMALL, 20, n_steps=2)
    rng = np.random.default_rng(0)
    for _ in range(4):
        rollout = make_rollout(rng, 5, 2, end_rate=0.1)
        on_disk.append(rollout)
        in_memory.append(rollout)
    slots = in_memory.sampleable_slots()
    assert torch.equal(on_disk.sampleable_slots(), slots)
    for key, value in in_memory.get(slots).items(include_nested=True, leaves_only=True):
        assert torch.equal(on_disk.get(slots)[key], value)
    if os.name == "posix":  # no name: a killed process leaves nothing either
        assert list(scratch.iterdir()) == []
    del on_disk
    assert list(scratch.iterdir()) == []


def test_a_ring_larger_than_the_disk_is_refused_before_anything_is_written(tmp_path: Path):
    with pytest.raises(NotEnoughSpaceError, match="free some space"):
        EpisodeStorage(SMALL, 10**13, scratch_dir=tmp_path / "scratch")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"capacity": 1}, "capacity is 1, expected 2 or more"),
        ({"n_steps": 0}, "n_steps is 0, expected 1 or more"),
        ({"gamma": 1.5}, r"gamma is 1.5, expected 0..1"),
    ],
)
def test_a_setting_out_of_range_is_refused(settings, message):
    with pytest.raises(ValueError, match=message):
        EpisodeStorage(SMALL, **{"capacity": 10, **settings})
    with pytest.raises(ValueError, match=r"num_steps is 3, expected 1..2"):
        EpisodeStorage(SMALL, 10, n_steps=2).get_transitions(torch.arange(1), 3)


def test_another_number_of_streams_is_refused():
    storage = EpisodeStorage(SMALL, 10)
    rng = np.random.default_rng(0)
    storage.append(make_rollout(rng, 2, 3))
    with pytest.raises(ValueError, match="has 2 streams, those before had 3"):
        storage.append(make_rollout(rng, 2, 2))
