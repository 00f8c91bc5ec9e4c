"""Agents that are processes of their own, in any language: JSON lines on standard input and output.

Named `process:COMMAND`, for example `process:python bots/mine.py`. Each line is one JSON object. At
the start the league sends

    {"type": "hello", "protocol": 1, "game": "deep_line_wars", "game_version": "...",
     "scenario": {...}, "actions": ["noop", ...], "action_shape": [],
     "representations": {"vector": {"shape": [12], "dtype": "float32"}, ...}}

which is answered by {"type": "ready"}, with "name" and "representation" if wanted (else the first),
or by {"error": "why"}.
Then, for each decision of N games,

    {"type": "act", "seed": 123, "num": 2, "observations": [...], "masks": [...]}

observations are N nested lists of the representation's shape, masks N lists (of `action_shape`) of
true for each legal action; seed is another number for each decision, to draw from. The answer is
{"actions": [3, 0, ...]}, N numbers (lists of `action_shape`), or {"error": "why"} to give the games
up. Decisions know nothing of each other: the games of a message are not those of the last. The
process is to end when its input ends.

Pictures are long lists. Who is ready with "arrays": "base64" gets both arrays as the Base64 of
their bytes, row by row: of observations in the representation's dtype and this machine's byte
order, of masks a byte each.

Every answer has a time limit. A process that misses it, ends, or writes anything else is killed,
and its agent forfeits the games it was asked about (see `league.foreign`). The protocol needs no
network, but nothing keeps a process from using one, as little as from reading files: run what you
trust.
"""

from __future__ import annotations

import base64
import contextlib
import dataclasses
import json
import math
import os
import queue
import shlex
import signal
import subprocess
import sys
import threading
import time
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import Game, GameSpec
from marl_cair.league.foreign import (
    AgentFault,
    ForeignAgent,
    ForeignAgentError,
    digest_code,
    name_code,
    refuse_function,
)

PREFIX = "process:"
PROTOCOL = 1
LISTS, BASE64 = "lists", "base64"  # how arrays are sent
ANSWER_SECONDS, START_SECONDS = 10.0, 60.0
FUNCTION_SECONDS = 60.0  # what the commands give functions: these may be networks without a GPU
MAX_LINE_BYTES = 1 << 24
_SHOWN = 200  # characters of what a process has written instead


def is_process(source: str | os.PathLike[str]) -> bool:
    """Whether `source` names a command."""
    return str(source).startswith(PREFIX)


def load_process(
    source: str, game: Game, scenario: Any, answer_seconds: float | None = None
) -> ForeignAgent:
    """The agent of `process:COMMAND`; starts the command.

    answer_seconds: the limit for each answer; None: ANSWER_SECONDS. The fingerprint is of the
    command and of the files that it names.

    Raises:
        ForeignAgentError: the command cannot be started, or does not answer as it should.
        ValueError: no such limit.
    """
    try:
        command = shlex.split(source.removeprefix(PREFIX))
    except ValueError as error:
        raise ForeignAgentError(f"{source} is no command ({error})") from error
    if not command:
        raise ForeignAgentError(f"{source} names no command: give process:COMMAND")
    files = [Path(word).read_bytes() for word in command if Path(word).is_file()]
    fingerprint = f"process {digest_code(source, *files)}"
    limit = ANSWER_SECONDS if answer_seconds is None else answer_seconds
    try:
        agent, spec = _start(source, command, game, scenario, limit)
    except AgentFault as fault:
        raise ForeignAgentError(
            f"{source} {fault}: it must answer a line as marl_cair.league.process says"
        ) from fault
    return ForeignAgent(agent, source, spec, fingerprint)


