"""Train a league, an agent against random play alone, and best responses; rate them: the self-play
results of the README.

    python -m benchmarks.league_learning [--game deep_line_wars] [--league league.yaml]
        [--alone-frames 150000] [--games 200] [--past-games 40] [--budget 20m] [--workers 2]
        [--out runs/self_play_<game>] [--picture docs/images/self_play_<game>.png]
        [option=value ...]

The league is the ready-made one of the game (`marl-cair league train --example`), or `--league`.
`--games` of the main agent and of the league's mixture against each bot and against the agent that
met random play alone, and `--past-games` of each past self against everybody, are one ladder; best
responses to both are rated by `marl-cair league exploit` (options with `=` go to it) on map seeds
that nothing else has seen. The same command again goes on where it was stopped. Writes
<out>/results.csv and the picture, and prints the table as Markdown.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
import re
import sys
from collections.abc import Iterator, Mapping
from math import isnan, nan
from pathlib import Path
from typing import Any, NamedTuple

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.stats import spearmanr

from benchmarks.learning import train, trained_minutes
from marl_cair.checkpoint import read_description
from marl_cair.cli import main as marl_cair
from marl_cair.cli.league_train import format_options
from marl_cair.files import atomic_path, write_atomically
from marl_cair.training.curves import COLOURS
from marl_cair.training.league_examples import EXAMPLES
from marl_cair.training.league_run import MIXTURE
from marl_cair.training.league_settings import build_league, load_league

MAIN, ALONE, EXPLOIT = "main_0", "alone", "exploit"
_PAST = re.compile(rf"{MAIN}-\d+-(\d+)$")  # the name of a frozen player ends in its decisions
COLUMNS = ("what", "against", "value", "low", "high", "games")


class Rated(NamedTuple):
    """A row of the ladder."""

    elo: float
    low: float
    high: float


def run(words: list[str]) -> None:
    """One command of marl-cair; exits where that fails or is interrupted."""
    if code := marl_cair(words):
        sys.exit(code)


def list_options(settings: Mapping[str, Any], prefix: str = "") -> Iterator[str]:
    """Nested settings as words of `marl-cair train`."""
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from list_options(value, f"{prefix}{name}.")
        elif isinstance(value, list):
            yield f"{prefix}{name}=[{','.join(map(str, value))}]"
        else:
            yield f"{prefix}{name}={value}"


def train_all(options: argparse.Namespace, out: Path) -> tuple[Path, Path]:
    """The league, then the agent against random play alone; returns the folders of both agents."""
    file = options.league or out / "league.yaml"
    if not file.exists():
        write_atomically(file, format_options(build_league(EXAMPLES[options.game])))
    league = load_league(file)
    folder = out / "league"
    run(["league", "train", str(file), "--out", str(folder)])
    training = dict(league.training)
    training.pop("game", None)
    game = league.learner_config("main").game
    words = [f"game={game.name}", f"scenario={game.scenario}", *list_options(training)]
    words += [f"representation={game.representation}", *list_options(game.options)]
    limits = ["opponent.mixture={random: 1}", f"total_frames={options.alone_frames}"]
    alone = out / ALONE
    train(alone, None, [*words, *limits, "checkpoint.include_replay=false"])
    return folder, alone


def play(options: argparse.Namespace, out: Path, league: Path, alone: Path) -> Path:
    """The ladder of all, and the best responses; returns the ladder's folder."""
    best = league / "shared" / "live" / MAIN
    ladder, workers = out / "ladder", ["--workers", str(options.workers)]
    bots = [str(name) for name in EXAMPLES[options.game]["final_bots"]]
    now = [str(best), str(league / MIXTURE), str(alone / "latest"), *bots]
    players = sorted((league / "shared" / "players").iterdir())
    now_at = read_description(best).frames  # frozen too, at the end of the league
    past = [
        str(path)
        for path in players
        if (found := _PAST.search(path.name)) and int(found[1]) != now_at
    ]
    where = ["--out", str(ladder), *workers]
    run(["league", *now, "--games", str(options.games), "--no-replays", *where])
    run(["league", *past, "--ladder", *now, "--games", str(options.past_games), *where])
    for name, agent in ((MAIN, best), (MIXTURE, league / MIXTURE)):
        exploit(agent, options, out / EXPLOIT / name)
    return ladder


