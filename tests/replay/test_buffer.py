"""The buffer: appending, sampling, bit-exact resume, and saved folders that hold invalid values."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from marl_cair.replay.buffer import EpisodeReplayBuffer, ReplayConfig, make_replay_buffer
from marl_cair.replay.generated import GeneratedReplay
from marl_cair.replay.reservoir import Reservoir
from marl_cair.replay.transition import TransitionSpec, check_transitions
from tests.damage import forget_checksums
from tests.replay.streams import SMALL, assert_same_rows, make_rollout, make_transitions

SPEC = TransitionSpec((2, 4, 4), 5)


def make_buffer(spec: TransitionSpec = SMALL, **settings) -> EpisodeReplayBuffer:
    chosen = {"capacity_transitions": 50, "batch_size": 8, "n_steps": 3, **settings}
    return make_replay_buffer(ReplayConfig(**chosen), spec)


def play_on(buffer: EpisodeReplayBuffer, rng: np.random.Generator, rounds: int) -> list:
    """Append and sample in turn; return the samples."""
    samples = []
    for _ in range(rounds):
        buffer.extend_rollout(make_rollout(rng, 4, 3, end_rate=0.1))
        samples.append(buffer.sample())
    return samples


def test_a_sample_has_the_transition_keys_and_its_index():
    buffer = make_buffer()
    (rows,) = play_on(buffer, np.random.default_rng(0), 1)
    check_transitions(rows, SMALL)
    assert set(rows.keys(include_nested=True, leaves_only=True)) == set(SMALL.fields())
    again = buffer.storage.get(rows["index"])
    assert torch.equal(again["observation"], rows["observation"])
    assert not rows["is_generated"].any()
    assert len(buffer.sample(5)) == 5


@pytest.mark.slow
@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**32 - 1),
    rounds_before=st.integers(0, 12),
    capacity=st.integers(12, 90),
    on_disk=st.booleans(),
)
def test_a_resumed_buffer_continues_with_the_same_bits(
    tmp_path_factory, seed, rounds_before, capacity, on_disk
):
    folder = tmp_path_factory.mktemp("replay")
    where = {"capacity_transitions": capacity, "scratch_dir": str(folder) if on_disk else None}
    rng = np.random.default_rng(seed)
    whole = make_buffer(**where)
    play_on(whole, rng, rounds_before)
    resumed = make_buffer(**where, seed=99)
    play_on(resumed, np.random.default_rng(1), 2)  # loading replaces all of it
    whole.save(folder / "saved")
    resumed.load(folder / "saved")
    rng_copy = np.random.default_rng()
    rng_copy.bit_generator.state = rng.bit_generator.state
    samples = zip(play_on(whole, rng, 6), play_on(resumed, rng_copy, 6), strict=True)
    for one, other in samples:
        assert_same_rows(one, other)
    assert torch.equal(whole.storage.sampleable_slots(), resumed.storage.sampleable_slots())


def test_a_saved_folder_holds_no_pickle_and_is_replaced_whole(tmp_path: Path):
    buffer = make_buffer()
    for _ in range(2):
        play_on(buffer, np.random.default_rng(0), 2)
        buffer.save(tmp_path / "replay")
    assert [path.name for path in tmp_path.iterdir()] == ["replay"]
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert {path.suffix for path in files} == {".npy", ".json"}
    for path in files:
        if path.suffix == ".npy":
            np.load(path, allow_pickle=False)


def test_a_save_that_fails_leaves_the_saved_folder_as_it_was(tmp_path: Path, monkeypatch):
    def fail(path: object) -> None:
        raise OSError("disk gone")

    buffer = make_buffer()
    buffer.save(tmp_path / "replay")
    before = sorted(path.name for path in tmp_path.rglob("*"))
    monkeypatch.setattr(buffer.sampler, "save", fail)
    with pytest.raises(OSError, match="disk gone"):
        buffer.save(tmp_path / "replay")
    assert sorted(path.name for path in tmp_path.rglob("*")) == before


def test_a_folder_without_replay_or_of_another_layout_is_refused(tmp_path: Path):
    with pytest.raises(FileNotFoundError, match="holds no saved replay"):
        make_buffer().load(tmp_path)
    make_buffer(priority_alpha=0.5).save(tmp_path / "replay")
    with pytest.raises(ValueError, match="saved replay has capacity 50, this one has 60"):
        make_buffer(capacity_transitions=60).load(tmp_path / "replay")
    with pytest.raises(ValueError, match="saved replay has num_actions 11, this one has 12"):
        make_buffer(TransitionSpec((5, 2, 3), 12, 2)).load(tmp_path / "replay")
    with pytest.raises(
        ValueError, match=r"priorities is float64 \[50\], it must be float64 \[60\]"
    ):
        make_buffer(capacity_transitions=60, priority_alpha=0.5).sampler.load(
            tmp_path / "replay" / "sampler"
        )


def test_a_batch_size_below_one_is_refused():
    with pytest.raises(ValueError, match="batch_size is 0, expected 1 or more"):
        make_buffer(batch_size=0)


# --- saved folders with invalid values: refused by name before compiled loops follow them -----


def make_prioritized() -> EpisodeReplayBuffer:
    return make_buffer(SPEC, capacity_transitions=64, batch_size=4, n_steps=1, priority_alpha=0.6)


@pytest.fixture
def saved(tmp_path):
    """A replay of 20 steps in a chain."""
    buffer = make_prioritized()
    ring, count = buffer.storage._ring, 20
    ring.rows[:count], ring.masks[:count] = 0, 255
    for name in ("reward", "terminated", "done", "opponent"):
        getattr(ring, name)[:count] = 0
    ring.action[:count], ring.expert_action[:count] = 1, -1
    ring.successor[:count] = [*range(1, count), -1]
    ring.sampleable[: count - 1] = True
    ring.state_row[:count] = -1
    ring.counters[:2] = count, count - 1
    buffer.sample(4)
    buffer.save(tmp_path / "replay")
    forget_checksums(tmp_path)
    valid = make_prioritized()
    valid.load(tmp_path / "replay")
    assert valid.num_sampleable == 19
    return tmp_path / "replay"


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("storage/successor", 10**12, r"successor holds .*, it must be in -1..19"),
        ("storage/successor", -2, "successor holds"),
        ("storage/action", 5, r"action holds 1..5, it must be in -1..4"),
        ("storage/action", -1, "are not those of the saved replay"),
        ("storage/expert_action", 7, "expert_action holds"),
        ("storage/reward", np.nan, "reward holds nan"),
        ("storage/reward", np.inf, "reward holds"),
        ("storage/opponent", -3, "opponent holds"),
        ("storage/masks", 0, "has an action that its mask does not allow|without a legal action"),
        ("sampler/priorities/priorities", np.nan, "priorities holds"),
        ("sampler/priorities/priorities", -1.0, "priorities holds"),
        ("sampler/priorities/priorities", 0.0, "are not those of the saved replay"),
    ],
)
def test_a_field_out_of_range_is_named(saved, name, value, message):
    path = saved / f"{name}.npy"
    field = np.load(path)
    field[7] = value
    np.save(path, field)
    with pytest.raises(ValueError, match=message):
        make_prioritized().load(saved)


def test_bytes_that_are_no_booleans(saved):
    path = saved / "storage" / "done.npy"
    field = np.load(path)
    field.view(np.uint8)[3] = 7
    np.save(path, field)
    with pytest.raises(ValueError, match="done holds 0..7, it must be"):
        make_prioritized().load(saved)


@pytest.mark.parametrize("name", ["rows", "action", "successor", "masks"])
def test_another_shape(saved, name):
    path = saved / "storage" / f"{name}.npy"
    np.save(path, np.load(path)[:-1])
    with pytest.raises(ValueError, match=f"{name} is .* it must be"):
        make_prioritized().load(saved)


@pytest.mark.parametrize("value", [-1, 2**70, "20", 1.5, None])
def test_an_invalid_count(saved, value):
    path = saved / "storage" / "facts.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "num_written": value}))
    with pytest.raises(ValueError, match="num_written is .*, it must be a whole number"):
        make_prioritized().load(saved)


def test_invalid_generated_rows(tmp_path):
    ring = GeneratedReplay(SPEC, 16)
    ring.extend(make_transitions(np.random.default_rng(0), 8, SPEC))
    ring.save(tmp_path / "made")
    forget_checksums(tmp_path)
    for name, value in (("next_reward", np.nan), ("action", 9), ("steps_to_next_obs", 0)):
        path = tmp_path / "made" / "ring" / f"{name}.npy"
        field = np.load(path)
        np.save(path, np.full_like(field, value))
        with pytest.raises(ValueError, match=name.removeprefix("next_")):
            GeneratedReplay(SPEC, 16).load(tmp_path / "made")
        np.save(path, field)
    GeneratedReplay(SPEC, 16).load(tmp_path / "made")


def test_invalid_actions_of_a_reservoir(tmp_path):
    reservoir = Reservoir(SPEC, 16, 0)
    mask = torch.ones(4, 5, dtype=torch.bool)
    reservoir.extend(torch.zeros(4, 2, 4, 4, dtype=torch.uint8), mask, torch.arange(4))
    reservoir.save(tmp_path / "kept")
    forget_checksums(tmp_path)
    path = tmp_path / "kept" / "reservoir" / "actions.npy"
    np.save(path, np.full(4, 5, np.int32))
    with pytest.raises(ValueError, match=r"actions holds 5..5, it must be in 0..4"):
        Reservoir(SPEC, 16, 0).load(tmp_path / "kept")
