"""Frame rate of the whole training loop, as a ratio to a bare PyTorch loop without TorchRL.

    python -m benchmarks.training [--policy conv] [--frames 20480] [--threads 2] [--autocast]
                                   [--device cuda] [--processor-time]

Both loops play the same engine with the newest self in every seat, store every transition, and
make one update of 256 rows per 64 frames with the same network, double Q-learning, Adam and soft
target updates; only the plumbing differs. A frame is one decision of one world. Best of 5 windows,
taken in turn; the first window warms up. Generated transitions are off in both. The package's loop
runs again with `learner.autocast`, in bfloat16, if asked: CPUs without bfloat16 may be slower;
and once more with `device`. At the end the package's loops make updates alone, in turn too,
sampling included. On a busy machine take processor time and one thread.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator
from copy import deepcopy
from typing import Any

import numpy as np
import torch
from torch.nn.functional import smooth_l1_loss

import marl_cair
from benchmarks._networks import read_preset
from marl_cair.games.randomness import EpisodeSeeds
from marl_cair.policies.actor import MaskedEpsilonGreedy, PolicyActor
from marl_cair.policies.q_network import make_q_network
from marl_cair.training import run as training_run
from marl_cair.training import trainer
from marl_cair.training.collecting.metrics import Timers
from marl_cair.training.settings.config import (
    CollectorSettings,
    OpponentSettings,
    TrainConfig,
)
from marl_cair.training.settings.evaluation import CheckpointSettings, EvaluationSettings
from marl_cair.training.settings.learner import LearnerSettings
from marl_cair.training.settings.replay import ReplaySettings

Clock = Callable[[], float]  # seconds
WORLDS, STEPS, CAPACITY, MIN_TRANSITIONS = 128, 16, 100_000, 5_000
WINDOWS, UPDATES = 5, 50
BATCH, FRAMES_PER_UPDATE = 256, 64
EPSILON = 0.5
FULL, REDUCED = "marl_cair (TorchRL)", "marl_cair, autocast"


class BareLoop:
    """Collect, store and learn with torch and NumPy alone: one-step transitions, whole rows."""

    def __init__(self, policy: str) -> None:
        self.settings = LearnerSettings(
            batch_size=BATCH, frames_per_update=FRAMES_PER_UPDATE, n_steps=1
        )
        self.engine = marl_cair.make_engine("deep_line_wars", "10x15", WORLDS, reward="shaped")
        shape = self.engine.representation("planes").shape
        actions = self.engine.num_actions
        self.network = make_q_network(read_preset(policy), shape, actions, seed=0)
        self.target = deepcopy(self.network).requires_grad_(False)
        rate = self.settings.learning_rate
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=rate)
        explore = MaskedEpsilonGreedy(0, self.engine.spec.action_groups)
        self.actor = PolicyActor(self.network, "bare", "planes", explore)
        self.seeds = EpisodeSeeds(WORLDS, 0)
        self.engine.reset(self.seeds.next())
        self.rows = {
            "observation": torch.empty((CAPACITY, *shape), dtype=torch.uint8),
            "next_observation": torch.empty((CAPACITY, *shape), dtype=torch.uint8),
            "next_mask": torch.empty((CAPACITY, actions), dtype=torch.bool),
            "action": torch.empty(CAPACITY, dtype=torch.int64),
            "reward": torch.empty(CAPACITY),
            "terminated": torch.empty(CAPACITY, dtype=torch.bool),
        }
        self.written = self.frames = 0
        self.seen = torch.from_numpy(self.engine.observe("planes")).flatten(0, 1)
        self.mask = torch.from_numpy(self.engine.action_mask()).flatten(0, 1)

    def play(self, num_frames: int) -> None:
        """Collect STEPS decisions of all worlds and learn, until `num_frames` are done."""
        for _ in range(num_frames // (WORLDS * STEPS)):
            for _ in range(STEPS):
                self._collect()
            if min(self.written, CAPACITY) >= MIN_TRANSITIONS:
                for _ in range(WORLDS * STEPS // self.settings.frames_per_update):
                    self._learn()

    def _collect(self) -> None:
        engine = self.engine
        actions = self.actor.select_actions(self.seen, self.mask, EPSILON)
        engine.step(actions.numpy().reshape(WORLDS, -1))
        following = torch.from_numpy(engine.observe("planes")).flatten(0, 1)
        next_mask = torch.from_numpy(engine.action_mask()).flatten(0, 1)
        players = engine.num_players
        self._store(
            observation=self.seen,
            next_observation=following,
            next_mask=next_mask,
            action=actions,
            reward=torch.from_numpy(engine.rewards).flatten(),
            terminated=torch.from_numpy(engine.terminated).repeat_interleave(players),
        )
        ended = engine.terminated | engine.truncated
        if ended.any():
            engine.reset(self.seeds.next(ended), ended)
            following = torch.from_numpy(engine.observe("planes")).flatten(0, 1)
            next_mask = torch.from_numpy(engine.action_mask()).flatten(0, 1)
        self.seen, self.mask = following, next_mask
        self.frames += WORLDS

    def _store(self, **columns: torch.Tensor) -> None:
        count = len(columns["action"])
        slots = (self.written + torch.arange(count)) % CAPACITY
        for name, values in columns.items():
            self.rows[name][slots] = values
        self.written += count

    def _learn(self) -> None:
        settings = self.settings
        stored = min(self.written, CAPACITY)
        index = torch.randint(stored, (settings.batch_size,))
        batch = {name: values[index] for name, values in self.rows.items()}
        with torch.no_grad():
            online = self.network(batch["next_observation"])
            best = online.masked_fill(~batch["next_mask"], -torch.inf).argmax(-1, keepdim=True)
            value = self.target(batch["next_observation"]).gather(-1, best).squeeze(-1)
            goal = batch["reward"] + settings.gamma * ~batch["terminated"] * value
        chosen = self.network(batch["observation"]).gather(-1, batch["action"].unsqueeze(-1))
        loss = smooth_l1_loss(chosen.squeeze(-1), goal)
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), settings.max_grad_norm)
        self.optimizer.step()
        with torch.no_grad():
            torch._foreach_lerp_(
                list(self.target.parameters()),
                list(self.network.parameters()),
                settings.target_tau,
            )


class FullLoop:
    """The package's own loop, as `marl-cair train` runs it."""

    def __init__(
        self, policy: str, folder: str, autocast: bool = False, device: str = "cpu"
    ) -> None:
        latest = {"latest": 1.0}
        self.config = TrainConfig(
            out=folder,
            device=device,
            synthetic_fraction=0.0,
            policy=read_preset(policy),
            opponent=OpponentSettings(latest, snapshot_every_frames=10**9),
            collector=CollectorSettings(WORLDS, STEPS),
            replay=ReplaySettings(CAPACITY, min_transitions=MIN_TRANSITIONS),
            learner=LearnerSettings(
                batch_size=BATCH, frames_per_update=FRAMES_PER_UPDATE, n_steps=1, autocast=autocast
            ),
            evaluation=EvaluationSettings(every_frames=10**9, bots=()),
            checkpoint=CheckpointSettings(every_frames=10**9, include_replay=False),
        )
        self.run = training_run.TrainingRun(self.config)
        self.timers = Timers()
        self._steps: Iterator[None] = trainer.iterate(self.run, self.timers)

    def measure_updates(self, clock: Clock) -> float:
        """Updates per second, of sampled batches."""
        start = clock()
        for _ in range(UPDATES):
            self.run.learner.update(self.run.replay.sample())  # which waits for a GPU
        return UPDATES / (clock() - start)

    def play(self, num_frames: int) -> None:
        """Run whole iterations until `num_frames` more are done."""
        goal = self.run.frames + num_frames
        while self.run.frames < goal:
            next(self._steps)


