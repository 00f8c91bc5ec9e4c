"""Replay buffer of real transitions: a storage of episodes and a sampler."""

import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from tensordict import TensorDict

from marl_cair.files import replaced_folder
from marl_cair.replay.prioritized import PrioritizedSampler
from marl_cair.replay.rollout import Rollout
from marl_cair.replay.sampler import UniformSampler
from marl_cair.replay.storage import EpisodeStorage
from marl_cair.replay.transition import TransitionSpec


@dataclass(frozen=True)
class ReplayConfig:
    """Settings of the replay buffer of real transitions."""

    capacity_transitions: int = 1_000_000  # entries of the ring: steps, and ends of episodes
    batch_size: int = 32  # transitions per sample
    n_steps: int = 1  # steps of a return
    gamma: float = 0.99  # discount per step
    scratch_dir: str | None = None  # folder for observations on disk; None: in memory
    keep_scratch_files: bool = False
    priority_alpha: float = 0.0  # exponent of TD errors in sampling; 0: uniform
    priority_beta: float = 0.4  # initial exponent of the importance weights
    seed: int = 0  # of the sampler


def make_replay_buffer(
    config: ReplayConfig, spec: TransitionSpec, sampler: UniformSampler | None = None
) -> "EpisodeReplayBuffer":
    """Make the replay buffer of real transitions of shape `spec`.

    sampler: default: by `config`.
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


class EpisodeReplayBuffer:
    """Stores rollouts and samples transitions of them.

    TorchRL's buffer takes single transitions and saves a pickle; this one takes rollouts, whose
    steps share their observations, and saves plain arrays.
    """

    def __init__(self, storage: EpisodeStorage, sampler: UniformSampler, batch_size: int) -> None:
        self.storage, self.sampler, self.batch_size = storage, sampler, batch_size

    def __len__(self) -> int:
        """Stored entries: steps, and ends of episodes."""
        return len(self.storage)

    def extend_rollout(self, rollout: Rollout) -> torch.Tensor:
        """Store the learned steps of `rollout`; return their slots. Raises as `append` does."""
        return self.storage.append(rollout)

    def close_streams(self) -> None:
        """Let no later step follow the stored ones: for worlds that restart without an end."""
        self.storage.close_streams()

    @property
    def num_sampleable(self) -> int:
        """How many stored steps start a transition that can be sampled now."""
        return self.storage.num_sampleable

    def sample(self, batch_size: int | None = None) -> TensorDict:
        """Sample a flat TensorDict [batch_size] with the keys of replay/transition.py.

        A prioritised sampler adds "priority_weight". Raises RuntimeError while no transition can be
        sampled.
        """
        num_rows = self.batch_size if batch_size is None else batch_size
        index, info = self.sampler.sample(self.storage, num_rows)
        return self.storage.get(index).update({"index": index, **info})

    def sample_steps(self, num_rows: int, num_steps: int = 1) -> TensorDict:
        """Sample transitions [num_rows] of up to `num_steps` steps (1..n_steps) uniformly.

        Raises RuntimeError while no transition can be sampled.
        """
        return self.read_steps(self.sampler.sample_evenly(self.storage, num_rows), num_steps)

    def read_steps(self, index: torch.Tensor, num_steps: int = 1) -> TensorDict:
        """Read transitions of up to `num_steps` steps (1..n_steps) that start at slots `index`
        int64 [N]; slots that cannot be sampled are left out.
        """
        index = index[self.storage.is_sampleable(index)]
        data = self.storage.get_steps(index, num_steps)
        data["index"] = index.clone()
        return data

    def update_priority(self, index: torch.Tensor, td_error: torch.Tensor) -> None:
        """Update the priorities of slots `index` [N] of a prioritised sampler."""
        if isinstance(self.sampler, PrioritizedSampler):
            self.sampler.update_priority(index, td_error)

    def anneal(self, done: float) -> None:
        """Anneal the importance weights of a prioritised sampler; done: share of the run, 0..1."""
        if isinstance(self.sampler, PrioritizedSampler):
            self.sampler.anneal(done)

    def state_dict(self) -> dict[str, Any]:
        """Return all that the next append and sample depend on, as tensors and plain data."""
        return {"storage": self.storage.state_dict(), "sampler": self.sampler.state_dict()}

    def load_state_dict(self, state_dict: Mapping[str, Any]) -> None:
        """Continue from a saved state.

        Raises ValueError where the layout differs, or for values that no buffer can hold.
        """
        self.storage.load_state_dict(state_dict["storage"])
        self.sampler.load_state_dict(state_dict["sampler"])
        self.sampler.check_storage(self.storage)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the buffer to folder `path` and replace an older one.

        Arrays are streamed to .npy files: no second copy in memory, no pickle.
        """
        with replaced_folder(path) as folder:
            self.storage.dumps(folder / "storage")
            self.sampler.dumps(folder / "sampler")

    def load(self, path: str | os.PathLike[str]) -> None:
        """Read a folder that `save` wrote. Raises as `load_state_dict`."""
        self.storage.loads(Path(path) / "storage")
        self.sampler.loads(Path(path) / "sampler")
        self.sampler.check_storage(self.storage)
