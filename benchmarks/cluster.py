"""Measure work on a Ray of this machine: empty tasks, league games and cells, and what each costs
the process that starts them.

python -m benchmarks.cluster [--workers 1 2 4] [--tasks 2000] [--games 480] [--cells 4]
The processor time of the head does not depend on what else the machine does, and bounds how many
workers it can feed (docs/cluster.md). Cells are runs of 20,000 steps of Deep Maze.
"""

import argparse
import functools
import os
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from marl_cair.cli.experiment import compose
from marl_cair.cluster import RayPool
from marl_cair.experiments.cells import CELLS, Cell, make_cells
from marl_cair.experiments.experiment import ExperimentConfig, run_experiment
from marl_cair.experiments.plan import Length, Plan, RatingSettings, TaskSettings
from marl_cair.league.league import LeagueConfig, play_league

BOTS = ("rusher", "economist", "turtle", "counter")
WORDS = (
    *("recipe=quick", "game=deep_maze", "scenario=9x9-stochastic", "generator=none"),
    "evaluation.bots=[]",
)


def measure(title: str, count: int, work: Callable[[], object]) -> None:
    """Print how long `work` takes, and what it costs this process, for each of `count` things."""
    wall, cpu = time.perf_counter(), time.process_time()
    work()
    wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    print(
        f"  {title:8} {count:6} in {wall:7.1f} s: {count / wall:8.2f} /s, "
        f"{1000 * cpu / count:8.2f} ms of the head's processor time each",
        flush=True,
    )


def run_empty_tasks(pool: RayPool, count: int) -> None:
    """Start tasks that do nothing, and wait for them."""
    for future in [pool.submit(os.getpid) for _ in range(count)]:
        future.result()


def make_league(out: Path, num_games: int, workers: int) -> LeagueConfig:
    """All pairs of the scripted bots of Deep Line Wars."""
    per_pair = max(2, num_games // 6 // 2 * 2)
    return LeagueConfig(BOTS, games_per_pair=per_pair, out=str(out), workers=workers, cluster="ray")


def make_plan(num_cells: int) -> Plan:
    """Runs without looks but the last."""
    task = TaskSettings(rating=RatingSettings(games=20))
    budget, seeds = Length(frames=20_000), tuple(range(num_cells))
    return Plan(words=WORDS, tasks={"maze": task}, factors={"learner": {"dqn": ()}}, seeds=seeds,
                budget=budget)  # fmt: skip


def list_files(cells: list[Cell], out: Path) -> str:
    """Number and size of the files of a finished cell."""
    files = [file for file in (out / CELLS / cells[0].name).rglob("*") if file.is_file()]
    return f"{len(files)} files, {sum(file.stat().st_size for file in files) / 1e6:.2f} MB"


def measure_workers(workers: int, options: argparse.Namespace, out: Path) -> None:
    """Print all numbers for a Ray of so many workers."""
    print(f"{workers} workers", flush=True)
    with RayPool("ray", workers) as pool:
        run_empty_tasks(pool, 4 * workers)  # starts them
        measure("tasks", options.tasks, functools.partial(run_empty_tasks, pool, options.tasks))
        play = functools.partial(play_league, show_progress=False)
        play(make_league(out / "warm", 12 * 16, workers))
        league = make_league(out / "league", options.games, workers)
        measure("games", 6 * league.games_per_pair, functools.partial(play, league))
        plan, config = make_plan(options.cells), ExperimentConfig(out / "plan", cluster="ray")
        run = functools.partial(run_experiment, plan, config, compose)
        measure("cells", options.cells, run)
        cells = make_cells(plan, compose, 1.0, config.out)
        print(f"  a cell leaves {list_files(cells, config.out)}", flush=True)


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n", maxsplit=1)[0])
    parser.add_argument("--workers", type=int, nargs="+", default=[1, 2, 4])
    parser.add_argument("--tasks", type=int, default=2_000)
    parser.add_argument("--games", type=int, default=480)
    parser.add_argument("--cells", type=int, default=4)
    options = parser.parse_args()
    print(f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}", flush=True)
    for workers in options.workers:
        with tempfile.TemporaryDirectory() as folder:
            measure_workers(workers, options, Path(folder))


if __name__ == "__main__":
    main()
