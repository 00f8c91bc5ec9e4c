"""The options that `evaluate`, `match` and `league` share: games, seed, game and scenario."""

from __future__ import annotations

import argparse

from marl_cair.games import GAMES


def add_match_options(
    parser: argparse.ArgumentParser, games: int, games_of: str, trained: str, bots_alone: str
) -> None:
    """Add --games, --seed, --game and --scenario.

    games: how many by default; games_of: against or of whom, for the help; trained: whose training
    gives game and scenario; bots_alone: who takes the game's default scenario.
    """
    parser.add_argument(
        "--games",
        type=int,
        default=games,
        help=f"games {games_of}, as many in each seat (default: {games})",
    )
    parser.add_argument(
        "--seed",
        type=int,
        default=0,
        help="whole number; the same seed plays the same games (default: %(default)s)",
    )
    parser.add_argument(
        "--game",
        choices=list(GAMES),
        help=f"default: the one that the {trained} was trained on, or the first choice",
    )
    parser.add_argument(
        "--scenario",
        help="a scenario of the game, as `marl-cair games` lists them (default: the one of that "
        f"training; for {bots_alone} the game's default)",
    )


def add_answer_seconds(parser: argparse.ArgumentParser) -> None:
    """Add --answer-seconds."""
    parser.add_argument(
        "--answer-seconds",
        type=float,
        default=None,
        help="limit for each answer of module:function, which then runs in a process of its own, "
        "and of process:COMMAND; who misses it forfeits (default: none, and 10 for commands)",
    )
