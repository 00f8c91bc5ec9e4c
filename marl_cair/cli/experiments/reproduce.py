"""`marl-cair reproduce`: run a ready-made plan of published results, with its authors' panels."""

from __future__ import annotations

from collections.abc import Sequence

from marl_cair.cli.experiments.experiment import run_plan


def run(arguments: Sequence[str]) -> int:
    """Run all cells that are missing and print the tables; returns the exit code."""
    return run_plan("reproduce", arguments, panels=True)
