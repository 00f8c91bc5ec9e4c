"""Tables and the figure of an experiment, made again from its raw looks.

python docs/experiment_results.py PLAN LOOKS.csv [MORE.csv] --out FOLDER [--only TASK]
"""

import argparse
import csv
import sys
from pathlib import Path

from marl_cair.experiments.figures import draw_results
from marl_cair.experiments.plan import Plan, read_plan
from marl_cair.experiments.summary import Run, find_levels, summarise
from marl_cair.experiments.tables import write_looks, write_tables


def read_runs(plan: Plan, path: Path) -> list[Run]:
    """The runs of a `looks.csv`, in the plan's order of tasks."""
    runs: dict[tuple[str, ...], Run] = {}
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            task, *kind, seed = (row.pop(name) for name in ("task", *plan.factors, "seed"))
            run = runs.setdefault((task, *kind, seed), Run(task, tuple(kind), int(seed), []))
            given = {name: value for name, value in row.items() if value}
            run.rows.append({n: int(v) if v.isdigit() else float(v) for n, v in given.items()})
    return sorted(runs.values(), key=lambda run: list(plan.tasks).index(run.task))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("plan", type=Path)
    parser.add_argument("looks", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, required=True, help="a folder")
    parser.add_argument("--only", nargs="+", default=[], metavar="TASK")
    args = parser.parse_args()
    plan = read_plan(args.plan)
    runs = [run for path in args.looks for run in read_runs(plan, path)]
    runs = [run for run in runs if run.task in (args.only or plan.tasks)]
    if not runs:
        parser.error(f"no run of {', '.join(args.only or plan.tasks)} in these looks")
    args.out.mkdir(parents=True, exist_ok=True)
    entries = summarise(plan, runs)
    write_looks(plan, runs, args.out / "looks.csv")
    notes = f"Made from {', '.join(map(str, args.looks))}."
    levels = find_levels(plan, runs)
    sys.stdout.write(write_tables(plan, entries, levels, notes, args.out))
    draw_results(plan, runs, entries, args.out / "figure.png")
