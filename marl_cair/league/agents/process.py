"""Runs agents as processes, in any language, by JSON lines on standard input and output.

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
and its agent forfeits the games it was asked about (see `foreign`). On Linux all that it has
started is killed with it, also what has left its session (`supervisor`), and memory and the
number of processes can be limited; on macOS what stays in its process group is killed, on Windows
the process alone. The protocol needs no network, but nothing keeps a process from using one, as
little as from reading files: run what you trust.
"""

from __future__ import annotations

import base64
import contextlib
import dataclasses
import json
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
from marl_cair.league.agents.allowed_code import PREFIX
from marl_cair.league.agents.foreign import (
    AgentFault,
    ForeignAgent,
    ForeignAgentError,
    digest_code,
    name_code,
    refuse_function,
)
from marl_cair.league.agents.limits import IS_SUPERVISED, Limits
from marl_cair.text import clean_text

PROTOCOL = 1
LISTS, BASE64 = "lists", "base64"  # how arrays are sent
START_SECONDS = 60.0
MAX_LINE_BYTES = 1 << 24
TOO_MANY_PROCESSES = 250  # exit code of `supervisor`
_SHOWN = 200  # characters of what a process has written instead
_END_SECONDS = 2.0  # for a supervisor to end what it has started
_SUPERVISOR = str(Path(__file__).with_name("supervisor.py"))


def load_process(
    source: str, game: Game, scenario: Any, limits: Limits | None = None
) -> ForeignAgent:
    """The agent of `process:COMMAND`; starts the command.

    limits: None: ANSWER_SECONDS for each answer. The fingerprint is of the command and of the files
    that it names.

    Raises:
        ForeignAgentError: the command cannot be started, or does not answer as it should.
    """
    try:
        command = shlex.split(source.removeprefix(PREFIX))
    except ValueError as error:
        raise ForeignAgentError(f"{source} is no command ({error})") from error
    if not command:
        raise ForeignAgentError(f"{source} names no command: give process:COMMAND")
    files = [Path(word).read_bytes() for word in command if Path(word).is_file()]
    fingerprint = f"process {digest_code(source, *files)}"
    try:
        agent, spec = _start(source, command, game, scenario, limits or Limits())
    except AgentFault as fault:
        raise ForeignAgentError(
            f"{source} {fault}: it must answer a line as marl_cair.league.agents.process says"
        ) from fault
    return ForeignAgent(agent, source, spec, fingerprint)


def load_hosted(source: str, game: Game, scenario: Any, limits: Limits) -> ForeignAgent:
    """As `foreign.load_foreign`, in a process of its own (`host`) with limits.

    It is the same agent, and plays the same: the fingerprint is of the source of the module, which
    only that process imports.

    Raises: as `load_process`; ForeignAgentError too where the module has no source.
    """
    command = [sys.executable, "-m", "marl_cair.league.agents.host", source]
    try:
        agent, spec = _start(source, command, game, scenario, limits)
    except AgentFault as fault:
        raise refuse_function(source, fault) from fault
    if not agent.digest:
        raise ForeignAgentError(
            f"{source}: its module has no file, so its version is unknown; give a function of a "
            "module that is a file"
        )
    return ForeignAgent(agent, source, spec, name_code(agent.digest))


def _start(
    source: str, command: Sequence[str], game: Game, scenario: Any, limits: Limits
) -> tuple[ProcessAgent, GameSpec]:
    """Raises AgentFault: it does not start."""
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
    return ProcessAgent(command, source, hello, limits), spec


