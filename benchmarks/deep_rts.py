"""Speed of Deep RTS on the workloads on which the original was measured.

    python -m benchmarks.deep_rts [--worlds 64] [--seconds 1.0]

One thread, random actions of the `classic` space at each tick, resets included; best of 5. `rich`
games start with a million of gold and lumber and food for 50 units, and end after 3,000 ticks.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.engine import REPEATS, measure
from marl_cair.games import make_engine
from marl_cair.games.deep_rts import tables
from marl_cair.games.deep_rts.state import NUM_UNITS
from marl_cair.games.engine import BatchedEngine
from marl_cair.games.randomness import episode_seeds

ACTION_SETS = 256
RICH = replace(
    tables.PRESETS["original"],
    start_gold=1_000_000,
    start_lumber=1_000_000,
    start_food=50,
)


@dataclass(frozen=True)
class Workload:
    """Settings of a measured game, and what is read at each tick."""

    name: str
    map: str
    num_players: int
    preset: str = "original"
    max_ticks: int = 10_000
    reads: str = ""  # "planes", or "planes and masks"

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
            actions="classic",
            ticks_per_step=1,
        )


WORKLOADS = (
    Workload("15x15, 2 players", "15x15-2p-crossing", 2),
    Workload("the same, planes and masks", "15x15-2p-crossing", 2, reads="planes and masks"),
    Workload("15x15, 2 players, rich", "15x15-2p-crossing", 2, "rich", 3_000),
    Workload("31x31, 6 players", "31x31-6p-frontier", 6),
    Workload("31x31, 6 players, rich", "31x31-6p-frontier", 6, "rich", 3_000),
    Workload("31x31, 6 players, planes", "31x31-6p-frontier", 6, reads="planes"),
)


def prepare(workload: Workload, num_worlds: int) -> tuple[Callable[[], int], Callable[[], int]]:
    """A round of play that returns its ticks, and the largest number of units seen so far."""
    engine = workload.make_engine(num_worlds)
    shape = (ACTION_SETS, num_worlds, engine.num_players)
    actions = np.random.default_rng(0).integers(engine.num_actions, size=shape, dtype=np.int32)
    indices, episodes = np.arange(num_worlds), np.zeros(num_worlds, np.int64)
    engine.reset(episode_seeds(0, indices, episodes))
    mask = engine.action_mask()
    most = 0

    def play() -> int:
        nonlocal most
        for chosen in actions:
            engine.step(chosen)
            ended = engine.terminated | engine.truncated
            if ended.any():
                episodes[ended] += 1
                engine.reset(episode_seeds(0, indices, episodes), ended)
            if workload.reads:
                engine.observe_in_place("planes")
            if workload.reads == "planes and masks":
                engine.action_mask(out=mask)
        most = max(most, int(engine._worlds.players[:, :, NUM_UNITS].sum(1).max()))
        return ACTION_SETS * num_worlds

    return play, lambda: most


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--worlds", type=int, default=64)
    parser.add_argument("--seconds", type=float, default=1.0, help="of each repeat")
    options = parser.parse_args()
    tables.PRESETS["rich"] = RICH
    print(f"deep_rts, {options.worlds} worlds, one thread, best of {REPEATS}")
    for workload in WORKLOADS:
        play, most = prepare(workload, options.worlds)
        rate = measure(play, options.seconds)
        print(f"{workload.name:40s} {rate:12,.0f} ticks/s, up to {most():4d} units", flush=True)


if __name__ == "__main__":
    main()
