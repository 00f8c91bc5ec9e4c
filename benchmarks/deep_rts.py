"""Speed of Deep RTS on the workloads on which the original was measured.

    python -m benchmarks.deep_rts [--worlds 256] [--seconds 1.0] [--processor-time]
                                  [--original /tmp/deep_rts_original]

One thread, random actions of the `classic` space at each tick, resets included; best of 5. Each row
says how many living units, buildings included, stand on a board on average and at most. `rich`
games start with a million of gold and lumber and food for 50 units, and end after 3,000 ticks; in
those with halls each player has a town hall from the start, so that few are defeated early. With
the same settings our boards have more units than the original's. "Equal units" is therefore ours
without halls beside the original with halls: as many units on games as long.

With --original, the C++ engine of Deep RTS (github.com/cair/deep-rts, which is not part of this
project) plays the same workloads in turns with ours, one game at a time on its own maps of these
sizes. Each row ends in two ratios, ours divided by its: ticks/s, and unit-ticks/s (ticks/s times
the mean number of units). The original's numbers are those of its fastest run.
Compare rates only where both boards have about as many units. "Planes" is there a copy of its state
array at each tick; it has no masks. The executable is a driver of your own around your build. It
takes

    --map FILE --players N --max-ticks N --seconds S
    [--rich] [--halls] [--copy-state] [--processor-time]

does a random action of the 16 for each player at each tick, drawn before the clock starts, plays
whole games, resets included, until the seconds are over, and prints as its last line
{"ticks_per_second": ..., "mean_units": ..., "most_units": ...}, units being those in the lists of
all players. Its settings are the engine's defaults with barracks and archer on, with --halls also
instant town hall, without GUI and limit of frames.

On a machine that others use too, --processor-time counts the seconds that each side computed.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks._legal_actions import make_draw_legal
from benchmarks.engine import REPEATS, measure_once
from marl_cair.games import make_engine
from marl_cair.games.deep_rts import tables
from marl_cair.games.deep_rts.state import NUM_UNITS
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.randomness import episode_seeds

ACTION_SETS = 256
ORIGINAL_MAPS = {
    "15x15-2p-crossing": "15x15-2p-ffa-Cresal.json",
    "31x31-6p-frontier": "31x31-6p-ffa-Thelor.json",
}
RICH = replace(
    tables.PRESETS["original"],
    start_gold=1_000_000,
    start_lumber=1_000_000,
    start_food=50,
)
RICH_PRESETS = {"rich": RICH, "rich, halls": replace(RICH, starts_with_hall=True)}


@dataclass(frozen=True)
class Workload:
    """Settings of a measured game, and what is read at each tick."""

    name: str
    map: str
    num_players: int
    preset: str = "original"
    max_ticks: int = 10_000
    reads: str = ""  # "planes", or "planes and masks"
    num_worlds: int = 512  # fewer where their planes would not fit the processor's caches
    actions: str = "classic"
    original_halls: bool = False
    legal: bool = False  # actions are drawn from the masks, at each tick; else drawn beforehand

    def make_engine(self, num_worlds: int) -> BatchedEngine:
        """The worlds."""
        return make_engine(
            "deep_rts",
            "1v1-15x15",
            num_worlds,
            map=self.map,
            num_players=self.num_players,
            preset=self.preset,
            max_ticks=self.max_ticks,
            actions=self.actions,
            ticks_per_step=1,
        )


WORKLOADS = (
    Workload("15x15, 2 players", "15x15-2p-crossing", 2),
    Workload(
        "the same, planes and masks",
        "15x15-2p-crossing",
        2,
        reads="planes and masks",
        num_worlds=256,
    ),
    Workload("15x15, 2 players, rich", "15x15-2p-crossing", 2, "rich", 3_000),
    Workload(
        "15x15, 2 players, rich, halls",
        "15x15-2p-crossing",
        2,
        "rich, halls",
        3_000,
        original_halls=True,
    ),
    Workload(
        "15x15, 2 players, equal units",
        "15x15-2p-crossing",
        2,
        "rich",
        3_000,
        original_halls=True,
    ),
    Workload("31x31, 6 players", "31x31-6p-frontier", 6),
    Workload("31x31, 6 players, rich", "31x31-6p-frontier", 6, "rich", 3_000),
    Workload(
        "31x31, 6 players, rich, halls",
        "31x31-6p-frontier",
        6,
        "rich, halls",
        3_000,
        original_halls=True,
    ),
    Workload(
        "31x31, 6 players, equal units",
        "31x31-6p-frontier",
        6,
        "rich",
        3_000,
        original_halls=True,
    ),
    Workload("31x31, 6 players, planes", "31x31-6p-frontier", 6, reads="planes", num_worlds=128),
)


class Units:
    """Living units of a world, buildings included: the mean and the largest number counted."""

    def __init__(self) -> None:
        self._counts: list[NDArray[np.int64]] = []

    def count(self, engine: BatchedEngine) -> None:
        """Count the units of every world now."""
        self._counts.append(engine._worlds.players[:, :, NUM_UNITS].sum(1))

    def mean(self) -> float:
        """Over worlds and times of counting."""
        return float(np.mean(self._counts))

    def most(self) -> int:
        """In one world."""
        return int(np.max(self._counts))


def prepare(workload: Workload, num_worlds: int) -> tuple[Callable[[], int], Units]:
    """A round of play that returns its ticks, and the units counted at the end of each round."""
    engine = workload.make_engine(num_worlds)
    shape = (ACTION_SETS, num_worlds, engine.num_players)
    actions = np.random.default_rng(0).integers(engine.num_actions, size=shape, dtype=np.int32)
    draws = np.random.default_rng(1).random(shape, dtype=np.float32)
    indices, episodes = np.arange(num_worlds), np.zeros(num_worlds, np.int64)
    engine.reset(episode_seeds(0, indices, episodes))
    mask = engine.action_mask()
    draw_legal = make_draw_legal() if workload.legal else None
    units = Units()

    def choose(index: int) -> NDArray[np.int32]:
        if draw_legal:
            draw_legal(mask, draws[index], actions[index])
        chosen: NDArray[np.int32] = actions[index]
        return chosen

    def step(chosen: NDArray[np.int32], restarted: NDArray[np.bool_]) -> None:
        engine.step(chosen)
        ended = engine.terminated | engine.truncated | restarted
        if ended.any():
            episodes[ended] += 1
            engine.reset(episode_seeds(0, indices, episodes), ended)

    # One world after the other is reset, so that games of all ages are measured at any time.
    starts = indices * workload.max_ticks // num_worlds
    for tick in range(workload.max_ticks):
        step(choose(tick % ACTION_SETS), starts == tick)
        if workload.legal:
            engine.action_mask(out=mask)
    no_worlds = np.zeros(num_worlds, np.bool_)

    def play() -> int:
        for index in range(ACTION_SETS):
            step(choose(index), no_worlds)
            if workload.reads:
                engine.observe_in_place("planes")
            if workload.reads == "planes and masks":
                engine.action_mask(out=mask)
        units.count(engine)
        return ACTION_SETS * num_worlds

    return play, units


class OriginalError(Exception):
    """The executable of the original could not be run, or did not do what was asked."""


@dataclass(frozen=True)
class Answer:
    """What the driver of the original measured."""

    rate: float  # ticks/s
    mean_units: float
    most_units: int


@dataclass(frozen=True)
class Original:
    """The original engine, by a driver that answers as this file's docstring says."""

    path: Path
    processor_time: bool

    def play(self, workload: Workload, seconds: float) -> Answer:
        """One run of the driver."""
        command = [str(self.path.resolve()), "--map", ORIGINAL_MAPS[workload.map]]
        command += ["--players", str(workload.num_players), "--seconds", str(seconds)]
        command += ["--max-ticks", str(workload.max_ticks)]
        command += ["--rich"] * (workload.preset in RICH_PRESETS)
        command += ["--halls"] * workload.original_halls
        command += ["--copy-state"] * bool(workload.reads)
        command += ["--processor-time"] * self.processor_time
        try:
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            answer = json.loads(done.stdout.splitlines()[-1])
            return Answer(
                float(answer["ticks_per_second"]),
                float(answer["mean_units"]),
                int(answer["most_units"]),
            )
        except OSError as error:
            raise OriginalError(f"{self.path} cannot be run: {error.strerror}") from error
        except subprocess.CalledProcessError as error:
            message = error.stderr.strip() or f"exit status {error.returncode}"
            raise OriginalError(f"{self.path} failed on {workload.name}: {message}") from error
        except (ValueError, KeyError, TypeError, IndexError) as error:
            message = f"{self.path} did not answer with a rate as `--help` asks for"
            raise OriginalError(message) from error

    def check(self) -> None:
        """Raise before anything is measured, not after minutes."""
        for workload in WORKLOADS:
            if workload.map in ORIGINAL_MAPS:
                self.play(workload, 0.0)


