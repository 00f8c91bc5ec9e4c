"""Train networks by the recipes of games of one player and rate them: tables and curves of their
READMEs.

    python -m benchmarks.solo_learning --game deep_maze [--recipes ...] [--networks conv capsule]
        [--seeds 0 1 2] [--games 500] [--out runs/deep_maze]
        [--picture docs/images/deep_maze_learning.png] [option=value ...]

Each run trains as `marl-cair train recipe=...` does, to its end. Then the last agent, or where
evaluations are as long as these games the best by them, plays `--games` games on seeds that no
training has seen. Runs one after another; the same command again goes on where it was stopped.
Options with `=` go to `marl-cair train`. Writes <out>/results.csv and curves, and prints the table
as Markdown.
"""

from __future__ import annotations

import argparse
import csv
import io
import sys
from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from benchmarks.learning import UNSEEN_SEED, train, trained_minutes
from marl_cair.checkpoint import LATEST_FOLDER, read_description
from marl_cair.cli import main as marl_cair
from marl_cair.files import atomic_path, write_atomically
from marl_cair.training.curves import COLOURS, STYLES
from marl_cair.training.evaluation import LEARNER
from marl_cair.training.run import BEST_FOLDER
from marl_cair.training.run_log import RunLog, read_log


class Task(NamedTuple):
    """What a recipe is rated by."""

    recipe: str
    networks: tuple[str, ...]
    games: int
    number: str  # of the game's own (`Game.info`) at the end of a game
    statistic: str  # of it: mean or median
    options: tuple[str, ...] = ()  # of the scenario, of the final games alone
    agent: str = LATEST_FOLDER  # of the run, which is rated
    scale: str = "linear"  # of the number's panel


TASKS = {
    "deep_maze": (
        Task("deep_maze_9x9", ("conv", "capsule"), 500, "extra_steps", "mean", scale="symlog"),
        Task(
            "deep_maze_25x25_fixed", ("conv", "capsule"), 500, "extra_steps", "mean", scale="symlog"
        ),
        Task("deep_maze_25x25", ("conv", "capsule"), 500, "extra_steps", "mean", scale="symlog"),
    ),
    "flappy_bird": (
        # 6,000 ticks are 158 pipes, 40,000 are 1,060.
        Task(
            "flappy_bird_features",
            ("mlp",),
            100,
            "pipes_passed",
            "median",
            ("max_ticks=40000",),
            BEST_FOLDER,
        ),
        Task(
            "flappy_bird_gray",
            ("conv", "capsule"),
            100,
            "pipes_passed",
            "median",
            ("max_ticks=6000",),
            BEST_FOLDER,
        ),
    ),
}
_ABOUT_RUN = ("recipe", "network", "seed", "decisions", "minutes")
COLUMNS = (*_ABOUT_RUN, "number", "statistic", "games", "value", "low", "high")


def rate(run: Path, task: Task, games: int) -> dict[str, Mapping[str, str]]:
    """Rows of `marl-cair evaluate` of the rated agent by number, played once, kept beside it."""
    table = run / f"evaluation_{games}.csv"
    if not table.exists():
        words = [str(run / task.agent), "--games", str(games), "--seed", str(UNSEEN_SEED)]
        words += ["--against", "--out", str(table)]
        words += [f"--set={option}" for option in task.options]
        if code := marl_cair(["evaluate", *words]):
            sys.exit(code)
    with table.open(encoding="utf-8", newline="") as file:
        return {row["number"]: row for row in csv.DictReader(file)}


def read_statistic(row: Mapping[str, str], statistic: str) -> tuple[float, float, float]:
    """Value and ends of the interval of `mean` or `median`."""
    prefix = "" if statistic == "mean" else "median_"
    low, high = f"{prefix}low", f"{prefix}high"
    return float(row[statistic]), float(row[low]), float(row[high])


