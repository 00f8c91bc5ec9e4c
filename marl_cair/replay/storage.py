"""`EpisodeStorage`: a ring of single steps that stores each observation once.

A transition is assembled when it is sampled: its next observation is the observation of the
stream's following step, and an n-step return follows the chain of steps. The newest step of a
running stream has no next observation yet and cannot be sampled. An episode ends with one more
entry, a tail, which holds only its final observation and cannot be sampled either. Sequences of
steps are assembled in the same way (replay/ring.py).
"""

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict

from marl_cair.files import require_free_space
from marl_cair.ranges import COUNT, NUMBER, Range, check_extremes, read_array, read_number
from marl_cair.replay import ring, sequences, transition
from marl_cair.replay.array_folder import load_arrays, require_layout, save_arrays
from marl_cair.replay.ring import (
    FIRST,
    NO_ENTRY,
    NO_START,
    NUM_SAMPLEABLE,
    NUM_STATES,
    NUM_WRITTEN,
    Ring,
    Streams,
)
from marl_cair.replay.rollout import Rollout, check_rollout
from marl_cair.replay.transition import Key, TransitionSpec

_SEQUENCE_FIELDS = ("state_row", "sampleable")  # of transitions they follow from other fields
_SAVED_FIELDS = Ring._fields[: Ring._fields.index("state_row")]
_STATE_FIELDS = ("states", "state_owner")
# The fields of `ring.Rows`, in its order.
_ROW_KEYS: tuple[Key, ...] = (
    *transition.EXPERIENCE_KEYS,
    *(transition.STEPS_TO_NEXT_OBS, transition.EXPERT_ACTION, transition.OPPONENT),
    transition.OTHER_ACTIONS,
)


