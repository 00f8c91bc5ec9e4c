"""`GeneratedReplay`: a ring of whole generated transitions.

Not a TorchRL buffer: that would write ring slots into "index", where generated rows hold NO_INDEX.
"""

import os
from collections.abc import Mapping
from pathlib import Path

import torch
from tensordict import TensorDict

from marl_cair.files import replaced_folder
from marl_cair.ranges import COUNT, NUMBER, Range, read_array, read_number
from marl_cair.replay import MOST_STEPS, transition
from marl_cair.replay.array_folder import load_arrays, require_layout, save_arrays
from marl_cair.replay.sampler import draw_integers, restore_generator
from marl_cair.replay.transition import EXPERIENCE_KEYS, STEPS_TO_NEXT_OBS, Key, TransitionSpec

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
        fields = spec.fields()
        self._ring = {
            key: torch.from_numpy(transition.make_array(capacity, *fields[key]))
            for key in _STORED_KEYS
        }

    def __len__(self) -> int:
        """Transitions in the ring."""
        return min(self._num_written, self.capacity)

    def extend(self, transitions: TensorDict) -> None:
        """Overwrite the oldest transitions by `transitions` [N], of more than `capacity` the last.

        They need EXPERIENCE_KEYS; "steps_to_next_obs" is 1 by default; other keys are ignored.
        Raises ValueError as `check_transitions` does.
        """
        given = STEPS_TO_NEXT_OBS in transitions.keys(include_nested=True)
        keys = _STORED_KEYS if given else EXPERIENCE_KEYS
        transition.check_transitions(transitions, self.spec, keys)
        transitions = transitions[-self.capacity :]
        first = self._num_written
        slots = torch.arange(first, first + len(transitions)) % self.capacity
        self._ring[STEPS_TO_NEXT_OBS][slots] = 1
        for key in keys:
            self._ring[key][slots] = transitions[key].detach()
        self._num_written += len(transitions)

    def sample(self, batch_size: int) -> TensorDict:
        """Return TensorDict [batch_size] with all transition keys, "is_generated" true.

        Raises RuntimeError while the ring is empty.
        """
        if len(self) == 0:
            raise RuntimeError("no generated transition to sample yet: extend the ring first")
        slots = draw_integers(len(self), batch_size, self._generator)
        return _add_labels({key: field.index_select(0, slots) for key, field in self._ring.items()})

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
        transition.check_transitions(_add_labels(saved), self.spec, _STORED_KEYS)
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


def _add_labels(rows: Mapping[Key, torch.Tensor]) -> TensorDict:
    """TensorDict [N] of generated rows with all labels. rows: fields [N, ...] of _STORED_KEYS."""
    num_rows = len(rows[transition.ACTION])
    return transition.make_tensordict(
        {
            **rows,
            transition.IS_GENERATED: torch.ones(num_rows, 1, dtype=torch.bool),
            transition.EXPERT_ACTION: torch.full((num_rows,), transition.NO_ACTION),
            transition.OPPONENT: torch.full((num_rows,), transition.NO_OPPONENT, dtype=torch.int16),
            transition.INDEX: torch.full((num_rows,), transition.NO_INDEX),
        }
    )


def _file_name(key: Key) -> str:
    return key if isinstance(key, str) else "_".join(key)