def exploit(agent: Path, options: argparse.Namespace, out: Path) -> None:
    """A best response to `agent`, rated by twice as many games as a pair plays."""
    words = ["--budget", options.budget, "--seeds", "1", "--games", str(2 * options.games)]
    run(["league", "exploit", str(agent), *words, "--out", str(out), *options.words])


def read_table(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def read_ladder(ladder: Path) -> dict[str, Rated]:
    """Ratings by name."""
    return {
        row["agent"]: Rated(*(float(row[name]) for name in Rated._fields))
        for row in read_table(ladder / "ladder.csv")
    }


def read_scores(ladder: Path, agent: str) -> dict[str, dict[str, str]]:
    """What `agent` scores against today's others, by their names."""
    return {
        row["opponent"]: row
        for row in read_table(ladder / "winrates.csv")
        if row["agent"] == agent and not _PAST.search(row["opponent"])
    }


def read_response(folder: Path) -> dict[str, Any]:
    """Score, interval and games of the best response that was chosen."""
    told = json.loads((folder / "exploit.json").read_text("utf-8"))
    chosen: dict[str, Any] = next(r for r in told["responses"] if r["name"] == told["chosen"])
    return chosen


def find_progress(rated: Mapping[str, Rated], decisions: int) -> list[tuple[int, Rated]]:
    """Ratings of the main agent and its past selves by their decisions, ascending."""
    past = {int(found[1]): r for name, r in rated.items() if (found := _PAST.search(name))}
    return sorted({**past, decisions: rated[MAIN]}.items())


def draw(
    progress: list[tuple[int, Rated]],
    others: Mapping[str, Rated],
    scores: Mapping[str, Mapping[str, str]],
    titles: tuple[str, str],
    path: Path,
) -> None:
    """Ratings of some over decisions beside `others`, and what one of them scores."""
    figure = Figure(figsize=(9.0, 3.9), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, width_ratios=(1.45, 1.0))
    thousands = [frames / 1_000 for frames, _ in progress]
    elo = [r.elo for _, r in progress]
    errors = [[r.elo - r.low for _, r in progress], [r.high - r.elo for _, r in progress]]
    left.errorbar(thousands, elo, errors, color=COLOURS[0], marker="o", capsize=2, markersize=4)
    for name, r in others.items():
        left.axhline(r.elo, color="0.6", linewidth=0.8, linestyle="--", zorder=0)
        left.annotate(
            _tell(name),
            (1.0, r.elo),
            xycoords=("axes fraction", "data"),
            xytext=(3, 0),
            textcoords="offset points",
            va="center",
            fontsize=7,
            color="0.3",
        )
    left.set(xlabel="decisions (thousands)", ylabel="Elo (random = 0), 95 %", xlim=(0, None))
    left.set_title(titles[0], fontsize=9)
    names = sorted(scores, key=lambda name: float(scores[name]["score"]))
    values = [100 * float(scores[name]["score"]) for name in names]
    ends = [
        [100 * abs(float(scores[name][end]) - float(scores[name]["score"])) for name in names]
        for end in ("low", "high")
    ]
    labels = [_tell(name) for name in names]
    right.barh(labels, values, xerr=ends, color=COLOURS[5], error_kw={"capsize": 2, "lw": 0.9})
    right.axvline(50, color="black", linewidth=0.7)
    right.set(xlim=(0, 100), xlabel="score, %, 95 %")
    right.set_title(f"{titles[1]} against", fontsize=9)
    for panel in (left, right):
        panel.spines[["top", "right"]].set_visible(False)
        panel.grid(alpha=0.25)
        panel.set_axisbelow(True)
        panel.tick_params(labelsize=7.5)
        for axis in (panel.xaxis, panel.yaxis):
            axis.label.set_size(8)
    with atomic_path(path) as unfinished:
        figure.savefig(unfinished, dpi=150)


def tell_progress(progress: list[tuple[int, Rated]]) -> tuple[object, ...]:
    """A row of Spearman's rank correlation: nan where no two ratings differ."""
    decisions, elo = [at for at, _ in progress], [rated.elo for _, rated in progress]
    rank = float(spearmanr(decisions, elo).statistic) if len(set(elo)) > 1 else nan
    return "rank correlation of rating with decisions", "", rank, "", "", len(progress)


def write_rows(rows: list[tuple[object, ...]], out: Path) -> None:
    """COLUMNS of all rows as <out>/results.csv."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([COLUMNS, *rows])
    write_atomically(out / "results.csv", text.getvalue())


def print_rows(rows: list[tuple[object, ...]]) -> None:
    """The same as Markdown."""
    print("| what | against | result | games |\n|---|---|---|---|")
    for what, against, value, low, high, number in rows:
        if low == "":
            told = "not defined: no two ratings differ" if isnan(value) else f"{value:.2f}"
            print(f"| {what} | | {told} | {number} agents |")
        else:
            shares = (f"{100 * float(str(one)):.1f}" for one in (value, low, high))
            result = "{} % [{}, {}]".format(*shares)
            print(f"| {what} | `{against}` | {result} | {number} |")


def _tell(name: str) -> str:
    return "only met random" if name == ALONE else name


def main() -> None:
    """Train, play, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--game", choices=("deep_line_wars", "deep_rts"), default="deep_line_wars")
    parser.add_argument("--league", type=Path, help="YAML (default: the example of the game)")
    parser.add_argument("--alone-frames", type=int, default=150_000, help="against random alone")
    parser.add_argument(
        "--games",
        type=int,
        default=200,
        help="of each pair of today's agents; a best response's twice",
    )
    parser.add_argument("--past-games", type=int, default=40, help="of each pair of past selves")
    parser.add_argument("--budget", default="20m", help="of the best response")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, help="default: runs/self_play_<game>")
    parser.add_argument("--picture", type=Path, help="default: <out>/self_play.png")
    options, words = parser.parse_known_args()
    options.words = words
    out = options.out or Path("runs") / f"self_play_{options.game}"
    league, alone = train_all(options, out)
    ladder = play(options, out, league, alone)
    rated = read_ladder(ladder)
    decisions = read_description(league / "shared" / "live" / MAIN).frames
    progress = find_progress(rated, decisions)
    scores = read_scores(ladder, MAIN)
    values = ("score", "low", "high", "games")
    rows: list[tuple[object, ...]] = [
        (f"{told} scores", name, *(row[key] for key in values))
        for told, agent in (("main agent", MAIN), ("mixture", MIXTURE))
        for name, row in read_scores(ladder, agent).items()
    ]
    for name in (MAIN, MIXTURE):
        found = read_response(out / EXPLOIT / name)
        rows.append((f"best response of {options.budget} scores", name, *map(found.get, values)))
    rows.append(tell_progress(progress))
    write_rows(rows, out)
    others = {name: r for name, r in rated.items() if name != MAIN and not _PAST.search(name)}
    titles = "The main agent and its past selves", "The main agent"
    draw(progress, others, scores, titles, options.picture or out / "self_play.png")
    minutes = sum(
        trained_minutes(path.parent) for path in (league / "members").glob("*/*/config.yaml")
    )
    print(f"{minutes:.0f} minutes of the league, {decisions:,} decisions of the main agent\n")
    print_rows(rows)


if __name__ == "__main__":
    main()