def print_table(options: argparse.Namespace) -> None:
    """Measure each workload and print its row."""
    original = options.original and Original(options.original, options.processor_time)
    if original:
        original.check()
    clock = time.process_time if options.processor_time else time.perf_counter
    print(f"deep_rts, one thread, best of {REPEATS}")
    for workload in WORKLOADS:
        num_worlds = options.worlds or workload.num_worlds
        play, units = prepare(workload, num_worlds)
        play()
        rates, answers = [], []
        for _ in range(REPEATS):
            rates.append(measure_once(play, options.seconds, clock))
            if original and workload.map in ORIGINAL_MAPS:
                answers.append(original.play(workload, options.seconds))
        rate, mean = max(rates), units.mean()
        row = f"{workload.name:31s} {num_worlds:4d} worlds {rate:10,.0f} ticks/s"
        row += f" with {mean:5.1f} units (most {units.most():3d})"
        if answers:
            best = max(answers, key=lambda answer: answer.rate)
            theirs, most = best.mean_units, best.most_units
            ratio = rate / best.rate
            row += f"; original {best.rate:9,.0f} with {theirs:5.1f} (most {most:3d}); "
            row += f"ratio {ratio:5.2f}, of unit-ticks {ratio * mean / theirs:5.2f}"
        print(row, flush=True)


def main() -> None:
    """Read the options, measure and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--worlds", type=int, help="of every workload (default: its own number)")
    parser.add_argument("--seconds", type=float, default=1.0, help="of each repeat")
    parser.add_argument(
        "--processor-time", action="store_true", help="seconds computed, not passed"
    )
    parser.add_argument("--original", type=Path, help="executable that plays the original engine")
    options = parser.parse_args()
    tables.PRESETS.update(RICH_PRESETS)
    try:
        print_table(options)
    except OriginalError as error:
        parser.error(str(error))


if __name__ == "__main__":
    main()
