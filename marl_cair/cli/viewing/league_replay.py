"""`marl-cair league replay`: write games of a league as replay files, played again from seeds."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import numpy as np

from marl_cair.cli import EXIT_DONE
from marl_cair.cli import match_options as shared
from marl_cair.cli.parser import Parser
from marl_cair.games.replays import REPLAY_SUFFIX, write_replay
from marl_cair.league.store.store import STORE_FILE, LeagueStore
from marl_cair.lookup import check_name


def run(arguments: Sequence[str]) -> int:
    """Write the files, and print a line for each game; returns the exit code."""
    options = make_parser().parse_args(arguments)
    if options.games < 1:
        raise ValueError(f"--games is {options.games}, it must be 1 or more")
    from marl_cair.league.report.replays import NotShownError, ReplayRenderer
    from marl_cair.league.report.report import name_agents

    folder = Path(options.out)
    target = Path(options.to or folder / "games")
    with closing(LeagueStore(folder / STORE_FILE)) as store:
        stored, names = store.read_games(), name_agents(store.read_agents())
        for name in options.between:
            check_name("agent of this league", name, names.values())
        ids = [number for number, name in names.items() if name in options.between]
        chosen = [place for place, row in enumerate(stored.agents) if np.isin(ids, row).all()]
        load = shared.choose_load(options)
        renderer = ReplayRenderer(store, stored, names, folder, load, options.allow_code)
        for place in chosen[: options.games]:
            number, turn = int(stored.line_ups[place]), int(stored.turns[place])
            name = f"{number:04}-{int(stored.numbers[place]):04}-{turn}{REPLAY_SUFFIX}"
            try:
                write_replay(target / name, renderer.play_again(place)[0])
                sys.stdout.write(f"{target / name}: {renderer.describe(place)}\n")
            except NotShownError as error:
                sys.stdout.write(f"not written: {renderer.describe(place)} {error}\n")
    return EXIT_DONE


def make_parser() -> Parser:
    """The options of the command."""
    parser = Parser("marl-cair league replay", description=__doc__)
    parser.add_argument(
        "out",
        nargs="?",
        default=shared.DEFAULT_OUT,
        help="folder of the league (default: %(default)s)",
    )
    parser.add_argument(
        "--between",
        nargs="+",
        default=[],
        metavar="NAME",
        help="only games in which all these agents play, as the ladder calls them (default: all)",
    )
    parser.add_argument("--games", type=int, default=10, help="at most (default: %(default)s)")
    parser.add_argument(
        "--to", help="folder to write to (default: `games` in the folder of the league)"
    )
    shared.add_options(parser, "--allow-code", *shared.ANSWER_LIMITS, files="the league file")
    return parser
