"""Speed, latency and memory of Flash games in a browser.

    python -m benchmarks.flash [--seconds 3] [--instances 1 2 4]

Steps per second are by the clock, so they depend on what else the machine does. Processor time,
in milliseconds per step, is that of the browsers with their displays, and of Python. `empty` draws
nothing: it is the floor of page, socket and Python. `duel` is measured in its stage, whose keys go
up and down. `multitask` is measured in the first 2000 frames of a game of the bot `juggler`, whose
keys are recorded before: all four tasks are open at the end. With resets a game begins every 60
frames, as in random play. The real-time rows use a file of the tests whose picture changes in each
of its 60 frames per second. PSS (proportional set size) is of all processes of the browsers. Needs
Linux. Prints Markdown tables.
"""

from __future__ import annotations

import argparse
import os
import re
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np

import marl_cair
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.flash.bots import play_multitask
from marl_cair.games.flash.browser.rfb import RFBClient
from marl_cair.games.flash.browser.server import FlashServer, KeyEvent
from marl_cair.games.flash.description import FOLDER
from marl_cair.games.flash.rules import close_spare_browsers

SIZE, SMALL = (480, 360), (84, 84)
PROBE = Path(__file__).parents[1] / "tests/games/flash/browser/probe/probe.swf"
LIGHT = slice(5, 35)  # rows and columns of the probe that are green while a key is held
WARM_UP = 20  # calls before the clock starts
SHORT_GAME = 60  # frames
CLOCK_TICKS = os.sysconf("SC_CLK_TCK")


def pack_empty() -> bytes:
    """A Flash file of 480 x 360 pixels with one empty frame."""
    sides = "".join(f"{20 * side:015b}" for side in (0, SIZE[0], 0, SIZE[1]))
    box = int(f"{15:05b}{sides}".ljust(72, "0"), 2).to_bytes(9, "big")
    body = box + bytes((0, 30, 1, 0)) + b"\x40\0\0\0"  # 30 frames per second, 1 frame; show, end
    return b"FWS\5" + (8 + len(body)).to_bytes(4, "little") + body


class Usage(NamedTuple):
    """Seconds: by the clock, of the processor in Python, and in its child processes."""

    clock: float
    python: float
    browsers: float

    @classmethod
    def now(cls) -> Usage:
        """What has been used until now."""
        browsers = sum(seconds for _, seconds in find_children())
        return cls(time.perf_counter(), time.process_time(), browsers)


