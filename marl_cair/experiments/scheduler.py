"""Runs cells side by side, each in a process of its own, with progress and time left."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path

from tqdm import tqdm

from marl_cair.experiments.cells import CELLS, DONE_FILE, Cell

OUTPUT_FILE = "output.txt"  # of a cell: what its process printed to stderr
_AGENT_SHARE = 0.01  # of a trained cell, in the time left
_BAR = "{percentage:3.0f} %|{bar}| {n:.1f} of {total:.1f} cells [{elapsed}<{remaining}{postfix}]"


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


class LocalProcesses:
    """Runs cells in processes of this machine, each of which ends when this process does."""

    def __init__(self) -> None:
        self._running: set[subprocess.Popen[str]] = set()
        self._lock = threading.Lock()
        self._is_stopped = False

    def run(self, cell: Cell, out: Path, note: Callable[[str, float, float | None], None]) -> str:
        """Run one cell; returns why it failed, "" if it is finished or was stopped."""
        folder = out / CELLS / cell.name
        threads = {"OMP_NUM_THREADS": str(cell.threads), "MPLBACKEND": "Agg"}
        command = [sys.executable, "-m", "marl_cair.experiments.worker", str(folder)]
        with (folder / OUTPUT_FILE).open("w", encoding="utf-8") as errors:
            with self._lock:
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
                )
                self._running.add(process)
            with process:  # closes its pipes
                for line in process.stdout or ():
                    if line.startswith("{"):
                        found = json.loads(line)
                        note(cell.name, found["share"], found["score"])
        with self._lock:
            self._running.discard(process)
        code = process.returncode
        if code == 0 or self._is_stopped:
            return ""
        lines = (folder / OUTPUT_FILE).read_text("utf-8", "replace").strip().splitlines()
        why = lines[-1] if lines else "it printed nothing"
        return f"{why} (exit code {code}; all of it is in {folder / OUTPUT_FILE})"

    def stop(self) -> None:
        """Let all save their runs and end; no further one begins."""
        with self._lock:
            self._is_stopped = True
            for process in self._running:
                if process.stdin and not process.stdin.closed:
                    process.stdin.close()


def run_cells(
    cells: Sequence[Cell], out: Path, num_workers: int, after: Callable[[], object]
) -> dict[str, str]:
    """Run all cells that are not finished; returns why cells failed, by name. `after` is called
    when one has ended.

    An interrupt lets all running cells save; then KeyboardInterrupt is raised.
    """
    todo = [cell for cell in cells if not is_finished(cell, out)]
    for cell in todo:
        (out / CELLS / cell.name).mkdir(parents=True, exist_ok=True)
        cell.save(out / CELLS / cell.name)
    failed: dict[str, str] = {}
    processes, progress = LocalProcesses(), Progress(todo)
    with ThreadPoolExecutor(num_workers) as pool:
        futures = {pool.submit(processes.run, cell, out, progress.note): cell for cell in todo}
        try:
            for future in as_completed(futures):
                name = futures[future].name
                if why := future.result():
                    failed[name] = why
                    tqdm.write(f"{name} failed: {why}")
                progress.note(name, 1.0)
                after()
        finally:
            processes.stop()
            progress.close()
    return failed