class ProcessAgent:
    """What `ForeignAgent` wraps: an object with `act` that asks a process.

    Args:
        command: words.
        source: what the agent is called where the process gives no name.
        hello: the first message.
        limits: that of seconds for each answer but the first, which has START_SECONDS.

    Raises:
        AgentFault: the process cannot be started, or is not ready in time.
    """

    def __init__(
        self, command: Sequence[str], source: str, hello: Mapping[str, Any], limits: Limits
    ) -> None:
        self.name, self.digest, self.arrays = source, "", LISTS
        self._command, self._hello, self._limits = list(command), dict(hello), limits
        self._seed = 0
        self._line: _Line | None = None
        self._start()

    def _start(self) -> _Line:
        line = _Line(self._command, self._limits)
        self._line = line
        ready = self._ask(line, self._hello, max(START_SECONDS, self._limits.seconds))
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
        answer = self._ask(self._line or self._start(), message, self._limits.seconds)
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

    Threads read and write: a process that reads nothing would else block who writes to it. Nobody
    waits for these threads, as a pipe is open for as long as any process holds its other end.
    """

    def __init__(self, command: Sequence[str], limits: Limits) -> None:
        self._limits = limits
        try:
            self._process, control = _start_process(command, limits)
        except OSError as error:
            raise AgentFault(f"cannot be started ({error})") from error
        assert self._process.stdin is not None  # noqa: S101  # for mypy
        assert self._process.stdout is not None  # noqa: S101
        asked: queue.Queue[str | None] = queue.Queue()
        self._asked, self._told, ended = asked, queue.Queue[bytes](maxsize=8), threading.Event()
        for work, *about in (
            (_write, self._process.stdin, asked),
            (_read, self._process.stdout, self._told, ended),
        ):
            threading.Thread(target=work, args=about, daemon=True).start()
        # Also at the end of the program.
        self.close = weakref.finalize(self, _end, self._process, control, asked, ended)

    def ask(self, text: str, seconds: float) -> str:
        """The line that answers `text`. Raises AgentFault: none came, or one that is too long."""
        if not self._told.empty():
            line = self._told.get()
            raise AgentFault(
                f"wrote {_shorten(line.decode(errors='replace'))} without being asked"
                if line
                else self._describe_end()
            )
        end = time.monotonic() + seconds
        self._asked.put(text + "\n")
        try:
            line = self._told.get(timeout=max(0.0, end - time.monotonic()))
        except queue.Empty:
            raise AgentFault(f"gave no answer within {seconds:g} s") from None
        if not line:
            raise AgentFault(self._describe_end())
        if not line.endswith(b"\n"):
            raise AgentFault(f"wrote a line without an end, or of more than {MAX_LINE_BYTES} bytes")
        try:
            return line.decode()
        except UnicodeDecodeError as error:
            raise AgentFault("wrote a line that is no UTF-8") from error

    def _describe_end(self) -> str:
        try:
            code = self._process.wait(timeout=1.0)
        except subprocess.TimeoutExpired:
            return "closed its output"
        if code == TOO_MANY_PROCESSES and self._limits.processes:
            return f"started more than {self._limits.processes} processes"
        return f"ended with exit code {code}"


def _start_process(
    command: Sequence[str], limits: Limits
) -> tuple[subprocess.Popen[bytes], int | None]:
    """The process, and on Linux the end of the pipe whose closing ends it."""
    pipe: list[int] = list(os.pipe()) if IS_SUPERVISED else []
    if pipe:
        words = [pipe[0], limits.memory_bytes, limits.processes]
        # Nothing is imported but the standard library, whatever lies in the current folder.
        command = [sys.executable, "-I", "-S", _SUPERVISOR, *map(str, words), *command]
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=os.name != "nt",
            pass_fds=pipe[:1],
        )
    except OSError:
        for number in pipe:
            os.close(number)
        raise
    if not pipe:
        return process, None
    os.close(pipe[0])
    return process, pipe[1]


def _read(stream: IO[bytes], lines: queue.Queue[bytes], ended: threading.Event) -> None:
    while not ended.is_set():
        line = stream.readline(MAX_LINE_BYTES)
        while not ended.is_set():
            with contextlib.suppress(queue.Full):
                lines.put(line, timeout=1.0)
                break
        if not line:
            break
    stream.close()


def _write(stream: IO[bytes], asked: queue.Queue[str | None]) -> None:
    with contextlib.suppress(OSError):  # it has ended: who reads finds out
        while (text := asked.get()) is not None:
            stream.write(text.encode())
            stream.flush()
    with contextlib.suppress(OSError):
        stream.close()


def _end(
    process: subprocess.Popen[bytes],
    control: int | None,
    asked: queue.Queue[str | None],
    ended: threading.Event,
) -> None:
    """Kill the process and what it has started, and let both threads end."""
    ended.set()
    asked.put(None)
    if control is not None:
        os.close(control)
        try:
            process.wait(_END_SECONDS)
        except subprocess.TimeoutExpired:  # the agent has stopped its supervisor
            from marl_cair.league.agents.supervisor import kill_below  # of Linux alone

            kill_below(process.pid)
            process.send_signal(signal.SIGCONT)  # it kills what a list of children has missed
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(_END_SECONDS)
    # A supervisor that ended by itself has killed everything; one that was killed could not.
    if process.returncode is None or process.returncode < 0:
        with contextlib.suppress(OSError):
            if os.name == "nt":
                process.kill()
            else:
                os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _shorten(text: str) -> str:
    plain = clean_text(text)
    return plain if len(plain) <= _SHOWN else f"{plain[:_SHOWN]}..."
