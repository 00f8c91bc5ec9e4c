"""What generated rows cost beside what learning from rows costs, in one run.

    python -m benchmarks.generator [--rows 1000] [--repeats 5]

On Deep Line Wars 10x15 with one torch thread: an update of the learner (conv, 128 rows), an update
of the generator (64 rows), and predicting rows: next state, mask, reward, end and surety. Processor
time, the best of `--repeats`, as a Markdown table.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import torch

from benchmarks._timing import best_seconds
from marl_cair.generative.generator import CCDNGenerator
from marl_cair.training.collecting.metrics import Timers
from marl_cair.training.run import TrainingRun
from marl_cair.training.settings.config import EvaluationSettings, GameSettings, TrainConfig
from marl_cair.training.settings.learner import LearnerSettings
from marl_cair.training.trainer import iterate

COLLECTED = 4_096  # decisions
LEARNER_ROWS, GENERATOR_ROWS = 128, 32


def collect(folder: Path) -> TrainingRun:
    """A run with some thousand decisions in its replay."""
    run = TrainingRun(
        TrainConfig(
            out=str(folder),
            torch_threads=1,
            game=GameSettings(scenario="10x15"),
            learner=LearnerSettings(batch_size=LEARNER_ROWS),
            evaluation=EvaluationSettings(bots=()),
        )
    )
    rounds = iterate(run, Timers())
    while run.frames < COLLECTED:
        next(rounds)
    return run


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
    return [(name, best_seconds(work, repeats, time.process_time)) for name, work in works.items()]


def make_table(measured: list[tuple[str, float]]) -> str:
    """Seconds, and how many updates of the learner that is."""
    reference = measured[0][1]
    lines = ["| work | ms | updates of the learner |", "|---|---|---|"]
    for name, seconds in measured:
        lines.append(f"| {name} | {1_000 * seconds:.1f} | {seconds / reference:.2f} |")
    return "\n".join(lines)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--rows", type=int, default=1_000)
    parser.add_argument("--repeats", type=int, default=5)
    words = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        run = collect(Path(folder) / "run")
        print(make_table(measure(run, words.rows, words.repeats)))
        run.close()


if __name__ == "__main__":
    main()
