"""`marl-cair games`: what there is to play, as text or JSON."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from marl_cair.cli import EXIT_DONE
from marl_cair.games import GAMES
from marl_cair.games.game import Game, GameSpec
from marl_cair.games.registry import gymnasium_id


def run(arguments: Sequence[str]) -> int:
    """Print the list; returns the exit code."""
    parser = argparse.ArgumentParser("marl-cair games", description=__doc__)
    parser.add_argument("--json", action="store_true", help="everything, for programs")
    listed = {name: describe_game(game) for name, game in GAMES.load_all().items()}
    if parser.parse_args(arguments).json:
        sys.stdout.write(json.dumps(listed, indent=2) + "\n")
    else:
        sys.stdout.write("\n".join(_format(name, told) for name, told in listed.items()))
    return EXIT_DONE


def describe_game(game: Game) -> dict[str, Any]:
    """All of a game that users choose from, as plain data."""
    return {
        "title": game.title,
        "version": game.version,
        "summary": game.summary,
        "players": list(game.player_range),
        "default_scenario": game.default_scenario,
        "bots": list(game.bots),
        "scenarios": {
            name: {
                "gymnasium_id": gymnasium_id(game.gymnasium_prefix, name),
                **_describe_spec(game.make_spec(scenario)),
            }
            for name, scenario in game.scenarios.items()
        },
    }


def _describe_spec(spec: GameSpec) -> dict[str, Any]:
    return {
        "num_players": spec.num_players,
        "num_actions": spec.num_actions,
        "action_names": list(spec.action_names),
        "action_groups": list(spec.action_group_names),
        "ticks_per_step": spec.ticks_per_step,
        "max_ticks": spec.max_ticks,
        "representations": {
            seen.name: {"shape": list(seen.shape), "dtype": np.dtype(seen.dtype).name}
            for seen in spec.representations.values()
        },
    }


def _count_players(fewest: int, most: int) -> str:
    if fewest == most:
        return "1 player" if most == 1 else f"{most} players"
    return f"{fewest} to {most} players"


def _format(name: str, told: dict[str, Any]) -> str:
    players = _count_players(*told["players"])
    lines = [
        f"{name}: {told['title']}, {players}, rules version {told['version']}",
        f"  {told['summary']}",
        f"  bots: {', '.join(told['bots'])}",
    ]
    for scenario, spec in told["scenarios"].items():
        default = " (default)" if scenario == told["default_scenario"] else ""
        players = _count_players(spec["num_players"], spec["num_players"])
        lines.append(
            f"  {scenario}{default}: {spec['gymnasium_id']}, {players}, "
            f"{spec['num_actions']} actions"
        )
        shown = (
            f"{seen} {part['dtype']} {part['shape']}"
            for seen, part in spec["representations"].items()
        )
        lines.append(f"      {', '.join(shown)}")
    first = next(iter(told["scenarios"].values()))
    lines.append(f"  kinds of action: {', '.join(first['action_groups'])}")
    return "\n".join(lines) + "\n"
