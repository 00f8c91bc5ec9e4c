"""Checks that a training run fits into memory, and keeps freed memory between updates."""

from __future__ import annotations

import ctypes
import math
import sys
from operator import attrgetter
from typing import Any

from marl_cair.checkpoint import count_weight_bytes
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.game import Game, Representation
from marl_cair.memory import require_memory
from marl_cair.policies.q_network import QNetworkConfig
from marl_cair.replay.transition import TransitionSpec
from marl_cair.training.settings.config import TrainConfig

_ENTRY_BYTES = 40  # of a step in replay, beside its observation and mask
_NETWORK_COPIES = 6  # network, target, average, gradients, two moments


def keep_freed_memory() -> None:
    """Let glibc keep the memory of activations: returning and requesting pages costs a fifth of an
    update.
    """
    if sys.platform != "linux":
        return
    libc = ctypes.CDLL(None)
    if hasattr(libc, "mallopt"):
        trim_threshold, mmap_threshold = -1, -3
        libc.mallopt(mmap_threshold, 32 << 20)
        libc.mallopt(trim_threshold, 1 << 30)


def require_memory_of_games(config: TrainConfig, game: Game, scenario: Any) -> None:
    """Raise NotEnoughMemoryError for too many worlds or too long batches."""
    spec, collector = game.make_spec(scenario), config.collector
    worlds, seen = collector.num_worlds, spec.representations[config.game.representation]
    one = sum(field.nbytes for field in BatchedEngine(game, scenario, 1).state_dict().values())
    require_memory(f"collector.num_worlds = {worlds}", worlds * one)
    step = 2 * _observation_bytes(seen) + 2 * spec.num_actions + _ENTRY_BYTES
    steps = worlds * collector.steps_per_batch
    name = f"collector.num_worlds * steps_per_batch = {steps}"
    require_memory(name, steps * spec.num_players * step)


def require_memory_of_learning(
    config: TrainConfig, policy: QNetworkConfig, seen: Representation, rows: TransitionSpec
) -> None:
    """Raise NotEnoughMemoryError for too large replay buffers, batches or networks."""
    in_ring = rows.mask_bytes + _ENTRY_BYTES
    in_ring += rows.row_bytes if config.replay.scratch_dir is None else 0
    replay = config.replay
    repeats = 1.0  # times that a batch holds each learned step
    if rows.state_size:
        starts = replay.sequence_steps - replay.burn_in_steps  # entries for each, at least
        in_ring += -(-4 * rows.state_size // starts)
        repeats += (replay.burn_in_steps + 1) / replay.sequence_steps
    whole = 2 * (_observation_bytes(seen) + rows.num_actions) + _ENTRY_BYTES
    for name, num_bytes in (
        ("replay.capacity_transitions", in_ring),
        ("replay.generated_capacity_transitions", whole),
        ("nfsp.capacity_rows", rows.row_bytes + rows.mask_bytes),
        ("learner.batch_size", int(4 * whole * repeats)),
        ("nfsp.batch_size", 4 * whole),
        ("generator.batch_size", 4 * whole),
        ("generator.rows_per_refill", whole),
    ):
        count = attrgetter(name)(config)
        require_memory(f"{name} = {count}", count * num_bytes)
    weights = count_weight_bytes(policy, seen.shape, rows.num_actions)
    require_memory(f"the network (policy.*) of {weights:,} bytes", _NETWORK_COPIES * weights)


def _observation_bytes(seen: Representation) -> int:
    return math.prod(seen.shape) * int(seen.dtype().itemsize)
