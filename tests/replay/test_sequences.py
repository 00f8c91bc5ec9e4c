"""Sequences of the replay buffer equal those of a slow replay on Python lists, bit by bit."""

import dataclasses
from collections import defaultdict

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from marl_cair.replay.buffer import ReplayConfig, make_replay_buffer
from marl_cair.replay.generated import GeneratedReplay, GeneratedSequences
from marl_cair.replay.mixed import MixedReplay
from marl_cair.replay.sequences import find_sequence_errors
from marl_cair.replay.storage import EpisodeStorage
from marl_cair.replay.transition import TransitionSpec
from tests.damage import forget_checksums
from tests.replay.streams import assert_same_rows, make_rollout

SPEC = TransitionSpec((5, 2, 3), num_actions=11, num_uniform=2, state_size=3)
COPIED = ("observation", "action_mask", "action", "reward", "terminated", "expert_action")
COPIED += ("opponent",)


class Streams:
    """Random rollouts with states, 0 where an episode begins."""

    def __init__(self, seed, num_streams, end_rate=0.1, learned_rate=0.9):
        self.rng, self.num_streams = np.random.default_rng(seed), num_streams
        self.rates = end_rate, learned_rate
        self.begins = torch.ones(num_streams, dtype=torch.bool)

    def collect(self, num_steps):
        rollout = make_rollout(self.rng, num_steps, self.num_streams, SPEC, *self.rates)
        state = torch.from_numpy(self.rng.normal(size=(num_steps, self.num_streams, 3))).float()
        for step, ends in enumerate(rollout.terminated | rollout.truncated):
            state[step, self.begins] = 0.0
            self.begins = ends
        return dataclasses.replace(rollout, state=state)


class ListSequences:
    """The slow, clear replay of sequences: runs as lists of entries."""

    def __init__(self, capacity, steps, burn_in):
        self.capacity, self.steps, self.burn_in = capacity, steps, burn_in
        self.num_written = 0
        self.runs = []
        self.running = {}

    def append(self, rollout):
        for t in range(len(rollout.action)):
            for s in range(rollout.num_streams):
                if not rollout.learned[t, s]:
                    if s in self.running:
                        self.running.pop(s)["is_over"] = True
                    continue
                if s not in self.running:
                    self.running[s] = {"entries": [], "is_over": False}
                    self.runs.append(self.running[s])
                step = {name: getattr(rollout, name)[t, s] for name in (*COPIED, "state")}
                self.add(s, step)
                if rollout.terminated[t, s] or rollout.truncated[t, s]:
                    row = rollout.final_step.tolist().index(t * rollout.num_streams + s)
                    seen = rollout.final_observation[row], rollout.final_action_mask[row]
                    tail = {"observation": seen[0], "action_mask": seen[1], "state": torch.zeros(3)}
                    self.add(s, tail)

    def add(self, stream, entry):
        self.running[stream]["entries"].append({**entry, "number": self.num_written})
        self.num_written += 1

    def sequences(self):
        """Fields of each sequence that can be sampled, by slot."""
        found = {}
        for run in self.runs:
            entries = run["entries"]
            for begin in range(0, len(entries), self.steps):
                is_whole = begin + self.steps < len(entries)
                least = 2 if "action" in entries[-1] else 1  # a step, and what follows it
                if not is_whole and not (run["is_over"] and begin + least < len(entries)):
                    continue
                if begin == 0 and entries[0]["state"].any():
                    continue
                first = entries[max(0, begin - self.burn_in)]["number"]
                if first >= self.num_written - self.capacity:
                    found[first % self.capacity] = self.read(entries, begin)
        return found

    def read(self, entries, begin):
        length = self.burn_in + self.steps + 1
        places = range(begin - self.burn_in, begin - self.burn_in + length)
        fields = defaultdict(list)
        defaults = {
            "action": torch.tensor(0),
            "reward": torch.tensor(0.0),
            "terminated": torch.tensor(False),
            "expert_action": torch.tensor(-1),
            "opponent": torch.tensor(-1, dtype=torch.int16),
        }
        for place in places:
            nearest = entries[min(max(place, 0), len(entries) - 1)]
            is_there = 0 <= place < len(entries)
            here = nearest if is_there else {}
            for name in ("observation", "action_mask"):
                fields[name].append(nearest[name])
            for name, value in defaults.items():
                fields[name].append(here.get(name, value))
            follows_tail = is_there and place > places[0] and "action" not in entries[place - 1]
            fields["starts"].append(torch.tensor((place == 0 and begin == 0) or follows_tail))
            has_next = place + 1 < min(len(entries), places[-1] + 1)
            learned = "action" in here and place >= begin and has_next
            fields["learned"].append(torch.tensor(learned))
            fields["state"].append(entries[max(0, places[0])]["state"])
        return {name: torch.stack(values) for name, values in fields.items()}


