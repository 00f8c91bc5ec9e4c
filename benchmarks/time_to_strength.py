"""Processor time until an agent is strong and stays so, for our learners and Stable-Baselines3.

    python -m benchmarks.time_to_strength [--tasks deep_line_wars ...] [--methods pqn dqn ...]
        [--networks small_conv capsule] [--seeds 0 1 2] [--seconds 360] [--every 10] [--games 500]
        [--out runs/time_to_strength] [--picture docs/images/time_to_strength.png]

A run trains in a process of its own, on one thread. Each `--every` seconds of processor time (not
counting what follows) its greedy agent plays `--games` new games, and once before it has learned
anything: some untrained networks beat a weak opponent. A level is reached at the first
of two looks in a row at or above it; it is held if all later looks are. Methods: `pqn` (recipe),
`dqn` (`recipe=quick`, 20 % generated transitions), `dqn_real` (none), and of Stable-Baselines3, if
it is installed (pip install stable-baselines3 sb3-contrib), `sb3_ppo` (with action masks) and
`sb3_dqn` (without: it has none) on the same Gymnasium id, with its own reward; ours learn from the
shaped one. Runs that are finished are not repeated. Writes <out>/looks.csv, prints two tables as
Markdown (levels, and strength at equal processor time and equal frames) and draws all looks.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.stats import bootstrap, trim_mean

from benchmarks._timing import Clock
from marl_cair.files import atomic_path, write_atomically
from marl_cair.games import GAMES
from marl_cair.games.registry import gymnasium_id
from marl_cair.league.play.match import play_match
from marl_cair.league.play.solo import play_alone
from marl_cair.training.curves import COLOURS

FRESH_SEED = 2_000_000  # of the first look's games; no training has them
NETWORKS_OF_OTHERS = "their own"


@dataclass(frozen=True)
class Task:
    """A game, what is measured there, and its levels."""

    game: str
    scenario: str
    levels: tuple[float, ...]
    bots: tuple[str, ...] = ()  # the score is the lowest against one of them, or
    number: str = ""  # the median of a number of the game (`Game.info`) at the end of games
    options: tuple[str, ...] = ()  # of all our runs
    representation: str = "planes"
    changes: dict[str, Any] = field(
        default_factory=dict
    )  # of the scenario: in looks, and of others


RANDOM = "opponent=random"
LINE_WARS = "deep_line_wars", "10x15"
RTS = "deep_rts", "1v1-15x15"
LONG_GAMES = "learner.gamma=0.997", "collector.stagger_steps=1000"
SIX_BOTS = "mixed", "rusher", "economist", "archers", "boomer", "turtle"
TASKS = {
    "deep_line_wars": Task(*LINE_WARS, (0.95, 0.99), ("random",), options=(RANDOM,)),
    "deep_line_wars_bots": Task(
        *LINE_WARS,
        (0.8,),
        ("counter", "economist", "turtle"),
        options=("opponent=deep_line_wars_bots",),
    ),
    "deep_rts": Task(*RTS, (0.98,), ("random",), options=(RANDOM, *LONG_GAMES)),
    "deep_rts_bots": Task(*RTS, (0.5,), SIX_BOTS, options=("opponent=hard_bots", *LONG_GAMES)),
    "deep_maze": Task(
        "deep_maze",
        "9x9-stochastic",
        (0.99,),
        number="reached_goal",
        options=("policy.distances=true", "policy.obstacle_planes=[0]", "learner.gamma=0.96"),
    ),
    "flappy_bird": Task(
        "flappy_bird",
        "classic",
        (100.0,),
        number="pipes_passed",
        options=(
            *("game.reward=alive", "learner.gamma=0.946", "policy.frame_differences=true"),
            "game.options={max_ticks: 1000, ticks_per_step: 2}",
        ),
        representation="gray_stack",
        changes={"ticks_per_step": 2},
    ),
}
OURS = {
    "pqn": ("recipe=pqn",),
    "dqn": ("recipe=quick",),
    "dqn_real": ("recipe=quick", "generator=none", "synthetic_fraction=0"),
}
OTHERS = ("sb3_ppo", "sb3_dqn")


class Look(NamedTuple):
    """One look at a run."""

    task: str
    method: str
    network: str
    seed: int
    seconds: float  # of processor time in training
    frames: int  # environment steps
    score: float  # against the hardest of the task's bots, or the task's number
    mean: float  # over the task's bots
    overestimation: float = float("nan")  # of the games since the last look, as the log has it


def measure(agent: Any, task: Task, games: int, look: int) -> tuple[float, float]:
    """The score and the mean of `agent` in games that no other look has."""
    game = GAMES[task.game]
    scenario = game.scenario(task.scenario, **task.changes)
    seed = FRESH_SEED + look * games
    if task.bots:
        bots = (game.bot(name, scenario) for name in task.bots)
        scores = [play_match(agent, bot, game, scenario, games, seed).score for bot in bots]
        return min(scores), float(np.mean(scores))
    result = play_alone(agent, game, scenario, games, seed)
    if task.number == "reached_goal":
        number = result.ended / result.games
    else:
        number = float(np.median(result.numbers[task.number]))
    return number, number


def train_ours(
    words: list[str], look: Callable[[Any, float, int, float], bool], every: float, folder: str
) -> None:
    """Train until `look` (agent, seconds, frames, overestimation) is False; it is called when
    `every` seconds are over.
    """
    from marl_cair.cli.compose import compose_config
    from marl_cair.training.collecting.metrics import Timers
    from marl_cair.training.run import TrainingRun
    from marl_cair.training.trainer import iterate

    run = TrainingRun(compose_config([*words, "torch_threads=1", f"out={folder}"]))
    steps = iterate(run, Timers())
    clock = Clock(every)
    goes_on = look(run.rated, 0.0, 0, float("nan"))
    while goes_on:
        clock.start()
        next(steps)
        clock.stop()
        if clock.is_due():
            row = run.statistics.report(run.book.name, run.spec.action_group_names)
            excess = row.get("q/overestimation", float("nan"))
            goes_on = look(run.rated, clock.seconds, run.frames, excess)
    run.close()


def run_one(case: dict[str, Any]) -> None:
    """Train one case and write its looks, in this process."""
    task, path = TASKS[case["task"]], Path(case["path"])
    looks: list[Look] = []

    def look(agent: Any, seconds: float, frames: int, overestimation: float = float("nan")) -> bool:
        scores = measure(agent, task, case["games"], len(looks))
        names = (case["task"], case["method"], case["network"], case["seed"])
        looks.append(Look(*names, round(seconds, 2), frames, *scores, overestimation))
        print(*looks[-1], flush=True)
        return bool(seconds < case["seconds"])

    if case["method"] in OTHERS:
        from benchmarks._stable_baselines import train_others

        name = gymnasium_id(GAMES[task.game].gymnasium_prefix, task.scenario)
        settings = [{"opponent": bot, **task.changes} for bot in task.bots] or [task.changes]
        what = case["method"], name, task.representation, settings
        train_others(*what, case["seed"], look, case["every"])
    else:
        words = [f"game={task.game}", f"scenario={task.scenario}", f"policy={case['network']}"]
        words += [f"representation={task.representation}", f"seed={case['seed']}"]
        words += [*OURS[case["method"]], *task.options, *case["words"]]
        folder = str(path.with_suffix(""))
        train_ours(words, look, case["every"], folder)
    write_atomically(path, _write_csv(looks))


def _write_csv(looks: list[Look]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([Look._fields, *looks])
    return text.getvalue()


def read_looks(path: Path) -> Iterator[Look]:
    """The looks that `run_one` wrote."""
    with path.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            names = row["task"], row["method"], row["network"], int(row["seed"])
            numbers = (float(row[name]) for name in ("score", "mean", "overestimation"))
            yield Look(*names, float(row["seconds"]), int(row["frames"]), *numbers)


def find_reached(looks: list[Look], level: float) -> Look | None:
    """The first of two looks in a row at or above `level`."""
    reached = (first for first, then in pairwise(looks) if min(first.score, then.score) >= level)
    return next(reached, None)


def print_table(runs: list[list[Look]]) -> None:
    """One row for each run and level."""
    columns = ("task", "method", "network", "seed", "untrained", "level", "reached after", "steps")
    print(f"| {' | '.join(columns)} | lowest later look |")
    print(f"|{'---|' * (len(columns) + 1)}")
    for looks in runs:
        about = looks[0]
        for level in TASKS[about.task].levels:
            found = find_reached(looks, level)
            when = ("never", "-", f"best {max(one.score for one in looks):.3g}")
            if found is not None:
                later = min(one.score for one in looks if one.seconds >= found.seconds)
                when = (f"{found.seconds:.0f} s", f"{found.frames:,}", f"{later:.3g}")
            names = (about.task, about.method, about.network, about.seed, f"{about.score:.2g}")
            print("|", " | ".join(map(str, (*names, f"{level:g}", *when))), "|")


def compare(runs: list[list[Look]]) -> None:
    """Strength of each method and network over its seeds: one row for each task, and for all.

    A run's strength is its mean points over the last third of its time, as a share of the task's
    highest level, at most 1 (against several bots: the mean over them): of processor time, and of
    the frames that the slowest run of the task has, at 20 even places between looks.
    Interquartile means over runs (of less than four: means)
    with 95 % intervals of the stratified bootstrap.
    """
    kinds = list(dict.fromkeys((one[0].method, one[0].network) for one in runs))
    tasks = list(dict.fromkeys(one[0].task for one in runs))
    print("| method | network | task | runs | equal time | equal frames | overestimation |")
    print("|---|---|---|---|---|---|---|")
    for method, network in kinds:
        columns: list[list[NDArray[np.float64]]] = []
        for task in tasks:
            of_task = [looks for looks in runs if looks[0].task == task]
            frames = min(looks[-1].frames for looks in of_task)
            own = [one for one in of_task if (one[0].method, one[0].network) == (method, network)]
            if own:
                columns.append([*_summarise(own, frames, TASKS[task].levels[-1])])
                cells = (task, str(len(own)), *(find_iqm([part]) for part in columns[-1]))
                print("|", " | ".join((method, network, *cells)), "|")
        parts = [find_iqm(list(part)) for part in zip(*columns, strict=True)]
        print("|", " | ".join((method, network, "all", "", *parts[:2], "")), "|")


def _summarise(runs: list[list[Look]], frames: int, level: float) -> Iterator[NDArray[np.float64]]:
    """Strength at equal time, at equal frames, and overestimation at equal time, float64 [runs]."""
    last = [[one for one in looks if one.seconds > looks[-1].seconds * 2 / 3] for looks in runs]
    means = [np.mean([one.mean for one in looks]) for looks in last]
    yield np.minimum(1.0, np.array(means) / level)
    places = np.linspace(frames * 2 / 3, frames, 20)
    means = [
        np.mean(np.interp(places, [one.frames for one in looks], [one.mean for one in looks]))
        for looks in runs
    ]
    yield np.minimum(1.0, np.array(means) / level)
    excess = ([one.overestimation for one in looks] for looks in last)
    known = ([value for value in values if not np.isnan(value)] for values in excess)
    yield np.array([np.mean(values) if values else np.nan for values in known])


def find_iqm(strata: list[NDArray[np.float64]]) -> str:
    """Interquartile mean of all values, with its interval; each stratum is drawn from apart."""

    def iqm(*parts: Any, axis: int = -1) -> Any:
        return trim_mean(np.concatenate(parts, axis), 0.25, axis)

    value = f"{iqm(*strata):.3f}"
    if min(map(len, strata)) < 2:
        return value
    drawn = bootstrap(strata, iqm, method="percentile", rng=np.random.default_rng(0))
    low, high = drawn.confidence_interval
    return f"{value} [{low:.3f}, {high:.3f}]"


def draw(runs: list[list[Look]], path: Path) -> None:
    """All looks: a panel for each task, a colour for each method and network."""
    tasks = list(dict.fromkeys(looks[0].task for looks in runs))
    figure = Figure(figsize=(5.0 * len(tasks), 3.6), layout="constrained")
    FigureCanvasAgg(figure)
    kinds = list(dict.fromkeys((looks[0].method, looks[0].network) for looks in runs))
    panels = figure.subplots(1, len(tasks), squeeze=False)[0]
    for panel, task in zip(panels, tasks, strict=True):
        shown = set()
        for looks in (looks for looks in runs if looks[0].task == task):
            kind = looks[0].method, looks[0].network
            label = None if kind in shown else ", ".join(kind)
            shown.add(kind)
            colour = COLOURS[kinds.index(kind) % len(COLOURS)]
            seconds = [one.seconds for one in looks]
            panel.plot(seconds, [one.score for one in looks], color=colour, lw=1.2, label=label)
        for level in TASKS[task].levels:
            panel.axhline(level, color="0.6", lw=0.8, ls=":")
        measured = TASKS[task].number.replace("_", " ")
        if bots := TASKS[task].bots:
            measured = f"points against {bots[0] if len(bots) == 1 else 'the hardest bot'}"
        panel.set(title=task.replace("_", " "), ylabel=measured)
        panel.set_xlabel("processor seconds of training")
        panel.legend(fontsize=7, frameon=False, loc="lower right")
    with atomic_path(path) as unfinished:
        figure.savefig(unfinished, dpi=150, format="png")


def main() -> None:
    """Run all cases, one after another; print and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tasks", nargs="+", choices=TASKS, default=list(TASKS))
    parser.add_argument("--methods", nargs="+", choices=(*OURS, *OTHERS), default=list(OURS))
    parser.add_argument("--networks", nargs="+", default=["small_conv", "capsule"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--seconds", type=float, default=360.0, help="of training of each run")
    parser.add_argument("--every", type=float, default=10.0, help="seconds between two looks")
    parser.add_argument("--games", type=int, default=500, help="of each look")
    parser.add_argument("--out", type=Path, default=Path("runs/time_to_strength"))
    parser.add_argument("--picture", type=Path)
    parser.add_argument("--one", help=argparse.SUPPRESS)
    options, words = parser.parse_known_args()
    if options.one:
        run_one(json.loads(options.one))
        return
    runs = []
    for task in options.tasks:
        for method in options.methods:
            networks = [NETWORKS_OF_OTHERS] if method in OTHERS else options.networks
            for network in networks:
                for seed in options.seeds:
                    name = "-".join((task, method, network.replace(" ", "_"), str(seed)))
                    path = options.out / f"{name}.csv"
                    case = {"task": task, "method": method, "network": network, "seed": seed}
                    case |= {"path": str(path), "every": options.every, "games": options.games}
                    case |= {"seconds": options.seconds, "words": words}
                    if not path.exists():
                        path.parent.mkdir(parents=True, exist_ok=True)
                        one = [sys.executable, "-m", "benchmarks.time_to_strength"]
                        subprocess.run([*one, "--one", json.dumps(case)], check=True)
                    runs.append(list(read_looks(path)))
    looks = [look for run in runs for look in run]
    write_atomically(options.out / "looks.csv", _write_csv(looks))
    print_table(runs)
    compare(runs)
    if options.picture:
        draw(runs, options.picture)


if __name__ == "__main__":
    main()
