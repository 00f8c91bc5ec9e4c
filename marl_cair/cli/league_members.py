"""`marl-cair league add` and `league mix`: add agents to a league, mix its agents into one."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path

from marl_cair.cli import EXIT_DONE
from marl_cair.cli import match_options as shared
from marl_cair.cli.league import add_limits, add_zero, read_limits
from marl_cair.cli.parser import Parser
from marl_cair.league.agents.mixtures import SLACK, save_mixture


def add(arguments: Sequence[str]) -> int:
    """Rate agents by games against all others of a league, which do not play again."""
    options = make_add_parser().parse_args(arguments)
    from marl_cair.league.extend import plan_extension
    from marl_cair.league.league import run_league

    load = shared.choose_load(options)
    folder = Path(options.out)
    found = shared.expand_agents(options.agents)
    agents = found.list_agents(options.agents)
    allow_code = options.allow_code or frozenset(agents)
    max_seconds, games = read_limits(options)
    config = plan_extension(folder, agents, games, options.workers, load, allow_code)
    config = dataclasses.replace(
        config,
        half_width_elo=options.ci,
        max_seconds=max_seconds,
        cluster=options.cluster,
        record=options.record,
        zero=options.zero,
        command=shared.format_command("league add", arguments),
        replays=not options.no_replays,
    )
    return shared.print_league(run_league(config, load))


def make_add_parser() -> Parser:
    """The options of `league add`."""
    parser = Parser("marl-cair league add", description=add.__doc__)
    parser.add_argument(
        "agents",
        nargs="+",
        help="as `marl-cair league` takes them; those that the league has already play on",
    )
    parser.add_argument(
        "--out", default=shared.DEFAULT_OUT, help="folder of the league (default: %(default)s)"
    )
    add_limits(parser)
    add_zero(parser)
    names = (
        *("--games", "--workers", "--cluster", "--record", "--allow-code", "--no-replays"),
        *shared.ANSWER_LIMITS,
    )
    usual = "as many as the league's pairs have on the median"
    shared.add_options(parser, *names, games_of="of each new pair", games=usual, files="the league")
    return parser


def mix(arguments: Sequence[str]) -> int:
    """Save the safest mixture of a league's agents as one agent.

    One member, drawn before each game, plays it, which makes a mixture harder to beat than a single
    agent. Its weights maximise the lowest score against any agent of the league, and are as even as
    that allows.
    """
    options = make_mix_parser().parse_intermixed_args(arguments)
    from marl_cair.league.mixing import describe_mixture, mix_league

    found = mix_league(Path(options.folder), options.agents, options.slack)
    save_mixture(options.out, found.sources, found.weights)
    sys.stdout.write(f"{describe_mixture(found)}The agent is in {options.out}\n")
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
        "agents", nargs="*", help="names of possible members (default: the league's networks)"
    )
    parser.add_argument(
        "--slack",
        type=float,
        default=SLACK,
        help="how much of the lowest score (0..1) evenness may cost (default: %(default)s)",
    )
    parser.add_argument(
        "--out",
        default="runs/mixture",
        help="folder to write; replaces a mixture that is there (default: %(default)s)",
    )
    return parser
