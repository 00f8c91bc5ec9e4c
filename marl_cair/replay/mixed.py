"""Batches that mix an exact share of generated rows into real ones.

TorchRL's ReplayBufferEnsemble draws each row's buffer by chance; here a batch is at most one row
off. Its buffers would write ring slots into "index", where generated rows hold NO_INDEX.
"""

import os
from pathlib import Path

import torch
from tensordict import TensorDict

from marl_cair.files import replaced_folder
from marl_cair.replay import transition
from marl_cair.replay.buffer import EpisodeReplayBuffer
from marl_cair.replay.generated import GeneratedReplay
from marl_cair.replay.sequences import find_sequence_errors


class MixedReplay:
    """Real and generated rows, transitions or sequences both, mixed in exact shares.

    A batch of n rows holds n * fraction generated ones, rounded up or down by chance, so that the
    share is exact in the mean: at 20 % of 32 rows 6 or 7. While `generated_open` is false (the
    generator has not passed its gate), or no transition was generated yet, batches are all real;
    with a fraction of 1 there are none then (`can_sample`).

    weight: of generated rows in the loss, 0..1; real ones have 1.
    """

    def __init__(
        self,
        real: EpisodeReplayBuffer,
        generated: GeneratedReplay,
        fraction: float = 0.2,
        weight: float = 1.0,
        *,
        generated_open: bool = True,
    ) -> None:
        if not 0.0 <= fraction <= 1.0:
            raise ValueError(f"fraction is {fraction}, expected 0..1")
        self.real = real
        self.generated = generated
        self.fraction, self.weight = fraction, weight
        self.generated_open = generated_open

    def sample(self, batch_size: int | None = None) -> TensorDict:
        """Return TensorDict [batch_size] with the transition keys: real rows, then generated ones;
        or batch_size / sequence_steps sequences (`EpisodeReplayBuffer.sample`).

        With `replay.priority_alpha` or a weight below 1 also "priority_weight" float32 of the same
        shape.
        Raises RuntimeError while no transition can be sampled (`can_sample`).
        """
        num_steps = self.real.batch_size if batch_size is None else batch_size
        each = self.real.storage.sequence_steps
        num_rows = num_steps // each
        num_generated = self._count_generated(num_rows * self.fraction)
        if not self.can_sample:
            raise RuntimeError("all rows are to be generated, and there are none yet")
        if num_generated == num_rows:
            return self.generated.sample(num_rows)
        batch: TensorDict = self.real.sample((num_rows - num_generated) * each)
        if not num_generated:
            return batch
        weights = batch.pop("priority_weight", None)
        if weights is None and self.weight < 1.0:
            weights = torch.ones(batch.shape)
        made = self.generated.sample(num_generated)
        batch = _join_rows(batch, made)
        if weights is not None:  # generated rows keep their share of the loss
            mean = (self.weight * weights.mean()).expand(made.shape)
            batch["priority_weight"] = torch.cat([weights, mean])
        return batch

    @property
    def can_sample(self) -> bool:
        """Whether batches can be made; it is false only while all rows are to be generated and
        there are none.
        """
        return self.fraction < 1.0 or self._has_generated

    def sample_generated(self, num_real: int) -> TensorDict | None:
        """Generated transitions that make their share of a batch with `num_real` real ones; None
        while there are none.
        """
        count = self._count_generated(num_real * self.fraction / (1.0 - self.fraction))
        return self.generated.sample(count) if count else None

    def _count_generated(self, wanted: float) -> int:
        return self.generated.round_by_chance(wanted) if self._has_generated else 0

    @property
    def _has_generated(self) -> bool:
        return self.generated_open and len(self.generated) > 0

    def note_errors(self, batch: TensorDict, done: float) -> None:
        """Set the priorities of a batch's real rows from their TD errors.

        batch: from `sample`, with "td_error" [batch_size], or [N, T] of sequences; done: share of
        the run, 0..1.
        """
        index, errors = batch["index"], batch["td_error"]
        if batch.ndim == 2:
            index, errors = index[:, 0], find_sequence_errors(errors, batch["learned"])
        real = index != transition.NO_INDEX
        self.real.update_priority(index[real], errors[real], done)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write both rings to folder `path` and replace an older one; no pickle."""
        with replaced_folder(path) as folder:
            self.real.save(folder / "real")
            self.generated.save(folder / "generated")

    def load(self, path: str | os.PathLike[str]) -> None:
        """Read a folder that `save` wrote. Raises ValueError if a layout differs."""
        self.real.load(Path(path) / "real")
        self.generated.load(Path(path) / "generated")


def _join_rows(real: TensorDict, generated: TensorDict) -> TensorDict:
    """Concatenate field by field: in a third of the time of torch.cat on the TensorDicts."""
    joined = {
        key: _join_rows(value, generated[key])
        if isinstance(value, TensorDict)
        else torch.cat([value, generated[key]])
        for key, value in real.items()
    }
    return TensorDict(joined, [len(real) + len(generated), *real.shape[1:]])
