"""Runs of seconds of the scripts in benchmarks/."""

import contextlib
import io
import runpy
import sys
from pathlib import Path
from unittest import mock

ROOT = Path(__file__).parents[1]


def read_table(name, start, words):
    """What `python -m benchmarks.<name> <words>`, in this process, prints from its table on, which
    begins with `start`.
    """
    said = io.StringIO()
    with (
        mock.patch.object(sys, "argv", [name, *map(str, words)]),
        contextlib.chdir(ROOT),
        contextlib.redirect_stdout(said),
    ):
        sys.modules.pop(f"benchmarks.{name}", None)  # one benchmark uses another
        runpy.run_module(f"benchmarks.{name}", run_name="__main__")
    return said.getvalue()[said.getvalue().index(start) :]
