"""Speed of Deep RTS beside other fast games, in one run and under the same clock.

    python -m benchmarks.peers [--seconds 3.0] [--processor-time] [--griddly PYTHON]
                               [--microrts PYTHON] [--generals PYTHON] [--puffer PYTHON]

Each option names the Python that has that peer; `install` in PEERS says how to get it, and without
an option the row says the same. A peer plays in a process of its own, driven by one script of
benchmarks/peer_drivers. All take turns, best of 5 turns each. Every process is tied to one and the
same core where the system can do that (Linux), so that the threads of JAX and Java count too; on a
machine that others use, --processor-time counts the seconds that each side computed.

An agent-step is one tick seen and acted upon by one player. Ours: 256 worlds of 1v1-15x15 at one
tick a decision, with the planes and the masks of both seats, each seat's action drawn from its mask
in the measured time, resets included. What the peers play stands in their rows.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from benchmarks.deep_rts import Workload, prepare
from benchmarks.engine import REPEATS, measure_once

DRIVERS = Path(__file__).parent / "peer_drivers"
MAP = "15x15-2p-crossing"
PLAYERS = 2
WORLDS = 256


@dataclass(frozen=True)
class Peer:
    """A game that is measured beside ours."""

    name: str
    option: str  # of the command line: the interpreter that has it
    driver: tuple[str, ...]  # the script in DRIVERS, and its words
    install: str


_PUFFER = (
    "pip install pufferlib==3.0.0 torch, Python 3.11 (its build needs torch and downloads from "
    "GitHub)"
)
PEERS = (
    Peer(
        "MicroRTS (gym-microrts 0.6.0)",
        "microrts",
        ("microrts_16x16.py",),
        "pip install gym-microrts==0.6.0 pillow, Python 3.9; a Java runtime",
    ),
    Peer(
        "generals-bots 2.6.0 (JAX)",
        "generals",
        ("generals_16x16.py",),
        "as github.com/strakam/generals-bots says, Python 3.11 (2.5 of PyPI is not the JAX one)",
    ),
    Peer(
        "Griddly 1.6.7, GriddlyRTS",
        "griddly",
        ("griddly_rts.py",),
        "pip install griddly==1.6.7 'numpy<2', Python 3.11",
    ),
    Peer("PufferLib 3.0, MOBA", "puffer", ("puffer_ocean.py", "moba"), _PUFFER),
    Peer("PufferLib 3.0, Neural MMO 3", "puffer", ("puffer_ocean.py", "nmmo3"), _PUFFER),
    Peer("PufferLib 3.0, Snake", "puffer", ("puffer_ocean.py", "snake"), _PUFFER),
)


class PeerError(Exception):
    """A peer's interpreter could not be run, or its driver did not answer with a rate."""


@dataclass
class Driver:
    """A peer in its own process, which plays when asked and waits in between."""

    peer: Peer
    process: subprocess.Popen[str]
    errors: IO[str]  # what the process wrote to standard error
    description: str = ""  # of what is played

    def measure(self, seconds: float) -> float:
        """Agent-steps per second of so many seconds of play.

        Raises:
            PeerError: the message names the peer and what it said last.
        """
        try:
            _pipe(self.process.stdin).write(f"{seconds}\n")
            _pipe(self.process.stdin).flush()
            # Libraries greet on standard output when they are imported.
            answers = (line for line in _pipe(self.process.stdout) if line.startswith("{"))
            answer = json.loads(next(answers))
            self.description = str(answer["description"])
            return float(answer["agent_steps_per_second"])
        except (OSError, StopIteration, ValueError, KeyError) as error:
            self.errors.seek(0)
            said = self.errors.read().strip().splitlines() or ["no rate in its answer"]
            raise PeerError(f"{self.peer.name} failed: {said[-1]}") from error


@contextmanager
def start(peer: Peer, python: Path, processor_time: bool) -> Iterator[Driver]:
    """The peer's process, ended with the context.

    Raises:
        PeerError: the interpreter cannot be run.
    """
    script, *words = peer.driver
    command = [str(python.absolute()), str(DRIVERS / script), *words]
    command += ["--processor-time"] * processor_time
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    environment.pop("PYTHONPATH", None)  # ours: another Python's packages would be found
    # Some write where they stand. An unread pipe of errors would fill up.
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryFile("w+") as errors:
        try:
            process = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                cwd=folder,
                env=environment,
            )
        except OSError as error:
            raise PeerError(f"{peer.name}: {python} cannot be run: {error.strerror}") from error
        try:
            yield Driver(peer, process, errors)
        finally:
            process.kill()
            process.communicate()


def _pipe(pipe: IO[str] | None) -> IO[str]:
    if pipe is None:
        raise TypeError("the process was started without this pipe")
    return pipe


@dataclass
class Row:
    """One line of the table."""

    name: str
    measure: Callable[[float], float]  # seconds to agent-steps per second
    best: float = 0.0


def make_own_row(actions: str, clock: Callable[[], float]) -> Row:
    """Deep RTS with one of its action spaces."""
    workload = Workload(
        actions, MAP, PLAYERS, "balanced", reads="planes and masks", actions=actions, legal=True
    )
    play, _ = prepare(workload, WORLDS)
    play()
    return Row(f"Deep RTS, {actions}", lambda seconds: PLAYERS * measure_once(play, seconds, clock))


def print_table(options: argparse.Namespace) -> None:
    """Measure all in turn and print the rows."""
    clock = time.process_time if options.processor_time else time.perf_counter
    interpreters = {peer: getattr(options, peer.option) for peer in PEERS}
    with ExitStack() as stack:
        drivers = [
            stack.enter_context(start(peer, python, options.processor_time))
            for peer, python in interpreters.items()
            if python
        ]
        for driver in drivers:
            driver.measure(0.0)  # a peer that fails does so now, not after minutes
        own = [make_own_row(actions, clock) for actions in ("classic", "unit")]
        rows = [Row(driver.peer.name, driver.measure) for driver in drivers]
        for _ in range(REPEATS):
            for row in own + rows:
                row.best = max(row.best, row.measure(options.seconds))
    tied = "one core" if sys.platform == "linux" else "as many cores as each takes"
    print(f"agent-steps per second, {tied}, best of {REPEATS} turns; ours divided by theirs\n")
    print("| game | agent-steps/s | " + " | ".join(f"ours, {row.name[10:]}" for row in own), end="")
    print(" | what was played |\n|---|---|---|---|---|")
    what = f"15x15, {PLAYERS} players, planes, masks, random legal actions, {WORLDS} worlds"
    described: list[tuple[Row, str]] = [(row, what) for row in own]
    described += [(row, driver.description) for row, driver in zip(rows, drivers, strict=True)]
    for row, what in described:
        ratios = " | ".join(f"{ours.best / row.best:.2f}" for ours in own)
        print(f"| {row.name} | {row.best:,.0f} | {ratios} | {what} |")
    for peer, python in interpreters.items():
        if not python:
            print(f"| {peer.name} | not installed | | | --{peer.option}: {peer.install} |")


def main() -> None:
    """Read the options, measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3.0, help="of each turn")
    parser.add_argument(
        "--processor-time", action="store_true", help="seconds computed, not passed"
    )
    for option in dict.fromkeys(peer.option for peer in PEERS):
        parser.add_argument(f"--{option}", type=Path, help="the Python that has it")
    options = parser.parse_args()
    if sys.platform == "linux":
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    try:
        print_table(options)
    except PeerError as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
