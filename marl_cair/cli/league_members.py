"""`marl-cair league add` and `league mix`: add agents to a league, mix its agents into one."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path

from marl_cair.cli import EXIT_DONE
from marl_cair.cli.match_options import (
    DEFAULT_OUT,
    add_allow_code,
    add_answer_limits,
    add_no_replays,
    add_workers,
    choose_load,
    expand_agents,
    format_command,
    print_league,
)
from marl_cair.cli.parser import Parser
from marl_cair.league.agents.mixtures import SLACK, save_mixture

MIXTURE_OUT = "runs/mixture"


def add(arguments: Sequence[str]) -> int:
    """New agents play all agents of a league; the others do not play again."""
    options = make_add_parser().parse_args(arguments)
    from marl_cair.league.extend import list_fingerprints, plan_extension
    from marl_cair.league.league import run_league

    load = choose_load(options)
    folder = Path(options.out)
    found = expand_agents(options.agents, known=list_fingerprints(folder))
    agents = found.list_agents(options.agents)
    allow_code = options.allow_code or frozenset(agents)
    config = plan_extension(folder, agents, options.games, options.workers, load, allow_code)
    command = format_command("league add", arguments)
    config = dataclasses.replace(config, command=command, replays=not options.no_replays)
    return print_league(run_league(config, load))


def make_add_parser() -> Parser:
    """The options of `league add`."""
    parser = Parser("marl-cair league add", description=add.__doc__)
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


def mix(arguments: Sequence[str]) -> int:
    """The safest mixture of a league's agents, as one agent.

    A single agent may always be beaten by another one; a mixture, drawn before each game, is harder
    to beat. Its weights have the highest possible least score against any agent of the league, and
    are as even as that allows.
    """
    options = make_mix_parser().parse_intermixed_args(arguments)
    from marl_cair.league.mixing import describe_mixture, mix_league

    found = mix_league(Path(options.folder), options.agents, options.slack)
    save_mixture(options.out, found.sources, found.weights)
    sys.stdout.write(f"{describe_mixture(found)}{options.out} is this agent\n")
    return EXIT_DONE


def make_mix_parser() -> Parser:
    """The options of `league mix`."""
    parser = Parser(
        "marl-cair league mix",
        description=mix.__doc__,
        epilog="example: marl-cair league mix runs/league --out runs/best && marl-cair league "
        "runs/best rusher turtle",
    )
    parser.add_argument("folder", help="of a league in which all have played all")
    parser.add_argument(
        "agents", nargs="*", help="who may be a member, by name (default: the league's networks)"
    )
    parser.add_argument(
        "--slack",
        type=float,
        default=SLACK,
        help="of the least score (0..1), that evenness may cost (default: %(default)s)",
    )
    parser.add_argument(
        "--out",
        default=MIXTURE_OUT,
        help="folder to write; a mixture that is there is replaced (default: %(default)s)",
    )
    return parser