def load_hosted(source: str, game: Game, scenario: Any, answer_seconds: float) -> ForeignAgent:
    """As `foreign.load_foreign`, in a process of its own (`league.host`) with a time limit.

    It is the same agent, and plays the same: the fingerprint is of the source of the module, which
    only that process imports.

    Raises: as `load_process`; ForeignAgentError too where the module has no source.
    """
    command = [sys.executable, "-m", "marl_cair.league.host", source]
    try:
        agent, spec = _start(source, command, game, scenario, answer_seconds)
    except AgentFault as fault:
        raise refuse_function(source, fault) from fault
    if not agent.digest:
        raise ForeignAgentError(
            f"{source}: the module has no file to tell its versions apart by; give a function of a "
            "module that is a file"
        )
    return ForeignAgent(agent, source, spec, name_code(agent.digest))


def _start(
    source: str, command: Sequence[str], game: Game, scenario: Any, limit: float
) -> tuple[ProcessAgent, GameSpec]:
    """Raises AgentFault: it does not start; ValueError: no such limit."""
    if not 0.0 < limit < math.inf:
        raise ValueError(f"answer_seconds is {limit}, it must be above 0 and finite")
    spec = game.make_spec(scenario)
    hello = {
        "type": "hello",
        "protocol": PROTOCOL,
        "game": game.name,
        "game_version": game.version,
        "scenario": dataclasses.asdict(scenario),
        "actions": list(spec.action_names),
        "action_shape": list(spec.action_shape),
        "representations": {
            name: {"shape": list(seen.shape), "dtype": np.dtype(seen.dtype).name}
            for name, seen in spec.representations.items()
        },
    }
    return ProcessAgent(command, source, hello, limit), spec


class ProcessAgent:
    """What `ForeignAgent` wraps: an object with `act` that asks a process.

    Args:
        command: words.
        source: what the agent is called where the process gives no name.
        hello: the first message.
        answer_seconds: limit for each answer but the first, which has START_SECONDS.

    Raises:
        AgentFault: the process cannot be started, or is not ready in time.
    """

    def __init__(
        self, command: Sequence[str], source: str, hello: Mapping[str, Any], answer_seconds: float
    ) -> None:
        self.name, self.digest, self.arrays = source, "", LISTS
        self._command, self._hello, self._limit = list(command), dict(hello), answer_seconds
        self._seed = 0
        self._line: _Line | None = None
        self._start()

    def _start(self) -> _Line:
        line = _Line(self._command)
        self._line = line
        ready = self._ask(line, self._hello, max(START_SECONDS, self._limit))
        if ready.get("type") != "ready":
            self._stop()
            if "error" in ready:
                raise AgentFault(_shorten(str(ready["error"])))
            raise AgentFault(f"wrote {_shorten(json.dumps(ready))}, and not that it is ready")
        if self.digest and ready.get("digest") != self.digest:
            self._stop()
            raise AgentFault("is no longer the agent that has begun: its code has changed")
        for attribute in ("name", "representation", "digest", "arrays"):
            if attribute in ready:
                setattr(self, attribute, str(ready[attribute]))
        if self.arrays not in (LISTS, BASE64):
            self._stop()
            raise AgentFault(f"wants arrays as {self.arrays!r}: there are {LISTS} and {BASE64}")
        return line

    def _stop(self) -> None:
        if self._line is not None:
            self._line.close()
        self._line = None

    def _ask(self, line: _Line, message: Mapping[str, Any], seconds: float) -> dict[str, Any]:
        try:
            answer = json.loads(line.ask(json.dumps(message), seconds))
            if isinstance(answer, dict):
                return answer
            raise AgentFault(f"wrote {_shorten(json.dumps(answer))}, and no JSON object")
        except (AgentFault, ValueError) as error:  # a process that was out of step once may stay so
            self._stop()
            if isinstance(error, AgentFault):
                raise
            raise AgentFault("wrote a line that is no JSON") from error

    def seed(self, seed: int) -> None:
        """What the next decision is to draw from."""
        self._seed = seed

    def act(self, observation: NDArray[Any], action_mask: NDArray[np.bool_]) -> Any:
        message = {
            "type": "act",
            "seed": self._seed,
            "num": len(action_mask),
            "observations": self._write(observation),
            "masks": self._write(action_mask),
        }
        answer = self._ask(self._line or self._start(), message, self._limit)
        if "error" in answer:
            raise AgentFault(_shorten(str(answer["error"])))
        if "actions" not in answer:
            self._stop()
            raise AgentFault(f"wrote {_shorten(json.dumps(answer))}, without `actions`")
        return answer["actions"]

    def _write(self, array: NDArray[Any]) -> Any:
        is_packed = self.arrays == BASE64
        return base64.b64encode(array.tobytes()).decode() if is_packed else array.tolist()


