"""`UniformSampler`: samples every step that starts a transition with the same probability."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from marl_cair.ranges import read_array
from marl_cair.replay.array_folder import load_arrays, save_arrays
from marl_cair.replay.storage import EpisodeStorage

_LIST_BELOW = 0.5  # share of sampleable entries below which listing them beats rejecting


class UniformSampler:
    """Draws slots of an EpisodeStorage with replacement, from its own seeded generator.

    Entries that cannot be sampled are drawn again, or left out where they are many. TorchRL's
    RandomSampler cannot leave entries out, and does not save its generator.
    """

    def __init__(self, seed: int) -> None:
        self._generator = torch.Generator().manual_seed(seed)

    def sample(
        self, storage: EpisodeStorage, batch_size: int
    ) -> tuple[torch.Tensor, dict[str, Any]]:
        """Return `batch_size` slots, int64, and no further information.

        Raises RuntimeError while nothing can be sampled.
        """
        return self.sample_evenly(storage, batch_size), {}

    def sample_evenly(self, storage: EpisodeStorage, num_rows: int) -> torch.Tensor:
        """Return `num_rows` slots, int64, also where the sampler has priorities.

        Raises RuntimeError while nothing can be sampled.
        """
        num_sampleable = require_sampleable(storage)
        if num_sampleable < _LIST_BELOW * len(storage):
            slots = storage.sampleable_slots()
            return slots[draw_integers(num_sampleable, num_rows, self._generator)]
        index = draw_integers(len(storage), num_rows, self._generator)
        rejected = ~storage.is_sampleable(index)
        while rejected.any():
            again = draw_integers(len(storage), int(rejected.sum()), self._generator)
            index[rejected] = again
            rejected = ~storage.is_sampleable(index)
        return index

    def check_storage(self, storage: EpisodeStorage) -> None:
        """Check a loaded state against the storage; uniform sampling depends on none."""

    def state_dict(self) -> dict[str, Any]:
        """Return the state of the generator."""
        return {"generator": self._generator.get_state()}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Continue from a saved state."""
        restore_generator(self._generator, state_dict)

    def dumps(self, path: str | os.PathLike[str]) -> None:
        """Write the state to a new folder."""
        save_arrays(Path(path), {"generator": self._generator.get_state().numpy()}, {})

    def loads(self, path: str | os.PathLike[str]) -> None:
        """Read what `dumps` wrote."""
        arrays, _ = load_arrays(Path(path))
        restore_generator(self._generator, arrays)


def restore_generator(generator: torch.Generator, saved: Mapping[str, Any]) -> None:
    """Continue from the state `generator` of `saved`. Raises ValueError for what is no state."""
    own = generator.get_state().numpy()
    state = read_array(saved, "generator", (own.dtype, own.shape))
    try:
        generator.set_state(torch.from_numpy(state.copy()))
    except RuntimeError as error:
        raise ValueError(f"generator is no random state of torch ({error})") from error


def require_sampleable(storage: EpisodeStorage) -> int:
    """How many steps of `storage` can be sampled; raises RuntimeError where none can."""
    num_sampleable = storage.num_sampleable
    if num_sampleable == 0:
        raise RuntimeError(
            f"no transition to sample yet: the replay holds {len(storage)} entries, none of "
            "which has a next observation; append more steps first"
        )
    return num_sampleable


def draw_integers(bound: int, num_draws: int, generator: torch.Generator) -> torch.Tensor:
    """Draw int64 [num_draws] uniformly from 0..bound - 1.

    From 63 random bits, so that the remainder favours no value by more than bound / 2^63, where
    torch.randint takes 32 bits for small bounds.
    """
    draws = torch.empty(num_draws, dtype=torch.int64).random_(generator=generator)
    return draws.remainder_(bound)
