"""Compare mixtures of opponents on a real game: which self-play makes the stronger agents?

    python -m benchmarks.opponents [--mixtures default latest ...] [--seeds 0 1 2]
        [--frames 500000] [--games 100] [--out runs/opponents] [option=value ...]

Every mixture trains one agent for each seed, all with the same number of decisions; options with
`=` go to `marl-cair train` (Deep Line Wars 10x15 by default). The agents as they are at the end
(none is chosen by its results) then play each other and the game's bots, seat-balanced, on map
seeds that no training has seen. One after another; the same command again goes on where it was
stopped. Writes <out>/matches.csv and prints a table as Markdown: the mean score against agents of
all other mixtures with the range over seeds, the lowest score against any one of them (how well the
others exploit it), and the mean score against bots. A difference between mixtures that is smaller
than the range over seeds has not been shown.
"""

from __future__ import annotations

import argparse
import csv
import io
import sys
from pathlib import Path

import numpy as np

from marl_cair.checkpoint import LATEST_FOLDER
from marl_cair.cli import main as marl_cair
from marl_cair.cli.compose import override
from marl_cair.files import write_atomically
from marl_cair.games import GAMES
from marl_cair.league.agents.load import load_agent
from marl_cair.league.play.match import play_match
from marl_cair.training.demo import FINISHED_FILE, MIXTURE
from marl_cair.training.settings.config import SELF_PLAY
from marl_cair.training.settings.config_file import CONFIG_FILE, load_config

MIXTURES: dict[str, dict[str, float]] = {
    "default": SELF_PLAY,
    "demo": MIXTURE,
    "latest": {"latest": 1.0},
    "uniform": {"uniform": 1.0},
    "half_recent": {"latest": 0.5, "recent": 0.5},  # as Unity ML-Agents
    "fifth_uniform": {"latest": 0.8, "uniform": 0.2},  # as OpenAI Five
    "half_delta": {"latest": 0.5, "delta_uniform": 0.5},
    "pfsp": {"latest": 0.35, "pfsp": 0.65},
    "pfsp_variance": {"latest": 0.35, "pfsp_variance": 0.65},
    "nash": {"latest": 0.35, "nash": 0.65},
    "bots": {"bots": 1.0},
}
RECIPE = (
    "policy=conv",
    "generator.name=none",
    "opponent.snapshot_every_frames=25000",
    "evaluation.every_frames=50000",
    "checkpoint.include_replay=false",
)
UNSEEN_SEED = 2_000_000
COLUMNS = ("first", "second", "games", "score")


def train(run: Path, mixture: str, frames: int, seed: int, words: list[str]) -> None:
    """Train an agent, or resume it. Exits where training was refused or interrupted."""
    finished = run / FINISHED_FILE
    if finished.exists():
        return
    if (run / CONFIG_FILE).exists():
        command = [f"resume={run}", f"total_frames={frames}"]
    else:
        weights = ", ".join(f"{name}: {weight}" for name, weight in MIXTURES[mixture].items())
        fixed = [f"out={run}", f"seed={seed}", f"total_frames={frames}"]
        command = [*fixed, f"opponent.mixture={{{weights}}}", *override(RECIPE, words)]
    if code := marl_cair(["train", *command]):
        sys.exit(code)
    write_atomically(finished, f"{frames} decisions\n")


def read_matches(path: Path) -> dict[tuple[str, str, int], float]:
    """Scores that an earlier call has played, by both names and the number of games."""
    if not path.is_file():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        return {
            (row["first"], row["second"], int(row["games"])): float(row["score"])
            for row in csv.DictReader(file)
        }


def play_all(out: Path, runs: dict[str, list[str]], games: int) -> dict[tuple[str, str], float]:
    """Scores of the first of each pair: agents of different mixtures, and agents against bots."""
    path = out / "matches.csv"
    known = read_matches(path)
    names = [name for of_mixture in runs.values() for name in of_mixture]
    config = load_config(out / names[0])
    game = GAMES[config.game.name]
    scenario = game.scenario(config.game.scenario, **config.game.options)
    mixture_of = {name: mixture for mixture, of_mixture in runs.items() for name in of_mixture}
    agents = {
        name: load_agent(out / name / LATEST_FOLDER, game.name, scenario) for name in names
    } | {name: game.bot(name, scenario) for name in game.bots}
    scores = {}
    for place, first in enumerate(names):
        rivals = [other for other in names[place + 1 :] if mixture_of[other] != mixture_of[first]]
        for second in (*rivals, *game.bots):
            key = (first, second, games)
            if key not in known:
                played = play_match(
                    agents[first], agents[second], game, scenario, games, UNSEEN_SEED
                )
                known[key] = played.score
                text = io.StringIO()
                rows = [(*pair, f"{score:.6f}") for pair, score in known.items()]
                csv.writer(text, lineterminator="\n").writerows([COLUMNS, *rows])
                write_atomically(path, text.getvalue())
            scores[first, second] = known[key]
            if second in mixture_of:
                scores[second, first] = 1.0 - known[key]
    return scores


def print_table(runs: dict[str, list[str]], scores: dict[tuple[str, str], float]) -> None:
    """One row for each mixture, the strongest first."""
    everybody = {name for of_mixture in runs.values() for name in of_mixture}
    rows = []
    for mixture, names in runs.items():
        others = [
            [score for (first, second), score in scores.items() if first == name and second in who]
            for who in (everybody, {second for _, second in scores} - everybody)
            for name in names
        ]
        agents, bots = others[: len(names)], others[len(names) :]
        means = [float(np.mean(of_run)) for of_run in agents if of_run] or [float("nan")]
        lowest = min((min(of_run) for of_run in agents if of_run), default=float("nan"))
        rows.append((float(np.mean(means)), mixture, means, lowest, float(np.mean(bots))))
    print("| mixture | against agents of the others | seeds | lowest | against bots |")
    print("|---|---|---|---|---|")
    for mean, mixture, means, lowest, of_bots in sorted(rows, reverse=True):
        print(
            f"| {mixture} | {mean:.1%} | {min(means):.1%} to {max(means):.1%} "
            f"| {lowest:.1%} | {of_bots:.1%} |"
        )


def main() -> None:
    """Train, play and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mixtures", nargs="+", choices=MIXTURES, default=list(MIXTURES))
    parser.add_argument("--seeds", nargs="+", type=int, default=[0, 1, 2])
    parser.add_argument("--frames", type=int, default=500_000, help="decisions of each run")
    parser.add_argument("--games", type=int, default=100, help="of each pair")
    parser.add_argument("--out", type=Path, default=Path("runs/opponents"))
    options, words = parser.parse_known_args()
    runs: dict[str, list[str]] = {}
    for mixture in options.mixtures:
        for seed in options.seeds:
            name = f"{mixture}-{seed}"
            train(options.out / name, mixture, options.frames, seed, words)
            runs.setdefault(mixture, []).append(name)
    print_table(runs, play_all(options.out, runs, options.games))


if __name__ == "__main__":
    main()
