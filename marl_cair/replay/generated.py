"""Rings of generated rows: transitions, or sequences for networks with memory."""

import math
import os
from collections.abc import Mapping
from pathlib import Path

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.files import replaced_folder
from marl_cair.ranges import COUNT, NUMBER, Range, read_array, read_number
from marl_cair.replay import MOST_STEPS, transition
from marl_cair.replay.array_folder import load_arrays, require_layout, save_arrays
from marl_cair.replay.sampler import draw_integers, restore_generator
from marl_cair.replay.sequences import LEARNED, STATE, check_sequences, sequence_fields
from marl_cair.replay.transition import EXPERIENCE_KEYS, STEPS_TO_NEXT_OBS, Key, TransitionSpec

Rows = Mapping[Key, Tensor]  # fields [N, ...] by key
_STORED_KEYS: tuple[Key, ...] = (*EXPERIENCE_KEYS, STEPS_TO_NEXT_OBS)


class GeneratedReplay:
    """Ring of the newest `capacity` generated transitions, sampled uniformly.

    spec: shapes of a transition. seed: of the sampling. Memory is paged in as the ring fills.
    Raises ValueError for a capacity below 1.
    """

    def __init__(self, spec: TransitionSpec, capacity: int = 20_000, seed: int = 0) -> None:
        if capacity < 1:
            raise ValueError(f"capacity is {capacity}, expected 1 or more")
        self.spec = spec
        self.capacity = capacity
        self._generator = torch.Generator().manual_seed(seed)
        self._num_written = 0
        self._ring = {
            key: torch.from_numpy(transition.make_array(capacity, *field))
            for key, field in self._fields().items()
        }

    def _fields(self) -> dict[Key, tuple[torch.dtype, tuple[int, ...]]]:
        """Dtype and shape of what is stored of one row."""
        fields = self.spec.fields()
        return {key: fields[key] for key in _STORED_KEYS}

    def __len__(self) -> int:
        """Rows in the ring."""
        return min(self._num_written, self.capacity)

    def extend(self, rows: TensorDict) -> None:
        """Overwrite the oldest transitions by `rows` [N], of more than `capacity` the last.

        They need EXPERIENCE_KEYS; "steps_to_next_obs" is 1 by default; other keys are ignored.
        Raises ValueError as `check_transitions` does.
        """
        stored = self._read(rows)
        after = self._num_written + min(len(rows), self.capacity)
        slots = torch.arange(self._num_written, after) % self.capacity
        for key, field in self._ring.items():
            field[slots] = stored[key][-self.capacity :].detach()
        self._num_written = after

    def _read(self, rows: TensorDict) -> Rows:
        """The fields to store of `rows`, checked."""
        given = STEPS_TO_NEXT_OBS in rows.keys(include_nested=True)
        transition.check_transitions(rows, self.spec, _STORED_KEYS if given else EXPERIENCE_KEYS)
        steps = rows[STEPS_TO_NEXT_OBS] if given else torch.ones(len(rows), 1, dtype=torch.int64)
        return {**{key: rows[key] for key in EXPERIENCE_KEYS}, STEPS_TO_NEXT_OBS: steps}

    def clear(self) -> None:
        """Remove all rows."""
        self._num_written = 0

    def sample(self, num_rows: int) -> TensorDict:
        """Return TensorDict [num_rows] with all transition keys, "is_generated" true.

        Raises RuntimeError while the ring is empty.
        """
        if len(self) == 0:
            raise RuntimeError("no generated transition to sample yet: extend the ring first")
        slots = draw_integers(len(self), num_rows, self._generator)
        return self._label({key: field.index_select(0, slots) for key, field in self._ring.items()})

    def round_by_chance(self, number: float) -> int:
        """`number` rounded up or down by chance, so that it is the mean; whole numbers stay."""
        whole = math.floor(number)
        drawn = torch.rand((), dtype=torch.float64, generator=self._generator)
        return whole + int(drawn < number - whole)

    def _label(self, stored: Rows) -> TensorDict:
        """Rows [N] with all labels, from what is stored of them."""
        num_rows, num_others = len(stored[transition.ACTION]), self.spec.num_others
        unknown = torch.full((num_rows, num_others), transition.UNKNOWN_ACTION)
        labels = {transition.IS_GENERATED: torch.ones(num_rows, 1, dtype=torch.bool)}
        others = {transition.OTHER_ACTIONS: unknown} if num_others else {}
        labels |= _make_labels((num_rows,)) | others
        return transition.make_tensordict({**stored, **labels})

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the ring to folder `path` and replace an older one; no pickle."""
        arrays = {_file_name(key): field[: len(self)].numpy() for key, field in self._ring.items()}
        arrays["generator"] = self._generator.get_state().numpy()
        with replaced_folder(path) as folder:
            facts = {**self._layout(), "num_written": self._num_written}
            save_arrays(folder / "ring", arrays, facts)

    def load(self, path: str | os.PathLike[str]) -> None:
        """Read a folder that `save` wrote. Raises ValueError if the layout differs."""
        arrays, facts = load_arrays(Path(path) / "ring")
        require_layout(facts, self._layout(), "generated replay")
        num_written = read_number(facts, "num_written", COUNT)
        size = min(num_written, self.capacity)
        saved = {}
        for key, field in self._ring.items():
            own = field.numpy()
            allowed = NUMBER if field.is_floating_point() else None
            if key == STEPS_TO_NEXT_OBS:
                allowed = Range(1, MOST_STEPS)
            like = own.dtype, (size, *own.shape[1:])
            array = read_array(arrays, _file_name(key), like, allowed)
            saved[key] = torch.from_numpy(array.copy())
        self._read(self._label(saved))
        restore_generator(self._generator, arrays)
        self._num_written = num_written
        for key, field in self._ring.items():
            field[:size] = saved[key]

    def _layout(self) -> dict[str, object]:
        return {
            "capacity": self.capacity,
            "observation_shape": list(self.spec.observation_shape),
            "observation_dtype": str(self.spec.observation_dtype),
            "num_actions": self.spec.num_actions,
        }


class GeneratedSequences(GeneratedReplay):
    """Ring of the newest `capacity` generated sequences of `entries` entries T.

    `extend` takes and `sample` returns TensorDict [N, T] with the keys of
    `sequences.read_sequences`.
    """

    def __init__(self, spec: TransitionSpec, entries: int, capacity: int, seed: int = 0) -> None:
        self.num_entries = entries
        super().__init__(spec, capacity, seed)

    def _fields(self) -> dict[Key, tuple[torch.dtype, tuple[int, ...]]]:
        labels = transition.IS_GENERATED, transition.EXPERT_ACTION, transition.OPPONENT
        fields: dict[Key, tuple[torch.dtype, tuple[int, ...]]] = {
            key: (dtype, (self.num_entries, *shape))
            for key, (dtype, shape) in sequence_fields(self.spec).items()
            if key not in labels
        }
        return {**fields, STATE: (torch.float32, (self.spec.state_size,))}  # once for all entries

    def _read(self, rows: TensorDict) -> Rows:
        check_sequences(rows, self.spec, self.num_entries)
        return {key: rows[key][:, 0] if key == STATE else rows[key] for key in self._ring}

    def _label(self, stored: Rows) -> TensorDict:
        batch = stored[LEARNED].shape
        labels = {transition.IS_GENERATED: torch.ones(batch, dtype=torch.bool)}
        labels |= _make_labels(batch)
        state = stored[STATE].unsqueeze(1).expand(*batch, -1)
        return TensorDict({**stored, **labels, STATE: state}, batch)

    def _layout(self) -> dict[str, object]:
        sizes = {"num_entries": self.num_entries, "state_size": self.spec.state_size}
        return {**super()._layout(), **sizes}


def _make_labels(batch: tuple[int, ...]) -> dict[Key, Tensor]:
    """What generated rows [*batch] have in place of a demonstrator, an opponent and a slot."""
    return {
        transition.EXPERT_ACTION: torch.full(batch, transition.NO_ACTION),
        transition.OPPONENT: torch.full(batch, transition.NO_OPPONENT, dtype=torch.int16),
        transition.INDEX: torch.full(batch, transition.NO_INDEX),
    }


def _file_name(key: Key) -> str:
    return key if isinstance(key, str) else "_".join(key)
