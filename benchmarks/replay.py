"""Measure the replay against TorchRL's LazyTensorStorage + RandomSampler of whole transitions.

python -m benchmarks.replay [--capacity 200000] [--repeats 5] [--threads 1]
Times are the best of the repeats, each the mean over many calls, taken in turn in one process.
"""

import argparse
import resource
import time
from collections.abc import Callable

import torch
from torchrl._utils import logger as torchrl_logger
from torchrl.data import LazyTensorStorage, TensorDictReplayBuffer
from torchrl.data.replay_buffers.samplers import RandomSampler

from marl_cair.replay.buffer import EpisodeReplayBuffer, ReplayConfig, make_replay_buffer
from marl_cair.replay.generated import GeneratedReplay
from marl_cair.replay.mixed import MixedReplay
from marl_cair.replay.rollout import Rollout
from marl_cair.replay.transition import EXPERIENCE_KEYS, NO_ACTION, TransitionSpec

SPEC = TransitionSpec((28, 10, 15), num_actions=185, num_uniform=10)
NUM_STREAMS = 256
NUM_STEPS = 16
EPISODE_STEPS = 150
BATCH_SIZES = (32, 256)
N_STEPS = (1, 3)
FRACTION = 0.2


def make_rollout(generator: torch.Generator) -> Rollout:
    """Make random steps of [NUM_STEPS, NUM_STREAMS]; episodes end by termination."""
    shape = (NUM_STEPS, NUM_STREAMS)
    boards = torch.randint(0, 256, (*shape, 18, 10, 15), dtype=torch.uint8, generator=generator)
    uniform = torch.randint(0, 256, (*shape, 10, 1, 1), dtype=torch.uint8, generator=generator)
    mask = torch.rand((*shape, SPEC.num_actions), generator=generator) < 0.5
    mask[..., 0] = True
    terminated = torch.rand(shape, generator=generator) < 1 / EPISODE_STEPS
    final_step = terminated.flatten().nonzero().flatten()
    num_ends = len(final_step)
    return Rollout(
        observation=torch.cat([boards, uniform.expand(*shape, 10, 10, 15)], dim=2),
        action_mask=mask,
        action=torch.zeros(shape, dtype=torch.int64),
        reward=torch.randn(shape, generator=generator),
        terminated=terminated,
        truncated=torch.zeros(shape, dtype=torch.bool),
        learned=torch.ones(shape, dtype=torch.bool),
        expert_action=torch.full(shape, NO_ACTION, dtype=torch.int64),
        opponent=torch.zeros(shape, dtype=torch.int16),
        final_step=final_step,
        final_observation=torch.zeros((num_ends, *SPEC.observation_shape), dtype=torch.uint8),
        final_action_mask=torch.zeros((num_ends, SPEC.num_actions), dtype=torch.bool),
    )


def fill_ours(capacity: int, n_steps: int, rollouts: list[Rollout]) -> EpisodeReplayBuffer:
    """Fill a buffer once over."""
    buffer = make_replay_buffer(ReplayConfig(capacity, n_steps=n_steps), SPEC)
    while len(buffer) < capacity:
        for rollout in rollouts:
            buffer.extend_rollout(rollout)
    return buffer


def fill_torchrl(ours: EpisodeReplayBuffer, capacity: int) -> TensorDictReplayBuffer:
    """Fill TorchRL's buffer with as many whole transitions, drawn from ours."""
    theirs = TensorDictReplayBuffer(
        storage=LazyTensorStorage(capacity), sampler=RandomSampler(), batch_size=None
    )
    while len(theirs) < capacity:
        theirs.extend(ours.sample(min(4096, capacity - len(theirs))))
    return theirs


def time_call(call: Callable[[], object], num_calls: int) -> float:
    """Mean seconds of one call."""
    start = time.perf_counter()
    for _ in range(num_calls):
        call()
    return (time.perf_counter() - start) / num_calls


def best_in_turn(
    ours: Callable[[], object], theirs: Callable[[], object], num_calls: int, repeats: int
) -> tuple[float, float]:
    """Best mean seconds of each, measured alternately so that both meet the same load."""
    times = [(time_call(ours, num_calls), time_call(theirs, num_calls)) for _ in range(repeats)]
    return min(first for first, _ in times), min(second for _, second in times)


def print_row(name: str, ours: float, theirs: float, unit: float = 1e6) -> None:
    """Print one line of the table."""
    print(f"{name:<42} {ours * unit:>10.1f} {theirs * unit:>10.1f} {ours / theirs:>8.2f}")


def measure_appending(rollouts: list[Rollout], repeats: int) -> None:
    """Compare an append with the bare copy of its observations."""
    buffer = make_replay_buffer(ReplayConfig(50_000), SPEC)
    target = torch.zeros_like(rollouts[0].observation)
    for rollout in rollouts:
        buffer.extend_rollout(rollout)
    for rollout in rollouts * 3:  # every page of the ring has been written once
        buffer.extend_rollout(rollout)
    num_steps = NUM_STEPS * NUM_STREAMS
    turn = iter(rollouts * 1000)
    ours, copy = best_in_turn(
        lambda: buffer.extend_rollout(next(turn)),
        lambda: target.copy_(next(turn).observation),
        8,
        repeats,
    )
    print_row("append, per step (against a bare copy)", ours / num_steps, copy / num_steps)


def measure_sampling(capacity: int, rollouts: list[Rollout], repeats: int) -> None:
    """Compare sampling for each batch size and n; the mixture with TorchRL's one-step batch."""
    theirs: TensorDictReplayBuffer | None = None
    for n_steps in N_STEPS:
        ours = fill_ours(capacity, n_steps, rollouts)
        if theirs is None:
            theirs = fill_torchrl(ours, capacity)
        generated = GeneratedReplay(SPEC)
        generated.extend(ours.sample(20_000).select(*EXPERIENCE_KEYS))
        mixed = MixedReplay(ours, generated, FRACTION)
        for size in BATCH_SIZES:
            num_calls = 20_000 // size
            name = f"sample({size}), n_steps={n_steps}"
            for label, buffer in ((name, ours), (f"{name}, {FRACTION:.0%} generated", mixed)):
                first, second = best_in_turn(
                    lambda buffer=buffer, size=size: buffer.sample(size),  # type: ignore[misc]
                    lambda theirs=theirs, size=size: theirs.sample(size),  # type: ignore[misc]
                    num_calls,
                    repeats,
                )
                print_row(label, first, second)


def measure_memory(num_transitions: int, rollouts: list[Rollout]) -> None:
    """Fill a large ring and print by how much the resident memory grew."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    buffer = fill_ours(num_transitions, 1, rollouts)
    grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024
    per_step = buffer.storage.nbytes_per_step
    print(f"{per_step} bytes per step; {num_transitions} steps: {grown / 1e9:.2f} GB resident")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--capacity", type=int, default=200_000)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--memory", type=int, default=0, help="only fill a ring of so many steps")
    arguments = parser.parse_args()
    torch.set_num_threads(arguments.threads)
    torchrl_logger.setLevel("WARNING")  # it would print among the rows of the table
    generator = torch.Generator().manual_seed(0)
    rollouts = [make_rollout(generator) for _ in range(4)]
    if arguments.memory:
        measure_memory(arguments.memory, rollouts)
        return
    print(f"{'microseconds':<42} {'ours':>10} {'theirs':>10} {'ratio':>8}")
    measure_appending(rollouts, arguments.repeats)
    measure_sampling(arguments.capacity, rollouts, arguments.repeats)


if __name__ == "__main__":
    main()
