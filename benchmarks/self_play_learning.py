"""Rate runs of self-play that went on from one another: the ladder of one learner and its past.

    python -m benchmarks.self_play_learning RUN [RUN ...] [--alone AGENT] [--games 200]
        [--past-games 20] [--past-every 200000] [--budget 20m] [--workers 2]
        [--out runs/self_play_stages] [--picture <out>/self_play.png] [option=value ...]

Each RUN is a folder of `marl-cair train` or an agent's alone, in the order in which they went on
from one another: the decisions of each are counted on from those of all before it. The last agent
plays `--games` games against each bot and `--alone`, an agent that met random play alone; what was
kept of its past, thinned to one agent in `--past-every` decisions, `--past-games` against
everybody. A best response to the last agent is rated by `marl-cair league exploit` (options with
`=` go to it) on map seeds that nothing else has seen; `--budget 0` trains none. The same command
again goes on where it was stopped. Writes <out>/results.csv and the picture, and prints the table
as Markdown.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

from benchmarks.league_learning import (
    ALONE,
    EXPLOIT,
    MAIN,
    draw,
    exploit,
    find_progress,
    print_rows,
    read_ladder,
    read_response,
    read_scores,
    run,
    tell_progress,
    write_rows,
)
from marl_cair.checkpoint import DESCRIPTION_FILE, read_description
from marl_cair.files import copy_folder, find_folder
from marl_cair.games import GAMES

AGENTS, LADDER = "agents", "ladder"


def list_past(runs: list[Path]) -> Iterator[tuple[int, Path]]:
    """Each agent that was kept, and its decisions since the first run began; ascending."""
    before = 0
    for folder in runs:
        last = folder if (folder / DESCRIPTION_FILE).exists() else find_folder(folder / "latest")
        kept = sorted((folder / "snapshots").glob(f"*/{DESCRIPTION_FILE}"))
        for agent in (file.parent for file in kept):
            if (frames := read_description(agent).frames) < read_description(last).frames:
                yield before + frames, agent
        before += read_description(last).frames
        yield before, last


def thin(past: list[tuple[int, Path]], every: int) -> list[tuple[int, Path]]:
    """One of `every` decisions at the most, the last always."""
    kept = past[-1:]
    for decisions, agent in reversed(past[:-1]):
        if kept[0][0] - decisions >= every:
            kept.insert(0, (decisions, agent))
    return kept


def gather(options: argparse.Namespace, agents: Path) -> int:
    """Copies of all in `agents`, named as a league names them; returns the last one's decisions."""
    past = list(list_past(options.runs))
    decisions, last = past[-1]
    copies = {f"{MAIN}-0-{at}": agent for at, agent in thin(past, options.past_every)[:-1]}
    copies[MAIN] = last
    if options.alone:
        copies[ALONE] = options.alone
    for name, agent in copies.items():
        if not (agents / name).exists():
            copy_folder(agent, agents / name)
    return decisions


def play(options: argparse.Namespace, out: Path) -> Path:
    """The ladder of all, and the best response; returns the ladder's folder."""
    agents, ladder = out / AGENTS, out / LADDER
    words = ["--workers", str(options.workers), "--out", str(ladder)]
    bots = GAMES[read_description(agents / MAIN).game].bots
    now = [str(agents / MAIN), *([str(agents / ALONE)] if options.alone else []), *bots]
    past = [str(path) for path in sorted(agents.glob(f"{MAIN}-*"))]
    run(["league", *now, "--games", str(options.games), "--no-replays", *words])
    if past:
        few = ["--games", str(options.past_games)]
        run(["league", *past, "--ladder", *now, *few, *words])
    if options.budget != "0":
        exploit(agents / MAIN, options, out / EXPLOIT)
    return ladder


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
    decisions = gather(options, options.out / AGENTS)
    ladder = play(options, options.out)
    rated, scores = read_ladder(ladder), read_scores(ladder, MAIN)
    progress = find_progress(rated, decisions)
    values = ("score", "low", "high", "games")
    rows: list[tuple[object, ...]] = [
        ("last agent scores", name, *(row[key] for key in values)) for name, row in scores.items()
    ]
    if options.budget != "0":
        found = read_response(options.out / EXPLOIT)
        told = f"best response of {options.budget} scores"
        rows.append((told, "last agent", *map(found.get, values)))
    rows.append(tell_progress(progress))
    write_rows(rows, options.out)
    others = {name: one for name, one in rated.items() if not name.startswith(MAIN)}
    titles = "One learner and its past selves", "The last agent"
    draw(progress, others, scores, titles, options.picture or options.out / "self_play.png")
    print(f"{decisions:,} decisions\n")
    print_rows(rows)


if __name__ == "__main__":
    main()
