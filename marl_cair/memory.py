"""What this machine has: cores, and memory, with an error before more of it is allocated."""

from __future__ import annotations

import os
from pathlib import Path

_LIMIT_FILE = Path("/sys/fs/cgroup/memory.max")  # of a container


class NotEnoughMemoryError(ValueError):
    """More memory is asked for than the machine has."""


def count_cores() -> int:
    """Cores that this process may use: a job of a cluster often has only some."""
    if hasattr(os, "sched_getaffinity"):  # Linux
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def total_memory() -> int:
    """The machine's memory in bytes, or its container's limit."""
    total = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    try:
        limit = _LIMIT_FILE.read_text("ascii").strip()
    except OSError:
        limit = ""
    return min(total, int(limit)) if limit.isdigit() else total


def require_memory(what: str, num_bytes: int) -> None:
    """Raise NotEnoughMemoryError where `what` needs more than the total memory."""
    if not hasattr(os, "sysconf"):  # Windows
        return
    total = total_memory()
    if num_bytes > total:
        raise NotEnoughMemoryError(
            f"{what} needs {num_bytes:,} bytes of memory, this machine has {total:,}: give a "
            "smaller number"
        )
