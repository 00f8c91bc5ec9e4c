"""`marl-cair league mix`: the safest mixture of a league's agents, as one agent.

Where every single agent has somebody who beats it, one of several, drawn before each game, is
harder to beat. The weights are those whose least score against any agent of the league is the
highest, as evenly spread as that allows.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from marl_cair.cli import EXIT_DONE
from marl_cair.cli.parser import Parser
from marl_cair.league.agents.mixtures import SLACK, save_mixture

DEFAULT_OUT = "runs/mixture"


def run(arguments: Sequence[str]) -> int:
    """Find the weights, write the agent and tell; returns the exit code."""
    options = make_parser().parse_intermixed_args(arguments)
    from marl_cair.league.mixing import describe_mixture, mix_league

    found = mix_league(Path(options.folder), options.agents, options.slack)
    save_mixture(options.out, found.sources, found.weights)
    sys.stdout.write(f"{describe_mixture(found)}{options.out} is this agent\n")
    return EXIT_DONE


def make_parser() -> Parser:
    """The options of the command."""
    parser = Parser(
        "marl-cair league mix",
        description=__doc__,
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
        default=DEFAULT_OUT,
        help="folder to write; a mixture that is there is replaced (default: %(default)s)",
    )
    return parser
