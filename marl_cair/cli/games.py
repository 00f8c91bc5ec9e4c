"""`marl-cair games`: list games with scenarios, bots and rewards, as text or as JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from marl_cair.cli import EXIT_DONE
from marl_cair.cli.parser import Parser
from marl_cair.games import GAMES
from marl_cair.games.game import Game, GameSpec
from marl_cair.games.registry import gymnasium_id


class Row(NamedTuple):
    """Scenarios of a game that are equal in all other columns."""

    scenarios: tuple[str, ...]
    players: str
    actions: str
    representations: str
    reward: str


def run(arguments: Sequence[str]) -> int:
    """Print the list; returns the exit code."""
    parser = Parser("marl-cair games", description=__doc__)
    parser.add_argument("games", nargs="*", help="names of games (default: all)")
    parser.add_argument("--json", action="store_true", help="everything, for programs")
    options = parser.parse_args(arguments)
    describe: Callable[[Game], Any] = _describe_for_json if options.json else _format_game
    named = {name: GAMES.apply(name, describe) for name in options.games}
    found = named or GAMES.apply_to_all(describe)
    text = json.dumps(found, indent=2) + "\n" if options.json else "\n".join(found.values())
    sys.stdout.write(text)
    return EXIT_DONE


def _describe_for_json(game: Game) -> dict[str, Any]:
    described = describe_game(game)
    json.dumps(described)  # raises here if this game cannot be written as JSON
    return described


def describe_game(game: Game) -> dict[str, Any]:
    """A game's scenarios, bots, rewards and representations as plain data."""
    return {
        "title": game.title,
        "version": game.version,
        "summary": game.summary,
        "players": list(game.player_range),
        "default_scenario": game.default_scenario,
        "bots": list(game.bots),
        "rewards": dict(game.rewards),
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
        "pays": spec.pays,
        "representations": {
            seen.name: {"shape": list(seen.shape), "dtype": np.dtype(seen.dtype).name}
            for seen in spec.representations.values()
        },
    }


def list_rows(game: Game) -> list[Row]:
    """One row for equal scenarios, in the order of the first of each."""
    alike: dict[tuple[str, ...], list[str]] = {}
    for name, scenario in game.scenarios.items():
        spec = game.make_spec(scenario)
        shown = ", ".join(
            f"{seen.name} {'x'.join(map(str, seen.shape))}"
            for seen in spec.representations.values()
        )
        cells = (_format_players(spec), str(spec.num_actions), shown, spec.pays)
        alike.setdefault(cells, []).append(name)
    return [Row(tuple(names), *cells) for cells, names in alike.items()]


def _format_players(spec: GameSpec) -> str:
    sizes = np.bincount(spec.team_of_seat)
    if 1 < len(sizes) < spec.num_players:
        return f"{spec.num_players} ({' v '.join(map(str, sizes))})"
    return str(spec.num_players)


def _format_game(game: Game) -> str:
    fewest, most = game.player_range
    players = f"{fewest}" if fewest == most else f"{fewest} to {most}"
    ids = gymnasium_id(game.gymnasium_prefix, "<scenario>")
    lines = [
        f"{game.name}: {game.title}, players: {players}, rules version {game.version}",
        f"  {game.summary}",
        f"  bots: {', '.join(game.bots)}",
        f"  rewards: {', '.join(game.rewards)} (play is rated by the first)",
        f"  default scenario: {game.default_scenario}; Gymnasium ids: {ids}",
    ]
    for row in list_rows(game):
        lines += [
            f"  {', '.join(row.scenarios)}",
            f"      players {row.players}; {row.actions} actions; reward: {row.reward}",
            f"      {row.representations}",
        ]
    return "\n".join(lines) + "\n"
