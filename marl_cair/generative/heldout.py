"""Rings of real transitions, and the split that holds some of them out of training."""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.generative.settings import GeneratorSpec
from marl_cair.ranges import NUMBER, Range, read_array, read_number
from marl_cair.replay.transition import OTHER_ACTIONS, check_transitions

_HASH_MODULUS = 2**31


def is_heldout(index: Tensor, share: float | Tensor, seed: int) -> Tensor:
    """Whether real transitions of these replay indices are held out of training, bool [N].
    share: of all, or [N] for each.

    A hash of the index decides: the same row is always on the same side, in every process and after
    a resume. int64 arithmetic wraps, as in a multiplicative hash; the constant from the seed is
    reduced to its range first.
    """
    mixed = index.long() * 0x9E3779B97F4A7C1 + (seed + 1) * 0x632BE59BD9B4E01 % 2**63
    for _ in range(2):
        mixed = mixed ^ ((mixed >> 29) & 0x7FFFFFFFF)
        mixed = mixed * 0x3F58476D1CE4E5B9
    mixed = mixed ^ ((mixed >> 32) & 0xFFFFFFFF)
    return (mixed % _HASH_MODULUS).abs() < share * _HASH_MODULUS


class TransitionRing:
    """The latest `capacity` transitions that were added, each replay index at most once."""

    def __init__(self, spec: GeneratorSpec, capacity: int) -> None:
        self.capacity = capacity
        self.num_rows = 0
        self._cursor = 0
        self._spec = spec.transition
        self._rows = make_empty_transitions(spec, capacity)
        self._rows["index"].fill_(-1)

    def add(self, rows: TensorDict) -> None:
        """Store rows of any number; a row replaces an older one of the same index."""
        latest = {index: place for place, index in enumerate(rows["index"].tolist())}
        index_at = self._rows["index"].tolist()
        held = {index: slot for slot, index in enumerate(index_at)}
        source_of: dict[int, int] = {}  # the last row of each slot
        for index, place in latest.items():
            slot = held.get(index)
            if slot is None:
                slot = self._cursor
                self._cursor = (self._cursor + 1) % self.capacity
                self.num_rows = min(self.num_rows + 1, self.capacity)
                held.pop(index_at[slot], None)
                held[index], index_at[slot] = slot, index
            source_of[slot] = place
        slots, sources = list(source_of), list(source_of.values())
        for key in self._rows.keys(True, True):
            self._rows[key][slots] = rows[key][sources]

    def select(self, places: Tensor) -> TensorDict:
        """Return a copy of the rows at `places` (int64, 0..num_rows-1)."""
        return self._rows[places]

    def sample(self, num: int, generator: torch.Generator) -> TensorDict:
        """Sample up to `num` rows uniformly without replacement."""
        return self.select(torch.randperm(self.num_rows, generator=generator)[:num])

    def state_dict(self) -> dict[str, Any]:
        rows = self._rows[: self.num_rows]
        return {
            "num_rows": self.num_rows,
            "cursor": self._cursor,
            "rows": {_join(key): rows[key].clone() for key in rows.keys(True, True)},
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Continue from `state_dict`.

        Raises ValueError for more rows than the capacity, or invalid transitions.
        """
        num_rows = read_number(state, "num_rows", Range(0, self.capacity))
        cursor = read_number(state, "cursor", Range(0, self.capacity - 1))
        rows = self._rows[:num_rows].clone()
        for key in rows.keys(True, True):
            own = rows[key].numpy()
            allowed = NUMBER if rows[key].is_floating_point() else None
            own[:] = read_array(state["rows"], _join(key), (own.dtype, own.shape), allowed)
        check_transitions(rows, self._spec)
        self.num_rows, self._cursor = num_rows, cursor
        self._rows["index"].fill_(-1)
        for key in self._rows.keys(True, True):
            self._rows[key][:num_rows] = rows[key]


def _join(key: str | tuple[str, ...]) -> str:
    return key if isinstance(key, str) else ".".join(key)


def make_empty_transitions(spec: GeneratorSpec, num: int) -> TensorDict:
    """Make `num` one-step transitions of zeros, with the keys and dtypes of replay."""
    rows = TensorDict({}, batch_size=[num])
    for key, (dtype, shape) in spec.transition.fields().items():
        rows[key] = torch.zeros(num, *shape, dtype=dtype)
    rows["steps_to_next_obs"].fill_(1)
    return rows


def check_real_rows(batch: TensorDict, spec: GeneratorSpec) -> None:
    """Raise ValueError unless `batch` [N] holds real one-step transitions of replay."""
    check_transitions(batch, spec.transition)
    if bool(batch["is_generated"].any()):
        raise ValueError(
            f"{int(batch['is_generated'].sum())} of the rows are generated: a generator learns "
            "from real transitions only"
        )
    steps = batch["steps_to_next_obs"]
    if bool((steps != 1).any()):
        raise ValueError(
            f"steps_to_next_obs reaches {int(steps.max())}, expected 1 everywhere: sample "
            "one-step transitions for the generator"
        )
    if bool((batch["index"] < 0).any()):
        raise ValueError(
            f"index {int(batch['index'].min())} is no slot of replay: it must be 0 or more, "
            "as it determines which rows are held out"
        )
    rewards, (low, high) = batch["next", "reward"], spec.reward_range
    rounding = 1e-6 * max(abs(low), abs(high))  # of scaled rewards, which are float32
    if not bool(((rewards >= low - rounding) & (rewards <= high + rounding)).all()):
        raise ValueError(
            f"rewards reach from {float(rewards.min())} to {float(rewards.max())}, outside of "
            f"reward_range {spec.reward_range}: widen it in the GeneratorSpec"
        )


def read_others(rows: TensorDict) -> Tensor:
    """A copy of the other seats' actions, int64 [N, O]; [N, 0] where there is no such column."""
    others = rows.get(OTHER_ACTIONS, None)
    return torch.zeros_like(rows["action"][:, None][:, :0]) if others is None else others.clone()
