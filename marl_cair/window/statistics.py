"""Saves a game's statistics: numbers over time as CSV, result and action counts as JSON."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

from marl_cair.files import write_atomically, write_json
from marl_cair.text import format_csv

if TYPE_CHECKING:
    from marl_cair.window.session import Session


def name_game(path: Path, number: int) -> Path:
    """The path of the game with a number from 0: a.replay, a-2.replay, a-3.replay, ..."""
    return path if number == 0 else path.with_name(f"{path.stem}-{number + 1}{path.suffix}")


def save_statistics(session: Session, path: Path) -> None:
    """Write `path`.csv, a row for each player after each decision, and `path`.json."""
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path.with_name(f"{path.name}.csv"), format_rows(session))
    write_json(path.with_name(f"{path.name}.json"), describe_game(session))


def format_rows(session: Session) -> str:
    """The numbers over time as CSV."""
    notes = session.history.notes
    resources, scoreboard = notes[0].numbers.resources, notes[0].numbers.scoreboard
    names = [*resources, *(name for name in scoreboard if name not in resources)]
    rows = [["step", "seconds", "player", "name", *names]]
    for step, seconds, numbers in notes:
        values = numbers.scoreboard | numbers.resources
        for player, name in enumerate(session.names):
            numbers_of = [f"{values[column][player]:g}" for column in names]
            rows.append([f"{step}", f"{seconds:.2f}", f"{player}", name, *numbers_of])
    return format_csv(rows)


def describe_game(session: Session) -> dict[str, Any]:
    """Result, final numbers and action counts of the game as plain data."""
    spec, last = session.spec, session.history.notes[-1]
    players = [
        {
            "name": name,
            "is_person": player in session.persons,
            "team": int(spec.team_of_seat[player]),
            "return": float(session.returns[player]),
            **{key: float(value[player]) for key, value in last.numbers.resources.items()},
            **{key: float(value[player]) for key, value in last.numbers.scoreboard.items()},
            "actions": {
                group: int(count)
                for group, count in zip(
                    spec.action_group_names, session.action_counts[player], strict=True
                )
            },
        }
        for player, name in enumerate(session.names)
    ]
    winner = int(session.engine.winner[0])
    return {
        "game": session.game.name,
        "rules_version": session.game.version,
        "scenario": dataclasses.asdict(session.scenario),
        "map_seed": session.map_seed,
        "steps": len(session.history.actions),
        "seconds": round(last.seconds, 2),
        "is_over": session.is_over,
        "winner": winner if session.is_over and winner >= 0 else None,
        "ending": session.describe_end() if session.is_over else "not played to its end",
        "players": players,
    }
