"""`EpisodeStorage`: a ring of single steps that stores each observation once.

A transition is put together when it is sampled: its next observation is the observation of the
stream's following step, and an n-step return walks along the chain of steps. The newest step of a
running stream has no next observation yet and cannot be sampled; an episode ends in one
more entry, a tail, that holds only its final observation and cannot be sampled either.
"""

import os
import shutil
import tempfile
import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict

from marl_cair.files import require_free_space
from marl_cair.ranges import COUNT, NUMBER, Range, check_extremes, read_array, read_number
from marl_cair.replay.array_folder import load_arrays, require_layout, save_arrays
from marl_cair.replay.ring import (
    NO_ENTRY,
    NUM_SAMPLEABLE,
    NUM_WRITTEN,
    Ring,
    Rows,
    append_steps,
    gather_transitions,
)
from marl_cair.replay.rollout import Rollout, check_rollout
from marl_cair.replay.saved_ring import (
    LINKED_FIELDS,
    SAVED_FAULTS,
    find_saved_fault,
    saved_ranges,
)
from marl_cair.replay.transition import TransitionSpec

_DERIVED_FIELDS = ("sampleable", "counters")  # not saved: they follow from the other fields
_SAVED_FIELDS = tuple(name for name in Ring._fields if name not in _DERIVED_FIELDS)


