"""Compare how many environment steps choices of a plan need to a level, against a control.

python -m benchmarks.steps_to_level LOOKS.csv [MORE.csv ...] --factor data
    --controls real real_twice [--share 0.9]
The level of a task is `--share` of the score of its best control over the last third of the
steps (a mean over seeds). A run has it at the first of two looks in a row at or above it; one that
never has it counts with all its steps. Prints in Markdown the strength (that mean score), the
steps, and their ratio to the best control's, with 95 % bootstrap intervals over seeds.
"""

import argparse
import csv
from collections import defaultdict
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import bootstrap

Curve = NDArray[np.float64]  # [looks, 2]: steps, score
Runs = dict[str, dict[str, list[Curve]]]  # by task and choice, one for each seed


def read_runs(paths: list[Path], factor: str) -> Runs:
    """The curves of all runs that were trained."""
    points: dict[tuple[str, str, str], list[tuple[float, float]]] = defaultdict(list)
    for path in paths:
        with path.open(newline="") as file:
            for row in csv.DictReader(file):
                if row[factor]:
                    key = row["task"], row[factor], row["seed"]
                    points[key].append((float(row["frames"]), float(row["score"])))
    runs: Runs = defaultdict(lambda: defaultdict(list))
    for (task, choice, _), curve in sorted(points.items()):
        runs[task][choice].append(np.array(sorted(curve)))
    return runs


def find_strength(curve: Curve) -> float:
    """Mean score over the last third of the steps."""
    return float(curve[curve[:, 0] >= 2 / 3 * curve[-1, 0], 1].mean())


def find_steps(curve: Curve, level: float) -> float:
    """Steps to the first of two looks in a row at `level` or above; else all of them."""
    reached = (a[0] for a, b in pairwise(curve) if min(a[1], b[1]) >= level)
    return float(next(reached, curve[-1, 0]))


def with_interval(values: list[float], others: list[float] | None = None, form: str = ".3g") -> str:
    """The mean, or its ratio to the mean of `others`, with a 95 % interval."""

    def statistic(own: Any, other: Any = None, axis: int = -1) -> Any:
        return np.mean(own, axis) / (1.0 if other is None else np.mean(other, axis))

    samples = (values,) if others is None else (values, others)
    mean = f"{statistic(*samples):{form}}"
    if min(map(len, samples)) < 2:
        return mean
    rng = np.random.default_rng(0)
    drawn = bootstrap(samples, statistic, method="percentile", rng=rng).confidence_interval
    return f"{mean} [{drawn.low:{form}}, {drawn.high:{form}}]"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("looks", nargs="+", type=Path, help="looks.csv of `marl-cair experiment`")
    parser.add_argument("--factor", default="data", help="whose choices are compared")
    parser.add_argument("--controls", nargs="+", default=["real", "real_twice"])
    parser.add_argument("--share", type=float, default=0.9, help="of the best control's score")
    args = parser.parse_args()
    print("| task | choice | seeds | strength | steps | ratio | never |")
    print("|---|---|---|---|---|---|---|")
    for task, choices in read_runs(args.looks, args.factor).items():
        strengths = {name: [find_strength(c) for c in runs] for name, runs in choices.items()}
        best = max(args.controls, key=lambda name: np.mean(strengths[name]))
        level = args.share * np.mean(strengths[best])
        steps = {name: [find_steps(c, level) for c in runs] for name, runs in choices.items()}
        for name, own in steps.items():
            ratio = "1 (control)" if name == best else with_interval(own, steps[best])
            never = sum(n == c[-1, 0] for n, c in zip(own, choices[name], strict=True))
            shown = with_interval(strengths[name]), with_interval(own, form=",.0f")
            print("| " + " | ".join([task, name, str(len(own)), *shown, ratio, str(never)]) + " |")


if __name__ == "__main__":
    main()
