"""Rate runs of self-play that went on from one another: the ladder of one learner and its past.

    python -m benchmarks.self_play_learning RUN [RUN ...] [--alone AGENT] [--games 200]
        [--past-games 20] [--past-every 200000] [--budget 20m] [--workers 2]
        [--out runs/self_play_stages] [--picture <out>/self_play.png] [option=value ...]

Each RUN is a folder of `marl-cair train`, or an agent's alone (as those of a league's main agent,
`runs/league/shared/players/main_0-*`), in the order in which they went on from one another; agents
carry the sum of their decisions. The last agent plays `--games` games against each bot and
`--alone`, an agent that met random play alone; what was kept of its past, thinned to one agent in
`--past-every` decisions, `--past-games` against everybody. A best response to the last agent is
rated by `marl-cair league exploit` (options with `=` go to it) on map seeds that nothing else has
seen; `--budget 0` trains none. The same command again goes on where it was stopped. Writes
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

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from scipy.optimize import isotonic_regression
from scipy.stats import spearmanr

from marl_cair.checkpoint import SNAPSHOT_FOLDER, find_agent, read_description
from marl_cair.cli import main as marl_cair
from marl_cair.files import atomic_path, copy_folder, write_atomically
from marl_cair.games import GAMES
from marl_cair.league.agents.run_folders import list_checkpoints
from marl_cair.training.curves import COLOURS
from marl_cair.training.population.exploit import RESULT_FILE

AGENTS = "agents"
NO_BUDGET = "0"
MAIN, ALONE, LADDER, EXPLOIT = "main_0", "alone", "ladder", "exploit"
_PAST = re.compile(rf"{MAIN}-\d+-(\d+)$")  # past selves are called as leagues call them
LABEL_HEIGHT = 0.033  # of a line of text beside the ladder, in heights of the panel
COLUMNS = ("what", "against", "value", "low", "high", "games")
_VALUES = ("score", "low", "high", "games")  # as files of leagues call the last four

Row = tuple[Any, ...]  # of COLUMNS


class Rated(NamedTuple):
    """A row of the ladder."""

    elo: float
    low: float
    high: float


def run(words: list[str]) -> None:
    """One command of marl-cair; exits where that fails or is interrupted."""
    if code := marl_cair(words):
        sys.exit(code)


def exploit(agent: Path, options: argparse.Namespace, out: Path) -> None:
    """A best response to `agent`, rated by twice as many games as a pair plays."""
    words = ["--budget", options.budget, "--seeds", "1", "--games", str(2 * options.games)]
    run(["league", "exploit", str(agent), *words, "--out", str(out), *options.words])


def name_past(decisions: int) -> str:
    """The name of the learner's past self of so many decisions."""
    return f"{MAIN}-0-{decisions}"


def read_decisions(name: str) -> int | None:
    """Of a past self of the learner, by its name; None of all others."""
    found = _PAST.fullmatch(name)
    return int(found[1]) if found else None


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
        if row["agent"] == agent and read_decisions(row["opponent"]) is None
    }


def read_response(folder: Path) -> dict[str, Any]:
    """Score, interval and games of the best response that was chosen."""
    shown = json.loads((folder / RESULT_FILE).read_text("utf-8"))
    chosen: dict[str, Any] = next(r for r in shown["responses"] if r["name"] == shown["chosen"])
    return chosen


class Traced(NamedTuple):
    """A ladder, parted into what was trained and the rest.

    Attributes:
        progress: ratings of what was trained, by decisions, ascending.
        others: ratings of the rest.
        scores: of one agent against today's others, as `read_scores`.
    """

    progress: list[tuple[int, Rated]]
    others: Mapping[str, Rated]
    scores: Mapping[str, Mapping[str, str]]


def trace_learner(ladder: Path, decisions: int) -> Traced:
    """MAIN, which has learned for so many decisions, and its past selves, beside all others."""
    rated = read_ladder(ladder)
    past = {at: one for name, one in rated.items() if (at := read_decisions(name)) is not None}
    others = {
        name: one for name, one in rated.items() if name != MAIN and read_decisions(name) is None
    }
    progress = sorted({**past, decisions: rated[MAIN]}.items())
    return Traced(progress, others, read_scores(ladder, MAIN))


