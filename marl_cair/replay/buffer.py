"""Replay buffer of real transitions: a storage of episodes and a sampler."""

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from tensordict import TensorDict

from marl_cair.files import replaced_folder
from marl_cair.replay.rollout import Rollout
from marl_cair.replay.sampler import (
    PrioritizedSampler,
    Sampler,
    UniformSampler,
    draw_steps,
    draw_uniformly,
)
from marl_cair.replay.storage import EpisodeStorage
from marl_cair.replay.transition import TransitionSpec, check_tensor


@dataclass(frozen=True)
class ReplayConfig:
    """Settings of the replay buffer of real transitions."""

    capacity_transitions: int = 1_000_000  # entries of the ring: steps, and ends of episodes
    batch_size: int = 32  # transitions per sample, or learned steps of sequences
    n_steps: int = 1  # steps of a return
    gamma: float = 0.99  # discount per step
    scratch_dir: str | None = None  # folder for observations on disk; None: in memory
    priority_alpha: float = 0.0  # exponent of TD errors in sampling; 0: uniform
    priority_beta: float = 0.4  # initial exponent of the importance weights
    seed: int = 0  # of the sampler
    sequence_steps: int = 1  # learned steps of a sequence; 1: transitions
    burn_in_steps: int = 0  # of a sequence, before the learned steps
    make_sampler: Callable[[int, int], Sampler] | None = None  # of seed and capacity; None: ours


def make_replay_buffer(config: ReplayConfig, spec: TransitionSpec) -> "EpisodeReplayBuffer":
    """Make the replay buffer of real transitions of shape `spec`.

    Raises ValueError for a setting out of range.
    """
    if config.batch_size < 1:
        raise ValueError(f"batch_size is {config.batch_size}, expected 1 or more")
    if config.sequence_steps < 1 or config.batch_size % config.sequence_steps:
        raise ValueError(
            f"batch_size is {config.batch_size}, expected a multiple of sequence_steps, which is "
            f"{config.sequence_steps} and must be 1 or more"
        )
    capacity, alpha, make = config.capacity_transitions, config.priority_alpha, config.make_sampler
    storage = EpisodeStorage(
        spec,
        capacity,
        n_steps=config.n_steps,
        gamma=config.gamma,
        scratch_dir=config.scratch_dir,
        sequence_steps=config.sequence_steps,
        burn_in_steps=config.burn_in_steps,
    )
    sampler: Sampler = UniformSampler(config.seed)
    if make is not None:
        sampler = make(config.seed, capacity)
    elif alpha:
        sampler = PrioritizedSampler(config.seed, capacity, alpha, config.priority_beta)
    return EpisodeReplayBuffer(storage, sampler, config.batch_size)


class EpisodeReplayBuffer:
    """Stores rollouts and samples transitions, or sequences, from them.

    TorchRL's buffer takes single transitions and saves a pickle; this one takes rollouts, whose
    steps share their observations, and saves plain arrays.
    """

    def __init__(self, storage: EpisodeStorage, sampler: Sampler, batch_size: int) -> None:
        self.storage, self.sampler, self.batch_size = storage, sampler, batch_size

    def __len__(self) -> int:
        """Stored entries: steps, and ends of episodes."""
        return len(self.storage)

    def extend_rollout(self, rollout: Rollout) -> torch.Tensor:
        """Store the learned steps of `rollout`; return their slots. Raises as `append` does."""
        return self.storage.append(rollout)

    @property
    def num_sampleable(self) -> int:
        """How many stored steps start a transition that can be sampled now; of sequences, about how
        many learned steps they have.
        """
        return self.storage.num_sampleable * self.storage.sequence_steps

    def sample(self, batch_size: int | None = None) -> TensorDict:
        """Sample a flat TensorDict [batch_size] with the keys of replay/transition.py, or
        batch_size / sequence_steps sequences, TensorDict [N, T] (replay/sequences.py).
        Raises ValueError for other slots than int64 [N] of the sampler, IndexError for slots that
        start nothing.

        A prioritised sampler adds "priority_weight". Raises RuntimeError while nothing can be
        sampled.
        """
        num_steps = self.batch_size if batch_size is None else batch_size
        num_rows = num_steps // self.storage.sequence_steps
        slots, fields = self.sampler.sample(self.storage, num_rows)
        maker = f"replay sampler {type(self.sampler).__module__}:{type(self.sampler).__name__}"
        check_tensor(f"slots of the {maker}", slots, torch.int64, (num_rows,))
        try:
            return self._read(slots, fields)
        except IndexError as error:
            raise IndexError(f"{maker}: {error}") from error

    def sample_uniformly(self, num_rows: int) -> TensorDict:
        """Sample transitions [num_rows] or sequences [num_rows, T] as `sample`, not by priority."""
        return self._read(draw_uniformly(self.storage, num_rows, self.sampler.generator), {})

    def _read(self, index: torch.Tensor, info: Mapping[str, torch.Tensor]) -> TensorDict:
        """What starts at slots `index`, with further fields [N] of it."""
        batch = self.storage.get(index)
        for name, value in {"index": index, **info}.items():
            batch[name] = value.view(len(index), *(1,) * (batch.ndim - 1)).expand(batch.shape)
        return batch

    def sample_steps(self, num_rows: int, num_steps: int = 1) -> TensorDict:
        """Sample transitions [num_rows] of up to `num_steps` steps (1..n_steps) uniformly, also
        where `sample` gives sequences.

        Raises RuntimeError while nothing can be sampled.
        """
        draws = self.storage, num_rows, self.sampler.generator
        return self.read_steps(draw_steps(*draws), num_steps)

    def read_steps(self, index: torch.Tensor, num_steps: int = 1) -> TensorDict:
        """Read transitions of up to `num_steps` steps (1..n_steps) that start at slots `index`
        int64 [N]; slots that start none are left out.
        """
        index = index[self.storage.has_next(index)]
        return self.storage.get_transitions(index, num_steps).set("index", index)

    def update_priority(self, index: torch.Tensor, td_error: torch.Tensor, done: float) -> None:
        """Give the sampler the TD errors [N], of either sign, of slots `index` [N].

        done: share of the run, 0..1.
        """
        self.sampler.update(index, td_error)
        self.sampler.anneal(done)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the buffer to folder `path` and replace an older one.

        Arrays are streamed to .npy files: no second copy in memory, no pickle.
        """
        with replaced_folder(path) as folder:
            self.storage.save(folder / "storage")
            self.sampler.save(folder / "sampler")

    def load(self, path: str | os.PathLike[str]) -> None:
        """Read a folder that `save` wrote.

        Raises ValueError if the layout differs, or for values that no buffer can hold.
        """
        self.storage.load(Path(path) / "storage")
        self.sampler.load(Path(path) / "sampler")
        self.sampler.check_storage(self.storage)
