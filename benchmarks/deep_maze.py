"""Speed of Deep Maze: moves, observations, mazes; against the same rules in plain Python.

    python -m benchmarks.deep_maze [--size 25] [--worlds 1024] [--seconds 1.0] [--processor-time]

One thread, uniform random actions, resets included but in the first rows; best of 5. "No end" plays
with a goal out of reach, so that moves alone are measured; "reset" makes a maze, its start,
its goal and all walking distances. On a machine that others use too, --processor-time counts the
seconds that were computed.

The original made 445,000 moves a second on 25x25 without observation, 335,000 with its array of ids
and 534 with its picture.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from benchmarks.engine import REPEATS, evaluate_plainly, measure
from marl_cair.games import make_engine
from marl_cair.games.deep_maze.state import GOAL
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.randomness import episode_seeds

ACTION_SETS = 256  # drawn before the clock starts


class Workload(NamedTuple):
    """A row of the table: settings of the game, and what is read after each move."""

    name: str
    options: dict[str, Any]
    reads: str = ""  # a representation
    resets: bool = True
    original: float = 0.0  # moves per second of the original with the same reading


FOG = {"visibility": "square"}
LINES = {"visibility": "line_of_sight"}
WORKLOADS = (
    Workload("moves, no end", {}, resets=False, original=445_000),
    Workload("moves", {}, original=445_000),
    Workload("moves, ids (classic)", {}, "classic", original=335_000),
    Workload("moves, planes", {}, "planes"),
    Workload("moves, vector", {}, "vector"),
    Workload("moves, image at 4 pixels a cell", {"cell_pixels": 4}, "image"),
    Workload("moves, gray", {}, "gray"),
    Workload("square sight, moves", FOG),
    Workload("square sight, ids", FOG, "classic"),
    Workload("square sight, planes", FOG, "planes"),
    Workload("line of sight, moves", LINES),
    Workload("line of sight, ids", LINES, "classic"),
    Workload("line of sight, planes", LINES, "planes"),
    Workload("distance reward, moves", {"reward": "distance"}),
    Workload("race of 4, moves of all", {"num_players": 4}),
)


def make_worlds(size: int, num_worlds: int, options: dict[str, Any]) -> BatchedEngine:
    """Worlds of one size, just reset."""
    engine = make_engine(
        "deep_maze", "25x25-stochastic", num_worlds, rows=size, columns=size, **options
    )
    engine.reset(episode_seeds(0, np.arange(num_worlds), np.zeros(num_worlds, np.int64)))
    return engine


def prepare(workload: Workload, size: int, num_worlds: int) -> Callable[[], int]:
    """A round of play that returns how many moves it was."""
    options = workload.options if workload.resets else {**workload.options, "max_ticks": 1_000_000}
    engine = make_worlds(size, num_worlds, options)
    if not workload.resets:
        engine._worlds.clock[:, GOAL] = -1  # no cell
    indices, episodes = np.arange(num_worlds), np.zeros(num_worlds, np.int64)
    shape = (ACTION_SETS, num_worlds, engine.num_players)
    actions = np.random.default_rng(0).integers(engine.num_actions, size=shape, dtype=np.int32)

    def play() -> int:
        for chosen in actions:
            engine.step(chosen)
            if workload.resets:
                ended = engine.terminated | engine.truncated
                if ended.any():
                    episodes[ended] += 1
                    engine.reset(episode_seeds(0, indices, episodes), ended)
            if workload.reads:
                engine.observe_in_place(workload.reads)
        return ACTION_SETS * num_worlds * engine.num_players

    return play


def prepare_resets(size: int, num_worlds: int, options: dict[str, Any]) -> Callable[[], int]:
    """A round of resets of all worlds that returns how many it was."""
    engine = make_worlds(size, num_worlds, options)
    indices, episodes = np.arange(num_worlds), np.zeros(num_worlds, np.int64)

    def reset() -> int:
        episodes[:] += 1
        engine.reset(episode_seeds(0, indices, episodes))
        return num_worlds

    return reset


def measure_plain_python(size: int) -> float:
    """Moves per second of the rules without compiler."""
    return evaluate_plainly(
        "benchmarks.deep_maze", f"measure(prepare(WORKLOADS[0], {size}, 4), 0.5)"
    )


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--size", type=int, default=25, help="rows and columns")
    parser.add_argument("--worlds", type=int, default=1024)
    parser.add_argument("--seconds", type=float, default=1.0, help="of each repeat")
    parser.add_argument(
        "--processor-time", action="store_true", help="seconds computed, not passed"
    )
    options = parser.parse_args()
    clock = time.process_time if options.processor_time else time.perf_counter
    size, worlds, seconds = options.size, options.worlds, options.seconds
    print(f"deep_maze {size}x{size}, {worlds} worlds, one thread, best of {REPEATS}")
    plain = measure_plain_python(size)
    print(f"{'plain Python rules, moves, no end':34s} {plain:14,.0f} moves/s", flush=True)
    for workload in WORKLOADS:
        rate = measure(prepare(workload, size, worlds), seconds, clock)
        row = f"{workload.name:34s} {rate:14,.0f} moves/s {rate / plain:9,.0f} x plain Python"
        if workload.original and size == 25:
            row += f" {rate / workload.original:7,.0f} x the original, as it was measured"
        print(row, flush=True)
    for name, chosen in (("prim", {}), ("growth", {"generator": "growth"}), ("square sight", FOG)):
        rate = measure(prepare_resets(size, worlds, chosen), seconds, clock)
        print(f"{'reset, ' + name:34s} {rate:14,.0f} mazes/s", flush=True)


if __name__ == "__main__":
    main()
