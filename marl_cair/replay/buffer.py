"""`make_replay_buffer`: TorchRL's replay buffer over an EpisodeStorage, fed with rollouts."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from tensordict import TensorDict
from torchrl.data import TensorDictReplayBuffer
from torchrl.data.replay_buffers.writers import Writer

from marl_cair.files import replaced_folder
from marl_cair.replay.prioritized import PrioritizedSampler
from marl_cair.replay.rollout import Rollout
from marl_cair.replay.sampler import UniformSampler
from marl_cair.replay.storage import EpisodeStorage
from marl_cair.replay.transition import TransitionSpec


@dataclass(frozen=True)
class ReplayConfig:
    """Settings of the replay of real transitions."""

    capacity_transitions: int = 1_000_000  # entries of the ring: steps, and ends of episodes
    batch_size: int = 32  # transitions per sample
    n_steps: int = 1  # steps of a return
    gamma: float = 0.99  # discount per step
    scratch_dir: str | None = None  # folder for observations on disk; None: in memory
    keep_scratch_files: bool = False
    priority_alpha: float = 0.0  # how far TD errors decide what is drawn; 0: all alike
    priority_beta: float = 0.4  # how far weights undo that to begin with
    seed: int = 0  # of the sampler


def make_replay_buffer(
    config: ReplayConfig, spec: TransitionSpec, sampler: UniformSampler | None = None
) -> "EpisodeReplayBuffer":
    """Make the replay of real transitions of shape `spec`.

    sampler: None makes the one that `config` asks for.
    Raises ValueError for a setting out of range.
    """
    if config.batch_size < 1:
        raise ValueError(f"batch_size is {config.batch_size}, expected 1 or more")
    storage = EpisodeStorage(
        spec,
        config.capacity_transitions,
        n_steps=config.n_steps,
        gamma=config.gamma,
        scratch_dir=config.scratch_dir,
        keep_files=config.keep_scratch_files,
    )
    if sampler is None:
        sampler = _make_sampler(config)
    return EpisodeReplayBuffer(storage, sampler, config.batch_size)


def _make_sampler(config: ReplayConfig) -> UniformSampler:
    if not config.priority_alpha:
        return UniformSampler(config.seed)
    alpha, beta = config.priority_alpha, config.priority_beta
    return PrioritizedSampler(config.seed, config.capacity_transitions, alpha, beta)


class EpisodeReplayBuffer(TensorDictReplayBuffer):
    """TorchRL replay buffer that takes rollouts and is saved as plain data.

    `sample(n)` returns a flat TensorDict [n] with the keys of replay/transition.py. TorchRL's own
    saving is replaced, as it writes a pickle.
    """

    def __init__(self, storage: EpisodeStorage, sampler: UniformSampler, batch_size: int) -> None:
        super().__init__(
            storage=storage,
            sampler=sampler,
            writer=RolloutWriter(),
            collate_fn=_keep,
            batch_size=batch_size,
        )

    def extend_rollout(self, rollout: Rollout) -> torch.Tensor:
        """Store the learned steps of `rollout`; return their slots. Raises as `append` does."""
        index: torch.Tensor = self._extend(rollout)
        return index

    def close_streams(self) -> None:
        """Let no later step follow on those stored: call it when worlds restart without an end."""
        with self._replay_lock, self._write_lock:
            self._storage.close_streams()

    @property
    def num_sampleable(self) -> int:
        """How many stored steps start a transition that can be sampled now."""
        return int(self._storage.num_sampleable)

    def sample(
        self,
        batch_size: int | None = None,
        return_info: bool = False,
        include_info: bool | None = None,
    ) -> Any:
        """Return a TensorDict of `batch_size` (default: as made) transitions; see `get` of storage.

        Another size than the default is no mistake here, as a mixture asks for its real part.
        Raises RuntimeError while nothing can be sampled.
        """
        data, info = self._sample(self.batch_size if batch_size is None else batch_size)
        data.update(info)  # "index", and "priority_weight" where not all are drawn alike
        return (data, info) if return_info else data

    def sample_steps(self, num_rows: int, num_steps: int = 1) -> TensorDict:
        """Transitions [num_rows] of up to `num_steps` steps (1..n_steps), drawn evenly whatever the
        priorities are.

        Raises RuntimeError while nothing can be sampled.
        """
        with self._replay_lock:
            index = self._sampler.sample_evenly(self._storage, num_rows)
            return self.read_steps(index, num_steps)

    def read_steps(self, index: torch.Tensor, num_steps: int = 1) -> TensorDict:
        """Transitions of up to `num_steps` steps (1..n_steps) that start at slots `index` int64
        [N]; those that cannot be sampled are left out.
        """
        index = index[self._storage.is_sampleable(index)]
        data: TensorDict = self._storage.get_steps(index, num_steps)
        data["index"] = index.clone()
        return data

    def update_priority(self, index: torch.Tensor, priority: torch.Tensor) -> None:
        """Take note of the TD errors `priority` [N] of the slots `index` [N], if they count."""
        with self._replay_lock:
            if isinstance(self._sampler, PrioritizedSampler):
                self._sampler.update_priority(index, priority)

    def anneal(self, done: float) -> None:
        """Tell a prioritised sampler which share of the run is over, 0..1."""
        if isinstance(self._sampler, PrioritizedSampler):
            self._sampler.anneal(done)

    def add(self, data: Any) -> int:
        """Refuse: see `extend_rollout`."""
        raise TypeError(_REFUSAL)

    def extend(
        self, tensordicts: TensorDict, *, update_priority: bool | None = None
    ) -> torch.Tensor:
        """Refuse: see `extend_rollout`."""
        raise TypeError(_REFUSAL)

    def state_dict(self) -> dict[str, Any]:
        """Return all that the next append and sample depend on, as tensors and plain data."""
        with self._replay_lock:
            return {"storage": self._storage.state_dict(), "sampler": self._sampler.state_dict()}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Go on where the saved buffer stood. Raises ValueError where the layout differs, or for
        what no buffer can hold.
        """
        with self._replay_lock, self._write_lock:
            self._storage.load_state_dict(state_dict["storage"])
            self._sampler.load_state_dict(state_dict["sampler"])
            self._sampler.check_storage(self._storage)

    def dumps(self, path: str | os.PathLike[str]) -> None:
        """Write the buffer to folder `path`, in place of one that is there; also `save`.

        Arrays are streamed to .npy files: no second copy in memory, no pickle.
        """
        with self._replay_lock, replaced_folder(path) as folder:
            self._storage.dumps(folder / "storage")
            self._sampler.dumps(folder / "sampler")

    def loads(self, path: str | os.PathLike[str]) -> None:
        """Read what `dumps` wrote; also `load`. Raises as `load_state_dict`."""
        with self._replay_lock, self._write_lock:
            self._storage.loads(Path(path) / "storage")
            self._sampler.loads(Path(path) / "sampler")
            self._sampler.check_storage(self._storage)


_REFUSAL = "EpisodeReplayBuffer stores steps in linked streams: call extend_rollout(rollout)"


class RolloutWriter(Writer):
    """Hands rollouts to the storage, which holds the write position itself."""

    def extend(self, data: Rollout) -> torch.Tensor:
        """Append a rollout; return the slots written."""
        slots: torch.Tensor = self._storage.append(data)
        return slots

    def add(self, data: Any) -> int:
        """Refuse: see `EpisodeReplayBuffer.extend_rollout`."""
        raise TypeError(_REFUSAL)

    @property
    def _write_count(self) -> int:
        return int(self._storage.num_written)

    def _empty(self, empty_write_count: bool = True) -> None:
        """Nothing to reset: the storage empties itself."""

    def state_dict(self) -> dict[str, Any]:
        """Return nothing: the storage saves the write position."""
        return {}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Do nothing, as `state_dict`."""

    def dumps(self, path: str | os.PathLike[str]) -> None:
        """Do nothing, as `state_dict`."""

    def loads(self, path: str | os.PathLike[str]) -> None:
        """Do nothing, as `state_dict`."""


def _keep(data: TensorDict) -> TensorDict:
    return data