@pytest.mark.slow
@given(
    seed=st.integers(0, 2**32 - 1),
    capacity=st.integers(20, 90),
    num_streams=st.integers(1, 4),
    window=st.sampled_from([(2, 0), (2, 1), (3, 2), (5, 1), (6, 3), (4, 0)]),
    lengths=st.lists(st.integers(0, 9), min_size=1, max_size=8),
    end_rate=st.sampled_from([0.0, 0.1, 0.4]),
    learned_rate=st.sampled_from([0.6, 0.95, 1.1]),
)
def test_any_history_gives_the_sequences_of_the_lists(
    seed, capacity, num_streams, window, lengths, end_rate, learned_rate
):
    streams = Streams(seed, num_streams, end_rate, learned_rate)
    storage = EpisodeStorage(SPEC, capacity, sequence_steps=window[0], burn_in_steps=window[1])
    slow = ListSequences(capacity, *window)
    for length in lengths:
        rollout = streams.collect(length)
        storage.append(rollout)
        slow.append(rollout)
        expected, slots = slow.sequences(), storage.sampleable_slots()
        assert storage.num_sampleable == len(slots)
        assert set(slots.tolist()) <= set(expected)
        if storage._ring.counters[2] <= len(storage._ring.states):  # no state is overwritten yet
            assert slots.tolist() == sorted(expected)
        batch = storage.get(slots)
        assert not bool(batch["is_generated"].any())
        for row, slot in enumerate(slots.tolist()):
            assert bool(batch["learned"][row].any())
            for name, value in expected[slot].items():
                assert batch[name].dtype == value.dtype, name
                assert torch.equal(batch[name][row], value), (name, slot)


def test_each_step_is_learned_in_one_sequence():
    streams = Streams(3, 3, end_rate=0.1, learned_rate=1.1)
    storage = EpisodeStorage(SPEC, 600, sequence_steps=6, burn_in_steps=2)
    rewards = []
    for _ in range(6):
        rollout = streams.collect(20)
        storage.append(rollout)
        rewards += rollout.reward.flatten().tolist()
    batch = storage.get(storage.sampleable_slots())
    learned = batch["reward"][batch["learned"]].tolist()
    assert len(set(learned)) == len(learned)
    assert set(learned) <= set(rewards)
    assert len(learned) > 0.9 * len(rewards)  # all but the newest steps


def make_buffer(alpha=0.0, seed=0, capacity=80, **changes):
    settings = {"batch_size": 16, "sequence_steps": 4, "burn_in_steps": 2, **changes}
    config = ReplayConfig(capacity, priority_alpha=alpha, seed=seed, **settings)
    return make_replay_buffer(config, SPEC)


@pytest.mark.parametrize("alpha", [0.0, 0.6])
@pytest.mark.parametrize("learned_rate", [0.7, 1.1])
def test_a_restored_buffer_continues_with_the_same_batches(tmp_path, alpha, learned_rate):
    streams = Streams(0, 3, learned_rate=learned_rate)
    buffers = [make_buffer(alpha, seed) for seed in (0, 9)]
    mixtures = [MixedReplay(real, GeneratedReplay(SPEC, 4), 0.2) for real in buffers]
    for _ in range(6):
        buffers[0].extend_rollout(streams.collect(9))
        batch = mixtures[0].sample()
        batch["td_error"] = torch.randn(batch.shape)
        mixtures[0].note_errors(batch, done=0.5)
    mixtures[0].save(tmp_path / "replay")
    mixtures[1].load(tmp_path / "replay")
    for _ in range(8):
        rollout, batches = streams.collect(9), []
        error = torch.randn(4, 7)
        for mixture in mixtures:
            mixture.real.extend_rollout(rollout)
            batches.append(mixture.sample())
            batches[-1]["td_error"] = error
            mixture.note_errors(batches[-1], done=0.7)
        assert batches[0].shape == (4, 7)
        assert_same_rows(*batches)


