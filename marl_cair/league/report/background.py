"""Reads a league's settings, agents, maps and training runs for its report."""

from __future__ import annotations

import json
import platform
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from typing import Any, NamedTuple

import numpy as np

from marl_cair.games.engine import BatchedEngine
from marl_cair.league.agents.load import shorten_paths
from marl_cair.league.play.arena import Rules
from marl_cair.league.ratings.games import Games
from marl_cair.league.ratings.payoffs import Share, find_map_shares
from marl_cair.league.ratings.rate import Rating, describe_method
from marl_cair.league.report.replays import ShownGame
from marl_cair.league.store.schema import AgentRecord
from marl_cair.league.store.store import LeagueStore, StoredGames

COMMANDS, VERSIONS = "commands", "versions"  # settings of a league file
_LIBRARIES = ("marl_cair", "numpy", "scipy", "torch")
_WORLDS = 256  # that are reset at once to find their maps


class Point(NamedTuple):
    """A snapshot of a run: its environment steps of training, and its rating."""

    frames: int
    rating: Rating


class Curve(NamedTuple):
    """The snapshots of one run, the youngest first."""

    run: str
    points: tuple[Point, ...]


@dataclass(frozen=True)
class Background:
    """Contents of a report beside ratings; by default those of a report without a league file.

    Attributes:
        title: of the game.
        settings: names and values, for a table.
        records: of the agents by name.
        map_shares: by name and map; empty where there are not several maps by name.
        map_words: a sentence about the maps.
        num_truncated: counted games that the time limit ended.
        replays: of a few games.
        replay_words: the reason why there are none; "" if there are.
    """

    title: str = ""
    settings: tuple[tuple[str, str], ...] = ()
    records: Mapping[str, AgentRecord] = field(default_factory=dict)
    map_shares: Mapping[tuple[str, str], Share] = field(default_factory=dict)
    map_words: str = "The maps of these games are unknown."
    num_truncated: int = 0
    replays: tuple[ShownGame, ...] = ()
    replay_words: str = "There is no league file to replay games from."


def read_background(
    store: LeagueStore,
    stored: StoredGames,
    names: Mapping[int, str],
    games: Games,
    replays: Sequence[ShownGame],
    replay_words: str,
) -> Background:
    """Read it for stored games; `names` by id, `games` has agents by place in `names`."""
    rules, records = Rules.read(store.settings), store.read_agents()
    maps, by_place = _find_maps(rules, stored), list(names.values())
    shares = find_map_shares(games, maps) if len(set(maps)) > 1 else {}
    return Background(
        rules.game.title,
        _list_settings(store.settings, rules, stored, games),
        {name: records[number] for number, name in names.items()},
        {(by_place[agent], name): share for (agent, name), share in shares.items()},
        _describe_maps(rules, set(maps)),
        int(stored.is_truncated[~games.is_repeat].sum()),
        tuple(replays),
        replay_words,
    )


def _find_maps(rules: Rules, stored: StoredGames) -> list[str]:
    """The name of the map of each game, "" where the game has none."""
    if rules.game.map_names is None or not len(stored.map_seeds):
        return [""] * len(stored.map_seeds)
    seeds, numbers = np.unique(stored.map_seeds, return_inverse=True)
    names: list[str] = []
    for start in range(0, len(seeds), _WORLDS):
        part = seeds[start : start + _WORLDS]
        engine = BatchedEngine(rules.game, rules.scenario, len(part))
        engine.reset(part)
        names += engine.map_names()
    return [names[number] for number in numbers.ravel().tolist()]


def _describe_maps(rules: Rules, maps: set[str]) -> str:
    if rules.game.map_names is None:
        return (
            f"{rules.game.title} has no named maps. The intervals include the effect of map seeds, "
            "which are resampled."
        )
    if len(maps) == 1:
        return f"All games are on one map, {maps.pop()}."
    return f"The games are on {len(maps)} maps, drawn by the map seeds."


def find_curves(ratings: Sequence[Rating], records: Mapping[str, AgentRecord]) -> list[Curve]:
    """A curve for each run of which two or more snapshots, of different age, are rated."""
    runs: dict[tuple[str, str, int], dict[int, Point]] = {}
    for rating in ratings:
        record = records.get(rating.name)
        if record and (about := _read_training(record)):
            key = str(about["run"]), str(about["name"]), int(about["seed"])
            frames = int(about["frames_total"])
            runs.setdefault(key, {})[frames] = Point(frames, rating)
    several = {key: points for key, points in sorted(runs.items()) if len(points) > 1}
    places = {
        (folder, name): folder if folder.endswith(f"/{name}") else f"{folder}/{name}"
        for folder, name, _ in several
    }
    short = shorten_paths(sorted(set(places.values())))
    count = Counter(key[:2] for key in several)  # the seed is named where runs differ only by it
    return [
        Curve(
            short[places[key[:2]]] + (f" (seed {key[2]})" if count[key[:2]] > 1 else ""),
            tuple(points[frames] for frames in sorted(points)),
        )
        for key, points in several.items()
    ]


def describe_training(record: AgentRecord) -> str:
    """Environment steps of training over all runs that were continued, and the seed; "" if
    unknown.
    """
    about = _read_training(record)
    if not about:
        return ""
    own, total = about["frames"], about["frames_total"]
    part = f" ({own:,} in its last run)" if own < total else ""
    return f"{total:,} steps{part}, seed {about['seed']}"


def _read_training(record: AgentRecord) -> dict[str, Any]:
    """As `agents.describe_training` wrote it; empty for an agent that was not trained."""
    return dict(json.loads(record.configuration).get("training", {}))


def list_versions() -> str:
    """Versions of Python and of the libraries that results may depend on."""
    found = [f"Python {platform.python_version()}"]
    for name in _LIBRARIES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:  # run from a folder, not installed
            continue
    return ", ".join(found)


def _list_settings(
    settings: Mapping[str, Any], rules: Rules, stored: StoredGames, games: Games
) -> tuple[tuple[str, str], ...]:
    method = describe_method(rules.seed)
    num_blocks, num_repeats = len(np.unique(stored.blocks)), int(games.is_repeat.sum())
    least, most, _ = method["bootstraps"]
    return (
        *(("Command", command) for command in settings.get(COMMANDS, [])),
        ("Game", f"{rules.game.name}, rules version {settings['game_version']}"),
        ("Scenario", ", ".join(f"{k} = {_format(v)}" for k, v in settings["scenario"].items())),
        ("League seed", str(rules.seed)),
        ("Games", f"{len(stored.agents)}, of which {num_repeats} repeat another and do not count"),
        ("Blocks", f"{num_blocks}, each one map seed in all its seatings"),
        ("Seating", f"{rules.seating}, {rules.num_teams} teams"),
        ("Ratings", f"{method['method']}; prior of {method['prior_elo']:g} Elo"),
        ("Intervals", f"95 %, {least:,} to {most:,} resamples of blocks, seed {method['seed']}"),
        *(("Played with", versions) for versions in settings.get(VERSIONS, [])),
    )


def _format(value: Any) -> str:
    return json.dumps(value) if isinstance(value, list) else str(value)
