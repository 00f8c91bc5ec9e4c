"""Programs in a private folder: all of it goes away with them, even if Python is killed."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal, Self

from marl_cair.files import require_free_space

_MAX_PATH = 60  # characters: programs put sockets in the folder, whose paths have 107 at most
_MIN_FREE = 64 << 20  # bytes that a browser's profile may need
_NUM_LOG_LINES = 8
_FOLDERS = (
    *("HOME", "TMPDIR", "XDG_RUNTIME_DIR", "XDG_CONFIG_HOME", "XDG_CACHE_HOME"),
    *("XDG_DATA_HOME", "XDG_STATE_HOME"),
)

# Reads lines until "end", or until Python is gone: "KILL 12" and "TERM 13" are signals and process
# groups, "FILE 14.99 /path" is a file that a program leaves if it is killed, with its inode and
# time (inodes are used again at once). Only what is sent TERM is waited for: what is killed changes
# no files, and may be a zombie for seconds.
_WATCHER = r"""
trap '' HUP INT QUIT TERM
groups= ending= files=
while read -r word number file && [ "$word" != end ]; do
    case $word in
    KILL) groups="$groups $number" ;;
    TERM) ending="$ending $number" ;;
    FILE) files="$files $number:$file" ;;
    esac
done
for pid in $groups; do kill -s KILL -- "-$pid"; done
for pid in $ending; do kill -s TERM -- "-$pid"; done
tries=0
for pid in $ending; do
    while kill -s 0 -- "-$pid" && [ $tries -lt 60 ]; do
        sleep 0.05
        tries=$((tries + 1))
    done
    kill -s KILL -- "-$pid"
done
for pair in $files; do
    file=${pair#*:}
    [ "$(stat -c %i.%Y -- "$file")" = "${pair%%:*}" ] && rm -f -- "$file"
done
tries=0
until rm -rf -- "$1" || [ $tries -ge 60 ]; do
    sleep 0.05
    tries=$((tries + 1))
done
"""
# The program starts only when Python has registered it with the watcher.
_WAIT_THEN_RUN = 'read -r _ && exec "$@" </dev/null'


class FlashError(OSError):
    """The browser, the display or the game failed: the message says which, and how."""


class PrivateFolder:
    """A new folder that only this user can enter, and the programs that run in it.

    A watcher process ends the programs and removes the folder on `close`, and when this process
    ends in any way.

    Raises OSError: the disk is full, or the folder for temporary files has too long a path.
    """

    def __init__(self) -> None:
        place = Path(tempfile.gettempdir())
        if len(str(place)) > _MAX_PATH:
            raise OSError(
                f"the path of the folder for temporary files has {len(str(place))} characters, at "
                f"most {_MAX_PATH} are allowed: {place}. Set TMPDIR to a shorter one"
            )
        require_free_space(place, _MIN_FREE)
        self.path = Path(tempfile.mkdtemp(prefix="flash-"))
        self._is_closed = False
        self._programs: dict[str, subprocess.Popen[bytes]] = {}
        self._watcher = subprocess.Popen(
            ["sh", "-c", _WATCHER, "sh", str(self.path)],
            bufsize=0,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            cwd="/",
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def environment(self) -> dict[str, str]:
        """This process's environment with the private folder for all others, without a display."""
        hidden = ("DISPLAY", "WAYLAND_DISPLAY", "XAUTHORITY", "DBUS_SESSION_BUS_ADDRESS")
        others = {name: os.environ[name] for name in os.environ.keys() - set(hidden)}
        return {**others, **dict.fromkeys(_FOLDERS, str(self.path)), "TZ": "UTC", "LC_ALL": "C"}

    def start(
        self,
        name: str,
        command: Sequence[str],
        *,
        end_by: Literal["KILL", "TERM"],
        environment: Mapping[str, str],
        pass_fds: Sequence[int] = (),
    ) -> int:
        """Start a program, which writes to the file `name`.log, and return its process id."""
        with (self.path / f"{name}.log").open("wb") as log:
            program = subprocess.Popen(
                ["sh", "-c", _WAIT_THEN_RUN, "sh", *command],
                bufsize=0,
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=log,
                env=environment,
                cwd=self.path,
                pass_fds=pass_fds,
                start_new_session=True,
            )
        self._programs[name] = program
        self.inform_watcher(f"{end_by} {program.pid}")
        _write_line(program, "")
        return program.pid

    def inform_watcher(self, line: str) -> None:
        """Send a line that the watcher's script reads."""
        try:
            _write_line(self._watcher, line)
        except BrokenPipeError:
            raise FlashError(f"the process that watches over {self.path} was killed") from None

    def check_running(self) -> None:
        """Raise FlashError if a program has ended."""
        for name, program in self._programs.items():
            status = program.poll()
            if status is not None:
                how = f"exit status {status}"
                if status < 0:
                    how = signal.Signals(-status).name
                raise FlashError(f"{name} ended ({how}).{self.describe_log(name)}")

    def wait_for_end(self, name: str) -> None:
        """Wait for a program that is ending, up to 5 s, and raise FlashError."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._programs[name].wait(5.0)
        self.check_running()
        raise FlashError(f"{name} does not answer.{self.describe_log(name)}")

    def describe_log(self, name: str) -> str:
        """The last lines that a program wrote, as the end of an error message."""
        try:
            text = (self.path / f"{name}.log").read_text("utf-8", errors="replace")
        except OSError:
            return ""
        lines = [line for line in text.splitlines() if "dbus" not in line and line.strip()]
        lines = lines[-_NUM_LOG_LINES:]
        return "\nIts last lines:\n" + "\n".join(line[:300] for line in lines) if lines else ""

    def close(self) -> None:
        """End the programs and remove the folder; takes up to 4 s if a program does not end."""
        if self._is_closed:
            return
        self._is_closed = True
        with contextlib.suppress(FlashError):
            self.inform_watcher("end")
        deadline = time.monotonic() + 4.0
        for process in (*self._programs.values(), self._watcher):
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(max(0.0, deadline - time.monotonic()))
        for process in self._programs.values():  # if the watcher was killed
            if process.poll() is None:
                with contextlib.suppress(ProcessLookupError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        for process in (*self._programs.values(), self._watcher):
            if process.stdin is not None:
                process.stdin.close()
        shutil.rmtree(self.path, ignore_errors=True)


def _write_line(process: subprocess.Popen[bytes], line: str) -> None:
    if process.stdin is not None:
        process.stdin.write(line.encode() + b"\n")
