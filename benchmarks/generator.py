"""What generated rows cost: beside what learning from rows costs, in the loop, and in arithmetic.

    python -m benchmarks.generator [--rows 1000] [--repeats 5] [--frames 25000] [--device cuda]

On Deep Line Wars 10x15 with one torch thread: an update of the learner (conv, 128 rows), an update
of the generator (32 rows), and predicting rows: next state, mask, reward, end and surety. Processor
time (with --device cuda: time), the best of `--repeats`, as a Markdown table.

Then the generator's share of the loop's time while a fifth of each batch is generated, over
`--frames` steps with an open gate; and the arithmetic of a predicted row (convolutions and matrix
products) beside what a matrix product reaches here.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import cast

import torch
from torch.utils.flop_counter import FlopCounterMode

from benchmarks._timing import best_seconds
from marl_cair.generative.generator import CHUNK_ROWS, CCDNGenerator
from marl_cair.generative.settings import GateConfig, GeneratorConfig
from marl_cair.training.collecting.metrics import Timers
from marl_cair.training.run import TrainingRun
from marl_cair.training.settings.config import (
    GameSettings,
    GeneratorSettings,
    TrainConfig,
)
from marl_cair.training.settings.evaluation import EvaluationSettings
from marl_cair.training.settings.learner import LearnerSettings
from marl_cair.training.trainer import iterate

COLLECTED = 4_096  # decisions
LEARNER_ROWS, GENERATOR_ROWS = 128, 32
SIDE = 1_024  # of the matrices that show what the machine reaches
OPEN = GateConfig(
    min_changed_f1=0.0,
    min_change_explained=-math.inf,
    min_reward_explained=-math.inf,
    max_constant_reward_error=math.inf,
    min_terminal_auc=0.0,
    max_terminal_overlooked=1.0,
    max_terminal_ece=1.0,
    max_rare_missed=1.0,
    min_mask_accuracy=0.0,
    min_scalar_gain=-1.0,
)


def collect(folder: Path, device: str = "cpu") -> TrainingRun:
    """A run with some thousand decisions in its replay, and an open gate."""
    run = TrainingRun(
        TrainConfig(
            out=str(folder),
            device=device,
            game=GameSettings(scenario="10x15"),
            learner=LearnerSettings(batch_size=LEARNER_ROWS),
            generator=GeneratorSettings(model=GeneratorConfig(gate=OPEN)),
            evaluation=EvaluationSettings(bots=()),
        )
    )
    run_until(run, COLLECTED)
    report = cast(CCDNGenerator, run.generator).evaluate()
    run.gate_is_open = run.replay.generated_open = report.passed
    return run


def run_until(run: TrainingRun, frames: int) -> dict[str, float]:
    """Train up to `frames`; returns the seconds of each part of the loop."""
    timers = Timers()
    rounds = iterate(run, timers)
    while run.frames < frames:
        next(rounds)
    return timers.report(0)


def measure(run: TrainingRun, num_rows: int, repeats: int) -> list[tuple[str, float]]:
    """Names and seconds."""
    generator = run.generator
    if not isinstance(generator, CCDNGenerator):
        raise TypeError(f"the run's generator is {generator!r}, expected a CCDNGenerator")
    rows = run.replay.real.sample_steps(num_rows)
    random = torch.Generator().manual_seed(0)
    batch, one_step = run.replay.sample(), run.replay.real.sample_steps(GENERATOR_ROWS)

    def learn() -> None:
        run.learner.update(batch.clone(), 0.5)

    works: dict[str, Callable[[], object]] = {
        f"the learner's update, {LEARNER_ROWS} rows": learn,
        f"the generator's update, {GENERATOR_ROWS} rows": lambda: generator.update(one_step),
        f"predicting {num_rows:,} rows": lambda: generator.imagine(rows, random),
    }
    for work in works.values():  # once to warm up
        work()
    # Each work ends with numbers on the CPU, so nothing of it is left on a GPU.
    clock = time.process_time if run.device.type == "cpu" else time.perf_counter
    return [(name, best_seconds(work, repeats, clock)) for name, work in works.items()]


def count_arithmetic(run: TrainingRun) -> tuple[float, float]:
    """Floating-point operations of a predicted row, and those of a matrix product in a second."""
    rows = run.replay.real.sample_steps(CHUNK_ROWS)
    with FlopCounterMode(display=False) as counter:
        cast(CCDNGenerator, run.generator).imagine(rows)
    matrix = torch.rand(SIDE, SIDE, device=run.device)
    seconds = best_seconds(lambda: float((matrix @ matrix)[0, 0]), 5)
    return counter.get_total_flops() / len(rows), 2.0 * SIDE**3 / seconds


def make_table(measured: list[tuple[str, float]]) -> str:
    """Seconds, and how many updates of the learner that is."""
    reference = measured[0][1]
    lines = ["| work | ms | updates of the learner |", "|---|---|---|"]
    for name, seconds in measured:
        lines.append(f"| {name} | {1_000 * seconds:.1f} | {seconds / reference:.2f} |")
    return "\n".join(lines)


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rows", type=int, default=1_000)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--frames", type=int, default=25_000)
    parser.add_argument("--device", default="cpu")
    words = parser.parse_args()
    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        run = collect(Path(folder) / "run", words.device)
        measured = measure(run, words.rows, words.repeats)
        print(make_table(measured))
        seconds = run_until(run, COLLECTED + words.frames)
        share = 100.0 * seconds["seconds/generate"] / (sum(seconds.values()) or math.nan)
        needed, reached = count_arithmetic(run)
        print("\n| number | value |\n|---|---|")
        print(f"| predicted rows/s | {words.rows / measured[-1][1]:,.0f} |")
        print(f"| the generator's share of the loop | {share:.0f} % |")
        print(f"| arithmetic of a predicted row | {needed / 1e6:.2f} MFLOP |")
        print(f"| a product of matrices | {reached / 1e9:.0f} GFLOP/s |")
        print(f"| so predicted rows/s at most | {reached / needed:,.0f} |")
        run.close()


if __name__ == "__main__":
    main()
