"""Runs an agent's command, and kills all its processes when it or its parent ends.

    python -I -S supervisor.py CONTROL MEMORY_BYTES NUM_PROCESSES COMMAND...

`process` starts it by its path, on Linux; it needs only the standard library. It is a subreaper: a
process that leaves its session and its parent stays below the supervisor. The command has the
supervisor's input and output. The end of the pipe CONTROL ends everything. A limit of 0 is none.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import resource
import select
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

TOO_MANY_PROCESSES = 250  # exit code, as in `process`
_POLL_SECONDS = 0.05
_SET_CHILD_SUBREAPER = 36  # of prctl(2)


def main(arguments: Sequence[str]) -> int:
    """Run the command until it or `control` ends; returns the exit code, 128 + n after signal n."""
    control, memory_bytes, num_processes = map(int, arguments[:3])
    os.set_inheritable(control, False)
    if ctypes.CDLL(None).prctl(_SET_CHILD_SUBREAPER, 1, 0, 0, 0):
        raise OSError("the kernel cannot make this process a subreaper")
    if memory_bytes:
        # Before this process needs more. The command inherits the limit and cannot raise it.
        resource.setrlimit(resource.RLIMIT_AS, (memory_bytes, memory_bytes))
    try:
        child = subprocess.Popen(arguments[3:])
    except OSError as error:
        sys.stdout.write(json.dumps({"error": f"cannot be started ({error})"}) + "\n")
        return 127
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1):  # else these would stay open until this process ends
        os.dup2(nothing, stream)
    code = _wait(child.pid, control, num_processes)
    kill_below(os.getpid())
    return code


def _wait(child: int, control: int, num_processes: int) -> int:
    """The exit code of `child`; TOO_MANY_PROCESSES, or 0 at the end of `control`."""
    while True:
        for number, status in _reap():
            if number == child:
                code = os.waitstatus_to_exitcode(status)
                return code if code >= 0 else 128 - code
        if select.select([control], [], [], _POLL_SECONDS)[0]:
            return 0
        if num_processes and len(find_below(os.getpid())) > num_processes:
            return TOO_MANY_PROCESSES


def _reap() -> list[tuple[int, int]]:
    """Collect the children that have ended; returns their numbers and statuses."""
    ended: list[tuple[int, int]] = []
    with contextlib.suppress(ChildProcessError):
        while (found := os.waitpid(-1, os.WNOHANG))[0]:
            ended.append(found)
    return ended


def kill_below(root: int) -> None:
    """Kill all processes below `root`, also those that start meanwhile.

    A list of children may miss a process that is moving while the list is read. Only the kernel
    knows that none is left, and only for this process, which adopts all orphans below it.
    """
    is_own = root == os.getpid()
    while (found := find_below(root)) or (is_own and _has_children()):
        for number in found:
            with contextlib.suppress(ProcessLookupError):
                os.kill(number, signal.SIGKILL)
        if is_own:
            _reap()


def _has_children() -> bool:
    try:
        os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
    except ChildProcessError:
        return False
    return True


def find_below(root: int) -> list[int]:
    """Numbers of all running processes below `root`."""
    found: list[int] = []
    waiting = [root]
    while waiting:
        below = _list_children(waiting.pop())
        found += filter(is_running, below)
        waiting += below
    return found


def _list_children(parent: int) -> list[int]:
    children: list[int] = []
    with contextlib.suppress(OSError):  # it has ended
        for thread in Path(f"/proc/{parent}/task").iterdir():
            children += map(int, (thread / "children").read_text("ascii").split())
    return children


def is_running(number: int) -> bool:
    """Whether the process exists and has not ended."""
    try:
        text = Path(f"/proc/{number}/stat").read_text("utf-8", "replace")
    except OSError:
        return False
    return text.rpartition(")")[2].split()[0] != "Z"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
