"""`Reservoir`: a uniform sample of all rows that were ever added, in a memory of fixed size."""

import json
import math
import os
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict

from marl_cair.files import replaced_folder
from marl_cair.ranges import COUNT, NUMBER, Range, check_extremes, read_array, read_number
from marl_cair.replay import transition
from marl_cair.replay.array_folder import load_arrays, require_layout, save_arrays
from marl_cair.replay.transition import TransitionSpec


class Reservoir:
    """Observations, masks and actions; after n rows each of them is kept with chance capacity / n.

    Algorithm R (Vitter 1985, "Random sampling with a reservoir"): row n, counted from 1, takes a
    slot drawn from 1..n, and is dropped if that is beyond the capacity. Batches of rows give the
    same draws as single rows. Uniform planes are stored as one byte each, masks as bits.
    Raises ValueError for a capacity below 1.
    """

    def __init__(self, spec: TransitionSpec, capacity: int, seed: int) -> None:
        if capacity < 1:
            raise ValueError(f"the reservoir's capacity is {capacity}, it must be 1 or more")
        self.spec, self.capacity = spec, capacity
        self._rng = np.random.default_rng(seed)
        self._rows = np.zeros((capacity, spec.row_bytes), np.uint8)
        self._masks = np.zeros((capacity, spec.mask_bytes), np.uint8)
        self._actions = np.zeros(capacity, np.int32)
        self.num_seen = 0  # rows ever added

    def __len__(self) -> int:
        return min(self.num_seen, self.capacity)

    def extend(
        self, observation: torch.Tensor, action_mask: torch.Tensor, action: torch.Tensor
    ) -> None:
        """Add N rows in their order.

        observation [N, *shape] as the spec says; action_mask bool [N, A]; action int64 [N].
        Raises ValueError for another dtype or shape, or an illegal action.
        """
        fields = self.spec.fields()
        given = {
            transition.OBSERVATION: observation,
            transition.ACTION_MASK: action_mask,
            transition.ACTION: action,
        }
        for key, value in given.items():
            dtype, shape = fields[key]
            transition.check_tensor(f"the reservoir's {key}", value, dtype, (len(action), *shape))
        if not bool(action_mask.gather(1, action.unsqueeze(1)).all()):
            raise ValueError(
                "the reservoir got an action that its mask does not allow: choose actions under it"
            )
        numbers = np.arange(self.num_seen, self.num_seen + len(action))
        drawn = self._rng.integers(0, numbers + 1)
        slots = np.where(numbers < self.capacity, numbers, drawn)
        kept = np.flatnonzero(slots < self.capacity)
        # NumPy assigns in order: of rows that take the same slot the last stays.
        at, rows = slots[kept], torch.from_numpy(kept)
        self._rows[at] = self._pack(observation[rows])
        self._masks[at] = np.packbits(action_mask[rows].numpy(), axis=1, bitorder="little")
        self._actions[at] = action[rows].numpy()
        self.num_seen += len(action)

    def sample(self, num_rows: int) -> TensorDict:
        """Sample TensorDict [num_rows] uniformly with replacement; keys: observation, action_mask,
        action. Raises RuntimeError while the reservoir is empty.
        """
        if not self.num_seen:
            raise RuntimeError("the reservoir is empty: nothing can be sampled yet")
        at = self._rng.integers(0, len(self), num_rows)
        num_actions = self.spec.num_actions
        legal = np.unpackbits(self._masks[at], axis=1, count=num_actions, bitorder="little")
        return TensorDict(
            {
                transition.OBSERVATION: self._unpack(self._rows[at]),
                transition.ACTION_MASK: torch.from_numpy(legal.astype(np.bool_)),
                transition.ACTION: torch.from_numpy(self._actions[at].astype(np.int64)),
            },
            [num_rows],
        )

    def _pack(self, observation: torch.Tensor) -> NDArray[np.uint8]:
        spec, num_rows = self.spec, len(observation)
        size = math.prod(spec.observation_shape)
        flat = observation.contiguous().numpy().reshape(num_rows, size).view(np.uint8)
        firsts = flat[:, spec.board_bytes :: spec.num_cells] if spec.num_uniform else flat[:, :0]
        packed: NDArray[np.uint8] = np.concatenate([flat[:, : spec.board_bytes], firsts], axis=1)
        return packed

    def _unpack(self, rows: NDArray[np.uint8]) -> torch.Tensor:
        spec = self.spec
        spread = np.repeat(rows[:, spec.board_bytes :], spec.num_cells, axis=1)
        flat = np.concatenate([rows[:, : spec.board_bytes], spread], axis=1)
        values = torch.from_numpy(flat).view(spec.observation_dtype)
        return values.reshape(len(rows), *spec.observation_shape)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write everything to folder `path` and replace an older one; no pickle."""
        arrays = {name: array[: len(self)] for name, array in self._arrays().items()}
        facts = {"num_seen": self.num_seen, "rng": json.dumps(self._rng.bit_generator.state)}
        with replaced_folder(path) as folder:
            save_arrays(folder / "reservoir", arrays, {**self._layout(), **facts})

    def load(self, path: str | os.PathLike[str]) -> None:
        """Continue from `save` with the same bits. Raises ValueError for another layout."""
        arrays, facts = load_arrays(Path(path) / "reservoir")
        require_layout(facts, self._layout(), "reservoir")
        num_seen = read_number(facts, "num_seen", COUNT)
        size = min(num_seen, self.capacity)
        ranges = {"actions": Range(0, self.spec.num_actions - 1)}
        saved = {
            name: read_array(arrays, name, (own.dtype, (size, *own.shape[1:])), ranges.get(name))
            for name, own in self._arrays().items()
        }
        if size and self.spec.observation_dtype == torch.float32:
            check_extremes(saved["rows"].view(np.float32), "rows", NUMBER)
        actions = saved["actions"]
        bits = saved["masks"][np.arange(size), actions // 8] >> (actions % 8)
        if not (bits & 1).all():
            raise ValueError("the reservoir holds an action that its mask does not allow")
        self._rng.bit_generator.state = json.loads(facts["rng"])
        self.num_seen = num_seen
        for name, own in self._arrays().items():
            own[:size] = saved[name]

    def _arrays(self) -> dict[str, NDArray[np.generic]]:
        return {"rows": self._rows, "masks": self._masks, "actions": self._actions}

    def _layout(self) -> dict[str, list[int]]:
        """Capacity, bytes of a row, actions."""
        return {"layout": [self.capacity, self.spec.row_bytes, self.spec.num_actions]}
