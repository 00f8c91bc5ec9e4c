"""`PrioritizedSampler`: samples steps with large TD errors more often (Schaul et al. 2016).

TorchRL's own needs a compiled extension that its wheels lack with this version of torch.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numba import njit
from numpy.typing import NDArray

from marl_cair.ranges import COUNT, SCORE, Range, read_array, read_number
from marl_cair.replay.array_folder import load_arrays, save_arrays
from marl_cair.replay.sampler import UniformSampler, require_sampleable
from marl_cair.replay.storage import EpisodeStorage

_PRIORITY = Range(0.0, 1e100, float)  # their sum is finite
_FACTS = {"highest": Range(1e-100, 1e100, float), "num_known": COUNT, "beta": SCORE}
_LEAST_ERROR = 1e-3  # added to each TD error: every step keeps a chance to be sampled


class PrioritizedSampler(UniformSampler):
    """Draws slots of an EpisodeStorage in proportion to (|TD error| + 0.001)^alpha.

    Steps that were never sampled have the highest priority so far. A batch of n takes one draw
    from each n-th of the sum. The weight of a row, for its loss, is (steps * probability)^-beta
    over the largest of the batch: beta = 1 removes the sampling bias.

    capacity: entries of the storage. alpha: 0 draws evenly, 1 in proportion to the error. beta: of
    the first batches; `anneal` raises it to 1.
    Raises ValueError for an alpha or beta outside 0..1.
    """

    def __init__(self, seed: int, capacity: int, alpha: float = 0.6, beta: float = 0.4) -> None:
        for name, value in (("alpha", alpha), ("beta", beta)):
            if not 0.0 <= value <= 1.0:
                raise ValueError(f"{name} is {value}, expected 0..1")
        super().__init__(seed)
        self.alpha, self.first_beta, self.beta = alpha, beta, beta
        self._capacity = capacity
        self._num_leaves = 1 << max(0, capacity - 1).bit_length()
        # Node k is the sum of nodes 2 k and 2 k + 1, the last half are the slots.
        self._sums = np.zeros(2 * self._num_leaves, np.float64)
        self._highest = 1.0
        self._num_known = 0  # of all entries that were ever written

    def anneal(self, done: float) -> None:
        """Raise beta to 1 in a straight line over the share `done` of the run, 0..1."""
        self.beta = self.first_beta + (1.0 - self.first_beta) * min(1.0, done)

    def sample(
        self, storage: EpisodeStorage, batch_size: int
    ) -> tuple[torch.Tensor, dict[str, Any]]:
        """Return `batch_size` slots, int64, and their "priority_weight", float32 [batch_size].

        Raises RuntimeError while nothing can be sampled.
        """
        require_sampleable(storage)
        self._take_in(storage)
        total = self._sums[1]
        places = (np.arange(batch_size) + self._draw(batch_size)) / batch_size
        slots = find_slots(self._sums, places * total)
        rejected = ~storage.is_sampleable(torch.from_numpy(slots)).numpy()
        while rejected.any():
            places = self._draw(int(rejected.sum()))
            slots[rejected] = find_slots(self._sums, places * total)
            rejected = ~storage.is_sampleable(torch.from_numpy(slots)).numpy()
        shares = self._sums[self._num_leaves + slots] / total
        weights = (storage.num_sampleable * shares) ** -self.beta
        weights = torch.from_numpy((weights / weights.max()).astype(np.float32))
        return torch.from_numpy(slots), {"priority_weight": weights}

    def update_priority(self, index: torch.Tensor, td_error: torch.Tensor) -> None:
        """Set priorities from the TD errors [N], of either sign, of the slots `index` int64 [N]."""
        errors = td_error.detach().abs().double().cpu().numpy()
        priorities = (np.where(np.isfinite(errors), errors, 0.0) + _LEAST_ERROR) ** self.alpha
        self._highest = max(self._highest, float(priorities.max(initial=0.0)))
        set_priorities(self._sums, index.cpu().numpy(), priorities)

    def _take_in(self, storage: EpisodeStorage) -> None:
        """Give entries that were written since the last batch their first priority."""
        first = max(self._num_known, storage.num_written - self._capacity)
        slots = np.arange(first, storage.num_written) % self._capacity
        is_step = storage.is_step(torch.from_numpy(slots)).numpy()
        set_priorities(self._sums, slots, np.where(is_step, self._highest, 0.0))
        self._num_known = storage.num_written

    def _draw(self, number: int) -> NDArray[np.float64]:
        fractions = torch.rand(number, generator=self._generator, dtype=torch.float64)
        return fractions.numpy()

    def state_dict(self) -> dict[str, Any]:
        """Return priorities, random state and facts."""
        arrays = {name: torch.from_numpy(array.copy()) for name, array in self._export().items()}
        return {**super().state_dict(), "arrays": arrays, "facts": self._export_facts()}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Continue from a saved state. Raises ValueError for another capacity."""
        arrays = {name: tensor.numpy() for name, tensor in state_dict["arrays"].items()}
        self._import(arrays, state_dict["facts"])
        super().load_state_dict(state_dict)

    def dumps(self, path: str | os.PathLike[str]) -> None:
        """Write the state to a new folder."""
        super().dumps(Path(path) / "uniform")
        save_arrays(Path(path) / "priorities", self._export(), self._export_facts())

    def loads(self, path: str | os.PathLike[str]) -> None:
        """Read what `dumps` wrote. Raises ValueError for another capacity."""
        self._import(*load_arrays(Path(path) / "priorities"))
        super().loads(Path(path) / "uniform")

    def _export(self) -> dict[str, NDArray[Any]]:
        return {"priorities": self._sums[self._num_leaves : self._num_leaves + self._capacity]}

    def _export_facts(self) -> dict[str, Any]:
        return {"highest": self._highest, "num_known": self._num_known, "beta": self.beta}

    def _import(self, arrays: Mapping[str, NDArray[Any]], facts: Mapping[str, Any]) -> None:
        saved = np.asarray(arrays.get("priorities", ()))
        if len(saved) != self._capacity:
            raise ValueError(
                f"the saved priorities are of {len(saved)} entries, this replay has "
                f"{self._capacity}: resume with the same capacity"
            )
        like = np.dtype(np.float64), (self._capacity,)
        priorities = read_array(arrays, "priorities", like, _PRIORITY)
        read = {name: read_number(facts, name, _FACTS[name]) for name in _FACTS}
        self._sums[:] = 0.0
        set_priorities(self._sums, np.arange(self._capacity), np.asarray(priorities, np.float64))
        self._highest, self._num_known = float(read["highest"]), read["num_known"]
        self.beta = float(read["beta"])

    def check_storage(self, storage: EpisodeStorage) -> None:
        """Raise ValueError unless just the known steps have priorities above 0: else draws could
        look for one for ever.
        """
        known = np.arange(max(0, storage.num_written - self._capacity), self._num_known)
        slots = known % self._capacity
        is_step = storage.is_step(torch.from_numpy(slots)).numpy()
        is_drawn = self._sums[self._num_leaves + slots] > 0.0
        if self._num_known > storage.num_written or (is_drawn != is_step).any():
            raise ValueError("the saved priorities are not those of the saved replay")


@njit(cache=True, nogil=True)
def set_priorities(sums: Any, slots: Any, priorities: Any) -> None:
    """Set slots int64 [N] and all sums above them, in order.

    Each sum is that of its two halves, so that the bits depend on the priorities alone and not on
    how they came about.
    """
    num_leaves = sums.shape[0] // 2
    for n in range(slots.shape[0]):
        node = num_leaves + slots[n]
        sums[node] = priorities[n]
        node //= 2
        while node >= 1:
            sums[node] = sums[2 * node] + sums[2 * node + 1]
            node //= 2


@njit(cache=True, nogil=True)
def find_slots(sums: Any, places: Any) -> Any:
    """Return the slots int64 [N] in which the places float64 [N], 0..sums[1], of the sum lie."""
    num_leaves = sums.shape[0] // 2
    slots = np.empty(places.shape[0], np.int64)
    for n in range(places.shape[0]):
        node, left = 1, places[n]
        while node < num_leaves:
            node *= 2
            # Rounding may leave a little more than there is: never go where there is nothing.
            if left >= sums[node] and sums[node + 1] > 0.0:
                left -= sums[node]
                node += 1
        slots[n] = node - num_leaves
    return slots
