"""`marl-cair benchmark`: run the measurements in benchmarks/ of the source checkout."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import marl_cair
from marl_cair.cli.parser import Parser
from marl_cair.lookup import find_by_name

# Benchmarks that run for hours, or need arguments: they run only when they are named.
HOURS = (
    *("capsule_scaling", "doctrine_search", "league_learning"),
    *("psro_learning", "self_play_learning"),
)


def run(arguments: Sequence[str]) -> int:
    """Run one benchmark, or all, with further words; returns the exit code. Raises ValueError: no
    such benchmark, or no source checkout.
    """
    parser = Parser("marl-cair benchmark", description=__doc__)
    parser.add_argument("name", nargs="?", help=f"default: all but {', '.join(HOURS)}")
    options, rest = parser.parse_known_args(arguments)
    root = Path(marl_cair.__file__).parents[1]
    scripts = {path.stem: path for path in sorted((root / "benchmarks").glob("[!_]*.py"))}
    if not scripts:
        raise ValueError(
            f"there is no folder benchmarks/ in {root}: benchmarks run from a source checkout "
            "(git clone, then pip install -e .)"
        )
    if options.name:
        chosen = [find_by_name("benchmark", options.name, scripts)]
    else:
        chosen = [script for name, script in scripts.items() if name not in HOURS]
    for script in chosen:
        sys.stdout.write(f"== {script.stem}\n")
        sys.stdout.flush()
        command = [sys.executable, "-m", f"benchmarks.{script.stem}", *rest]
        done = subprocess.run(command, cwd=root, check=False)
        if done.returncode:
            return done.returncode
    return 0
