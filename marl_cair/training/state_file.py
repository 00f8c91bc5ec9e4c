"""The file of a resumable state: a version, and arrays as tensors, which load as data only."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch

from marl_cair.checkpoint import CheckpointError, load_tensors, save_tensors
from marl_cair.files import require_free_space
from marl_cair.replay.buffer import EpisodeReplayBuffer
from marl_cair.replay.transition import TransitionSpec
from marl_cair.training.settings.config import TrainConfig

STATE_FILE = "state.pt"
_SPARE_BYTES = 64 << 20  # logs, agents, pictures
STATE_VERSION = 6  # of the contents that `TrainingRun.save_state` writes; raise it on a change


def save_state(state: dict[str, Any], folder: Path) -> None:
    """Write tensors and plain data to `folder`."""
    save_tensors({"version": STATE_VERSION, **state}, folder / STATE_FILE)


def load_state(folder: Path) -> dict[str, Any]:
    """Read what `save_state` wrote.

    Raises:
        CheckpointError: it cannot be read, or another version of marl_cair wrote it.
    """
    state = dict(load_tensors(folder / STATE_FILE))
    version = state.get("version", 0)  # 0: before states had versions
    if version != STATE_VERSION:
        raise CheckpointError(
            f"{folder / STATE_FILE} has version {version}, this marl_cair resumes {STATE_VERSION}: "
            "resume with the marl_cair that wrote it, or begin a new run as its agent with "
            f"initial_agent={folder.parent / 'latest'}"
        )
    return state


def require_space(
    folder: Path,
    config: TrainConfig,
    real: EpisodeReplayBuffer,
    spec: TransitionSpec,
    has_state: bool,
) -> None:
    """Raise NotEnoughSpaceError without room on disk; has_state: the run resumes one there."""
    state = 0
    if config.checkpoint.include_replay and config.fills_replay:
        state += real.storage.nbytes_per_step * config.replay.capacity_transitions
    if config.nfsp.enabled:
        state += config.nfsp.capacity_rows * (spec.row_bytes + spec.mask_bytes + 4)
    copies = 1 if has_state else 2  # a new one is written beside the old
    require_free_space(folder, _SPARE_BYTES + copies * state)


def to_tensors(value: Any) -> Any:
    """Arrays within nested dictionaries become tensors."""
    if isinstance(value, dict):
        return {name: to_tensors(item) for name, item in value.items()}
    return torch.from_numpy(value) if isinstance(value, np.ndarray) else value


def to_arrays(value: Any) -> Any:
    """Undo `to_tensors`."""
    if isinstance(value, dict):
        return {name: to_arrays(item) for name, item in value.items()}
    return value.numpy() if isinstance(value, torch.Tensor) else value
