"""`marl-cair evaluate`: one agent against others, greedy, sparse reward, seats balanced."""

from __future__ import annotations

import argparse
import csv
import io
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from marl_cair.checkpoint import read_description
from marl_cair.cli import EXIT_DONE
from marl_cair.files import write_atomically
from marl_cair.games import GAMES
from marl_cair.games.game import Game
from marl_cair.league.agents import load_agent
from marl_cair.league.match import play_match
from marl_cair.league.ratings import win_rate_interval

COLUMNS = ("opponent", "games", "wins", "draws", "losses", "win_rate", "low", "high")


def run(arguments: Sequence[str]) -> int:
    """Play and print a table; returns the exit code."""
    options = make_parser().parse_args(arguments)
    game, scenario = find_scenario(options.agent, options.game, options.scenario)
    agent = load_agent(options.agent, game.name, scenario)
    opponents = [load_agent(name, game.name, scenario) for name in options.against]
    rows = []
    for name, opponent in zip(options.against, opponents, strict=True):
        match = play_match(agent, opponent, game, scenario, options.games, options.seed)
        low, high = win_rate_interval(match.wins, 0, match.games)
        share = match.wins / match.games
        rows.append((name, match.games, match.wins, match.draws, match.losses, share, low, high))
    sys.stdout.write(format_table(options.agent, rows))
    if options.out:
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerows([COLUMNS, *rows])
        write_atomically(options.out, text.getvalue())
    return EXIT_DONE


def find_scenario(agent: str, game_name: str, scenario: str | None) -> tuple[Game, Any]:
    """The game, and the scenario: the given one, else the one a checkpoint was trained on."""
    game = GAMES[game_name]
    if scenario is None and Path(agent).is_dir():
        about = read_description(agent)
        game = GAMES[about.game]
        return game, game.scenario(about.scenario, **{**about.scenario_options, "reward": "sparse"})
    return game, game.scenario(scenario, reward="sparse")


def format_table(agent: str, rows: Sequence[tuple[Any, ...]]) -> str:
    """Wins, draws and losses against each opponent with Wilson's interval of the win rate."""
    width = max(len("against"), *(len(str(row[0])) for row in rows))
    lines = [f"{agent}: share of games won, draws are not wins"]
    lines.append(f"{'against':{width}} {'games':>6} {'won':>6} {'drawn':>6} {'lost':>6}  win rate")
    for name, games, wins, draws, losses, share, low, high in rows:
        lines.append(
            f"{name:{width}} {games:>6} {wins:>6} {draws:>6} {losses:>6}  "
            f"{share:.1%} [{low:.1%}, {high:.1%}]"
        )
    return "\n".join(lines) + "\n"


def make_parser() -> argparse.ArgumentParser:
    """The options of the command."""
    parser = argparse.ArgumentParser(
        "marl-cair evaluate",
        description=__doc__,
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    parser.add_argument("agent", help="a checkpoint's folder, or a bot as deep_line_wars/counter")
    parser.add_argument("--against", nargs="+", default=["random"], help="bots or checkpoints")
    parser.add_argument("--games", type=int, default=500, help="against each, an even number")
    parser.add_argument("--seed", type=int, default=0, help="the same seed plays the same games")
    parser.add_argument("--game", default=next(iter(GAMES)), choices=list(GAMES), help="of a bot")
    parser.add_argument("--scenario", help="default: the one that the agent was trained on")
    parser.add_argument("--out", help="CSV file to write the table to")
    return parser