class _Line:
    """A process and the lines to and from it; killed with all that it has started when forgotten.

    Threads read and write: a process that reads nothing would else block who writes to it.
    """

    def __init__(self, command: Sequence[str]) -> None:
        try:
            self._process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=os.name != "nt",
            )
        except OSError as error:
            raise AgentFault(f"cannot be started ({error})") from error
        assert self._process.stdin is not None  # noqa: S101  # for mypy
        assert self._process.stdout is not None  # noqa: S101
        self._asked: queue.Queue[str | None] = queue.Queue()
        self._told: queue.Queue[bytes] = queue.Queue(maxsize=8)
        self._threads = [
            threading.Thread(target=_write, args=(self._process.stdin, self._asked), daemon=True),
            threading.Thread(target=_read, args=(self._process.stdout, self._told), daemon=True),
        ]
        for thread in self._threads:
            thread.start()
        # Also at the end of the program.
        self.close = weakref.finalize(self, _end, self._process, self._asked, self._told)

    def ask(self, text: str, seconds: float) -> str:
        """The line that answers `text`. Raises AgentFault: none came, or one that is too long."""
        if not self._told.empty():
            line = self._told.get()
            raise AgentFault(
                f"wrote {_shorten(line.decode(errors='replace'))} without being asked"
                if line
                else self._tell_end()
            )
        end = time.monotonic() + seconds
        self._asked.put(text + "\n")
        try:
            line = self._told.get(timeout=max(0.0, end - time.monotonic()))
        except queue.Empty:
            raise AgentFault(f"gave no answer within {seconds:g} s") from None
        if not line:
            raise AgentFault(self._tell_end())
        if not line.endswith(b"\n"):
            raise AgentFault(f"wrote a line without an end, or of more than {MAX_LINE_BYTES} bytes")
        try:
            return line.decode()
        except UnicodeDecodeError as error:
            raise AgentFault("wrote a line that is no UTF-8") from error

    def _tell_end(self) -> str:
        try:
            return f"ended with exit code {self._process.wait(timeout=1.0)}"
        except subprocess.TimeoutExpired:
            return "closed its output"


def _read(stream: IO[bytes], told: queue.Queue[bytes]) -> None:
    while True:
        try:
            line = stream.readline(MAX_LINE_BYTES)
        except (OSError, ValueError):  # closed meanwhile
            line = b""
        told.put(line)
        if not line:
            return


def _write(stream: IO[bytes], asked: queue.Queue[str | None]) -> None:
    while (text := asked.get()) is not None:
        try:
            stream.write(text.encode())
            stream.flush()
        except (OSError, ValueError):  # it has ended: who reads finds out
            return


def _end(
    process: subprocess.Popen[bytes], asked: queue.Queue[str | None], told: queue.Queue[bytes]
) -> None:
    """Kill the process and what it has started, and let both threads end."""
    with contextlib.suppress(OSError):
        if os.name == "nt":
            process.kill()
        else:
            os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    asked.put(None)
    with contextlib.suppress(queue.Empty):  # a reader may wait for room
        while True:
            told.get_nowait()
    for stream in (process.stdin, process.stdout):
        with contextlib.suppress(OSError):
            if stream is not None:
                stream.close()


def _shorten(text: str) -> str:
    plain = " ".join(text.split())
    return plain if len(plain) <= _SHOWN else f"{plain[:_SHOWN]}..."
