"""Compare how many environment steps choices of a plan need to a level, against a control.

python -m benchmarks.steps_to_level LOOKS.csv [MORE.csv ...] --factor data
    --controls real real_twice [--share 0.9] [--equal-steps] [--iqm]
    [--plan PLAN.yaml --figure FILE.png]
Strength and level are those of the tables of `marl-cair experiment`, of the mean over all bots: the
mean score over the last third of the steps, and the first of two looks in a row. The level of a
task is `--share` of the strength of its best control; a run that never has it counts with all its
steps. `--equal-steps` ends all runs of a task at the steps of the shortest one, between two looks
on the line from one to the other. Numbers are means over seeds; with `--iqm` interquartile means
(of four or more), as in those tables.
Prints strength, the mean score over all steps (the area under the curve: it separates choices with
fewer seeds than the steps to a level do), steps, and ratios to the best control's in Markdown, with
95 % bootstrap intervals over seeds. The figure is that of the experiment, of the runs in the files.
"""

import argparse
import csv
from collections import defaultdict
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import bootstrap

import marl_cair
from marl_cair.experiments.figures import draw_results
from marl_cair.experiments.plan import read_plan
from marl_cair.experiments.summary import Run, find_level, find_strength, trim

PLAN = Path(marl_cair.__file__).parent / "conf" / "plan" / "synthetic.yaml"
NUMBERS = ("frames", "seconds", "score", "mean")

Runs = dict[str, dict[str, list[Run]]]  # by task and choice, one for each seed


def read_runs(paths: list[Path], factor: str) -> Runs:
    """All runs of the files; the plan has no other factor."""
    runs: dict[tuple[str, str, str], Run] = {}
    for path in paths:
        with path.open(newline="") as file:
            for row in csv.DictReader(file):
                key = row["task"], row[factor], row["seed"]
                run = runs.setdefault(key, Run(row["task"], (row[factor],), int(row["seed"]), []))
                run.rows.append({name: float(row[name]) for name in NUMBERS})
    found: Runs = defaultdict(lambda: defaultdict(list))
    for (task, choice, _), run in sorted(runs.items()):
        found[task][choice].append(run)
    return found


def end_together(choices: dict[str, list[Run]]) -> dict[str, list[Run]]:
    """The runs up to the steps of the shortest one."""
    end = min(run.rows[-1]["frames"] for runs in choices.values() for run in runs)

    def cut(run: Run) -> Run:
        steps = [row["frames"] for row in run.rows]
        last = {
            name: float(np.interp(end, steps, [row[name] for row in run.rows])) for name in NUMBERS
        }
        return run._replace(rows=[row for row in run.rows if row["frames"] < end] + [last])

    return {name: [*map(cut, runs)] for name, runs in choices.items()}


def rate_strength(run: Run) -> float:
    """Mean score over the last third of the run's steps."""
    return find_strength(run.rows, "frames", run.rows[-1]["frames"])


def rate_course(run: Run) -> float:
    """Mean score over all of the run's steps, straight between looks."""
    steps, scores = [row["frames"] for row in run.rows], [row["mean"] for row in run.rows]
    return float(np.trapezoid(scores, steps)) / steps[-1]


def with_interval(
    average: Callable[..., Any],
    values: list[float],
    others: list[float] | None = None,
    form: str = ".3g",
) -> str:
    """The average, or its ratio to that of `others`, with a 95 % interval."""

    def statistic(own: Any, other: Any = None, axis: int = -1) -> Any:
        return average(own, axis) / (1.0 if other is None else average(other, axis))

    samples = (values,) if others is None else (values, others)
    arrays: list[Any] = [np.array(sample) for sample in samples]
    mean = f"{statistic(*arrays):{form}}"
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
    parser.add_argument(
        "--equal-steps", action="store_true", help="end where the shortest run does"
    )
    parser.add_argument("--iqm", action="store_true", help="interquartile means over seeds")
    parser.add_argument("--plan", type=Path, default=PLAN, help="of the figure")
    parser.add_argument("--figure", type=Path, help="a .png or .pdf file to draw")
    args = parser.parse_args()
    tasks = read_runs(args.looks, args.factor)
    average = trim if args.iqm else np.mean
    shorten = partial(with_interval, average)
    if args.figure:
        runs = [run for choices in tasks.values() for own in choices.values() for run in own]
        draw_results(read_plan(args.plan), runs, [], args.figure)
    print("| task | choice | seeds | strength | course | its ratio | steps | ratio | never |")
    print("|---|---|---|---|---|---|---|---|---|")
    for task, whole in tasks.items():
        choices = end_together(whole) if args.equal_steps else whole
        strengths = {name: [*map(rate_strength, runs)] for name, runs in choices.items()}
        controls = [name for name in args.controls if name in strengths]
        best = max(controls, key=lambda name: average(np.array(strengths[name]), 0))
        level = args.share * average(np.array(strengths[best]), 0)
        courses = {name: [*map(rate_course, runs)] for name, runs in choices.items()}
        steps, never = {}, {}
        for name, runs in choices.items():
            reached = [(find_level(run, level, "mean").first, run.rows[-1]) for run in runs]
            steps[name] = [(first or last)["frames"] for first, last in reached]
            never[name] = sum(first is None for first, _ in reached)
        for name, own in steps.items():
            ratio = "1 (control)" if name == best else shorten(own, steps[best])
            course = "1" if name == best else shorten(courses[name], courses[best])
            shown = shorten(strengths[name]), shorten(courses[name]), course
            cells = task, name, str(len(own)), *shown, shorten(own, form=",.0f"), ratio
            print("| " + " | ".join((*cells, str(never[name]))) + " |")


if __name__ == "__main__":
    main()