def list_past(runs: list[Path]) -> Iterator[tuple[int, Path]]:
    """Each agent that was kept, and its decisions since the first run began; ascending."""
    for folder in runs:
        last = read_description(folder)
        for agent in list_checkpoints(folder / SNAPSHOT_FOLDER):
            about = read_description(agent)
            if about.frames < last.frames:
                yield about.frames_total, agent
        yield last.frames_total, find_agent(folder)


def thin(past: list[tuple[int, Path]], every: int) -> list[tuple[int, Path]]:
    """One of `every` decisions at the most, the last always."""
    kept = past[-1:]
    for decisions, agent in reversed(past[:-1]):
        if kept[0][0] - decisions >= every:
            kept.insert(0, (decisions, agent))
    return kept


def gather(options: argparse.Namespace, agents: Path) -> int:
    """Copies of all in `agents`, named as a league names them; returns the last one's decisions.

    Exits where copies of before are of other agents.
    """
    past = list(list_past(options.runs))
    decisions, last = past[-1]
    copies = {name_past(at): agent for at, agent in thin(past, options.past_every)[:-1]}
    copies[MAIN] = last
    if options.alone:
        copies[ALONE] = find_agent(options.alone)
    for name, agent in copies.items():
        if not (agents / name).exists():
            copy_folder(agent, agents / name)
    if read_description(agents / MAIN) != read_description(last):
        sys.exit(f"{agents / MAIN} was another agent before than {last} is now: give another --out")
    return decisions


def play(options: argparse.Namespace, out: Path) -> Path:
    """The ladder of all, and the best response; returns the ladder's folder."""
    agents, ladder = out / AGENTS, out / LADDER
    words = ["--workers", str(options.workers), "--out", str(ladder)]
    bots = GAMES[read_description(agents / MAIN).game].bots
    now = [str(agents / MAIN), *([str(agents / ALONE)] if options.alone else []), *bots]
    past = [str(one) for one in sorted(agents.iterdir()) if read_decisions(one.name) is not None]
    run(["league", *now, "--games", str(options.games), "--no-replays", *words])
    if past:
        few = ["--games", str(options.past_games)]
        run(["league", *past, "--ladder", *now, *few, *words])
    if options.budget != NO_BUDGET:
        exploit(agents / MAIN, options, out / EXPLOIT)
    return ladder


def show(
    traced: Traced, rows: list[Row], titles: tuple[str, str], shown: str, out: Path, picture: Path
) -> None:
    """Write and draw what was found, print `shown`, and the rows as Markdown; the last row is how
    ratings rise with decisions.
    """
    rows = [*rows, _format_progress(traced.progress)]
    _write_rows(rows, out)
    _draw(traced, titles, picture)
    print(f"{shown}\n")
    _print_rows(rows)


def _space_out(heights: list[float], least: float) -> list[float]:
    """The same heights, in their order, moved as little as it takes to stand `least` apart."""
    if not heights:
        return []
    order = np.argsort(heights, kind="stable")
    steps = least * np.arange(len(heights))
    spaced = np.empty(len(heights))
    spaced[order] = isotonic_regression(np.array(heights)[order] - steps).x + steps
    return list(spaced.tolist())


