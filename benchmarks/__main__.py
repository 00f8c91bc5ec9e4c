"""Run one benchmark, or all but those of hours: python -m benchmarks [NAME] [ITS OPTIONS]."""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

NAMES = sorted(path.stem for path in Path(__file__).parent.glob("[!_]*.py"))
# Benchmarks that run for hours, or need arguments: they run only when they are named.
HOURS = ("capsule_scaling", "positions", "steps_to_level", "time_shares")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run with further words, until one fails; returns the exit code."""
    parser = argparse.ArgumentParser("python -m benchmarks", description=__doc__)
    parser.add_argument(
        "name",
        nargs="?",
        choices=NAMES,
        metavar="NAME",
        help=f"default: all but {', '.join(HOURS)}",
    )
    options, rest = parser.parse_known_args(arguments)
    chosen = [options.name] if options.name else [name for name in NAMES if name not in HOURS]
    for name in chosen:
        sys.stdout.write(f"== {name}\n")
        sys.stdout.flush()
        command = [sys.executable, "-m", f"benchmarks.{name}", *rest]
        done = subprocess.run(command, cwd=Path(__file__).parents[1], check=False)
        if done.returncode:
            return done.returncode
    return 0


if __name__ == "__main__":
    sys.exit(main())
