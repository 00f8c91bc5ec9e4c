"""Runs one cell in a process of its own: `python -m marl_cair.experiments.worker FOLDER`.

It prints a line of JSON for its progress now and then, and ends when its standard input does: then
the process that started it has ended, however that was.
"""

from __future__ import annotations

import _thread
import dataclasses
import json
import math
import os
import shutil
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import torch
from filelock import FileLock

from marl_cair.cluster import digest_code
from marl_cair.experiments.cells import DONE_FILE, RUN, Cell, load_cell, make_scenario, require_best
from marl_cair.experiments.looks import Looks, Row, read_overestimation
from marl_cair.experiments.plan import BEST
from marl_cair.files import write_atomically
from marl_cair.league.agents.load import load_agent
from marl_cair.outside import import_outside
from marl_cair.training.run import BEST_FOLDER, RESUME_FOLDER, TrainingRun
from marl_cair.training.run_log import RunLog
from marl_cair.training.trainer import train

_LOCK_FILE = ".cell.lock"
_EXIT_INTERRUPTED = 130
_LOCK_SECONDS = 120.0  # a process of an experiment that was killed saves its run before it ends
_REPORT_SECONDS = 2.0
Report = Callable[[float, Sequence[Row]], None]  # the share of the budget that is spent, all looks


def run_cell(folder: Path, report: Report) -> bool:
    """Train and rate the cell in `folder`, or resume it; False if it was interrupted."""
    cell, finished, code = load_cell(folder), folder / DONE_FILE, digest_code()
    with FileLock(folder / _LOCK_FILE, timeout=_LOCK_SECONDS):
        if not finished.exists():
            looks = Looks(cell, folder)
            if cell.agent is not None:
                looks.rows = []
                looks.add(_load(cell.agent, cell), 0, 0.0)
            elif cell.trainer is not None:
                looks.rows = []
                import_outside(cell.trainer)(cell, _make_look(looks, report))
            elif not _train(looks, folder / RUN, report):
                return False
            if not looks.rows:
                raise ValueError(f"{cell.trainer} has made no look: call its second argument")
            write_atomically(finished, f"marl_cair {code}, torch {torch.__version__}\n")
        shutil.rmtree(folder / RUN / RESUME_FOLDER, ignore_errors=True)  # gigabytes of all cells
    return True


def _load(agent: str, cell: Cell) -> Any:
    return load_agent(agent, cell.config.game.name, make_scenario(cell.config, cell.rating))


def _make_look(looks: Looks, report: Report) -> Callable[[Any, float, int], bool]:
    """The function that another trainer calls with agent, seconds and frames, as often as it can.
    It rates the agent if a look is due, and returns False when the budget is spent.
    """

    def look(agent: Any, seconds: float, frames: int) -> bool:
        share = looks.cell.find_share(frames, seconds)
        if looks.is_due(frames, seconds) or share >= 1.0:
            looks.add(agent, frames, seconds)
        report(share, looks.rows)
        return share < 1.0

    return look


def _train(looks: Looks, out: Path, report: Report) -> bool:
    """A training run with looks; False if it was interrupted."""
    cell, log, is_first = looks.cell, out / RunLog.FILE, True
    learning: dict[str, float] = {}

    def watch(run: TrainingRun) -> bool:
        nonlocal is_first, learning
        if is_first:
            looks.drop_after(run.frames)
            is_first = False
        spent = run.frames, run.processor_seconds
        share, last = cell.find_share(*spent), looks.last_frames
        is_final = share >= 1.0 and cell.rating.agent != BEST and run.frames > last
        updates = run.learner.updates
        learning = {
            "updates": updates,
            "generated_share": run.learner.generated / max(1, updates),
        }
        if is_final or looks.is_due(*spent):
            learning["overestimation"] = read_overestimation(log, last)
            looks.add(run.rated, *spent, learning)
        report(share, looks.rows)
        return share < 1.0

    config = dataclasses.replace(cell.config, out=str(out))
    result = train(config, resume=True, show_progress=False, watch=watch)
    if result.was_interrupted:
        return False
    if cell.rating.agent == BEST:  # saved by its evaluations
        require_best(config, result.frames)
        agent = _load(str(out / BEST_FOLDER), cell)
        looks.drop_after(result.frames - 1)
        looks.add(agent, result.frames, result.processor_seconds, learning)
    return True


def end_with_input() -> None:
    """Interrupt this process as Ctrl-C does when standard input ends."""

    def wait() -> None:
        while os.read(0, 1024):
            pass
        if os.name == "nt":  # there SIGTERM ends the process at once
            _thread.interrupt_main()
        else:
            os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=wait, daemon=True).start()


def make_report(send: Callable[[float, float | None], object]) -> Report:
    """A report that sends the share and the last score, at most every two seconds."""
    last = -math.inf

    def report(share: float, rows: Sequence[Row]) -> None:
        nonlocal last
        if time.monotonic() > last + _REPORT_SECONDS:
            last = time.monotonic()
            send(min(1.0, share), rows[-1]["score"] if rows else None)

    return report


def main() -> int:
    """Run the cell in the folder of the first argument; returns the exit code."""
    end_with_input()
    # What a user's trainer prints goes to the cell's output.txt. The number of the pipe stays open
    # to the end of the process: the scheduler waits for that.
    progress = os.dup(1)
    os.dup2(2, 1)

    def send(share: float, score: float | None) -> None:
        os.write(progress, f"{json.dumps({'share': share, 'score': score})}\n".encode())

    is_done = run_cell(Path(sys.argv[1]), make_report(send))
    return 0 if is_done else _EXIT_INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
