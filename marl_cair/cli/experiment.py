"""`marl-cair experiment`: train and rate all cells of a plan, for one table and one figure.

`marl-cair reproduce` does so for a ready-made plan of published results, with its authors' panels.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import reduce
from pathlib import Path

from marl_cair.cli import EXIT_DAMAGED, EXIT_DONE
from marl_cair.cli import match_options as shared
from marl_cair.cli.compose import CONF, compose_config, override
from marl_cair.cli.parser import Parser, require_counts
from marl_cair.lookup import check_name
from marl_cair.training.settings.config import TrainConfig

_PLANS = CONF / "plan"


def run(arguments: Sequence[str]) -> int:
    """Run all cells that are missing and print the tables; returns the exit code."""
    return run_plan("experiment", arguments)


def reproduce(arguments: Sequence[str]) -> int:
    """As `run`, with the panels of the plan's authors."""
    return run_plan("reproduce", arguments, panels=True)


def list_plans() -> list[str]:
    """Names of the ready-made plans."""
    return sorted(file.name.removesuffix(".yaml") for file in _PLANS.iterdir())


def run_plan(command: str, arguments: Sequence[str], panels: bool = False) -> int:
    """Run the plan of a command line; returns the exit code. panels: as `ExperimentConfig`."""
    options = make_parser(command).parse_args(arguments)
    from marl_cair.experiments.experiment import ExperimentConfig, run_experiment
    from marl_cair.experiments.plan import read_plan
    from marl_cair.experiments.tables import LOOKS

    path, is_own = _find_plan(options.plan)
    plan = read_plan(path)
    seconds = shared.read_seconds(options.budget, "--budget") if options.budget else None
    require_counts(options, "workers")
    out = Path(options.out or f"runs/{path.stem}")
    config = ExperimentConfig(
        out=out,
        workers=options.workers,
        cluster=options.cluster,
        budget=options.budget,
        budget_seconds=seconds,
        only=tuple(options.only),
        panels=panels,
        allow_code=options.allow_code or (is_own and frozenset(plan.list_code())),
    )
    result = run_experiment(plan, config, compose)
    is_empty = not (out / LOOKS).is_file()
    where = "" if is_empty else f"\nTables, looks.csv and figure.png are in {out}\n"
    sys.stdout.write(result.text + where)
    for name, why in result.failed.items():
        sys.stderr.write(f"{name} failed: {why}\n")
    if result.failed:
        sys.stderr.write("the same command again runs cells that failed\n")
    return EXIT_DAMAGED if result.failed or is_empty else EXIT_DONE


def compose(layers: Sequence[Sequence[str]]) -> TrainConfig:
    """Settings from lists of words of `marl-cair train`; later lists override earlier ones."""
    words: list[str] = reduce(override, layers, [])
    return compose_config(words)


def _find_plan(name: str) -> tuple[Path, bool]:
    """A file, or a ready-made plan by its name; and whether it is a ready-made one."""
    if Path(name).is_file():
        return Path(name), False
    if name.endswith((".yaml", ".yml")):
        raise ValueError(f"there is no file {name}: give a plan, or a ready-made one by its name")
    check_name("plan (a YAML file, or a ready-made one)", name, list_plans())
    return Path(str(_PLANS / f"{name}.yaml")), True


def make_parser(command: str) -> Parser:
    """The options of the command."""
    parser = Parser(
        f"marl-cair {command}",
        description=f"{__doc__} The same command again resumes it, also after a crash; finished "
        "cells are not repeated.",
        epilog=f"example: marl-cair {command} "
        f"{'thesis' if command == 'reproduce' else 'plan.yaml'} --budget 20m",
    )
    parser.add_argument(
        "plan", help=f"a YAML file, or a ready-made plan: {', '.join(list_plans())}"
    )
    parser.add_argument(
        "--budget",
        default="",
        help="time for all of it on this machine, for example 20m: every cell is scaled down alike "
        "(default: the plan's own budgets)",
    )
    parser.add_argument("--workers", type=int, help="cells side by side (default: one a core)")
    shared.add_options(parser, "--cluster", "--allow-code", files="the plan")
    parser.add_argument(
        "--only",
        nargs="+",
        default=[],
        metavar="NAME",
        help="tasks and choices of factors; cells of others wait (default: all cells)",
    )
    parser.add_argument("--out", help="folder of results (default: runs/<plan>)")
    return parser
