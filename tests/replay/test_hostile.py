"""What a saved replay may not hold is refused by name, before compiled loops follow it."""

import json

import numpy as np
import pytest
import torch

from marl_cair.replay.buffer import ReplayConfig, make_replay_buffer
from marl_cair.replay.generated import GeneratedReplay
from marl_cair.replay.reservoir import Reservoir
from marl_cair.replay.transition import TransitionSpec
from tests.damage import forget_checksums
from tests.replay.streams import make_transitions

SPEC = TransitionSpec((2, 4, 4), 5)


def make_buffer():
    return make_replay_buffer(ReplayConfig(64, batch_size=4, priority_alpha=0.6), SPEC)


def put(path, place, value):
    """Change one entry of a saved array."""
    field = np.load(path)
    field[place] = value
    np.save(path, field)


@pytest.fixture
def saved(tmp_path):
    """A replay of 20 steps in a chain."""
    buffer = make_buffer()
    ring, count = buffer.storage._ring, 20
    ring.rows[:count], ring.masks[:count] = 0, 255
    for name in ("reward", "terminated", "done", "opponent"):
        getattr(ring, name)[:count] = 0
    ring.action[:count], ring.expert_action[:count] = 1, -1
    ring.successor[:count] = [*range(1, count), -1]
    ring.sampleable[: count - 1] = True
    ring.counters[:] = count, count - 1
    buffer.sample(4)
    buffer.save(tmp_path / "replay")
    forget_checksums(tmp_path)
    return tmp_path / "replay"


def test_what_is_sound_is_taken_over(saved):
    buffer = make_buffer()
    buffer.load(saved)
    assert buffer.num_sampleable == 19


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("successor", 10**12, r"successor holds .*, it must be in -1..19"),
        ("successor", -2, "successor holds"),
        ("action", 5, r"action holds 1..5, it must be in -1..4"),
        ("action", -1, "has a successor, but no action"),
        ("expert_action", 7, "expert_action holds"),
        ("reward", np.nan, "reward holds nan"),
        ("reward", np.inf, "reward holds"),
        ("opponent", -3, "opponent holds"),
        ("masks", 0, "has an action that its mask does not allow|without a legal action"),
    ],
)
def test_a_field_out_of_range_is_named(saved, name, value, message):
    put(saved / "storage" / f"{name}.npy", 7, value)
    with pytest.raises(ValueError, match=message):
        make_buffer().load(saved)


def test_bytes_that_are_no_booleans(saved):
    path = saved / "storage" / "done.npy"
    field = np.load(path)
    field.view(np.uint8)[3] = 7
    np.save(path, field)
    with pytest.raises(ValueError, match="done holds 0..7, it must be"):
        make_buffer().load(saved)


@pytest.mark.parametrize("name", ["rows", "action", "successor", "masks"])
def test_another_shape_or_dtype(saved, name):
    path = saved / "storage" / f"{name}.npy"
    np.save(path, np.load(path)[:-1])
    with pytest.raises(ValueError, match=f"{name} is .* it must be"):
        make_buffer().load(saved)


@pytest.mark.parametrize("value", [-1, 2**70, "20", 1.5, None])
def test_a_count_that_is_none(saved, value):
    path = saved / "storage" / "facts.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "num_written": value}))
    with pytest.raises(ValueError, match="num_written is .*, it must be a whole number"):
        make_buffer().load(saved)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (np.nan, "priorities holds"),
        (-1.0, "priorities holds"),
        (0.0, "are not those of the saved replay"),
    ],
)
def test_priorities(saved, value, message):
    put(saved / "sampler" / "priorities" / "priorities.npy", 3, value)
    with pytest.raises(ValueError, match=message):
        make_buffer().load(saved)


def test_generated_rows(tmp_path):
    ring = GeneratedReplay(SPEC, 16)
    rows = make_transitions(np.random.default_rng(0), 8, SPEC)
    ring.extend(rows)
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


def test_a_reservoir(tmp_path):
    reservoir = Reservoir(SPEC, 16, 0)
    mask = torch.ones(4, 5, dtype=torch.bool)
    reservoir.extend(torch.zeros(4, 2, 4, 4, dtype=torch.uint8), mask, torch.arange(4))
    reservoir.save(tmp_path / "kept")
    forget_checksums(tmp_path)
    path = tmp_path / "kept" / "reservoir" / "actions.npy"
    np.save(path, np.full(4, 5, np.int32))
    with pytest.raises(ValueError, match=r"actions holds 5..5, it must be in 0..4"):
        Reservoir(SPEC, 16, 0).load(tmp_path / "kept")
