"""Runs cells side by side, each in a process of its own, with progress and time left."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Protocol

from tqdm import tqdm

from marl_cair.experiments.cells import CELLS, DONE_FILE, Cell, list_shortages

OUTPUT_FILE = "output.txt"  # of a cell: what its process printed to stderr
_AFTER_SECONDS = 60.0
_KILLED = -9  # exit code
_AGENT_SHARE = 0.01  # of a trained cell, in the time left
_BAR = "{percentage:3.0f} %|{bar}| {n:.1f} of {total:.1f} cells [{elapsed}<{remaining}{postfix}]"

Note = Callable[[str, float, float | None], None]  # cell, share of its budget, last score


def is_finished(cell: Cell, out: Path) -> bool:
    """Whether the cell has all its looks."""
    return (out / CELLS / cell.name / DONE_FILE).exists()


class Progress:
    """A bar over all cells that are still to run, by the shares of their budgets."""

    def __init__(self, cells: Sequence[Cell]) -> None:
        self._weights = {one.name: 1.0 if one.agent is None else _AGENT_SHARE for one in cells}
        self._shares = dict.fromkeys(self._weights, 0.0)
        self._lock = threading.Lock()
        self._bar = tqdm(total=sum(self._weights.values()), bar_format=_BAR)

    def note(self, name: str, share: float, score: float | None = None) -> None:
        """Cell `name` has spent so much of its budget, and its last look found `score`."""
        with self._lock:
            self._bar.update((share - self._shares[name]) * self._weights[name])
            self._shares[name] = share
            if score is not None:
                self._bar.set_postfix_str(f"{name}: {score:.3g}")

    def close(self) -> None:
        """End the bar."""
        self._bar.close()


class Runner(Protocol):
    """Where cells run."""

    def find_shortages(self, cells: Sequence[Cell]) -> dict[str, str]:
        """Why cells cannot be run, by name."""

    def submit(self, cell: Cell, folder: Path, note: Note) -> Future[str]:
        """Run a cell that is saved in `folder`; gives why it failed, "" if it is finished or was
        stopped.
        """

    def stop(self) -> None:
        """Let all cells save their runs and end; no further one begins."""


class LocalProcesses:
    """Runs cells in processes of this machine, each of which ends when this process does. A cell of
    several threads takes the place of as many others.
    """

    def __init__(self, num_workers: int) -> None:
        self._threads = ThreadPoolExecutor(num_workers)
        self._running: set[subprocess.Popen[str]] = set()
        self._lock = threading.Condition()
        self._num_workers = self._free = num_workers
        self._is_stopped = False

    def find_shortages(self, cells: Sequence[Cell]) -> dict[str, str]:
        return list_shortages(cells)

    def submit(self, cell: Cell, folder: Path, note: Note) -> Future[str]:
        return self._threads.submit(self._run, cell, folder, note)

    def _run(self, cell: Cell, folder: Path, note: Note) -> str:
        threads = {"OMP_NUM_THREADS": str(cell.threads), "MPLBACKEND": "Agg"}
        command = [sys.executable, "-m", "marl_cair.experiments.worker", str(folder)]
        cores = min(cell.threads, self._num_workers)
        with (folder / OUTPUT_FILE).open("w", encoding="utf-8") as errors:
            with self._lock:
                self._lock.wait_for(lambda: self._is_stopped or self._free >= cores)
                if self._is_stopped:
                    return ""
                process = subprocess.Popen(
                    command,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=errors,
                    text=True,
                    env={**os.environ, **threads},
                    start_new_session=True,  # Ctrl-C reaches it through `stop`, once
                    creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),  # Windows
                )
                self._running.add(process)
                self._free -= cores
            try:
                with process:  # closes its pipes
                    for line in process.stdout or ():
                        if line.startswith("{"):  # not what libraries print when imported
                            found = json.loads(line)
                            note(cell.name, found["share"], found["score"])
            finally:
                with self._lock:
                    self._running.discard(process)
                    self._free += cores
                    self._lock.notify_all()
        code = process.returncode
        if code == 0 or self._is_stopped:
            return ""
        lines = (folder / OUTPUT_FILE).read_text("utf-8", "replace").strip().splitlines()
        why = lines[-1] if lines else "it printed nothing"
        if code == _KILLED:
            why = "it was killed: memory may be short (--workers 1 runs one cell at a time)"
        return f"{why} (exit code {code}; all of it is in {folder / OUTPUT_FILE})"

    def stop(self) -> None:
        with self._lock:
            self._is_stopped = True
            self._lock.notify_all()
            for process in self._running:
                if process.stdin and not process.stdin.closed:
                    process.stdin.close()
        self._threads.shutdown()


def run_cells(
    cells: Sequence[Cell], out: Path, runner: Runner, after: Callable[[], object]
) -> dict[str, str]:
    """Run all cells that are not finished; returns why cells failed, by name. `after` is called
    when some have ended, once a minute at the most.

    An interrupt lets all running cells save; then KeyboardInterrupt is raised.
    """
    todo = [cell for cell in cells if not is_finished(cell, out)]
    failed: dict[str, str] = {}
    progress, futures, last = Progress(todo), {}, -math.inf
    try:
        for cell in todo:
            folder = out / CELLS / cell.name
            folder.mkdir(parents=True, exist_ok=True)
            cell.save(folder)
            futures[runner.submit(cell, folder, progress.note)] = cell.name
        for future in as_completed(futures):
            name, error = futures[future], future.exception()
            if why := f"{type(error).__name__}: {error}" if error else future.result():
                failed[name] = why
                tqdm.write(f"{name} failed: {why}")
            progress.note(name, 1.0)
            if time.monotonic() > last + _AFTER_SECONDS:
                after()
                last = time.monotonic()
    finally:
        runner.stop()
        progress.close()
    return failed
