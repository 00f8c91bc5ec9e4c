"""`GeneratedReplay`: a ring of whole transitions that a generator made.

Not a TorchRL buffer: that would write ring slots into "index", where generated rows hold NO_INDEX.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict

from marl_cair.files import replaced_folder
from marl_cair.ranges import COUNT, NUMBER, Range, read_array, read_number
from marl_cair.replay import MOST_STEPS
from marl_cair.replay.array_folder import load_arrays, require_layout, save_arrays
from marl_cair.replay.sampler import draw_integers, restore_generator
from marl_cair.replay.transition import (
    EXPERIENCE_KEYS,
    EXPERT_ACTION,
    IS_GENERATED,
    NEXT_DONE,
    NO_ACTION,
    NO_INDEX,
    NO_OPPONENT,
    STEPS_TO_NEXT_OBS,
    Key,
    TransitionSpec,
    check_transitions,
)

_STORED_KEYS: tuple[Key, ...] = (*EXPERIENCE_KEYS, STEPS_TO_NEXT_OBS)


class GeneratedReplay:
    """Ring of the newest `capacity` generated transitions, drawn from uniformly.

    spec: shapes of a transition. seed: of the draws. Memory is paged in as the ring fills.
    Raises ValueError for a capacity below 1.
    """

    def __init__(self, spec: TransitionSpec, capacity: int = 20_000, seed: int = 0) -> None:
        if capacity < 1:
            raise ValueError(f"capacity is {capacity}, expected 1 or more")
        self.spec = spec
        self.capacity = capacity
        self._generator = torch.Generator().manual_seed(seed)
        self._num_written = 0
        fields = spec.fields()
        self._ring = {key: _make_field(capacity, *fields[key]) for key in _STORED_KEYS}

    def __len__(self) -> int:
        """Transitions in the ring."""
        return min(self._num_written, self.capacity)

    def extend(self, transitions: TensorDict) -> None:
        """Store transitions [N] over the oldest; of more than `capacity` the last ones.

        They need EXPERIENCE_KEYS; "steps_to_next_obs" counts as 1 where it is not given; other keys
        are not looked at. Raises ValueError as `check_transitions` does.
        """
        given = STEPS_TO_NEXT_OBS in transitions.keys(include_nested=True)
        check_transitions(transitions, self.spec, _STORED_KEYS if given else EXPERIENCE_KEYS)
        transitions = transitions[-self.capacity :]
        skipped = self._num_written
        slots = torch.arange(skipped, skipped + len(transitions)) % self.capacity
        for key, field in self._ring.items():
            if key == STEPS_TO_NEXT_OBS and not given:
                field[slots] = 1
            else:
                field[slots] = transitions[key].detach()
        self._num_written += len(transitions)

    def clear(self) -> None:
        """Drop all transitions; the draws go on from where they stand."""
        self._num_written = 0

    def sample(self, batch_size: int) -> TensorDict:
        """Return TensorDict [batch_size] with all transition keys, "is_generated" true.

        Raises RuntimeError while the ring is empty.
        """
        if len(self) == 0:
            raise RuntimeError("no generated transition to sample yet: extend the ring first")
        slots = draw_integers(len(self), batch_size, self._generator)
        drawn = {key: field.index_select(0, slots) for key, field in self._ring.items()}
        return make_transitions(drawn, is_generated=True)

    def state_dict(self) -> dict[str, Any]:
        """Return a copy of the used part as tensors, and plain facts."""
        arrays, facts = self._export()
        tensors = {name: torch.from_numpy(array.copy()) for name, array in arrays.items()}
        return {"facts": facts, "arrays": tensors}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Go on where the saved ring stood. Raises ValueError where the layout differs."""
        arrays = {name: tensor.numpy() for name, tensor in state_dict["arrays"].items()}
        self._import(arrays, state_dict["facts"])

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the ring to folder `path`, in place of one that is there, without pickle."""
        with replaced_folder(path) as folder:
            save_arrays(folder / "ring", *self._export())

    def load(self, path: str | os.PathLike[str]) -> None:
        """Read what `save` wrote. Raises ValueError where the layout differs."""
        self._import(*load_arrays(Path(path) / "ring"))

    def _export(self) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
        arrays = {_file_name(key): field[: len(self)].numpy() for key, field in self._ring.items()}
        arrays["generator"] = self._generator.get_state().numpy()
        return arrays, {**self._layout(), "num_written": self._num_written}

    def _layout(self) -> dict[str, Any]:
        return {
            "capacity": self.capacity,
            "observation_shape": list(self.spec.observation_shape),
            "observation_dtype": str(self.spec.observation_dtype),
            "num_actions": self.spec.num_actions,
        }

    def _import(self, arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> None:
        require_layout(facts, self._layout(), "generated replay")
        num_written = read_number(facts, "num_written", COUNT)
        size = min(num_written, self.capacity)
        saved = {}
        for key, field in self._ring.items():
            own = field.numpy()
            like = own.dtype, (size, *own.shape[1:])
            array = read_array(arrays, _file_name(key), like, self._find_range(key))
            saved[key] = torch.from_numpy(array.copy())
        check_transitions(make_transitions(saved, is_generated=True), self.spec, _STORED_KEYS)
        restore_generator(self._generator, arrays)
        self._num_written = num_written
        for key, field in self._ring.items():
            field[:size] = saved[key]

    def _find_range(self, key: Key) -> Range | None:
        """What a saved field may hold; None: whatever `check_transitions` lets through."""
        if key == STEPS_TO_NEXT_OBS:
            return Range(1, MOST_STEPS)
        is_float = self._ring[key].is_floating_point()
        return NUMBER if is_float else None


def make_transitions(drawn: Mapping[Key, torch.Tensor], is_generated: bool) -> TensorDict:
    """Make TensorDict [N] of rows that lie in no ring of real steps, with all labels.

    drawn: EXPERIENCE_KEYS and "steps_to_next_obs", each [N, ...].
    """
    num_rows = len(drawn[NEXT_DONE])
    following = {key[1]: value for key, value in drawn.items() if isinstance(key, tuple)}
    current = {key: value for key, value in drawn.items() if isinstance(key, str)}
    labels = {
        str(IS_GENERATED): torch.full((num_rows, 1), is_generated),
        str(EXPERT_ACTION): torch.full((num_rows,), NO_ACTION, dtype=torch.int64),
        "opponent": torch.full((num_rows,), NO_OPPONENT, dtype=torch.int16),
        "index": torch.full((num_rows,), NO_INDEX, dtype=torch.int64),
    }
    return TensorDict({**current, "next": TensorDict(following, [num_rows]), **labels}, [num_rows])


def _make_field(capacity: int, dtype: torch.dtype, shape: tuple[int, ...]) -> torch.Tensor:
    # NumPy, as torch.empty would write every page under deterministic algorithms.
    item = torch.empty((), dtype=dtype).numpy().dtype
    return torch.from_numpy(np.empty((capacity, *shape), item))


def _file_name(key: Key) -> str:
    return key if isinstance(key, str) else "_".join(key)