def test_the_largest_error_of_a_sequence_decides_its_priority():
    error = torch.tensor([[9.0, -4.0, 2.0], [1.0, 1.0, 9.0]])
    learned = torch.tensor([[False, True, True], [True, True, False]])
    torch.testing.assert_close(find_sequence_errors(error, learned), torch.tensor([3.9, 1.0]))
    buffer = make_buffer(alpha=1.0)
    buffer.extend_rollout(Streams(0, 1, 0.0, 1.1).collect(41))
    mixture = MixedReplay(buffer, GeneratedReplay(SPEC, 4), 0.0)
    for _ in range(20):  # every sequence is sampled
        batch = mixture.sample()
        batch["td_error"] = torch.where(batch["index"] == 10, 20.0, 0.0) * batch["learned"]
        mixture.note_errors(batch, done=1.0)
    assert buffer.sampler.priorities[10] == pytest.approx(20.001)
    drawn = torch.cat([mixture.sample()["index"][:, 0] for _ in range(50)])
    assert (drawn == 10).float().mean() > 0.99
    assert mixture.sample()["priority_weight"].shape == (4, 7)


def test_a_slot_that_starts_no_sequence_is_refused():
    buffer = make_buffer()
    buffer.extend_rollout(Streams(0, 1, 0.0, 1.1).collect(5))
    assert buffer.storage.sampleable_slots().tolist() == [0]
    assert buffer.num_sampleable == 4
    with pytest.raises(IndexError, match="slot 1 starts no sequence"):
        buffer.storage.get(torch.tensor([0, 1]))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"burn_in_steps": 4}, r"burn_in_steps is 4, expected 0..3: less than sequence_steps"),
        ({"burn_in_steps": -1}, "burn_in_steps is -1"),
        ({"sequence_steps": 0}, "multiple of sequence_steps, which is 0"),
        ({"sequence_steps": 5}, "batch_size is 16, expected a multiple of sequence_steps, which"),
    ],
)
def test_settings_out_of_range_are_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        make_buffer(**changes)


def test_a_rollout_without_states_or_with_others_is_refused():
    rollout = Streams(0, 2).collect(3)
    for state, shape in ((None, r"\[3, 2, 0\]"), (torch.zeros(3, 2, 4), r"\[3, 2, 4\]")):
        with pytest.raises(ValueError, match=rf"rollout.state is float32 {shape}, expected .*3\]"):
            make_buffer().extend_rollout(dataclasses.replace(rollout, state=state))


@pytest.mark.parametrize(
    ("name", "place", "value", "message"),
    [
        ("states", 0, np.nan, "states holds nan"),
        ("state_row", 0, 99, r"state_row holds .*, it must be in -3.."),
        ("state_row", 2, -3, "entry 2 can be sampled, but starts no sequence with this state"),
        ("state_owner", 0, 5, "entry 2 can be sampled, but starts no sequence with this state"),
        ("successor", 2, -1, "entry 2 can be sampled, but starts no sequence with this state"),
        ("open_ends", 0, 99, "open_ends holds 99"),
        ("positions", 0, -1, "positions holds -1"),
        ("starts", 0, 99, "starts holds"),
    ],
)
def test_saved_values_that_no_ring_can_hold_are_refused(tmp_path, name, place, value, message):
    buffer = make_buffer()
    buffer.extend_rollout(Streams(0, 1, 0.0, 1.1).collect(30))
    buffer.save(tmp_path / "replay")
    forget_checksums(tmp_path)
    make_buffer().load(tmp_path / "replay")
    path = tmp_path / "replay" / "storage" / f"{name}.npy"
    field = np.load(path)
    field[place] = value
    np.save(path, field)
    with pytest.raises(ValueError, match=message):
        make_buffer().load(tmp_path / "replay")


def test_a_replay_of_other_sequences_is_refused(tmp_path):
    make_buffer().save(tmp_path / "replay")
    with pytest.raises(ValueError, match=r"has window \[4, 2\], this one has \[8, 2\]"):
        make_buffer(sequence_steps=8).load(tmp_path / "replay")
    with pytest.raises(ValueError, match=r"saved replay has fields"):
        make_buffer(sequence_steps=1, burn_in_steps=0).load(tmp_path / "replay")


@pytest.mark.parametrize("learned_rate", [0.7, 1.1])
def test_steps_are_read_as_transitions_too(learned_rate):
    streams = Streams(0, 3, learned_rate=learned_rate)
    settings = {"n_steps": 3, "gamma": 0.9}
    single = EpisodeStorage(dataclasses.replace(SPEC, state_size=0), 60, **settings)
    ring = EpisodeStorage(SPEC, 60, sequence_steps=4, burn_in_steps=2, **settings)
    for _ in range(5):
        rollout = streams.collect(9)
        single.append(dataclasses.replace(rollout, state=None))
        ring.append(rollout)
        slots = ring.step_slots()
        assert torch.equal(slots, single.sampleable_slots())
        for num_steps in (1, 3):
            assert_same_rows(
                ring.get_transitions(slots, num_steps), single.get_transitions(slots, num_steps)
            )
    buffer = make_buffer(capacity=60)
    buffer.extend_rollout(streams.collect(9))
    drawn = torch.cat([buffer.sample_steps(100)["index"] for _ in range(20)])
    assert sorted(drawn.unique().tolist()) == buffer.storage.step_slots().tolist()


