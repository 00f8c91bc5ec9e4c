"""Runs cells as tasks of a Ray cluster."""

from __future__ import annotations

import platform
import sys
import threading
import traceback
from collections.abc import Sequence
from concurrent.futures import Future
from contextlib import redirect_stderr
from pathlib import Path
from typing import Any

from marl_cair.cluster import Node, RayPool
from marl_cair.experiments.cells import Cell, list_shortages
from marl_cair.experiments.scheduler import OUTPUT_FILE, Note
from marl_cair.experiments.worker import make_report, run_cell


class RayTasks:
    """Runs cells on the machines of a cluster, as `scheduler.LocalProcesses` does on one.

    Args:
        pool: the cluster.
    """

    def __init__(self, pool: RayPool) -> None:
        from ray.util.queue import Queue

        self._pool = pool
        self._small: dict[str, list[str]] = {}  # keys of machines that are too small for a cell
        # Of what cells report. It is on this machine: no other one's end may end it.
        place = pool.place_on(pool.here)
        self._queue = Queue(actor_options={"num_cpus": 0, "scheduling_strategy": place})
        self._reader: threading.Thread | None = None

    def find_shortages(self, cells: Sequence[Cell]) -> dict[str, str]:
        """Cells that no machine can run; others will avoid the machines that are too small."""
        answers = self._pool.ask_nodes(list_shortages, cells) if cells else {}
        shortages = {}
        for cell in cells:
            found = {node: small.get(cell.name) or _find_missing_cores(cell, node)
                     for node, small in answers.items()}  # fmt: skip
            found = {node: why for node, why in found.items() if why}
            if len(found) == len(answers):
                node, why = next(iter(found.items()))
                shortages[cell.name] = f"on {node.address}: {why}"
            self._small[cell.name] = [node.key for node in found]
        return shortages

    def submit(self, cell: Cell, folder: Path, note: Note) -> Future[str]:
        if self._reader is None:
            self._reader = threading.Thread(target=self._pass_on, args=(note,), daemon=True)
            self._reader.start()
        options: dict[str, Any] = {"num_cpus": cell.threads, "is_fresh": True}
        if small := self._small[cell.name]:
            options["label_selector"] = {"ray.io/node-id": f"!in({','.join(small)})"}
        return self._pool.submit(_run, cell.name, folder.resolve(), self._queue, **options)

    def _pass_on(self, note: Note) -> None:
        for found in iter(self._queue.get, None):
            note(*found)

    def stop(self) -> None:
        self._pool.cancel()
        if self._reader is not None:
            self._queue.put(None)
            self._reader.join()
        self._queue.shutdown()


def _find_missing_cores(cell: Cell, node: Node) -> str:
    if cell.threads <= node.num_cpus:
        return ""
    return f"it needs {cell.threads} cores (torch_threads), Ray has {node.num_cpus} there"


def _run(name: str, folder: Path, queue: Any) -> str:
    """Run a cell on a machine; `RayPool.cancel` interrupts it as Ctrl-C does."""
    with (folder / OUTPUT_FILE).open("w", encoding="utf-8") as errors, redirect_stderr(errors):
        try:
            # Not `put`, which waits: that raises in a task that is cancelled and has yet to save.
            note = queue.actor.put_nowait.remote
            is_done = run_cell(folder, make_report(lambda *found: note((name, *found))))
        except Exception:
            sys.stderr.write(f"on {platform.node()}:\n")
            traceback.print_exc()
            raise
    return "" if is_done else "it was interrupted"