class EpisodeStorage:
    """Ring of `capacity` entries, in memory (paged in as it fills) or with observations on disk.

    spec: shapes of a transition. capacity: entries, i.e. steps and tails. n_steps, gamma: of the
    returns that `get` builds. scratch_dir: where a memory-mapped file for the observations is made
    (reserved at once, removed when the storage goes or the program exits, unless `keep_files`); the
    other fields, about 40 bytes a step, stay in memory.
    Raises ValueError for a number out of range and NotEnoughSpaceError where the disk is too full.
    """

    def __init__(
        self,
        spec: TransitionSpec,
        capacity: int,
        *,
        n_steps: int = 1,
        gamma: float = 0.99,
        scratch_dir: str | os.PathLike[str] | None = None,
        keep_files: bool = False,
    ) -> None:
        if capacity < 2:
            raise ValueError(
                f"capacity is {capacity}, expected 2 or more: a step and its successor"
            )
        if n_steps < 1:
            raise ValueError(f"n_steps is {n_steps}, expected 1 or more")
        if not 0.0 <= gamma <= 1.0:
            raise ValueError(f"gamma is {gamma}, expected 0..1")
        self.max_size = capacity
        self.spec = spec
        self.n_steps = n_steps
        self.gamma = gamma
        self.scratch_folder: Path | None = None
        self._discounts = np.array([gamma**k for k in range(n_steps)], np.float64)
        self._ring = self._make_ring(scratch_dir, keep_files)
        self._open_ends: NDArray[np.int64] | None = None  # None: the number of streams is free

    def _make_ring(self, scratch_dir: str | os.PathLike[str] | None, keep_files: bool) -> Ring:
        capacity = self.max_size
        rows_shape = (capacity, self.spec.row_bytes)
        return Ring(
            # NumPy, as torch.empty would write every page under deterministic algorithms.
            rows=(
                np.empty(rows_shape, np.uint8)
                if scratch_dir is None
                else self._map_rows(Path(scratch_dir), rows_shape, keep_files)
            ),
            masks=np.empty((capacity, self.spec.mask_bytes), np.uint8),
            action=np.empty(capacity, np.int32),
            reward=np.empty(capacity, np.float32),
            terminated=np.empty(capacity, np.bool_),
            done=np.empty(capacity, np.bool_),
            expert_action=np.empty(capacity, np.int32),
            opponent=np.empty(capacity, np.int16),
            successor=np.empty(capacity, np.int64),
            sampleable=np.zeros(capacity, np.bool_),
            counters=np.zeros(2, np.int64),
        )

    def _map_rows(
        self, scratch_dir: Path, shape: tuple[int, int], keep_files: bool
    ) -> NDArray[np.uint8]:
        num_bytes = shape[0] * shape[1]
        require_free_space(scratch_dir, num_bytes)
        scratch_dir.mkdir(parents=True, exist_ok=True)
        folder = Path(tempfile.mkdtemp(prefix="replay-", dir=scratch_dir))
        if not keep_files:
            weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
        self.scratch_folder = folder
        with (folder / "rows.bin").open("w+b") as file:
            # Blocks reserved now cannot run out later, when a write to the map would kill us.
            if hasattr(os, "posix_fallocate"):
                os.posix_fallocate(file.fileno(), 0, num_bytes)
            else:
                file.truncate(num_bytes)
            mapped = np.memmap(file, np.uint8, "r+", shape=shape)
        return mapped.view(np.ndarray)

    def __len__(self) -> int:
        """Entries in the ring: steps, sampleable or not, and tails."""
        return min(self.num_written, self.max_size)

    @property
    def num_written(self) -> int:
        """Entries ever written."""
        return int(self._ring.counters[NUM_WRITTEN])

    @property
    def num_sampleable(self) -> int:
        """Entries that start a transition with a known end."""
        return int(self._ring.counters[NUM_SAMPLEABLE])

    @property
    def nbytes_per_step(self) -> int:
        """Bytes that one entry takes, in memory and on disk together."""
        fields: list[NDArray[Any]] = [
            getattr(self._ring, name) for name in Ring._fields if name != "counters"
        ]
        return sum(field.nbytes // self.max_size for field in fields)

    def is_sampleable(self, index: torch.Tensor) -> torch.Tensor:
        """Whether each slot of `index` [N] int64, in 0..len - 1, starts a transition: bool [N]."""
        return torch.from_numpy(self._ring.sampleable[index.numpy()])

    def is_step(self, index: torch.Tensor) -> torch.Tensor:
        """Whether each slot of `index` [N] int64 holds a step and no tail: bool [N]."""
        return torch.from_numpy(self._ring.action[index.numpy()] != NO_ENTRY)

    def sampleable_slots(self) -> torch.Tensor:
        """All slots that start a transition, ascending: int64 [num_sampleable]."""
        return torch.from_numpy(np.flatnonzero(self._ring.sampleable[: len(self)]))

    def append(self, rollout: Rollout) -> torch.Tensor:
        """Store the learned steps of `rollout`; return their slots, int64, in time order.

        The first steps follow on the last ones of the same streams in the rollout before. Oldest
        entries are overwritten. Nothing is stored if the rollout is refused.
        Raises ValueError as `check_rollout` does, and where the number of streams has changed.
        """
        steps = check_rollout(rollout, self.spec)
        open_ends = self._open_ends
        if open_ends is None:
            open_ends = np.full(rollout.num_streams, NO_ENTRY, np.int64)
        if rollout.num_streams != len(open_ends):
            raise ValueError(
                f"the rollout has {rollout.num_streams} streams, those before had "
                f"{len(open_ends)}: call close_streams() before the number changes"
            )
        self._open_ends = open_ends
        slots = np.empty(len(steps.action), np.int64)
        append_steps(
            self._ring, steps, open_ends, slots, self.spec.board_bytes, self.spec.num_cells
        )
        return torch.from_numpy(slots[steps.learned])

    def close_streams(self) -> None:
        """Forget where the streams stand, as when worlds restart without resuming.

        The newest step of each running stream gets no successor any more: it is never sampled.
        The next rollout may have another number of streams.
        """
        self._open_ends = None

    def get(self, index: Any) -> TensorDict:
        """Return the transitions that start at slots `index` (int, sequence, slice or tensor) [N].

        Keys, dtypes and shapes are those of `TransitionSpec.fields`, but "index", which the buffer
        adds. The reward is the sum of gamma^k r_k over up to n_steps steps: fewer where the episode
        ends or its next steps are not there yet; steps_to_next_obs tells how many.
        Raises IndexError for a slot that is not sampleable.
        """
        return self._gather(index, self._discounts)

    def get_steps(self, index: Any, num_steps: int) -> TensorDict:
        """Return as `get`, but of up to `num_steps` steps: a world model learns of one.

        Raises ValueError where `num_steps` is not in 1..n_steps.
        """
        if not 1 <= num_steps <= len(self._discounts):
            raise ValueError(f"num_steps is {num_steps}, expected 1..{len(self._discounts)}")
        return self._gather(index, self._discounts[:num_steps])

    def _gather(self, index: Any, discounts: NDArray[np.float64]) -> TensorDict:
        slots = self._as_slots(index)
        rows = self._make_rows(len(slots))
        spec = self.spec
        wrong = gather_transitions(
            self._ring, slots, discounts, rows, spec.board_bytes, spec.num_cells
        )
        if wrong != NO_ENTRY:
            raise IndexError(
                f"slot {slots[wrong]} starts no transition (the ring holds {len(self)} entries, "
                f"{self.num_sampleable} of them sampleable): draw slots with UniformSampler or "
                "from sampleable_slots()"
            )
        return self._as_tensordict(rows)

    def _as_slots(self, index: Any) -> NDArray[np.int64]:
        if isinstance(index, slice):
            index = range(*index.indices(len(self)))
        slots = torch.as_tensor(index, dtype=torch.int64).reshape(-1)
        return np.ascontiguousarray(slots.numpy())

    def _make_rows(self, num_rows: int) -> Rows:
        observation_bytes = self.spec.board_bytes + self.spec.num_uniform * self.spec.num_cells
        return Rows(
            observation=np.empty((num_rows, observation_bytes), np.uint8),
            action_mask=np.empty((num_rows, self.spec.num_actions), np.bool_),
            action=np.empty(num_rows, np.int64),
            next_observation=np.empty((num_rows, observation_bytes), np.uint8),
            next_action_mask=np.empty((num_rows, self.spec.num_actions), np.bool_),
            next_reward=np.empty(num_rows, np.float32),
            next_terminated=np.empty(num_rows, np.bool_),
            next_done=np.empty(num_rows, np.bool_),
            steps_to_next_obs=np.empty(num_rows, np.int64),
            expert_action=np.empty(num_rows, np.int64),
            opponent=np.empty(num_rows, np.int16),
        )

    def _as_tensordict(self, rows: Rows) -> TensorDict:
        num_rows = len(rows.action)
        following = TensorDict(
            {
                "observation": self._as_observation(rows.next_observation),
                "action_mask": torch.from_numpy(rows.next_action_mask),
                "reward": torch.from_numpy(rows.next_reward).unsqueeze(1),
                "terminated": torch.from_numpy(rows.next_terminated).unsqueeze(1),
                "done": torch.from_numpy(rows.next_done).unsqueeze(1),
            },
            [num_rows],
        )
        return TensorDict(
            {
                "observation": self._as_observation(rows.observation),
                "action_mask": torch.from_numpy(rows.action_mask),
                "action": torch.from_numpy(rows.action),
                "next": following,
                "steps_to_next_obs": torch.from_numpy(rows.steps_to_next_obs).unsqueeze(1),
                "is_generated": torch.zeros(num_rows, 1, dtype=torch.bool),
                "expert_action": torch.from_numpy(rows.expert_action),
                "opponent": torch.from_numpy(rows.opponent),
            },
            [num_rows],
        )

    def _as_observation(self, observation: NDArray[np.uint8]) -> torch.Tensor:
        typed = torch.from_numpy(observation).view(self.spec.observation_dtype)
        return typed.view(len(observation), *self.spec.observation_shape)

    def _empty(self) -> None:
        self._ring.sampleable[: len(self)] = False
        self._ring.counters[:] = 0
        self._open_ends = None

    def state_dict(self) -> dict[str, Any]:
        """Return a copy of the used part of the ring as tensors, and plain facts."""
        arrays, facts = self._export()
        tensors = {name: torch.from_numpy(array.copy()) for name, array in arrays.items()}
        return {"facts": facts, "arrays": tensors}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Take over a state of a storage with the same layout; n_steps and gamma stay as they are.

        Raises ValueError where the layout or the capacity differs, or for what no ring can hold;
        nothing is taken over then.
        """
        arrays = {name: tensor.numpy() for name, tensor in state_dict["arrays"].items()}
        self._import(arrays, state_dict["facts"])

    def dumps(self, path: str | os.PathLike[str]) -> None:
        """Write the used part of the ring to a new folder `path`, without a copy in memory."""
        save_arrays(Path(path), *self._export())

    def loads(self, path: str | os.PathLike[str]) -> None:
        """Read what `dumps` wrote. Raises as `load_state_dict` does."""
        self._import(*load_arrays(Path(path)))

    def _export(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        arrays = {name: getattr(self._ring, name)[: len(self)] for name in _SAVED_FIELDS}
        if self._open_ends is not None:
            arrays["open_ends"] = self._open_ends
        return arrays, {**self._layout(), "num_written": self.num_written}

    def _layout(self) -> dict[str, Any]:
        return {
            "capacity": self.max_size,
            "observation_shape": list(self.spec.observation_shape),
            "observation_dtype": str(self.spec.observation_dtype),
            "num_actions": self.spec.num_actions,
            "num_uniform": self.spec.num_uniform,
            "fields": list(_SAVED_FIELDS),
        }

    def _import(self, arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> None:
        require_layout(facts, self._layout(), "replay")
        num_written = read_number(facts, "num_written", COUNT)
        size = min(num_written, self.max_size)
        fields = self._read_fields(arrays, size)
        open_ends = arrays.get("open_ends")
        if open_ends is not None:
            like, entries = (
                (np.dtype(np.int64), (len(open_ends),)),
                Range(NO_ENTRY, num_written - 1),
            )
            open_ends = read_array(arrays, "open_ends", like, entries)
        self._empty()
        for name, field in fields.items():
            getattr(self._ring, name)[:size] = field
        ring = self._ring
        ring.sampleable[:size] = ring.successor[:size] != NO_ENTRY
        ring.counters[NUM_WRITTEN] = num_written
        ring.counters[NUM_SAMPLEABLE] = np.count_nonzero(ring.sampleable[:size])
        self._open_ends = None if open_ends is None else np.array(open_ends)

    def _read_fields(
        self, arrays: Mapping[str, NDArray[Any]], size: int
    ) -> dict[str, NDArray[Any]]:
        """The saved fields of `size` entries. Raises ValueError for what no ring can hold."""
        spec = self.spec
        ranges = saved_ranges(spec.num_actions, size)
        fields = {}
        for name in _SAVED_FIELDS:
            own = getattr(self._ring, name)
            like = own.dtype, (size, *own.shape[1:])
            fields[name] = read_array(arrays, name, like, ranges.get(name))
        if spec.observation_dtype == torch.float32 and size:
            check_extremes(fields["rows"].view(np.float32), "rows", NUMBER)
        slot, fault = find_saved_fault(*(fields[name] for name in LINKED_FIELDS))
        if slot != NO_ENTRY:
            raise ValueError(f"the replay's entry {slot} {SAVED_FAULTS[fault]}")
        return fields