def make_mixture(fraction=0.2, alpha=0.0, seed=0, num_made=9, **settings):
    """4 sequences of 4 learned steps in a batch; real ones stand for generated ones."""
    buffer = make_buffer(alpha, seed, capacity=200)
    streams = Streams(seed, 3)
    for _ in range(6):
        buffer.extend_rollout(streams.collect(9))
    generated = GeneratedSequences(SPEC, 7, capacity=5, seed=seed)
    if num_made:
        generated.extend(buffer.sample(4 * num_made))
    return MixedReplay(buffer, generated, fraction, **settings)


@pytest.mark.parametrize(
    ("fraction", "numbers"), [(0.0, {0}), (0.2, {0, 1}), (0.5, {2}), (0.9, {3, 4})]
)
@pytest.mark.parametrize("alpha", [0.0, 0.6])
def test_a_batch_holds_its_share_of_generated_sequences(fraction, numbers, alpha):
    mixture = make_mixture(fraction, alpha)
    batch = mixture.sample()
    assert batch.shape == (4, 7)
    generated = batch["is_generated"]
    assert torch.equal(generated, generated[:, :1].expand(4, 7))
    wanted = int(generated[:, 0].sum())
    assert wanted in numbers
    made = generated[:, 0]
    assert (batch["index"][made] == -1).all()
    assert (batch["index"][~made] >= 0).all()
    assert (batch["expert_action"][made] == -1).all()
    assert (batch["opponent"][made] == -1).all()
    if alpha and 0 < wanted < 4:
        weights = batch["priority_weight"]
        torch.testing.assert_close(weights[made].mean(), weights[~made].mean())
    batch["td_error"] = torch.ones(4, 7)
    mixture.note_errors(batch, done=0.5)


def test_generated_sequences_come_back_as_they_were_stored(tmp_path):
    mixture = make_mixture(num_made=0)
    made = mixture.real.sample(8)
    made["state"] = torch.randn(2, 1, 3).expand(2, 7, 3)
    mixture.generated.extend(made)
    mixture.generated.save(tmp_path / "ring")
    resumed = GeneratedSequences(SPEC, 7, capacity=5, seed=1)
    resumed.load(tmp_path / "ring")
    drawn = resumed.sample(20)
    assert_same_rows(drawn, mixture.generated.sample(20))
    assert drawn.shape == (20, 7)
    for row in drawn:
        same = [bool((row["observation"] == one["observation"]).all()) for one in made]
        [source] = [one for one, is_same in zip(made, same, strict=True) if is_same]
        for name in ("action_mask", "action", "reward", "terminated", "starts", "learned", "state"):
            assert torch.equal(row[name], source[name]), name


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        ("action", torch.full((4, 7), 99), "action is 99, expected 0..10"),
        ("reward", torch.zeros(4, 7, dtype=torch.float64), r"sequences\['reward'\] is float64"),
        ("learned", torch.ones(4, 7, dtype=torch.bool), "the last entry of a sequence is learned"),
        ("starts", None, "sequences lack 'starts'"),
    ],
)
def test_wrong_generated_sequences_are_refused(key, value, message):
    mixture = make_mixture()
    made = mixture.real.sample()
    if value is None:
        del made[key]
    else:
        made[key] = value
    with pytest.raises(ValueError, match=message):
        mixture.generated.extend(made)
    with pytest.raises(ValueError, match=r"batch size \[4, 6\], expected \[N, 7\]"):
        mixture.generated.extend(mixture.real.sample()[:, :6])


def test_a_ring_of_other_sequences_is_not_loaded(tmp_path):
    mixture = make_mixture()
    mixture.generated.save(tmp_path / "ring")
    with pytest.raises(ValueError, match="has num_entries 7, this one has 8"):
        GeneratedSequences(SPEC, 8, capacity=5).load(tmp_path / "ring")
    with pytest.raises(ValueError, match=r"observation is uint8 \[5, 7, 5, 2, 3\], it must be"):
        GeneratedReplay(SPEC, capacity=5).load(tmp_path / "ring")
