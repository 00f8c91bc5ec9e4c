"""Speed of Flappy Bird: ticks without pictures, and frames of what learners look at.

    python -m benchmarks.flappy_bird [--worlds 8192] [--seconds 1.0] [--processor-time]

One thread, best of 5, resets included, all in one run. Ratios are to the same rules in plain Python
in a process of its own. `seldom` flaps in one of 12 ticks, with which birds live longer than with
even choices; a frame is a decision of one world and the picture that follows.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import numpy as np

from benchmarks.engine import REPEATS, evaluate_plainly, measure
from marl_cair.games import make_engine
from marl_cair.games.randomness import episode_seeds

ACTION_SETS = 64
EVEN, SELDOM = 0.5, 1 / 12
FRAMES_WORLDS = 64
REPRESENTATIONS = ("vector", "features", "planes", "gray", "gray_80", "gray_stack", "image")


def make_round(
    num_worlds: int, share: float, representation: str | None = None, scenario: str = "classic"
) -> Callable[[], int]:
    """A round of play that returns its ticks; flaps are drawn before with probability `share`."""
    engine = make_engine("flappy_bird", scenario, num_worlds)
    shape = (ACTION_SETS, num_worlds, engine.num_players)
    actions = (np.random.default_rng(0).random(shape) < share).astype(np.int32)
    episodes = np.zeros(num_worlds, np.int64)
    seeds = episode_seeds(0, np.arange(num_worlds), episodes)
    engine.reset(seeds)
    seen = None if representation is None else engine.observe(representation)

    def play() -> int:
        for chosen in actions:
            engine.step(chosen)
            ended = engine.terminated | engine.truncated
            rows = np.flatnonzero(ended)
            if len(rows):
                episodes[rows] += 1
                seeds[rows] = episode_seeds(0, rows, episodes[rows])
                engine.reset(seeds, ended)
            if representation is not None:
                engine.observe(representation, out=seen)
        return ACTION_SETS * num_worlds

    return play


def measure_plain_python() -> float:
    """Ticks per second of the rules without compiler."""
    return evaluate_plainly(
        "benchmarks.flappy_bird", "measure(make_round(1, SELDOM), 0.3, time.process_time)"
    )


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=int, default=8192, help="of the rows without pictures")
    parser.add_argument("--seconds", type=float, default=1.0, help="of each repeat")
    parser.add_argument(
        "--processor-time", action="store_true", help="seconds computed, not passed"
    )
    options = parser.parse_args()
    clock = time.process_time if options.processor_time else time.perf_counter
    plain = measure_plain_python()
    print(f"flappy_bird, one thread, best of {REPEATS}")
    rows: list[tuple[str, int, float, str | None, str]] = []
    rows += [(f"engine, {options.worlds} worlds, even", options.worlds, EVEN, None, "classic")]
    rows += [(f"engine, {options.worlds} worlds, seldom", options.worlds, SELDOM, None, "classic")]
    rows += [("the same, windy", options.worlds, SELDOM, None, "windy")]
    rows += [("the same, race of 8", options.worlds, SELDOM, None, "race-8")]
    rows += [
        (f"{name}, {FRAMES_WORLDS} worlds", FRAMES_WORLDS, SELDOM, name, "classic")
        for name in REPRESENTATIONS
    ]
    print(f"{'plain Python rules, 1 world':36s} {plain:14,.0f} ticks/s")
    for name, worlds, share, representation, scenario in rows:
        play = make_round(worlds, share, representation, scenario)
        rate = measure(play, options.seconds, clock)
        unit = "ticks/s" if representation is None else "frames/s"
        print(f"{name:36s} {rate:14,.0f} {unit:9s} {rate / plain:9,.0f} x plain", flush=True)


if __name__ == "__main__":
    main()
