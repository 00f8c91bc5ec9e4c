"""`marl-cair curves`: plot learning curves of training runs as a PNG, also while they train."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path

from marl_cair.cli import EXIT_DONE
from marl_cair.cli.parser import Parser
from marl_cair.training.run_log import RunLog, read_log

DEFAULT_OUT = "runs/curves.png"


def run(arguments: Sequence[str]) -> int:
    """Draw the picture and print its path; returns the exit code."""
    options = make_parser().parse_args(arguments)
    out = Path(options.out)
    if out.is_dir():
        raise IsADirectoryError(f"--out {options.out} is a folder: give the name of a PNG file")
    if out.suffix.lower() != ".png":
        raise ValueError(f"--out is {options.out!r}, it must end in .png: the picture is a PNG")
    runs = name_runs(options.runs)
    out.parent.mkdir(parents=True, exist_ok=True)
    from marl_cair.training.curves import draw_curves

    draw_curves(runs, out)
    sys.stdout.write(f"{out}: {', '.join(runs)}\n")
    return EXIT_DONE


def make_parser() -> Parser:
    """The options of the command."""
    parser = Parser(
        "marl-cair curves",
        description=__doc__,
        epilog="example: marl-cair curves runs/conv runs/capsule --out curves.png",
    )
    parser.add_argument("runs", nargs="+", metavar="RUN", help="folder of a training run")
    parser.add_argument("--out", default=DEFAULT_OUT, help="PNG to write (default: %(default)s)")
    return parser


def name_runs(folders: Sequence[str], needed: str = RunLog.FILE) -> dict[str, Path]:
    """Runs by their folders' names; by their paths below the common folder where two are equal.

    needed: the file of a run without which a folder is refused; a log must have rows.
    Raises ValueError for such a folder, and for one that is given twice.
    """
    paths = [Path(folder).resolve() for folder in folders]
    for given, path in zip(folders, paths, strict=True):
        if paths.count(path) > 1:
            raise ValueError(f"{given!r} is given twice: name each run once")
        if needed != RunLog.FILE and not (path / needed).is_file():
            raise ValueError(
                f"{given!r} has no {needed}: give the folder of a run (`marl-cair train out=...`)"
            )
        if needed == RunLog.FILE and not read_log(path / needed):
            raise ValueError(
                f"{given!r} has no {RunLog.FILE} with rows: give the folder of a run "
                "(`marl-cair train out=...`) that has logged something"
            )
    if len({path.name for path in paths}) == len(paths):
        return {path.name: path for path in paths}
    common = Path(os.path.commonpath(paths))
    return {path.relative_to(common).as_posix(): path for path in paths}
