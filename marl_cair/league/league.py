"""`run_league`: a seat-balanced round-robin of any agents, rated with intervals."""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from marl_cair.files import claim_output_folder
from marl_cair.games import GAMES
from marl_cair.games.game import Agent, Game
from marl_cair.league.agents import load_agent
from marl_cair.league.match import MatchResult, play_match
from marl_cair.league.ratings import Games, Rating, rate
from marl_cair.league.report import describe_league, write_report
from marl_cair.league.store import LeagueStore

STORE_FILE = "league.sqlite"


@dataclass(frozen=True)
class LeagueConfig:
    """A league.

    Raises:
        ValueError: fewer than two agents, one named twice, or a number that is not allowed.
    """

    agents: tuple[str, ...]  # checkpoint folders and bot names
    game: str = "deep_line_wars"
    scenario: str = "10x15"
    games_per_pair: int = 40  # even: each seed is played in both seats
    seed: int = 0
    out: str = "runs/league"
    games_per_match: int = 100  # played at once on one engine and stored together

    def __post_init__(self) -> None:
        if len(self.agents) < 2:
            raise ValueError(f"agents are {list(self.agents)}, a league needs two or more")
        twice = sorted({name for name in self.agents if self.agents.count(name) > 1})
        if twice:
            raise ValueError(f"{', '.join(twice)} is given twice: name each agent once")
        for name in ("games_per_pair", "games_per_match"):
            value = getattr(self, name)
            if value < 2 or value % 2:
                raise ValueError(f"{name} is {value}, it must be even and 2 or more")


@dataclass(frozen=True)
class LeagueResult:
    """What a league found."""

    ratings: tuple[Rating, ...]  # best first
    text: str  # ladder, matrix and plain words
    folder: Path


@dataclass(frozen=True)
class Entrant:
    """An agent of the league; `fingerprint` tells its weights (a bot's rules version) apart."""

    name: str
    fingerprint: str
    agent: Agent


def run_league(
    config: LeagueConfig,
    load: Callable[..., Agent] = load_agent,
    show_progress: bool = True,
) -> LeagueResult:
    """Play what is not yet stored in `<out>/league.sqlite`, rate all agents, write the report.

    The same agents, seed and number of games give the same tables, in whatever order the agents are
    given and however often the league was interrupted.

    Raises:
        CheckpointError, UnknownNameError: an agent cannot be loaded; before any game.
        OutputFolderError, LeagueStoreError: the folder holds something else, or a league of other
            settings.
    """
    game = GAMES[config.game]
    scenario = game.scenario(config.scenario, reward="sparse")
    entrants = _load_entrants(config, game, scenario, load)
    folder = Path(config.out)
    settings = {
        "game": game.name,
        "game_version": game.version,
        "scenario": dataclasses.asdict(scenario),
        "seed": config.seed,
        "games_per_match": config.games_per_match,
    }
    claim_output_folder(folder, "league", json.dumps(settings, sort_keys=True), resume=True)
    store = LeagueStore(folder / STORE_FILE, settings)
    try:
        games, distinct = _play_all(config, game, scenario, entrants, store, show_progress)
    finally:
        store.close()
    names = [entrant.name for entrant in entrants]
    ratings = rate(names, games, config.seed)
    text = describe_league(names, games, ratings, distinct)
    write_report(folder, names, games, ratings, text)
    return LeagueResult(tuple(ratings), text, folder)


def _load_entrants(
    config: LeagueConfig, game: Game, scenario: Any, load: Callable[..., Agent]
) -> list[Entrant]:
    """All agents by short, unique names, in the order of those names."""
    sources = dict(zip(_short_names(config.agents), config.agents, strict=True))
    return [
        Entrant(name, _fingerprint(source, game), load(source, game=game.name, scenario=scenario))
        for name, source in sorted(sources.items())
    ]


def _short_names(sources: tuple[str, ...]) -> list[str]:
    """The fewest last parts of the paths that tell them apart; `latest` alone says nothing."""
    parts = [[p for p in Path(source).parts if p not in ("/", "latest")] for source in sources]
    for depth in range(1, max(map(len, parts)) + 1):
        names = ["/".join(path[-depth:]) for path in parts]
        if len(set(names)) == len(names):
            return names
    return list(sources)


def _fingerprint(source: str, game: Game) -> str:
    weights = Path(source) / "weights.pt"
    if weights.is_file():
        return hashlib.blake2b(weights.read_bytes(), digest_size=16).hexdigest()
    return f"{game.name} {game.version} {source.rpartition('/')[2]}"


def _play_all(
    config: LeagueConfig,
    game: Game,
    scenario: Any,
    entrants: list[Entrant],
    store: LeagueStore,
    show_progress: bool,
) -> tuple[Games, dict[tuple[str, str], int]]:
    """Games [N, 4] of `rate`, and the number of distinct games of each pair."""
    numbers = [store.add_agent(entrant.name, entrant.fingerprint) for entrant in entrants]
    pairs = list(itertools.combinations(range(len(entrants)), 2))
    rows: list[tuple[int, int, int, float]] = []
    distinct = {}
    bar = tqdm(total=len(pairs) * config.games_per_pair, unit=" games", disable=not show_progress)
    for first, second in pairs:
        bar.set_postfix_str(f"{entrants[first].name} v {entrants[second].name}")
        chunks = range(0, config.games_per_pair, config.games_per_match)
        for start in chunks:
            held = store.read_match(numbers[first], numbers[second])
            count = min(config.games_per_match, config.games_per_pair - start)
            if held.games < start + count:
                match = play_match(
                    entrants[first].agent,
                    entrants[second].agent,
                    game,
                    scenario,
                    count,
                    config.seed,  # the same games for all pairs
                    first_block=start // 2,
                )
                store.add_match(numbers[first], numbers[second], match)
            bar.update(count)
        held = store.read_match(numbers[first], numbers[second])
        match = MatchResult(held.results[: config.games_per_pair])
        rows += [(first, second, game_.block, game_.score) for game_ in match.results]
        distinct[entrants[first].name, entrants[second].name] = match.distinct_games
    bar.close()
    return np.array(rows, np.float64), distinct