def measure(loop: BareLoop | FullLoop, num_frames: int, clock: Clock) -> float:
    """Frames per second of one window."""
    start = clock()
    loop.play(num_frames)
    return num_frames / (clock() - start)


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--policy", default="conv")
    parser.add_argument("--frames", type=int, default=20_480, help="of each window")
    parser.add_argument("--threads", type=int, default=2, help="of torch")
    parser.add_argument("--autocast", action="store_true", help="measure bfloat16 too")
    parser.add_argument("--device", help="measure it too: cuda or cuda:N")
    parser.add_argument("--processor-time", action="store_true", help="seconds of all threads")
    options = parser.parse_args()
    clock = time.process_time if options.processor_time else time.perf_counter
    torch.set_num_threads(options.threads)
    folder = tempfile.mkdtemp(prefix="marl_cair_benchmark_")
    try:
        loops: dict[str, BareLoop | FullLoop] = {"bare PyTorch": BareLoop(options.policy)}
        loops[FULL] = FullLoop(options.policy, f"{folder}/run")
        if options.autocast:
            loops[REDUCED] = FullLoop(options.policy, f"{folder}/reduced", autocast=True)
        if options.device:
            name = f"marl_cair, {options.device}"
            loops[name] = FullLoop(options.policy, f"{folder}/gpu", device=options.device)
        rates: dict[str, list[float]] = {name: [] for name in loops}
        for window in range(WINDOWS + 1):
            for name, loop in loops.items():
                rate = measure(loop, options.frames, clock)
                if window:
                    rates[name].append(rate)
        report(loops, rates, options, clock)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def report(
    loops: dict[str, Any],
    rates: dict[str, list[float]],
    options: argparse.Namespace,
    clock: Clock,
) -> None:
    """Print rates, ratios and where the time goes."""
    print(
        f"{options.policy}, batch {BATCH}, 1 update per {FRAMES_PER_UPDATE} frames, "
        f"{options.threads} threads, "
        f"best of {WINDOWS} windows of {options.frames} frames"
    )
    reference = max(rates["bare PyTorch"])
    for name, values in rates.items():
        spread = f"{np.min(values):,.0f} .. {np.max(values):,.0f}"
        print(
            f"{name:24s} {max(values):8,.0f} frames/s  {max(values) / reference:6.1%}  ({spread})"
        )
    full = {name: loop for name, loop in loops.items() if isinstance(loop, FullLoop)}
    rounds = [[loop.measure_updates(clock) for loop in full.values()] for _ in range(WINDOWS)]
    for name, each in zip(full, zip(*rounds, strict=True), strict=True):
        print(f"{name:24s} {max(each):8,.1f} updates/s, sampling included ({min(each):,.1f} ..)")
    seconds = loops[FULL].timers.report(1)
    parts = {name: value for name, value in seconds.items() if name.startswith("seconds/")}
    total = sum(parts.values())
    shares = ", ".join(f"{name[8:]} {value / total:.1%}" for name, value in parts.items())
    print(f"where marl_cair's time goes: {shares}")


if __name__ == "__main__":
    main()