def find_children() -> Iterator[tuple[int, float]]:
    """Process id and processor seconds of each descendant of this process."""
    parents, seconds = {}, {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except (FileNotFoundError, ProcessLookupError):
            continue
        pid = int(path.parent.name)
        parents[pid] = int(fields[1])
        seconds[pid] = (int(fields[11]) + int(fields[12])) / CLOCK_TICKS
    found = {os.getpid()}
    while more := {pid for pid, parent in parents.items() if parent in found} - found:
        found |= more
    for pid in found - {os.getpid()}:
        yield pid, seconds[pid]


def measure_memory() -> float:
    """PSS of all child processes in MiB."""
    total = 0
    for pid, _ in find_children():
        text = Path(f"/proc/{pid}/smaps_rollup").read_text()
        total += int(re.search(r"^Pss: +(\d+) kB", text, re.MULTILINE)[1])  # type: ignore[index]
    return total / 1024


def measure(step: Callable[[int], Any], seconds: float, per_call: int = 1) -> str:
    """Columns of a table: `step(n)`, which makes `per_call` steps, is called for some seconds."""
    for number in range(WARM_UP):
        step(number)
    before, number = Usage.now(), WARM_UP
    while time.perf_counter() - before.clock < seconds:
        step(number)
        number += 1
    clock, *used = (b - a for a, b in zip(before, Usage.now(), strict=True))
    steps = (number - WARM_UP) * per_call
    python, browsers = (1000 * one / steps for one in used)
    return f"{steps / clock:,.0f} | {browsers:.2f} | {python:.2f}"


@contextmanager
def start(
    swf: Path, num_instances: int = 1, transport: Any = "bridge"
) -> Iterator[list[FlashServer]]:
    """Lockstep servers."""
    with ExitStack() as stack:
        servers = []
        for _ in range(num_instances):
            server = FlashServer(swf, SIZE, 30, mode="lockstep", transport=transport)
            servers.append(stack.enter_context(server))
        yield servers


Keys = Sequence[Sequence[KeyEvent]]  # what changes before each frame of a game
UP_AND_DOWN = [[KeyEvent("up", frame % 2 == 0)] for frame in range(1500)]  # before duel's end


def begin(server: FlashServer) -> None:
    """Start a game with seed 0."""
    server.reset(0)
    server.step(2, [KeyEvent("enter", True)], None)
    server.step(1, [KeyEvent("enter", False)], None)


def record_multitask(num_frames: int = 2000) -> Keys:
    """Keys of the bot `juggler`, which is asked before each frame."""
    recorded: list[list[KeyEvent]] = []
    with start(FOLDER / "multitask.swf") as (server,):
        server.watch("getState")
        begin(server)
        while len(recorded) < num_frames:
            state = server.values["getState"]
            if state["done"]:
                raise RuntimeError(f"juggler has lost the game after {len(recorded)} frames")
            keys = play_multitask(state)
            names = ("left", "right", "up", "down")
            recorded.append([KeyEvent(name, name in keys) for name in names])
            server.step(1, recorded[-1], None)
    return recorded


def play(
    servers: Sequence[FlashServer], keys: Keys, picture: Any, frames: int, number: int
) -> None:
    """One step of all servers, at the same time; a new game where the keys are used up."""
    frame = number * frames % len(keys)
    if frame < frames:
        for server in servers:
            begin(server)
    for server in servers:
        server.begin_step(frames, keys[frame], picture)
    for server in servers:
        server.end_step()


def print_steps(seconds: float, instances: Sequence[int], empty: Path) -> None:
    """Steps of servers, without the engine."""
    duel, multitask = FOLDER / "duel.swf", FOLDER / "multitask.swf"
    keys = {empty: UP_AND_DOWN, duel: UP_AND_DOWN, multitask: record_multitask()}
    print("| steps of one frame | steps/s | browser, ms | Python, ms |\n|---|---|---|---|")
    for swf, played in keys.items():
        with start(swf) as servers:
            for name, picture, frames in (
                ("no picture", None, 1),
                ("84 x 84", SMALL, 1),
                ("480 x 360", SIZE, 1),
                ("84 x 84, 30 frames in a call", SMALL, 30),
            ):
                if swf != multitask or frames == 1:  # its keys change in each frame
                    row = measure(partial(play, servers, played, picture, frames), seconds, frames)
                    print(f"| {swf.stem}, bridge, {name} | {row} |", flush=True)
    for swf in (duel, multitask):
        for count in instances[1:]:
            with start(swf, count) as servers:
                row = measure(partial(play, servers, keys[swf], SMALL, 1), seconds, count)
            print(
                f"| {swf.stem}, bridge, 84 x 84, {count} instances together | {row} |", flush=True
            )
    for count in instances:
        with start(multitask, count) as servers:
            short = keys[multitask][:SHORT_GAME]
            row = measure(partial(play, servers, short, SMALL, 1), seconds, count)
        name = f"multitask, bridge, 84 x 84, with resets, {count} together"
        print(f"| {name} | {row} |", flush=True)
    for swf, played in keys.items():
        with start(swf, transport="vnc") as servers:
            row = measure(partial(play, servers, played, SMALL, 1), seconds)
        print(f"| {swf.stem}, vnc, 84 x 84 | {row} |", flush=True)


def print_engines(seconds: float, instances: Sequence[int]) -> None:
    """Steps of engines, and memory of their browsers."""
    print(
        "\n| random steps of two frames, with resets | steps/s | browser, ms | Python, ms | PSS |"
    )
    print("|---|---|---|---|---|")
    rng = np.random.default_rng(0)
    for scenario, seen in (("multitask", "gray_stack"), ("duel", "gray_stack"), ("duel", "vector")):
        for count in instances:
            transport = "numbers" if seen == "vector" else "bridge"
            engine = marl_cair.make_engine("flash", scenario, num_worlds=count, transport=transport)
            engine.reset(np.arange(count, dtype=np.uint64))
            out = engine.observe(seen)

            def step(
                number: int, engine: BatchedEngine = engine, seen: str = seen, out: Any = out
            ) -> None:
                engine.step(rng.integers(engine.num_actions, size=out.shape[:2]))
                done = engine.terminated | engine.truncated
                if done.any():
                    seeds = np.full(len(done), number, np.uint64)
                    engine.reset(seeds, done)
                engine.observe(seen, out=out)

            row = measure(step, seconds, count)
            memory = measure_memory()
            print(f"| {scenario}, {seen}, {count} worlds | {row} | {memory:,.0f} MiB |", flush=True)
            engine.close()
            close_spare_browsers()


def print_waiting(seconds: float) -> None:
    """Start, reset, and the time of frames and keys in real time."""
    starts, resets = [], []
    for _ in range(3):
        begun = time.perf_counter()
        with FlashServer(FOLDER / "multitask.swf", SIZE, 30, mode="lockstep") as server:
            starts.append(time.perf_counter() - begun)
            for seed in range(10):
                begun = time.perf_counter()
                server.reset(seed)
                resets.append(time.perf_counter() - begun)
    with FlashServer(PROBE, SIZE, 60) as server, server.connect() as client:
        rate, distinct = measure_frames(client, seconds)
        delays = [measure_key(client) for _ in range(30)]
    print(f"""
| | |
|---|---|
| start, until a game can be played | {median(starts):.2f} s |
| reset of multitask | {1000 * median(resets):.0f} ms |
| real time: frames/s over VNC, and distinct ones, of a game of 60 | {rate:.1f}, {distinct:.1f} |
| real time: key to frame, median and 95th percentile | \
{1000 * median(delays):.1f}, {1000 * np.quantile(delays, 0.95):.1f} ms |""")


def measure_frames(client: RFBClient, seconds: float) -> tuple[float, float]:
    """Updates per second, and those that differ from the one before."""
    begun, sums = time.perf_counter(), [0]
    while time.perf_counter() - begun < seconds:
        sums.append(zlib.adler32(client.wait_for_update().tobytes()))
    elapsed = time.perf_counter() - begun
    return (len(sums) - 1) / elapsed, sum(a != b for a, b in pairwise(sums)) / elapsed


def measure_key(client: RFBClient) -> float:
    """Seconds from a key to the picture that shows it."""
    for is_down in (False, True):
        time.sleep(0.1 * np.random.default_rng().random())  # any time within a frame
        begun = time.perf_counter()
        client.send_key("a", is_down)
        while (client.frame()[LIGHT, LIGHT, 0] == 0).all() != is_down:
            client.wait_for_update(10)
    return time.perf_counter() - begun


def main() -> None:
    """Measure and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3.0, help="of each row")
    parser.add_argument("--instances", type=int, nargs="+", default=[1, 2, 4])
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        empty = Path(folder) / "empty.swf"
        empty.write_bytes(pack_empty())
        print_steps(options.seconds, options.instances, empty)
    print_engines(options.seconds, options.instances)
    print_waiting(options.seconds)


if __name__ == "__main__":
    main()
