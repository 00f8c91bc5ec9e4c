"""`marl-cair evaluate`: shares of games won by one agent against others, with 95 % intervals.

Agents play greedily, for the rated reward, equally often in each seat. In games of more than two
the agent has one seat (or team) and each opponent all others. In games for one, all agents play the
same map seeds, each alone.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from marl_cair.cli import EXIT_DONE
from marl_cair.cli import match_options as shared
from marl_cair.cli.match import describe_doubts, warn_of_repeats
from marl_cair.cli.parser import Parser
from marl_cair.files import write_atomically
from marl_cair.games.game import Game
from marl_cair.league.agents.load import find_fingerprint
from marl_cair.league.play.match import play_match, require_rivals
from marl_cair.league.play.solo import play_alone
from marl_cair.league.ratings.intervals import mean_interval, median_interval, share_interval
from marl_cair.text import format_csv

COLUMNS = ("opponent", "games", "wins", "draws", "losses", "share_won", "low", "high")
_OF_MEDIAN = ("median", "median_low", "median_high")
ALONE_COLUMNS = ("agent", "number", "games", "mean", "low", "high", *_OF_MEDIAN)


def run(arguments: Sequence[str]) -> int:
    """Play and print a table, each row as soon as it is played; returns the exit code."""
    options = make_parser().parse_args(arguments)
    if options.out and Path(options.out).is_dir():
        raise IsADirectoryError(f"--out {options.out} is a folder: give the name of a CSV file")
    twice = {name for name in options.against if options.against.count(name) > 1}
    if twice:
        raise ValueError(f"{', '.join(sorted(twice))} is given twice: name each opponent once")
    game, name, scenario = shared.choose_scenario(options, [options.agent])
    is_alone = game.make_spec(scenario).num_teams == 1
    rows = (_rate_alone if is_alone else _rate_against)(options, game, name, scenario)
    if options.out:
        columns = ALONE_COLUMNS if is_alone else COLUMNS
        write_atomically(options.out, format_csv([columns, *rows]))
    return EXIT_DONE


def _rate_against(
    options: argparse.Namespace, game: Game, name: str, scenario: Any
) -> list[tuple[object, ...]]:
    num_teams = require_rivals(game, scenario)
    if not options.against:
        raise ValueError(
            f"--against is empty: name one or more opponents on {game.name}, for example random"
        )
    num_games = shared.round_games(options.games, game.make_spec(scenario))
    load = shared.choose_load(options)
    agent = load(options.agent, game.name, scenario)
    opponents = [load(opponent, game.name, scenario) for opponent in options.against]
    width = max(len("against"), *map(len, options.against))
    fair = "" if num_teams == 2 else f" (fair: {1.0 / num_teams:.1%})"
    sys.stdout.write(
        f"{options.agent} on {game.name} {name}: share of games won{fair}, draws are not wins\n"
        f"{'against':{width}} {'games':>6} {'won':>6} {'drawn':>6} {'lost':>6}  share won\n"
    )
    rows: list[tuple[object, ...]] = []
    for source, opponent in zip(options.against, opponents, strict=True):
        identities = find_fingerprint(agent, game), find_fingerprint(opponent, game)
        record = shared.choose_recording(options.record, options.agent, source)
        played = play_match(
            agent, opponent, game, scenario, num_games, options.seed, identities, record
        )
        match = played.without_repeats()
        doubts = describe_doubts(num_games, match)
        counts = match.games, match.wins, match.draws, match.losses
        shares = match.wins / match.games, *match.interval(wins_only=True)
        sys.stdout.write(f"{format_row(source, counts, shares, width)}{doubts}\n")
        sys.stdout.flush()
        rows.append((source, *counts, *_digits(*shares)))
    return rows


def _rate_alone(
    options: argparse.Namespace, game: Game, name: str, scenario: Any
) -> list[tuple[object, ...]]:
    sources = [options.agent, *options.against]
    load = shared.choose_load(options)
    agents = [load(one, game.name, scenario) for one in sources]
    sys.stdout.write(f"{game.name} {name}: {options.games} games, each alone, 95 % intervals\n")
    rows: list[tuple[object, ...]] = []
    for source, agent in zip(sources, agents, strict=True):
        identity = find_fingerprint(agent, game)
        record = shared.choose_recording(options.record, source)
        played = play_alone(agent, game, scenario, options.games, options.seed, identity, record)
        result = played.without_repeats()
        doubts = warn_of_repeats(options.games, played.distinct_games)
        low, high = share_interval(result.ended, result.games)
        part = result.ended / result.games
        sys.stdout.write(
            f"{source}: {part:.1%} [{low:.1%}, {high:.1%}] ended before the time limit{doubts}\n"
        )
        rows.append((source, "ended", result.games, *_digits(part, low, high), "", "", ""))
        for number, values in {"score": result.scores, **result.numbers}.items():
            mean = float(values.mean()), *mean_interval(values)
            median = float(np.median(values)), *median_interval(values)
            sys.stdout.write(f"  {number}: {_format(*mean)}, median {_format(*median)}\n")
            rows.append((source, number, result.games, *_digits(*mean), *_digits(*median)))
        sys.stdout.flush()
    return rows


def _format(value: float, low: float, high: float) -> str:
    return f"{value:.2f}" + (f" [{low:.2f}, {high:.2f}]" if np.isfinite(high - low) else "")


def _digits(*values: float) -> tuple[str, ...]:
    return tuple(f"{value:.4f}" for value in values)


def format_row(
    source: str, counts: Sequence[int], shares: tuple[float, float, float], width: int
) -> str:
    """Games, wins, draws and losses against one opponent; the share won with its 95 % interval."""
    share, low, high = shares
    numbers = " ".join(f"{count:>6}" for count in counts)
    return f"{source:{width}} {numbers}  {share:.1%} [{low:.1%}, {high:.1%}]"


def make_parser() -> Parser:
    """The options of the command."""
    parser = Parser("marl-cair evaluate", description=__doc__)
    parser.add_argument("agent", help=shared.AGENT_HELP)
    parser.add_argument(
        "--against", nargs="*", default=["random"], help="opponents, as AGENT (default: random)"
    )
    shared.add_options(
        parser,
        *(*shared.MATCH_OPTIONS, "--record"),
        games_of="against each opponent",
        games="%(default)s",
    )
    parser.set_defaults(games=500)
    parser.add_argument("--out", help="CSV file to write the table to (default: none is written)")
    return parser