def _draw(traced: Traced, titles: tuple[str, str], path: Path) -> None:
    """Ratings over decisions beside the others', and what one agent scores."""
    progress, others, scores = traced
    figure = Figure(figsize=(9.0, 3.9), layout="constrained")
    FigureCanvasAgg(figure)
    left, right = figure.subplots(1, 2, width_ratios=(1.45, 1.0))
    thousands = [frames / 1_000 for frames, _ in progress]
    elo = [r.elo for _, r in progress]
    errors = [[r.elo - r.low for _, r in progress], [r.high - r.elo for _, r in progress]]
    left.errorbar(thousands, elo, errors, color=COLOURS[0], marker="o", capsize=2, markersize=4)
    for r in others.values():
        left.axhline(r.elo, color="0.6", linewidth=0.8, linestyle="--", zorder=0)
    low, high = left.get_ylim()
    heights = _space_out([r.elo for r in others.values()], LABEL_HEIGHT * (high - low))
    place = ("axes fraction", "data")
    for (name, rating), height in zip(others.items(), heights, strict=True):
        left.annotate(
            _format_name(name),
            (1.0, rating.elo),
            xycoords=place,
            xytext=(1.05, height),  # a thin line leads from there to its own
            textcoords=place,
            arrowprops={"arrowstyle": "-", "color": "0.6", "linewidth": 0.6, "shrinkB": 0.0},
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
    labels = [_format_name(name) for name in names]
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


def format_scores(title: str, ladder: Path, agent: str) -> list[Row]:
    """A row for each of today's others, and the score of `agent` against it; `title`: its name."""
    scores = read_scores(ladder, agent).items()
    return [(f"{title} scores", name, *(row[key] for key in _VALUES)) for name, row in scores]


def format_response(folder: Path, budget: str, against: str) -> Row:
    """A row of the best response in `folder`, of a budget of training."""
    found = read_response(folder)
    return f"best response of {budget} scores", against, *map(found.get, _VALUES)


def _format_progress(progress: list[tuple[int, Rated]]) -> Row:
    """A row of Spearman's rank correlation: nan where no two ratings differ."""
    decisions, elo = [at for at, _ in progress], [rated.elo for _, rated in progress]
    rank = float(spearmanr(decisions, elo).statistic) if len(set(elo)) > 1 else nan
    return "rank correlation of rating with decisions", "", rank, "", "", len(progress)


def _write_rows(rows: list[Row], out: Path) -> None:
    """COLUMNS of all rows as <out>/results.csv."""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([COLUMNS, *rows])
    write_atomically(out / "results.csv", text.getvalue())


def _print_rows(rows: list[Row]) -> None:
    """The same as Markdown."""
    print("| what | against | result | games |\n|---|---|---|---|")
    for what, against, value, low, high, number in rows:
        if low == "":
            shown = "not defined: no two ratings differ" if isnan(value) else f"{value:.2f}"
            print(f"| {what} | | {shown} | {number} agents |")
        else:
            shares = (f"{100 * float(one):.1f}" for one in (value, low, high))
            result = "{} % [{}, {}]".format(*shares)
            print(f"| {what} | `{against}` | {result} | {number} |")


def _format_name(name: str) -> str:
    return "only met random" if name == ALONE else name


def main() -> None:
    """Play, print and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", nargs="+", help="in the order of their training")
    parser.add_argument("--alone", type=Path, help="an agent that met random play alone")
    parser.add_argument(
        "--games", type=int, default=200, help="against each bot; a best response's twice"
    )
    parser.add_argument("--past-games", type=int, default=20, help="of each pair of past selves")
    parser.add_argument("--past-every", type=int, default=200_000, help="decisions")
    parser.add_argument("--budget", default="20m", help="of the best response; 0: none")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("runs/self_play_stages"))
    parser.add_argument("--picture", type=Path, help="default: <out>/self_play.png")
    options, words = parser.parse_known_args()
    options.words = [*(word for word in options.runs if "=" in word), *words]
    options.runs = [Path(name) for name in options.runs if "=" not in name]
    if not options.runs:
        parser.error("name one run or more")
    decisions = gather(options, options.out / AGENTS)
    ladder = play(options, options.out)
    rows = format_scores("last agent", ladder, MAIN)
    if options.budget != NO_BUDGET:
        rows.append(format_response(options.out / EXPLOIT, options.budget, "last agent"))
    titles = "One learner and its past selves", "The last agent"
    picture, title = options.picture or options.out / "self_play.png", f"{decisions:,} decisions"
    show(trace_learner(ladder, decisions), rows, titles, title, options.out, picture)


if __name__ == "__main__":
    main()
