"""`Reservoir`: an even sample of all decisions there have ever been, in a memory of fixed size."""

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict

from marl_cair.files import replaced_folder
from marl_cair.ranges import COUNT, NUMBER, Range, check_extremes, read_array, read_number
from marl_cair.replay.array_folder import load_arrays, save_arrays
from marl_cair.replay.transition import ACTION, ACTION_MASK, OBSERVATION, TransitionSpec


class Reservoir:
    """Observations, masks and actions; after n rows each of them is kept with chance capacity / n.

    Algorithm R (Vitter 1985, "Random sampling with a reservoir"): row n, counted from 1, takes a
    place drawn from 1..n, and is dropped where that lies beyond the capacity. Rows come in batches,
    with the same draws as one by one. Uniform planes are stored as one byte each, masks as bits.

    Args:
        spec: of the rows.
        capacity: rows.
        seed: of places and samples.

    Raises:
        ValueError: no capacity.
    """

    def __init__(self, spec: TransitionSpec, capacity: int, seed: int) -> None:
        if capacity < 1:
            raise ValueError(f"the reservoir's capacity is {capacity}, it must be 1 or more")
        self.spec, self.capacity = spec, capacity
        self._rng = np.random.default_rng(seed)
        self._rows = np.zeros((capacity, spec.row_bytes), np.uint8)
        self._masks = np.zeros((capacity, spec.mask_bytes), np.uint8)
        self._actions = np.zeros(capacity, np.int32)
        self.num_seen = 0  # rows that ever came

    def __len__(self) -> int:
        return min(self.num_seen, self.capacity)

    def extend(
        self, observation: torch.Tensor, action_mask: torch.Tensor, action: torch.Tensor
    ) -> None:
        """Take in N rows, in their order.

        observation [N, *shape] as the spec says; action_mask bool [N, A]; action int64 [N].

        Raises:
            ValueError: another dtype or shape, or an action that is not legal.
        """
        self._check(observation, action_mask, action)
        places = self._draw_places(len(action))
        kept = np.flatnonzero(places < self.capacity)
        # Of rows that take one place the last stays; NumPy says so of a repeated index.
        at = places[kept]
        rows = torch.from_numpy(kept)
        self._rows[at] = self._pack(observation[rows])
        self._masks[at] = np.packbits(action_mask[rows].numpy(), axis=1, bitorder="little")
        self._actions[at] = action[rows].numpy()
        self.num_seen += len(action)

    def _draw_places(self, count: int) -> NDArray[np.int64]:
        numbers = np.arange(self.num_seen, self.num_seen + count)
        drawn = self._rng.integers(0, numbers + 1)
        return np.where(numbers < self.capacity, numbers, drawn).astype(np.int64)

    def sample(self, num_rows: int) -> TensorDict:
        """`num_rows` rows, each drawn evenly with replacement: TensorDict [num_rows] with the keys
        observation, action_mask and action.

        Raises:
            RuntimeError: there are none yet.
        """
        if not self.num_seen:
            raise RuntimeError("the reservoir is empty: nothing can be sampled yet")
        at = self._rng.integers(0, len(self), num_rows)
        legal = np.unpackbits(
            self._masks[at], axis=1, count=self.spec.num_actions, bitorder="little"
        )
        return TensorDict(
            {
                OBSERVATION: self._unpack(self._rows[at]),
                ACTION_MASK: torch.from_numpy(legal.astype(np.bool_)),
                ACTION: torch.from_numpy(self._actions[at].astype(np.int64)),
            },
            [num_rows],
        )

    def _pack(self, observation: torch.Tensor) -> NDArray[np.uint8]:
        spec, num_rows = self.spec, len(observation)
        size = math.prod(spec.observation_shape)
        flat = observation.contiguous().numpy().reshape(num_rows, size).view(np.uint8)
        # Of a uniform plane the first cell stands for all.
        firsts = flat[:, spec.board_bytes :: spec.num_cells] if spec.num_uniform else flat[:, :0]
        packed: NDArray[np.uint8] = np.concatenate([flat[:, : spec.board_bytes], firsts], axis=1)
        return packed

    def _unpack(self, rows: NDArray[np.uint8]) -> torch.Tensor:
        spec = self.spec
        spread = np.repeat(rows[:, spec.board_bytes :], spec.num_cells, axis=1)
        flat = np.concatenate([rows[:, : spec.board_bytes], spread], axis=1)
        values = torch.from_numpy(flat).view(spec.observation_dtype)
        return values.reshape(len(rows), *spec.observation_shape)

    def _check(
        self, observation: torch.Tensor, action_mask: torch.Tensor, action: torch.Tensor
    ) -> None:
        fields = self.spec.fields()
        given = {OBSERVATION: observation, ACTION_MASK: action_mask, ACTION: action}
        for key, value in given.items():
            dtype, shape = fields[key]
            if value.dtype != dtype or tuple(value.shape) != (len(action), *shape):
                raise ValueError(
                    f"the reservoir got {key!r} as {value.dtype} {list(value.shape)}, expected "
                    f"{dtype} {[len(action), *shape]}"
                )
        if not bool(action_mask.gather(1, action.unsqueeze(1)).all()):
            raise ValueError(
                "the reservoir got an action that its mask does not allow: choose actions under it"
            )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write everything to folder `path`, in place of one that is there, without pickle."""
        size = len(self)
        arrays: dict[str, NDArray[Any]] = {
            "rows": self._rows[:size],
            "masks": self._masks[:size],
            "actions": self._actions[:size],
        }
        with replaced_folder(path) as folder:
            save_arrays(folder / "reservoir", arrays, self._export_facts())

    def load(self, path: str | os.PathLike[str]) -> None:
        """Go on where `save` was called, with the same bits.

        Raises:
            ValueError: it has another capacity or layout.
        """
        arrays, facts = load_arrays(Path(path) / "reservoir")
        layout = [self.capacity, self.spec.row_bytes, self.spec.num_actions]
        if facts.get("layout") != layout:
            raise ValueError(
                f"{path} holds a reservoir of another layout (capacity, bytes of a row, actions: "
                f"{facts.get('layout')}) than this one ({layout}): start a new run"
            )
        num_seen = read_number(facts, "num_seen", COUNT)
        size = min(num_seen, self.capacity)
        fields: dict[str, NDArray[Any]] = {
            "rows": self._rows,
            "masks": self._masks,
            "actions": self._actions,
        }
        ranges = {"actions": Range(0, self.spec.num_actions - 1)}
        saved = {
            name: read_array(arrays, name, (own.dtype, (size, *own.shape[1:])), ranges.get(name))
            for name, own in fields.items()
        }
        if size:
            self._check_saved(saved)
        self._rng.bit_generator.state = json.loads(facts["rng"])
        self.num_seen = num_seen
        for name, own in fields.items():
            own[:size] = saved[name]

    def _check_saved(self, saved: Mapping[str, NDArray[Any]]) -> None:
        """Raise ValueError for observations that are not finite, or actions that are illegal."""
        if self.spec.observation_dtype == torch.float32:
            check_extremes(saved["rows"].view(np.float32), "rows", NUMBER)
        actions = saved["actions"]
        bits = saved["masks"][np.arange(len(actions)), actions // 8] >> (actions % 8)
        if not (bits & 1).all():
            raise ValueError("the reservoir holds an action that its mask does not allow")

    def _export_facts(self) -> dict[str, Any]:
        return {
            "layout": [self.capacity, self.spec.row_bytes, self.spec.num_actions],
            "num_seen": self.num_seen,
            "rng": json.dumps(self._rng.bit_generator.state),
        }
