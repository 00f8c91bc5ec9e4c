"""Checks that a training run fits into memory, and keeps freed memory between updates."""

from __future__ import annotations

import contextlib
import ctypes
import math
import sys
import weakref
from operator import attrgetter
from typing import Any

import torch
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

from marl_cair.checkpoint import count_weight_bytes
from marl_cair.games import GAMES
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.game import Game, Representation
from marl_cair.memory import require_memory
from marl_cair.policies.q_network import QNetwork, QNetworkConfig
from marl_cair.replay.transition import TransitionSpec
from marl_cair.training.initial_network import describe_rows, fit_policy
from marl_cair.training.settings.checks import find_device
from marl_cair.training.settings.config import TrainConfig

_ENTRY_BYTES = 40  # of a step in replay, beside its observation and mask
_OTHER_COPIES = 5  # network, target, average, two moments; gradients are counted with activations


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


def require_memory_of_run(config: TrainConfig) -> None:
    """Raise NotEnoughMemoryError or DeviceError where a run needs more than this machine has;
    nothing is begun. Raises ValueError for a network that cannot read the observation.
    """
    find_device(config.device)
    game, scenario = GAMES[config.game.name], config.game.played_scenario
    spec = game.make_spec(scenario)
    seen = spec.representations[config.game.representation]
    policy = fit_policy(config.policy, seen, spec, config.initial_agent)
    require_memory_of_games(config, game, scenario)
    rows = describe_rows(config, policy, seen, spec)
    require_memory_of_learning(config, policy, seen, rows)


def require_memory_of_games(config: TrainConfig, game: Game, scenario: Any) -> None:
    """Raise NotEnoughMemoryError for too many worlds or too long batches."""
    spec, collector = game.make_spec(scenario), config.collector
    worlds, seen = collector.num_worlds, spec.representations[config.game.representation]
    if game.has_snapshots:  # else worlds are in other processes
        one = sum(field.nbytes for field in BatchedEngine(game, scenario, 1).state_dict().values())
        require_memory(f"collector.num_worlds = {worlds}", worlds * one)
    num_legal = spec.num_actions * math.prod(spec.action_shape)
    step = 2 * _observation_bytes(seen) + 2 * num_legal + _ENTRY_BYTES
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
        ("replay.capacity_transitions", in_ring * config.fills_replay),
        ("replay.generated_capacity_transitions", whole),
        ("nfsp.capacity_rows", (rows.row_bytes + rows.mask_bytes) * config.nfsp.enabled),
        ("learner.batch_size", int(4 * whole * repeats)),
        ("nfsp.batch_size", 4 * whole),
        ("generator.batch_size", 4 * whole),
        ("generator.rows_per_refill", whole),
    ):
        count = attrgetter(name)(config)
        require_memory(f"{name} = {count}", count * num_bytes)
    size = config.learner.batch_size
    weights = count_weight_bytes(policy, seen.shape, rows.num_actions)
    require_memory(
        f"the network (policy.*) of {weights:,} bytes, in updates of learner.batch_size = {size}",
        count_update_bytes(policy, seen.shape, rows.num_actions, size),
    )


def count_update_bytes(
    policy: QNetworkConfig, shape: tuple[int, ...], num_actions: int, num_rows: int
) -> int:
    """Bytes that an update from `num_rows` observations of `shape` needs, without doing it.

    All copies of the weights, and what is alive at once while body, memory and head run forward and
    backward: planes, the votes of dynamic routing, gradients. Memory that a kernel needs while it
    computes is not counted. A body from outside that cannot run without data counts as weights.
    """
    with torch.device("meta"):  # shapes without data
        network = QNetwork(policy, shape, num_actions)
        planes = torch.empty(num_rows, *network.observation_shape)
        seen = torch.empty(num_rows, *network.body.observation_shape)
    alive = _LiveBytes()
    with alive, contextlib.suppress(Exception):
        features = network.body(seen)
        if network.memory is not None:
            features, _ = network.memory(features, seen.new_empty(num_rows, network.state_size))
        network.read_values(planes, features).sum().backward()  # type: ignore[no-untyped-call]
    weights = sum(weight.nbytes for weight in network.parameters())
    return _OTHER_COPIES * weights + max(alive.peak, weights)


class _LiveBytes(TorchDispatchMode):  # type: ignore[no-untyped-call]  # torch gives no types
    """Counts bytes of all tensors that are made while it is active.

    Attributes:
        peak: the most that were alive at once.
    """

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]  # torch gives no types
        self.peak = self._alive = 0
        self._known = weakref.WeakSet[torch.UntypedStorage]()

    def __torch_dispatch__(
        self, function: Any, types: Any, args: Any = (), kwargs: Any = None
    ) -> Any:
        result = function(*args, **(kwargs or {}))
        for item in tree_leaves(result):
            if isinstance(item, torch.Tensor):
                self._count(item.untyped_storage())
        return result

    def _count(self, storage: torch.UntypedStorage) -> None:
        if storage not in self._known:  # views share one
            self._known.add(storage)
            self._change(storage.nbytes())
            weakref.finalize(storage, self._change, -storage.nbytes())

    def _change(self, num_bytes: int) -> None:
        self._alive += num_bytes
        self.peak = max(self.peak, self._alive)


def _observation_bytes(seen: Representation) -> int:
    return math.prod(seen.shape) * int(seen.dtype().itemsize)
