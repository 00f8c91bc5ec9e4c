"""Limits of agents that are code and run in processes of their own: time, memory, processes."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass

ANSWER_SECONDS = 10.0
FUNCTION_SECONDS = 60.0  # what the commands give functions: these may be networks without a GPU
IS_SUPERVISED = sys.platform == "linux"  # whether `supervisor` runs here


@dataclass(frozen=True)
class Limits:
    """Limits of an agent in a process of its own.

    Attributes:
        seconds: for each answer.
        memory_bytes: address space of each of its processes (RLIMIT_AS); 0: no limit. Programs may
            reserve much more than they use, above all those on a GPU, in Java or in Go.
        processes: that may be alive at once, looked at every 50 ms; 0: no limit. (RLIMIT_NPROC
            would count all processes of the user.)

    Raises ValueError for a limit that is none, or that this system cannot keep.
    """

    seconds: float = ANSWER_SECONDS
    memory_bytes: int = 0
    processes: int = 0

    def __post_init__(self) -> None:
        if not 0.0 < self.seconds < math.inf:
            raise ValueError(f"answer_seconds is {self.seconds}, it must be above 0 and finite")
        for name, value in (
            ("answer_memory", self.memory_bytes),
            ("answer_processes", self.processes),
        ):
            if not 0 <= value < 2**63:
                raise ValueError(f"{name} is {value}, it must be 0 or more")
            if value and not IS_SUPERVISED:
                raise ValueError(f"{name} is {value}: only Linux can limit it; leave it out here")
