"""Replay samplers: uniform, and by TD error (prioritised, Schaul et al. 2016).

TorchRL's RandomSampler cannot leave entries out and does not save its generator; its
PrioritizedSampler needs a compiled extension that its wheels lack with this version of torch.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numba import njit

from marl_cair.ranges import COUNT, SCORE, Range, read_array, read_number
from marl_cair.replay.array_folder import load_arrays, save_arrays
from marl_cair.replay.storage import EpisodeStorage

_LIST_BELOW = 0.5  # share of sampleable entries below which listing them is faster than rejecting
_PRIORITY = Range(0.0, 1e100, float)  # their sum is finite
_FACTS = {"highest": Range(1e-100, 1e100, float), "num_known": COUNT, "beta": SCORE}
_LEAST_ERROR = 1e-3  # added to each TD error: every start can be sampled


class Sampler(ABC):
    """Chooses which stored transitions or sequences are learned from, by its seeded generator.

    capacity: entries of the storage, where a sampler must know it.
    """

    def __init__(self, seed: int, capacity: int = 0) -> None:
        self.generator, self.capacity = torch.Generator().manual_seed(seed), capacity

    @abstractmethod
    def sample(
        self, storage: EpisodeStorage, batch_size: int
    ) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        """Return slots int64 [batch_size], and further fields of the batch, [batch_size] each.

        Raises RuntimeError while nothing can be sampled.
        """

    def update(self, index: torch.Tensor, td_error: torch.Tensor) -> None:  # noqa: B027
        """Note the TD errors [N], of either sign, of the slots `index` int64 [N]."""

    def anneal(self, done: float) -> None:  # noqa: B027
        """Follow the share `done` of the run, 0..1."""

    def check_storage(self, storage: EpisodeStorage) -> None:  # noqa: B027
        """Raise ValueError unless the loaded state belongs to the loaded storage."""

    def save(self, path: Path) -> None:
        """Write the state to a new folder."""
        save_arrays(path, {"generator": self.generator.get_state().numpy()}, {})

    def load(self, path: Path) -> None:
        """Read a folder that `save` wrote. Raises ValueError for an invalid state."""
        restore_generator(self.generator, load_arrays(path)[0])


class UniformSampler(Sampler):
    """Samples all slots with the same chance, with replacement."""

    def sample(
        self, storage: EpisodeStorage, batch_size: int
    ) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        """Return slots int64 [batch_size], and no further fields."""
        return draw_uniformly(storage, batch_size, self.generator), {}


class PrioritizedSampler(Sampler):
    """Samples slots of an EpisodeStorage in proportion to (|TD error| + 0.001)^alpha.

    Starts that were never sampled have the highest priority so far. A batch of n takes one draw
    from each n-th of the sum. The weight in the loss is (starts * probability)^-beta, divided by
    the largest of the batch: beta = 1 removes the sampling bias.

    capacity: entries of the storage. alpha: 0 samples uniformly, 1 in proportion to the error.
    beta: at the start; `anneal` raises it to 1.
    Raises ValueError for an alpha or beta outside 0..1.
    """

    def __init__(self, seed: int, capacity: int, alpha: float = 0.6, beta: float = 0.4) -> None:
        for name, value in (("alpha", alpha), ("beta", beta)):
            if not 0.0 <= value <= 1.0:
                raise ValueError(f"{name} is {value}, expected 0..1")
        super().__init__(seed, capacity)
        self.alpha, self.first_beta, self.beta = alpha, beta, beta
        self._num_leaves = 1 << max(0, capacity - 1).bit_length()
        # Node k is the sum of nodes 2 k and 2 k + 1, the last half are the slots.
        self._sums = np.zeros(2 * self._num_leaves, np.float64)
        self._highest = 1.0
        self._num_known = 0  # of all entries that were ever written

    @property
    def priorities(self) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Priorities of all slots, float64 [capacity], a view."""
        return self._sums[self._num_leaves : self._num_leaves + self.capacity]

    def anneal(self, done: float) -> None:
        """Raise beta linearly to 1 over the share `done` of the run, 0..1."""
        self.beta = self.first_beta + (1.0 - self.first_beta) * min(1.0, done)

    def sample(
        self, storage: EpisodeStorage, batch_size: int
    ) -> tuple[torch.Tensor, dict[str, torch.Tensor]]:
        """Return slots int64 [batch_size] and their "priority_weight", float32 [batch_size]."""
        require_sampleable(storage)
        self._add_new_entries(storage)
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

    def update(self, index: torch.Tensor, td_error: torch.Tensor) -> None:
        """Set priorities from the TD errors [N], of either sign, of the slots `index` int64 [N]."""
        errors = td_error.detach().abs().double().cpu().numpy()
        priorities = (np.where(np.isfinite(errors), errors, 0.0) + _LEAST_ERROR) ** self.alpha
        self._highest = max(self._highest, float(priorities.max(initial=0.0)))
        set_priorities(self._sums, index.cpu().numpy(), priorities)

    def _add_new_entries(self, storage: EpisodeStorage) -> None:
        """Give entries written since the last batch their first priority."""
        first = max(self._num_known, storage.num_written - self.capacity)
        slots = np.arange(first, storage.num_written) % self.capacity
        is_start = storage.is_start(torch.from_numpy(slots)).numpy()
        set_priorities(self._sums, slots, np.where(is_start, self._highest, 0.0))
        self._num_known = storage.num_written

    def _draw(self, number: int) -> Any:
        return torch.rand(number, generator=self.generator, dtype=torch.float64).numpy()

    def save(self, path: Path) -> None:
        super().save(path / "uniform")
        facts = {"highest": self._highest, "num_known": self._num_known, "beta": self.beta}
        save_arrays(path / "priorities", {"priorities": self.priorities}, facts)

    def load(self, path: Path) -> None:
        """Read a folder that `save` wrote. Raises ValueError for another capacity."""
        arrays, facts = load_arrays(path / "priorities")
        like = np.dtype(np.float64), (self.capacity,)
        priorities = read_array(arrays, "priorities", like, _PRIORITY)
        read = {name: read_number(facts, name, allowed) for name, allowed in _FACTS.items()}
        super().load(path / "uniform")
        self._sums[:] = 0.0
        set_priorities(self._sums, np.arange(self.capacity), np.asarray(priorities))
        self._highest, self._num_known = float(read["highest"]), read["num_known"]
        self.beta = float(read["beta"])

    def check_storage(self, storage: EpisodeStorage) -> None:
        """Raise ValueError unless exactly the known starts have priorities above 0: sampling could
        loop forever.
        """
        known = np.arange(max(0, storage.num_written - self.capacity), self._num_known)
        slots = known % self.capacity
        is_start = storage.is_start(torch.from_numpy(slots)).numpy()
        has_priority = self._sums[self._num_leaves + slots] > 0.0
        if self._num_known > storage.num_written or (has_priority != is_start).any():
            raise ValueError("the saved priorities are not those of the saved replay")


