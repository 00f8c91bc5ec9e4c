"""Runs agents as processes, in any language, by JSON lines on standard input and output.

An agent is named `process:COMMAND`, for example `process:python bots/mine.py`. Each line is one
JSON object. The league sends

    {"type": "hello", "protocol": 1, "game": "deep_line_wars", "game_version": "...",
     "scenario": {...}, "actions": ["noop", ...], "action_shape": [],
     "representations": {"vector": {"shape": [12], "dtype": "float32"}, ...}}

The answer is {"type": "ready"}, optionally with "name" and "representation" (default: the first),
or {"error": "why"}. Then, for each step of N games, the league sends

    {"type": "act", "seed": 123, "num": 2, "observations": [...], "masks": [...]}

`observations` are N nested lists of the representation's shape, `masks` N lists (of `action_shape`)
of true for each legal action; `seed` is another number in each message, for random draws. The
answer is {"actions": [3, 0, ...]}, N numbers (lists of `action_shape`), or {"error": "why"}, which
forfeits the games. Messages are independent: the games of one are not those of the last. The
process must end when its input ends.

A process with a memory of each game answers `hello` with "state_size": S, above 0. Then each `act`
has a "state" too, N lists of S numbers: 0 when a game begins, and then what the process has
answered as {"actions": [...], "state": [...]} at the game's last step. The league stores them as
float32, so a process that starts again, or gets other games together, plays the same.

A process that answers `hello` with "arrays": "base64" receives all arrays as the Base64 of their
bytes, in C order: observations in the representation's dtype and this machine's byte order, masks
as one byte for each action, states as float32. This is much faster for pictures. It answers states
in the same way.

Every answer has a time limit. A process that misses it, ends, or writes anything else is killed,
and its agent forfeits the games of that message (see `foreign`). On Linux all processes that it
has started are killed too, also those that have left its session (`supervisor`), and memory and
the number of processes can be limited; on macOS those in its process group are killed, on Windows
the process alone. The protocol needs no network, but a process can use one, and can read files:
run only code that you trust.
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
from marl_cair.league.agents import foreign
from marl_cair.league.agents.allowed_code import IS_SUPERVISED, PREFIX, Limits
from marl_cair.league.agents.foreign import AgentFault, ForeignAgent, ForeignAgentError
from marl_cair.text import clean_text

PROTOCOL = 1
LISTS, BASE64 = "lists", "base64"  # how arrays are sent
START_SECONDS = 60.0
MAX_LINE_BYTES = 1 << 24
TOO_MANY_PROCESSES = 250  # exit code of `supervisor`
_SHOWN = 200  # characters of a wrong answer in an error
_END_SECONDS = 5.0  # for a supervisor to end the processes below it
_EXIT_SECONDS = 10.0  # for a process that has closed its output to end
_SUPERVISOR = str(Path(__file__).with_name("supervisor.py"))


def load_process(source: str, game: Game, scenario: Any, limits: Limits) -> ForeignAgent:
    """Start the command of `process:COMMAND`; returns its agent. The fingerprint is of the command
    and of the files that it names.

    Raises ForeignAgentError: the command cannot be started, or does not follow the protocol.
    """
    try:
        command = shlex.split(source.removeprefix(PREFIX))
    except ValueError as error:
        raise ForeignAgentError(f"{source} is no command ({error})") from error
    if not command:
        raise ForeignAgentError(f"{source} names no command: give process:COMMAND")
    files = [Path(word).read_bytes() for word in command if Path(word).is_file()]
    fingerprint = f"process {foreign.digest_code(source, *files)}"
    try:
        agent, spec = _start(source, command, game, scenario, limits)
    except AgentFault as fault:
        raise ForeignAgentError(
            f"{source} {fault}: it must answer a line as marl_cair.league.agents.process says"
        ) from fault
    return ForeignAgent(agent, source, spec, fingerprint)


def load_hosted(source: str, game: Game, scenario: Any, limits: Limits) -> ForeignAgent:
    """As `foreign.load_foreign`, in a process of its own (`host`) with limits.

    It is the same agent with the same fingerprint, and plays the same; only the other process
    imports the module.

    Raises: as `load_process`; ForeignAgentError also if the module has no source file.
    """
    command = [sys.executable, "-m", "marl_cair.league.agents.host", source]
    try:
        agent, spec = _start(source, command, game, scenario, limits)
    except AgentFault as fault:
        raise foreign.refuse_function(source, fault) from fault
    if not agent.digest:
        raise ForeignAgentError(
            f"{source}: its module has no file, so its version is unknown; give a function of a "
            "module that is a file"
        )
    return ForeignAgent(agent, source, spec, f"foreign {agent.digest}")


def _start(
    source: str, command: Sequence[str], game: Game, scenario: Any, limits: Limits
) -> tuple[ProcessAgent, GameSpec]:
    """Raises AgentFault if it does not start."""
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
    """The object for `ForeignAgent` whose `act` asks a process.

    Args:
        command: words.
        source: the agent's name, unless the process gives another.
        hello: the first message.
        limits: the seconds hold for each answer; the first one has START_SECONDS at least.

    Raises AgentFault: the process cannot be started, or is not ready in time.
    """

    def __init__(
        self, command: Sequence[str], source: str, hello: Mapping[str, Any], limits: Limits
    ) -> None:
        self.name, self.digest, self.arrays = source, "", LISTS
        self.state_size: Any = 0  # checked by `ForeignAgent`
        self._command, self._hello, self._limits = list(command), dict(hello), limits
        self._seed = 0
        self._connection: _Connection | None = None
        self._start()

    def _start(self) -> _Connection:
        self._connection = connection = _Connection(self._command, self._limits)
        ready = self._ask(connection, self._hello, max(START_SECONDS, self._limits.seconds))
        if ready.get("type") != "ready":
            other = f"wrote {_shorten(json.dumps(ready))}, and not that it is ready"
            raise self._fail(_shorten(str(ready["error"])) if "error" in ready else other)
        if self.digest and ready.get("digest") != self.digest:
            raise self._fail("is no longer the agent that has begun: its code has changed")
        for attribute in ("name", "representation", "digest", "arrays"):
            if attribute in ready:
                setattr(self, attribute, str(ready[attribute]))
        self.state_size = ready.get("state_size", 0)
        if self.arrays not in (LISTS, BASE64):
            raise self._fail(f"wants arrays as {self.arrays!r}: there are {LISTS} and {BASE64}")
        return connection

    def _fail(self, text: str) -> AgentFault:
        """Kill the process, whose next answers may belong to earlier questions."""
        if self._connection is not None:
            self._connection.close()
        self._connection = None
        return AgentFault(text)

    def _ask(
        self, connection: _Connection, message: Mapping[str, Any], seconds: float
    ) -> dict[str, Any]:
        try:
            answer = json.loads(connection.ask(json.dumps(message), seconds))
        except AgentFault as fault:
            raise self._fail(str(fault)) from fault
        except (ValueError, RecursionError) as error:
            raise self._fail("wrote a line that is no JSON") from error
        if not isinstance(answer, dict):
            raise self._fail(f"wrote {_shorten(json.dumps(answer))}, and no JSON object")
        return answer

    def seed(self, seed: int) -> None:
        """Set the seed of the next message."""
        self._seed = seed

    def act(
        self,
        observation: NDArray[Any],
        action_mask: NDArray[np.bool_],
        state: NDArray[np.float32] | None = None,
    ) -> Any:
        message = {
            "type": "act",
            "seed": self._seed,
            "num": len(action_mask),
            "observations": self._encode(observation),
            "masks": self._encode(action_mask),
        }
        if state is not None:
            message["state"] = self._encode(state)
        answer = self._ask(self._connection or self._start(), message, self._limits.seconds)
        if "error" in answer:
            raise AgentFault(_shorten(str(answer["error"])))
        if "actions" not in answer:
            raise self._fail(f"wrote {_shorten(json.dumps(answer))}, without `actions`")
        if state is None:
            return answer["actions"]
        after = answer.get("state")
        if isinstance(after, str):
            after = np.frombuffer(base64.b64decode(after), np.float32).reshape(state.shape)
        return answer["actions"], after

    def _encode(self, array: NDArray[Any]) -> Any:
        is_packed = self.arrays == BASE64
        return base64.b64encode(array.tobytes()).decode() if is_packed else array.tolist()


class _Connection:
    """A process and the lines to and from it; all its processes are killed by `close`, when it is
    garbage-collected, and when this program ends.

    Threads read and write, since a process that does not read would block a writer. They are not
    joined, as a pipe stays open while any process holds its other end.
    """

    def __init__(self, command: Sequence[str], limits: Limits) -> None:
        self._limits = limits
        try:
            self._process, control = _start_process(command, limits)
        except OSError as error:
            raise AgentFault(f"cannot be started ({error})") from error
        assert self._process.stdin is not None  # noqa: S101  # for mypy
        assert self._process.stdout is not None  # noqa: S101
        questions: queue.Queue[str | None] = queue.Queue()
        self._questions, self._answers = questions, queue.Queue[bytes](maxsize=8)
        ended = threading.Event()
        for work, *about in (
            (_write, self._process.stdin, questions),
            (_read, self._process.stdout, self._answers, ended),
        ):
            threading.Thread(target=work, args=about, daemon=True).start()
        self.close = weakref.finalize(self, _end, self._process, control, questions, ended)

    def ask(self, text: str, seconds: float) -> str:
        """Send a line, and return its answer. Raises AgentFault: none came, or one too long."""
        if not self._answers.empty():
            line = self._answers.get()
            raise AgentFault(
                f"wrote {_shorten(line.decode(errors='replace'))} without being asked"
                if line
                else self._describe_end()
            )
        end = time.monotonic() + seconds
        self._questions.put(text + "\n")
        try:
            line = self._answers.get(timeout=max(0.0, end - time.monotonic()))
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
            code = self._process.wait(_EXIT_SECONDS)
        except subprocess.TimeoutExpired:
            return "closed its output"
        if code == TOO_MANY_PROCESSES and self._limits.processes:
            return f"started more than {self._limits.processes} processes"
        return f"ended with exit code {code}"


def _start_process(
    command: Sequence[str], limits: Limits
) -> tuple[subprocess.Popen[bytes], int | None]:
    """The process, and on Linux the end of a pipe that ends the process when it is closed."""
    pipe: list[int] = list(os.pipe()) if IS_SUPERVISED else []
    if pipe:
        words = [pipe[0], limits.memory_bytes, limits.processes]
        # Only the standard library is imported, whatever lies in the current folder.
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


def _read(stream: IO[bytes], answers: queue.Queue[bytes], ended: threading.Event) -> None:
    while not ended.is_set():
        line = stream.readline(MAX_LINE_BYTES)
        while not ended.is_set():
            with contextlib.suppress(queue.Full):
                answers.put(line, timeout=1.0)
                break
        if not line:
            break
    stream.close()


def _write(stream: IO[bytes], questions: queue.Queue[str | None]) -> None:
    with contextlib.suppress(OSError):  # the process has ended: the reader notices
        while (text := questions.get()) is not None:
            stream.write(text.encode())
            stream.flush()
    with contextlib.suppress(OSError):
        stream.close()


def _end(
    process: subprocess.Popen[bytes],
    control: int | None,
    questions: queue.Queue[str | None],
    ended: threading.Event,
) -> None:
    """Kill the process and all below it, and let both threads end."""
    ended.set()
    questions.put(None)
    if control is not None:
        os.close(control)
        try:
            process.wait(_END_SECONDS)
        except subprocess.TimeoutExpired:  # the agent has stopped its supervisor
            from marl_cair.league.agents.supervisor import kill_below  # only on Linux

            kill_below(process.pid)
            process.send_signal(signal.SIGCONT)  # it kills what a list of children has missed
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(_END_SECONDS)
    # A supervisor that has ended by itself has killed everything; a killed one has not.
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
