"""Python processes of tests, which find the packages of a folder and ours."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]


def run_python(folder, *arguments, **settings):
    """The ended process; `settings` are added to the environment."""
    return subprocess.run(
        [sys.executable, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{ROOT}", **settings},
    )


def read_output(folder, *arguments, **settings):
    """Standard output of a process that must succeed."""
    done = run_python(folder, "-W", "ignore", *arguments, **settings)
    assert done.returncode == 0, done.stderr
    return done.stdout
