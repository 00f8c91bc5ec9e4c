"""Runs of seconds of the scripts in benchmarks/."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def read_table(name, start, words):
    """What `python -m benchmarks.<name> <words>` prints from its table on, which begins with
    `start`.
    """
    command = [sys.executable, "-m", f"benchmarks.{name}", *words]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout[done.stdout.index(start) :]
