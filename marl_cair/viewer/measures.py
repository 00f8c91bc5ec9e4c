"""Measures players at each step of a game, and finds the events to jump to."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.engine import BatchedEngine
from marl_cair.games.replays import Replay

Numbers = NDArray[np.float32]  # [P], or over time [T + 1, P]
RETURN = "return"
T = TypeVar("T")
_Measure = Callable[[BatchedEngine, Mapping[str, Numbers]], Numbers]


class Event(NamedTuple):
    """Something to jump to; `seat`: the player that it is about."""

    step: int
    text: str
    seat: int | None = None


def _sum_own(*names: str) -> _Measure:
    def add(engine: BatchedEngine, columns: Mapping[str, Numbers]) -> Numbers:
        total: Numbers = np.sum([columns[f"own {name}"] for name in names], 0)
        return total

    return add


def _count_towers(engine: BatchedEngine, columns: Mapping[str, Numbers]) -> Numbers:
    towers: Numbers = engine.state_dict()["world.num_towers"][0].astype(np.float32)
    return towers


def _count_units(engine: BatchedEngine, columns: Mapping[str, Numbers]) -> Numbers:
    living: Numbers = (engine.state_dict()["world.unit_health"][0] > 0).sum(1).astype(np.float32)
    return living


# What is measured beside resources, `infos` and returns; by game.
MEASURES: Mapping[str, Mapping[str, _Measure]] = {
    "deep_rts": {
        "army": _sum_own("footman", "archer", "cavalry"),
        "peasants": _sum_own("peasant"),
        "buildings": _sum_own("town_hall", "barracks", "farm", "smithy", "oil_well"),
        "town halls": _sum_own("town_hall"),
        "damage done": _sum_own("damage done"),
        "score": _sum_own("score"),
    },
    "deep_line_wars": {"towers": _count_towers, "units": _count_units},
}


def _find_first_rise(values: Numbers) -> NDArray[np.bool_]:
    """The players that were the first to get above their start."""
    rises = values > values[0]
    steps = np.cumsum(rises.any(1)) == 1
    first: NDArray[np.bool_] = rises & steps[:, None]
    return first


def _find_falls(values: Numbers) -> NDArray[np.bool_]:
    return np.diff(values, axis=0, prepend=values[:1]) < 0


def _find_first_falls(values: Numbers) -> NDArray[np.bool_]:
    falls = _find_falls(values)
    first: NDArray[np.bool_] = falls & (np.cumsum(falls, 0) == 1)
    return first


# The measure, the places [T + 1, P] in it that are events, and their text; by game.
_CAUSES: Mapping[str, Sequence[tuple[str, Callable[[Numbers], NDArray[np.bool_]], str]]] = {
    "deep_rts": (
        ("damage done", _find_first_rise, "first attack, by {}"),
        ("town halls", _find_falls, "{} loses a town hall"),
    ),
    "deep_line_wars": (
        ("towers", _find_first_rise, "first tower, by {}"),
        ("units", _find_first_rise, "first unit, by {}"),
        ("health", _find_first_falls, "{} loses health for the first time"),
    ),
}


def read_columns(engine: BatchedEngine) -> dict[str, Numbers]:
    """The entries of `vector` of world 0 by name; none in a game without it."""
    if "vector" not in engine.spec.representations:
        return {}
    names = engine.representation("vector").plane_names
    return dict(zip(names, engine.observe("vector")[0].T.astype(np.float32), strict=True))


def find_resources(engine: BatchedEngine, columns: Mapping[str, T]) -> dict[str, T]:
    """What players own, by the names of `spec.resources`, among the entries of `vector`."""
    owned = {name: f"own {name}" for name in engine.spec.resources}
    return {name: columns[own] for name, own in owned.items() if own in columns}


class Measurements:
    """Gathers the numbers of all players, step by step.

    Attributes:
        is_out: bool [T + 1][P], the players that were out.
    """

    def __init__(self) -> None:
        self._rows: list[dict[str, Numbers]] = []
        self._total: Numbers | None = None
        self.is_out: list[NDArray[np.bool_]] = []

    def add(self, engine: BatchedEngine) -> None:
        """Measure world 0 at its start, or after a step."""
        columns = read_columns(engine)
        row = find_resources(engine, columns)
        for name, measure in MEASURES.get(engine.game.name, {}).items():
            row[name] = measure(engine, columns)
        for name, values in engine.info(np.float32).items():
            row[name.replace("_", " ")] = values[0]
        if self._total is None:
            self._total = np.zeros_like(engine.rewards[0])
        else:
            self._total = self._total + engine.rewards[0]
        row[RETURN] = self._total
        self._rows.append(row)
        self.is_out.append(engine.eliminated[0].copy())

    def list_series(self) -> dict[str, Numbers]:
        """The measures that change in the game, float32 [T + 1, P] by name."""
        series = {name: np.stack([row[name] for row in self._rows]) for name in self._rows[0]}
        return {name: values for name, values in series.items() if np.ptp(values, axis=0).any()}


def find_events(replay: Replay, measured: Measurements, players: Sequence[str]) -> list[Event]:
    """What to jump to, in the order of steps; the last is the end of the recording."""
    series, events = measured.list_series(), []
    for measure, find, text in _CAUSES.get(replay.game, ()):
        if measure in series:
            for step, seat in np.argwhere(find(series[measure])).tolist():
                events.append(Event(step, text.format(players[seat]), seat))
    is_out = np.stack(measured.is_out)
    events += [
        Event(int(is_out[:, seat].argmax()), f"{players[seat]} is out", seat)
        for seat in np.flatnonzero(is_out.any(0)).tolist()
    ]
    events.append(Event(len(replay.actions), describe_end(replay, players), replay.winner))
    return sorted(events, key=lambda event: event.step)


def describe_end(replay: Replay, players: Sequence[str]) -> str:
    """How a game ended, in a few words."""
    if not replay.is_complete:
        return "the recording was cut off here"
    if replay.winner is None:
        return "the end, without a winner"
    teams = replay.spec.team_of_seat
    team = np.flatnonzero(teams == teams[replay.winner]).tolist()
    return f"{' and '.join(players[seat] for seat in team)} won"
