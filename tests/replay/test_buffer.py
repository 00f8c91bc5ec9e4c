"""The buffer: fed with rollouts, sampled, saved, and resumed bit by bit."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from marl_cair.replay import (
    EpisodeReplayBuffer,
    ReplayConfig,
    TransitionSpec,
    UniformSampler,
    check_transitions,
    make_replay_buffer,
)
from tests.replay.streams import SMALL, assert_same_rows, make_rollout


def make_buffer(scratch_dir: Path | None = None, **settings) -> EpisodeReplayBuffer:
    folder = None if scratch_dir is None else str(scratch_dir)
    chosen = {"capacity_transitions": 50, "batch_size": 8, "n_steps": 3, "scratch_dir": folder}
    return make_replay_buffer(ReplayConfig(**{**chosen, **settings}), SMALL)


def play_on(buffer: EpisodeReplayBuffer, rng: np.random.Generator, rounds: int) -> list:
    """Append and sample in turn; return the samples."""
    samples = []
    for _ in range(rounds):
        buffer.extend_rollout(make_rollout(rng, 4, 3, end_rate=0.1))
        samples.append(buffer.sample())
    return samples


def assert_same_samples(first: list, second: list) -> None:
    assert len(first) == len(second)
    for one, other in zip(first, second, strict=True):
        assert_same_rows(one, other)


def test_a_sample_has_the_transition_keys_and_its_index():
    buffer = make_buffer()
    (rows,) = play_on(buffer, np.random.default_rng(0), 1)
    check_transitions(rows, SMALL)
    assert set(rows.keys(include_nested=True, leaves_only=True)) == set(SMALL.fields())
    again = buffer.storage.get(rows["index"])
    assert torch.equal(again["observation"], rows["observation"])
    assert not rows["is_generated"].any()
    assert len(buffer.sample(5)) == 5


@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**32 - 1),
    rounds_before=st.integers(0, 12),
    capacity=st.integers(12, 90),
    way=st.sampled_from(["state_dict", "folder"]),
    on_disk=st.booleans(),
    is_closed=st.booleans(),
)
def test_a_resumed_buffer_goes_on_with_the_same_bits(
    tmp_path_factory, seed, rounds_before, capacity, way, on_disk, is_closed
):
    folder = tmp_path_factory.mktemp("replay")
    scratch = folder / "scratch" if on_disk else None
    rng = np.random.default_rng(seed)
    whole = make_buffer(scratch, capacity_transitions=capacity)
    play_on(whole, rng, rounds_before)
    if is_closed:
        whole.close_streams()
    resumed = make_buffer(scratch, capacity_transitions=capacity, seed=99)
    play_on(resumed, np.random.default_rng(1), 2)  # what is loaded replaces all of it
    if way == "folder":
        whole.save(folder / "saved")
        resumed.load(folder / "saved")
    else:
        resumed.load_state_dict(whole.state_dict())
    rng_copy = np.random.default_rng()
    rng_copy.bit_generator.state = rng.bit_generator.state
    assert_same_samples(play_on(whole, rng, 6), play_on(resumed, rng_copy, 6))
    assert torch.equal(whole.storage.sampleable_slots(), resumed.storage.sampleable_slots())


def test_a_state_is_a_copy_of_the_used_part_in_plain_data():
    buffer = make_buffer(capacity_transitions=1000)
    play_on(buffer, np.random.default_rng(0), 2)
    state = buffer.state_dict()

    def leaves(value):
        if isinstance(value, dict):
            return [leaf for item in value.values() for leaf in leaves(item)]
        return [value]

    assert {type(leaf) for leaf in leaves(state)} <= {torch.Tensor, int, float, str, list}
    assert len(state["storage"]["arrays"]["rows"]) == len(buffer)
    before = state["storage"]["arrays"]["rows"].clone()
    play_on(buffer, np.random.default_rng(0), 300)
    assert torch.equal(state["storage"]["arrays"]["rows"], before)


def test_a_saved_folder_holds_no_pickle_and_is_replaced_whole(tmp_path: Path):
    buffer = make_buffer()
    play_on(buffer, np.random.default_rng(0), 2)
    buffer.save(tmp_path / "replay")
    play_on(buffer, np.random.default_rng(0), 2)
    buffer.save(tmp_path / "replay")
    assert [path.name for path in tmp_path.iterdir()] == ["replay"]
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert {path.suffix for path in files} == {".npy", ".json"}
    for path in files:
        if path.suffix == ".npy":
            np.load(path, allow_pickle=False)


def test_a_save_that_fails_leaves_the_saved_folder_as_it_was(tmp_path: Path):
    class FailingSampler(UniformSampler):
        def dumps(self, path: object) -> None:
            raise OSError("disk gone")

    make_buffer().save(tmp_path / "replay")
    before = sorted(path.name for path in tmp_path.rglob("*"))
    failing = make_replay_buffer(ReplayConfig(50), SMALL, FailingSampler(0))
    with pytest.raises(OSError, match="disk gone"):
        failing.save(tmp_path / "replay")
    assert sorted(path.name for path in tmp_path.rglob("*")) == before


def test_a_folder_that_holds_no_replay_is_refused(tmp_path: Path):
    with pytest.raises(FileNotFoundError, match="holds no saved replay"):
        make_buffer().load(tmp_path)


def test_a_replay_of_another_layout_is_refused():
    state = make_buffer().state_dict()
    with pytest.raises(ValueError, match="saved replay has capacity 50, this one has 60"):
        make_buffer(capacity_transitions=60).load_state_dict(state)
    other = make_replay_buffer(ReplayConfig(50), TransitionSpec((5, 2, 3), 12, 2))
    with pytest.raises(ValueError, match="saved replay has num_actions 11, this one has 12"):
        other.load_state_dict(state)


def test_closed_streams_of_a_buffer_are_never_continued():
    buffer = make_buffer()
    rng = np.random.default_rng(0)
    for num_streams in (3, 2):  # another number of streams: only closing allows it
        buffer.extend_rollout(make_rollout(rng, 1, num_streams, end_rate=0.0, learned_rate=1.1))
        buffer.close_streams()
    assert len(buffer) == 5
    assert buffer.num_sampleable == 0


def test_scratch_files_are_gone_when_the_program_ends(tmp_path: Path):
    script = (
        "import sys\n"
        "from marl_cair.replay import ReplayConfig, TransitionSpec, make_replay_buffer\n"
        "config = ReplayConfig(50, scratch_dir=sys.argv[1])\n"
        "buffer = make_replay_buffer(config, TransitionSpec((5, 2, 3), 11))\n"
        "print(buffer.storage.scratch_folder.is_dir())\n"
    )
    command = [sys.executable, "-W", "ignore", "-c", script, str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["True"]
    assert list(tmp_path.iterdir()) == []


def test_a_batch_size_below_one_is_refused():
    with pytest.raises(ValueError, match="batch_size is 0, expected 1 or more"):
        make_buffer(batch_size=0)
