"""Train networks with several seeds and rate them: the results table of the README.

    python -m benchmarks.learning [--networks conv capsule] [--seeds 0 1 2] [--minutes 12]
        [--games 500] [--against random counter] [--out runs/results] [option=value ...]

Each run trains by self-play mixed with the scripted bots and looks every 25,000 decisions how it
does in 100 games against each of `--against`; its best agent by that then plays `--games` other
games. Options with `=` go to `marl-cair train`. Runs one after another; the same command again goes
on where it was stopped. Writes <out>/results.csv and prints the table as Markdown.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import sys
from pathlib import Path
from typing import Any

from marl_cair.checkpoint import read_description
from marl_cair.cli import main as marl_cair
from marl_cair.cli.compose import override
from marl_cair.files import write_atomically
from marl_cair.training.demo import FINISHED_FILE
from marl_cair.training.run import BEST_FOLDER
from marl_cair.training.run_log import RunLog, read_log
from marl_cair.training.settings.config_file import CONFIG_FILE

RECIPE = (
    "opponent.mixture={latest:0.3,uniform:0.1,bots:0.25,counter:0.25,random:0.1}",
    "opponent.snapshot_every_frames=50000",
    "evaluation.every_frames=25000",
    "evaluation.games=100",
    "checkpoint.include_replay=false",
    "total_frames=1000000000",  # the clock ends it
)
UNSEEN_SEED = 1_000_000  # of the final games; evaluations while training have other seeds
COLUMNS = ("network", "seed", "decisions", "minutes", "opponent", "games", "won", "low", "high")


def trained_minutes(run: Path) -> float:
    """Minutes that a run has trained so far, over all its sittings."""
    rows = read_log(run / RunLog.FILE)
    seconds = [value for row in rows for name, value in row.items() if name.startswith("seconds/")]
    return sum(seconds) / 60.0


def train(run: Path, minutes: float | None, words: list[str]) -> None:
    """Train to the run's `total_frames`, for so many minutes in all at the most. Exits where
    training was refused or interrupted, or the run was begun with other words.
    """
    about = run.with_name(f"{run.name}.json")
    begun = {"minutes": minutes, "words": words}
    if about.exists() and (held := json.loads(about.read_text("utf-8"))) != begun:
        sys.exit(f"{run} was begun with {held}, not {begun}: give another --out")
    write_atomically(about, json.dumps(begun))
    if (run / FINISHED_FILE).exists():
        return
    begins = not (run / CONFIG_FILE).exists()
    command = [f"out={run}", *words] if begins else [f"resume={run}"]
    if minutes is not None:
        command.append(f"max_minutes={max(0.01, minutes - trained_minutes(run))}")
    if code := marl_cair(["train", *command]):
        sys.exit(code)
    write_atomically(run / FINISHED_FILE, "")


def rate(run: Path, against: list[str], games: int) -> list[dict[str, str]]:
    """Rows of the evaluation of the best agent, played once and kept beside it."""
    table = run / f"evaluation_{'_'.join(against)}_{games}.csv"
    if not table.exists():
        words = [str(run / BEST_FOLDER), "--against", *against, "--games", str(games)]
        words += ["--seed", str(UNSEEN_SEED)]
        if code := marl_cair(["evaluate", *words, "--out", str(table)]):
            sys.exit(code)
    with table.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def main() -> None:
    """Train, rate and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--networks", nargs="+", default=["conv", "capsule"])
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--minutes", type=float, default=12.0, help="of training of each run")
    parser.add_argument("--games", type=int, default=500, help="against each opponent")
    parser.add_argument("--against", nargs="+", default=["random", "counter"])
    parser.add_argument("--out", type=Path, default=Path("runs/results"))
    options, words = parser.parse_known_args()
    rows: list[tuple[Any, ...]] = []
    for network in options.networks:
        for seed in options.seeds:
            run = options.out / f"{network}-{seed}"
            fixed = [f"policy={network}", f"seed={seed}"]
            fixed.append(f"evaluation.bots=[{','.join(options.against)}]")
            train(run, options.minutes, [*fixed, *override(RECIPE, words)])
            decisions = read_description(run / BEST_FOLDER).frames
            minutes = f"{trained_minutes(run):.1f}"
            for line in rate(run, options.against, options.games):
                shares = [f"{100 * float(line[name]):.1f}" for name in ("win_rate", "low", "high")]
                rows.append(
                    (network, seed, decisions, minutes, line["opponent"], line["games"], *shares)
                )
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([COLUMNS, *rows])
    write_atomically(options.out / "results.csv", text.getvalue())
    print("| network | seed | decisions | minutes | against | games | won |")
    print("|---|---|---|---|---|---|---|")
    for network, seed, decisions, minutes, opponent, games, won, low, high in rows:
        print(
            f"| {network} | {seed} | {decisions:,} | {minutes} | `{opponent}` | {games} "
            f"| {won} % [{low}, {high}] |"
        )


if __name__ == "__main__":
    main()
