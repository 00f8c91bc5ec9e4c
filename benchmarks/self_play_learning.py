"""Rate runs of self-play that went on from one another: the ladder of one learner and its past.

    python -m benchmarks.self_play_learning RUN [RUN ...] [--alone AGENT] [--games 200]
        [--past-games 20] [--past-every 200000] [--budget 20m] [--workers 2]
        [--out runs/self_play_stages] [--picture <out>/self_play.png] [option=value ...]

Each RUN is a folder of `marl-cair train` or an agent's alone, in the order in which they went on
from one another; agents carry the sum of their decisions. The last agent
plays `--games` games against each bot and `--alone`, an agent that met random play alone; what was
kept of its past, thinned to one agent in `--past-every` decisions, `--past-games` against
everybody. A best response to the last agent is rated by `marl-cair league exploit` (options with
`=` go to it) on map seeds that nothing else has seen; `--budget 0` trains none. The same command
again goes on where it was stopped. Writes <out>/results.csv and the picture, and prints the table
as Markdown.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

from benchmarks._ladders import (
    ALONE,
    EXPLOIT,
    LADDER,
    MAIN,
    exploit,
    format_response,
    format_scores,
    name_past,
    read_decisions,
    run,
    show,
    trace_learner,
)
from marl_cair.checkpoint import SNAPSHOT_FOLDER, find_agent, read_description
from marl_cair.files import copy_folder
from marl_cair.games import GAMES
from marl_cair.league.agents.run_folders import list_checkpoints

AGENTS = "agents"
NO_BUDGET = "0"


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
