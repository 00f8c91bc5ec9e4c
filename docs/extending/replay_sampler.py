"""A replay sampler: newer transitions are learned from more often.

No change of marl_cair is needed. With this file in the current folder:

    marl-cair train replay.sampler=replay_sampler:NewerFirst
"""

import torch

from marl_cair.replay.sampler import Sampler, draw_uniformly


class NewerFirst(Sampler):
    """Of two transitions, or sequences, that are drawn uniformly the newer one is learned from."""

    def sample(self, storage, batch_size):
        """Slots int64 [batch_size], and no further fields of the batch."""
        first, second = (draw_uniformly(storage, batch_size, self.generator) for _ in range(2))
        return torch.where(
            self._age(storage, first) < self._age(storage, second), first, second
        ), {}

    def _age(self, storage, slots):
        """Entries that were written after those at `slots`."""
        return (storage.num_written - 1 - slots) % len(storage)
