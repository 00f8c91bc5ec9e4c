"""`marl-cair league add`: new agents play all that are in a league; nobody else plays anew."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from marl_cair.cli.league import DEFAULT_OUT, tell, tell_command
from marl_cair.cli.match_options import (
    add_allow_code,
    add_answer_limits,
    add_no_replays,
    add_workers,
    choose_load,
    expand_agents,
)
from marl_cair.cli.parser import Parser


def run(arguments: Sequence[str]) -> int:
    """Play and print ladder and matrix; returns the exit code."""
    options = make_parser().parse_args(arguments)
    from marl_cair.league.extend import list_fingerprints, plan_extension
    from marl_cair.league.league import run_league

    load = choose_load(options)
    folder = Path(options.out)
    found = expand_agents(options.agents, known=list_fingerprints(folder))
    agents = found.list_agents(options.agents)
    allow_code = options.allow_code or frozenset(agents)
    config = plan_extension(folder, agents, options.games, options.workers, load, allow_code)
    told = tell_command("league add", arguments)
    return tell(
        run_league(dataclasses.replace(config, command=told, replays=not options.no_replays), load)
    )


def make_parser() -> Parser:
    """The options of the command."""
    parser = Parser("marl-cair league add", description=__doc__)
    parser.add_argument(
        "agents",
        nargs="+",
        help="as `marl-cair league` takes them; of a run those that are not in the league yet",
    )
    parser.add_argument(
        "--out", default=DEFAULT_OUT, help="folder of the league (default: %(default)s)"
    )
    parser.add_argument(
        "--games",
        type=int,
        default=None,
        help="games of each new pair (default: as many as the league's pairs have on the median)",
    )
    add_workers(parser)
    add_answer_limits(parser)
    add_allow_code(parser, "the league")
    add_no_replays(parser)
    return parser