class EpisodeStorage:
    """Ring of `capacity` entries, in memory (paged in as it fills) or with observations on disk.

    spec: shapes of a transition. capacity: entries, i.e. steps and tails. n_steps, gamma: of the
    returns that `get` builds. scratch_dir: folder for a memory-mapped file of the observations
    (reserved at once, removed with the storage or when the program exits); the other fields, about
    40 bytes a step and the recurrent states, stay in memory.

    sequence_steps: learned steps of a sequence; 1: transitions are sampled, without states.
    burn_in_steps: of a sequence, before them, below sequence_steps. All steps of a stream are in
    the learned part of one sequence, but its first ones where no episode begins.
    Raises ValueError for a number out of range and NotEnoughSpaceError if the disk is too full.
    """

    def __init__(
        self,
        spec: TransitionSpec,
        capacity: int,
        *,
        n_steps: int = 1,
        gamma: float = 0.99,
        scratch_dir: str | os.PathLike[str] | None = None,
        sequence_steps: int = 1,
        burn_in_steps: int = 0,
    ) -> None:
        if capacity < 2:
            raise ValueError(
                f"capacity is {capacity}, expected 2 or more: a step and its successor"
            )
        if n_steps < 1:
            raise ValueError(f"n_steps is {n_steps}, expected 1 or more")
        if not 0.0 <= gamma <= 1.0:
            raise ValueError(f"gamma is {gamma}, expected 0..1")
        if not 0 <= burn_in_steps < sequence_steps:
            raise ValueError(
                f"burn_in_steps is {burn_in_steps}, expected 0..{sequence_steps - 1}: less than "
                f"sequence_steps, which is {sequence_steps}"
            )
        self.capacity = capacity
        self.spec = spec
        self.sequence_steps, self._window = sequence_steps, (sequence_steps, burn_in_steps)
        # No more windows can start in the ring.
        num_states = capacity // (sequence_steps - burn_in_steps) + 1 if spec.state_size else 1
        self._fields = {transition.OTHER_ACTIONS: (torch.int64, (0,)), **spec.fields()}
        self._discounts = np.array([gamma**k for k in range(n_steps)], np.float64)
        # NumPy: torch.empty would write every page under deterministic algorithms.
        self._ring = Ring(
            rows=self._make_rows(scratch_dir),
            masks=np.empty((capacity, spec.mask_bytes), np.uint8),
            action=np.empty(capacity, np.int32),
            reward=np.empty(capacity, np.float32),
            terminated=np.empty(capacity, np.bool_),
            done=np.empty(capacity, np.bool_),
            expert_action=np.empty(capacity, np.int32),
            opponent=np.empty(capacity, np.int16),
            other_actions=np.empty((capacity, spec.num_others), np.int32),
            successor=np.empty(capacity, np.int64),
            state_row=np.empty(capacity, np.int32),
            sampleable=np.zeros(capacity, np.bool_),
            counters=np.zeros(3, np.int64),
            states=np.empty((num_states, spec.state_size), np.float32),
            state_owner=np.empty(num_states, np.int64),
        )
        self._streams: Streams | None = None  # before the first rollout

    def _make_rows(self, scratch_dir: str | os.PathLike[str] | None) -> NDArray[np.uint8]:
        shape = self.capacity, self.spec.row_bytes
        if scratch_dir is None:
            return np.empty(shape, np.uint8)
        num_bytes = shape[0] * shape[1]
        require_free_space(scratch_dir, num_bytes)
        Path(scratch_dir).mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=scratch_dir) as file:  # unnamed: gone when the process ends
            # Reserved now: a full disk would later kill the process at a write to the map.
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, num_bytes)
            else:
                file.truncate(num_bytes)
            return np.memmap(file, np.uint8, "r+", shape=shape).view(np.ndarray)

    def __len__(self) -> int:
        """Entries in the ring: steps, sampleable or not, and tails."""
        return min(self.num_written, self.capacity)

    @property
    def num_written(self) -> int:
        """Entries ever written."""
        return int(self._ring.counters[NUM_WRITTEN])

    @property
    def num_sampleable(self) -> int:
        """Entries that start a transition with a known end, or a sequence."""
        return int(self._ring.counters[NUM_SAMPLEABLE])

    @property
    def nbytes_per_step(self) -> int:
        """Bytes of one entry, in memory and on disk together."""
        total = sum(field.nbytes for field in self._ring) - self._ring.counters.nbytes
        return total // self.capacity

    def is_sampleable(self, index: torch.Tensor) -> torch.Tensor:
        """Whether each slot of `index` [N] int64, in 0..len - 1, can be sampled: bool [N]."""
        return torch.from_numpy(self._ring.sampleable[index.numpy()])

    def is_start(self, index: torch.Tensor) -> torch.Tensor:
        """Whether each slot of `index` [N] int64 can be sampled now or later: bool [N]."""
        return torch.from_numpy(self._ring.state_row[index.numpy()] != NO_START)

    def step_slots(self) -> torch.Tensor:
        """All slots that start a transition, ascending: int64 [N]."""
        return self.has_next(torch.arange(len(self))).nonzero()[:, 0]

    def has_next(self, index: torch.Tensor) -> torch.Tensor:
        """Whether each slot of `index` [N] int64, in 0..len - 1, starts a transition: bool [N]."""
        slots, stored = index.numpy(), self._ring
        is_step = stored.action[slots] != NO_ENTRY
        return torch.from_numpy(is_step & (stored.successor[slots] != NO_ENTRY))

    def sampleable_slots(self) -> torch.Tensor:
        """All slots that can be sampled, ascending: int64 [num_sampleable]."""
        return torch.from_numpy(np.flatnonzero(self._ring.sampleable[: len(self)]))

    def append(self, rollout: Rollout) -> torch.Tensor:
        """Store the learned steps of `rollout`; return their slots, int64, in time order.

        The first steps follow the last ones of the same streams in the previous rollout. The oldest
        entries are overwritten. Nothing is stored if the rollout is invalid.
        Raises ValueError as `check_rollout` does, and if the number of streams has changed.
        """
        steps = check_rollout(rollout, self.spec)
        streams = self._streams
        if streams is None:
            streams = _make_streams(np.full(rollout.num_streams, NO_ENTRY, np.int64))
        if rollout.num_streams != len(streams.open_ends):
            raise ValueError(
                f"the rollout has {rollout.num_streams} streams, those before had "
                f"{len(streams.open_ends)}: collect with the same number of worlds and seats"
            )
        self._streams = streams
        slots = np.empty(len(steps.action), np.int64)
        sizes = self.spec.board_bytes, self.spec.num_cells
        ring.append_steps(self._ring, steps, streams, slots, self._window, sizes)
        return torch.from_numpy(slots[steps.learned])

    def open_slots(self) -> torch.Tensor:
        """Slots of the newest entry of each stream, which the next rollout may continue: int64."""
        ends = np.empty(0, np.int64) if self._streams is None else self._streams.open_ends
        return torch.from_numpy(ends[ends != NO_ENTRY] % self.capacity)

    def forget_streams(self) -> None:
        """The next rollout follows no stored step: running games were given up."""
        self._streams = None

    def get(self, index: torch.Tensor) -> TensorDict:
        """Return what is sampled: the transitions (`get_transitions`) or sequences
        (`sequences.read_sequences`) that start at slots `index` int64 [N].
        """
        if self.sequence_steps > 1:
            return sequences.read_sequences(self._ring, self.spec, index, self._window)
        return self.get_transitions(index)

    def get_transitions(self, index: torch.Tensor, num_steps: int | None = None) -> TensorDict:
        """Return the transitions [N] that start at slots `index` int64 [N].

        num_steps: 1..n_steps (default).
        Keys, dtypes and shapes are those of `TransitionSpec.fields` without "index", which the
        buffer adds. The reward is the sum of gamma^k r_k over up to num_steps steps: fewer if the
        episode ends or its next steps are not stored yet; see "steps_to_next_obs".
        Raises IndexError for a slot that starts none, ValueError for num_steps out of range.
        """
        if num_steps is not None and not 1 <= num_steps <= len(self._discounts):
            raise ValueError(f"num_steps is {num_steps}, expected 1..{len(self._discounts)}")
        slots = np.ascontiguousarray(index.numpy())
        arrays = {key: transition.make_array(len(slots), *self._fields[key]) for key in _ROW_KEYS}
        views = dict(arrays)
        for key in (transition.OBSERVATION, transition.NEXT_OBSERVATION):
            views[key] = arrays[key].reshape(len(slots), -1).view(np.uint8)
        sizes = self.spec.board_bytes, self.spec.num_cells
        discounts, rows = self._discounts[:num_steps], ring.Rows(*views.values())
        wrong = ring.gather_transitions(self._ring, slots, discounts, rows, *sizes)
        if wrong != NO_ENTRY:
            raise IndexError(
                f"slot {slots[wrong]} starts no transition (the ring holds {len(self)} entries): "
                "take slots from a sampler or from step_slots()"
            )
        fields = {key: torch.from_numpy(array) for key, array in arrays.items()}
        if not self.spec.num_others:
            del fields[transition.OTHER_ACTIONS]
        fields[transition.IS_GENERATED] = torch.zeros(len(slots), 1, dtype=torch.bool)
        return transition.make_tensordict(fields)

    def find_others_after(self, index: torch.Tensor, num_steps: torch.Tensor) -> torch.Tensor:
        """The other seats' actions int64 [N, O] in the states `num_steps` int64 [N] steps after
        slots `index` of transitions that long; UNKNOWN_ACTION after an end, and where they were
        not recorded.
        """
        slots, steps = index.numpy(), num_steps.numpy()
        for step in range(max(steps, default=0)):
            slots = np.where(step < steps, self._ring.successor[slots], slots)
        return torch.from_numpy(self._ring.other_actions[slots].astype(np.int64))

    def save(self, path: Path) -> None:
        """Write the used part of the ring to a new folder `path`, without a copy in memory."""
        arrays = {name: getattr(self._ring, name)[: len(self)] for name in self._saved_fields}
        facts = {**self._layout(), "num_written": self.num_written}
        if self._streams is not None:
            arrays["open_ends"] = self._streams.open_ends
        if self.sequence_steps > 1:
            num_states = int(self._ring.counters[NUM_STATES])
            facts["num_states"] = num_states
            arrays |= {name: getattr(self._ring, name)[:num_states] for name in _STATE_FIELDS}
            arrays |= {} if self._streams is None else self._streams._asdict()
        save_arrays(path, arrays, facts)

    def load(self, path: Path) -> None:
        """Read a folder that `save` wrote; n_steps and gamma stay as they are.

        Raises ValueError, and keeps the present content, if the layout or the capacity differs, or
        for values that no ring can hold.
        """
        arrays, facts = load_arrays(path)
        require_layout(facts, self._layout(), "replay")
        num_written = read_number(facts, "num_written", COUNT)
        size = min(num_written, self.capacity)
        num_states = 0
        if self.sequence_steps > 1:
            num_states = read_number(facts, "num_states", COUNT)
        fields = self._read_fields(arrays, size, num_states)
        streams = self._read_streams(arrays, num_written)
        self._ring.sampleable[: len(self)] = False
        for name, field in fields.items():
            getattr(self._ring, name)[: len(field)] = field
        num_sampleable = np.count_nonzero(fields["sampleable"])
        self._ring.counters[:] = num_written, num_sampleable, num_states
        self._streams = streams

    @property
    def _saved_fields(self) -> tuple[str, ...]:
        saved = _SAVED_FIELDS + (_SEQUENCE_FIELDS if self.sequence_steps > 1 else ())
        if self.spec.num_others:
            return saved
        return tuple(name for name in saved if name != transition.OTHER_ACTIONS)

    def _layout(self) -> dict[str, Any]:
        layout = {
            "capacity": self.capacity,
            "observation_shape": list(self.spec.observation_shape),
            "observation_dtype": str(self.spec.observation_dtype),
            "num_actions": self.spec.num_actions,
            "num_uniform": self.spec.num_uniform,
            "fields": list(self._saved_fields),
        }
        if self.sequence_steps > 1:
            layout |= {"window": list(self._window), "state_size": self.spec.state_size}
        if self.spec.num_others:
            layout["num_others"] = self.spec.num_others
        return layout

    def _read_fields(
        self, arrays: Mapping[str, NDArray[Any]], size: int, num_states: int
    ) -> dict[str, NDArray[Any]]:
        """Fields of `size` entries and `num_states` states ever written, as they were saved.

        Raises ValueError for values that no ring can hold.
        """
        num_states = min(num_states, len(self._ring.states))
        actions = Range(NO_ENTRY, self.spec.num_actions - 1)
        ranges = {
            "action": actions,
            "expert_action": actions,
            "reward": NUMBER,
            "opponent": Range(NO_ENTRY, 2**15 - 1),
            "other_actions": actions,
            "successor": Range(NO_ENTRY, size - 1),
            "state_row": Range(NO_START, num_states - 1),
            "states": NUMBER,
        }
        sizes = dict.fromkeys(self._saved_fields, size)
        if self.sequence_steps > 1:
            sizes |= dict.fromkeys(_STATE_FIELDS, num_states)
        fields = {}
        for name, length in sizes.items():
            own = getattr(self._ring, name)
            like = own.dtype, (length, *own.shape[1:])
            fields[name] = read_array(arrays, name, like, ranges.get(name))
        if self.sequence_steps == 1:
            has_action = fields["action"] != NO_ENTRY
            fields["state_row"] = np.where(has_action, FIRST, NO_START).astype(np.int32)
            fields["sampleable"] = has_action & (fields["successor"] != NO_ENTRY)
        if self.spec.observation_dtype == torch.float32 and size:
            check_extremes(fields["rows"].view(np.float32), "rows", NUMBER)
        # Checked before compiled loops follow the links.
        linked = self._ring._replace(**{**fields, "rows": self._ring.rows})
        slot, fault = ring.find_saved_fault(linked, size)
        if slot != NO_ENTRY:
            raise ValueError(f"the replay's entry {slot} {ring.SAVED_FAULTS[fault]}")
        return fields

    def _read_streams(self, arrays: Mapping[str, NDArray[Any]], num_written: int) -> Streams | None:
        """Saved streams; those of transitions have only "open_ends"."""
        if "open_ends" not in arrays:
            return None
        streams = _make_streams(np.empty(len(arrays["open_ends"]), np.int64))
        entries = Range(NO_ENTRY, num_written - 1)
        ranges = {"open_ends": entries, "positions": COUNT, "starts": entries}
        names = Streams._fields if self.sequence_steps > 1 else ("open_ends",)
        for name in names:
            own = getattr(streams, name)
            own[:] = read_array(arrays, name, (own.dtype, own.shape), ranges[name])
        if self.sequence_steps == 1:
            streams.starts[:, 0] = streams.open_ends
        return streams


def _make_streams(open_ends: NDArray[np.int64]) -> Streams:
    starts = np.full((len(open_ends), 2), NO_ENTRY, np.int64)
    return Streams(open_ends, np.zeros_like(open_ends), starts)
