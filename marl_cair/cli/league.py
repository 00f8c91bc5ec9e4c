"""`marl-cair league`: any agents, one round-robin, ratings with intervals."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from marl_cair.cli import EXIT_DONE
from marl_cair.cli.match_options import add_match_options
from marl_cair.league.agents import find_scenario
from marl_cair.league.league import LeagueConfig, run_league


def run(arguments: Sequence[str]) -> int:
    """Play and print ladder and matrix; returns the exit code."""
    options = make_parser().parse_args(arguments)
    game, scenario, scenario_options = find_scenario(options.agents, options.game, options.scenario)
    result = run_league(
        LeagueConfig(
            agents=tuple(options.agents),
            game=game.name,
            scenario=scenario,
            scenario_options=scenario_options,
            games_per_pair=options.games,
            seed=options.seed,
            out=options.out,
        )
    )
    sys.stdout.write(
        f"{result.text}\nladder.txt, ladder.csv, winrates.csv, league.png and league.pdf are in "
        f"{result.folder}\n"
    )
    return EXIT_DONE


def make_parser() -> argparse.ArgumentParser:
    """The options of the command."""
    parser = argparse.ArgumentParser(
        "marl-cair league",
        description=f"{__doc__} The same command again goes on where it stopped, and with more "
        "games or agents plays only what is new.",
    )
    parser.add_argument(
        "agents",
        nargs="+",
        help="two or more: folders of checkpoints (runs/a/latest) and bots (`marl-cair games` "
        "lists them); `random` is rated 0 where it takes part",
    )
    add_match_options(parser, 40, "of each pair", "first checkpoint", "bots alone")
    parser.add_argument(
        "--out",
        default="runs/league",
        help="folder of results and report; one of another seed, game or scenario is refused "
        "(default: %(default)s)",
    )
    return parser