@njit(cache=True, nogil=True)
def set_priorities(sums: Any, slots: Any, priorities: Any) -> None:
    """Set slots int64 [N] and all sums above them, in order.

    Each sum is that of its two halves: the bits depend on the priorities alone, not on their order.
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
            # Rounding may leave a little more than the sum: never enter a half that is empty.
            if left >= sums[node] and sums[node + 1] > 0.0:
                left -= sums[node]
                node += 1
        slots[n] = node - num_leaves
    return slots


def draw_uniformly(
    storage: EpisodeStorage, num_rows: int, generator: torch.Generator
) -> torch.Tensor:
    """Draw slots int64 [num_rows] that can be sampled, each with the same chance.

    Raises RuntimeError while nothing can be sampled.
    """
    require_sampleable(storage)
    if storage.num_sampleable < _LIST_BELOW * len(storage):
        slots = storage.sampleable_slots()
        return slots[draw_integers(len(slots), num_rows, generator)]
    return _draw_where(storage.is_sampleable, len(storage), num_rows, generator)


def draw_steps(storage: EpisodeStorage, num_rows: int, generator: torch.Generator) -> torch.Tensor:
    """Draw slots int64 [num_rows] that start a transition, each with the same chance.

    Raises RuntimeError while nothing can be sampled.
    """
    if storage.sequence_steps == 1:
        return draw_uniformly(storage, num_rows, generator)
    require_sampleable(storage)
    return _draw_where(storage.has_next, len(storage), num_rows, generator)


def _draw_where(
    fits: Callable[[torch.Tensor], torch.Tensor], bound: int, num: int, generator: torch.Generator
) -> torch.Tensor:
    """Draw int64 [num] from 0..bound - 1, again where `fits` is false of them."""
    index = draw_integers(bound, num, generator)
    while (rejected := ~fits(index)).any():
        index[rejected] = draw_integers(bound, int(rejected.sum()), generator)
    return index


def restore_generator(generator: torch.Generator, saved: Mapping[str, Any]) -> None:
    """Continue from the state `generator` of `saved`. Raises ValueError for an invalid state."""
    own = generator.get_state().numpy()
    state = read_array(saved, "generator", (own.dtype, own.shape))
    try:
        generator.set_state(torch.from_numpy(state.copy()))
    except RuntimeError as error:
        raise ValueError(f"generator is no random state of torch ({error})") from error


def require_sampleable(storage: EpisodeStorage) -> None:
    """Raise RuntimeError while no step of `storage` can be sampled."""
    if storage.num_sampleable == 0:
        raise RuntimeError(
            f"no transition to sample yet: the replay holds {len(storage)} entries, none of "
            "which has a next observation (or ends a sequence); append more steps first"
        )


def draw_integers(bound: int, num_draws: int, generator: torch.Generator) -> torch.Tensor:
    """Draw int64 [num_draws] uniformly from 0..bound - 1.

    From 63 random bits: the remainder favours no value by more than bound / 2^63. torch.randint
    takes 32 bits for small bounds.
    """
    draws = torch.empty(num_draws, dtype=torch.int64).random_(generator=generator)
    return draws.remainder_(bound)