def draw(runs: Mapping[Task, Mapping[str, Path]], path: Path) -> None:
    """Two panels for each task, over decisions: share of games that ended, and its number."""
    figure = Figure(figsize=(4.4 * len(runs), 6.6), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(2, len(runs), squeeze=False)
    for column, (task, folders) in enumerate(runs.items()):
        for row, name in enumerate(("ended", task.number)):
            panel = panels[row, column]
            for style, (label, folder) in zip(cycle(_styles()), folders.items(), strict=False):
                panel.plot(*_curve(folder, name), **style, label=label, marker=".", linewidth=1)
            panel.set(xlabel="decisions (thousands)", ylabel=name.replace("_", " ") + ", mean")
            panel.spines[["top", "right"]].set_visible(False)
            panel.grid(alpha=0.25)
        panels[0, column].set(title=task.recipe, ylim=(-0.03, 1.03), ylabel="ended before its time")
        panels[1, column].set_yscale(task.scale)
        panels[1, column].set_ylim(bottom=0)
        for panel in panels[:, column]:
            panel.set_xlim(left=0)
        # Under the panels, where it hides no line.
        panels[1, column].legend(
            fontsize=7, ncols=2, loc="upper center", bbox_to_anchor=(0.5, -0.16), frameon=False
        )
    with atomic_path(path) as unfinished:
        figure.savefig(unfinished, dpi=130)


def _styles() -> list[dict[str, Any]]:
    return [{"color": colour, "linestyle": style} for style in STYLES for colour in COLOURS[:6]]


def _curve(folder: Path, name: str) -> tuple[list[float], list[float]]:
    key = f"{name}/{LEARNER}"
    rows = [row for row in read_log(folder / RunLog.FILE) if key in row]
    return [row["frames"] / 1_000 for row in rows], [row[key] for row in rows]


def make_table(rows: Sequence[Sequence[object]]) -> str:
    """The results as Markdown."""
    lines = ["| recipe | network | seed | decisions | minutes | games | result |", "|---" * 7 + "|"]
    for recipe, network, seed, decisions, minutes, number, statistic, games, *values in rows:
        value, low, high = (float(str(value)) for value in values)
        if number == "ended":
            result = f"{value:.1%} [{low:.1%}, {high:.1%}] ended before their time"
        else:
            name = str(number).replace("_", " ")
            result = f"{name}, {statistic}: {value:.2f} [{low:.2f}, {high:.2f}]"
        shown = f"{int(str(decisions)):,}"
        lines.append(
            f"| `{recipe}` | {network} | {seed} | {shown} | {minutes} | {games} | {result} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Train, rate, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--game", choices=list(TASKS), required=True)
    parser.add_argument("--recipes", nargs="+", help="of the game (default: all)")
    parser.add_argument("--networks", nargs="+", help="default: all that can read it")
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--games", type=int, help="of the final evaluation (default: by task)")
    parser.add_argument("--out", type=Path, help="default: runs/<game>")
    parser.add_argument("--picture", type=Path, help="default: <out>/curves.png")
    options, words = parser.parse_known_args()
    out = options.out or Path("runs") / options.game
    rows: list[tuple[object, ...]] = []
    runs: dict[Task, dict[str, Path]] = {}
    for task in TASKS[options.game]:
        if options.recipes and task.recipe not in options.recipes:
            continue
        networks = [name for name in options.networks or task.networks if name in task.networks]
        for network, seed in ((network, seed) for network in networks for seed in options.seeds):
            run = out / f"{task.recipe}-{network}-{seed}"
            fixed = [f"recipe={task.recipe}", f"policy={network}", f"seed={seed}"]
            train(run, None, [*fixed, "checkpoint.include_replay=false", *words])
            runs.setdefault(task, {})[f"{network}, seed {seed}"] = run
            rated = rate(run, task, options.games or task.games)
            decisions = read_description(run / task.agent).frames
            about = (task.recipe, network, seed, decisions, f"{trained_minutes(run):.1f}")
            for number, statistic in (("ended", "mean"), (task.number, task.statistic)):
                values = read_statistic(rated[number], statistic)
                rows.append((*about, number, statistic, rated[number]["games"], *values))
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([COLUMNS, *rows])
    write_atomically(out / "results.csv", text.getvalue())
    draw(runs, options.picture or out / "curves.png")
    sys.stdout.write(make_table(rows))


if __name__ == "__main__":
    main()
