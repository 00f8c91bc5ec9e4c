"""Handle the signals that stop a command: Ctrl-C, SIGTERM and a closed terminal."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

# SIGHUP: the terminal was closed, or the connection to it broke; Windows has none.
SIGNALS = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


@contextmanager
def interrupts_noted(report: Callable[[str], None]) -> Iterator[threading.Event]:
    """Yield an event that one of SIGNALS sets, and report it; a second signal acts as usual.

    Outside the main thread, which alone gets signals, the event is never set.
    """
    noted = threading.Event()

    def note(number: int, usual: Any) -> None:
        noted.set()
        signal.signal(number, usual)
        report("interrupted: finishing this iteration and saving (once more stops at once)")

    with _handled(note):
        yield noted


@contextmanager
def interrupts_raised() -> Iterator[None]:
    """Raise KeyboardInterrupt at each of SIGNALS, as Python does for Ctrl-C."""

    def stop(number: int, usual: Any) -> None:
        raise KeyboardInterrupt

    with _handled(stop):
        yield


@contextmanager
def _handled(act: Callable[[int, Any], None]) -> Iterator[None]:
    """Call `act` with a signal's number and its usual handler, until the block ends."""
    usual: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        has_terminal = [_is_terminal(stream) for stream in (1, 2)]

        def handle(number: int, frame: Any) -> None:
            if number == getattr(signal, "SIGHUP", None):
                _leave_terminal(has_terminal)
            act(number, usual[number])

        for number in SIGNALS:
            if signal.getsignal(number) != signal.SIG_IGN:  # as `nohup` asks
                usual[number] = signal.signal(number, handle)
    try:
        yield
    finally:
        for number, handler in usual.items():
            signal.signal(number, handler)


def _is_terminal(stream: int) -> bool:
    try:
        return os.isatty(stream)
    except OSError:
        return False


def _leave_terminal(has_terminal: list[bool]) -> None:
    """Redirect the terminal's streams to the null device: printing to a closed terminal raises."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream, is_terminal in zip((1, 2), has_terminal, strict=True):
        if is_terminal:
            os.dup2(nowhere, stream)
    os.close(nowhere)
    for file in (sys.stdout, sys.stderr):  # what was left in their buffers
        file.flush()
