"""`marl-cair league`: any agents, one round-robin, ratings with intervals."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from marl_cair.cli import EXIT_DONE
from marl_cair.games import GAMES
from marl_cair.league.league import LeagueConfig, run_league


def run(arguments: Sequence[str]) -> int:
    """Play and print ladder and matrix; returns the exit code."""
    options = make_parser().parse_args(arguments)
    result = run_league(
        LeagueConfig(
            agents=tuple(options.agents),
            game=options.game,
            scenario=options.scenario or GAMES[options.game].default_scenario,
            games_per_pair=options.games,
            seed=options.seed,
            out=options.out,
        )
    )
    sys.stdout.write(f"{result.text}\nladder.csv, winrates.csv, league.png in {result.folder}\n")
    return EXIT_DONE


def make_parser() -> argparse.ArgumentParser:
    """The options of the command."""
    parser = argparse.ArgumentParser(
        "marl-cair league",
        description=f"{__doc__} Calling it again goes on where it stopped.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("agents", nargs="+", help="checkpoint folders and bot names")
    parser.add_argument("--games", type=int, default=40, help="for each pair, an even number")
    parser.add_argument("--seed", type=int, default=0, help="the same seed plays the same games")
    parser.add_argument("--game", default=next(iter(GAMES)), choices=list(GAMES))
    parser.add_argument("--scenario", help="default: the game's")
    parser.add_argument("--out", default="runs/league", help="folder of results and report")
    return parser
