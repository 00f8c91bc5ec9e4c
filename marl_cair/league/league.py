"""`run_league`: a seat-balanced round-robin of any agents, rated with intervals."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from marl_cair.files import claim_output_folder
from marl_cair.games import GAMES
from marl_cair.games.game import Agent, Game
from marl_cair.league.agents import find_fingerprint, is_checkpoint, load_agent
from marl_cair.league.match import (
    BLOCKS_PER_CHUNK,
    GAMES_PER_BLOCK,
    GAMES_PER_CHUNK,
    MatchResult,
    play_chunks,
    require_rivals,
)
from marl_cair.league.playing import CHUNKS_AT_ONCE
from marl_cair.league.ratings import Games, Rating, rate
from marl_cair.league.report import describe_league, make_table, write_report
from marl_cair.league.store import LeagueStore
from marl_cair.lookup import find_by_name

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
    scenario_options: Mapping[str, Any] = field(default_factory=dict)  # fields of it to change
    games_per_pair: int = 40  # even: each map seed is played in both seats
    seed: int = 0
    out: str = "runs/league"

    def __post_init__(self) -> None:
        if len(self.agents) < 2:
            raise ValueError(f"agents are {list(self.agents)}, a league needs two or more")
        twice = sorted({name for name in self.agents if self.agents.count(name) > 1})
        if twice:
            raise ValueError(f"{', '.join(twice)} is given twice: name each agent once")
        if self.games_per_pair < GAMES_PER_BLOCK or self.games_per_pair % GAMES_PER_BLOCK:
            raise ValueError(
                f"games_per_pair (--games) is {self.games_per_pair}, it must be even and 2 or "
                "more: every map seed is played once in each seat"
            )


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
    given, however often the league was interrupted, and whether it had fewer games or other agents
    before.

    Raises:
        CheckpointError, UnknownNameError: an agent cannot be loaded; before any game.
        ValueError: two of the agents are one and the same, or the scenario has not two teams.
        OutputFolderError, LeagueStoreError: the folder holds something else, or a league of other
            settings; or its file cannot be written.
    """
    game = find_by_name("game", config.game, GAMES)
    options = {**config.scenario_options, "reward": game.rated_reward}
    scenario = game.scenario(config.scenario, **options)
    if (num_teams := require_rivals(game, scenario)) != 2:
        raise ValueError(
            f"{game.name} {config.scenario} has {num_teams} teams: a league is of games between "
            "two; compare two agents by `marl-cair match`"
        )
    entrants = _load_entrants(config, game, scenario, load)
    folder = Path(config.out)
    settings = {
        "game": game.name,
        "game_version": game.version,
        "scenario": dataclasses.asdict(scenario),
        "seed": config.seed,
    }
    claim_output_folder(folder, "league", settings, resume=True)
    store = LeagueStore(folder / STORE_FILE, settings)
    try:
        matches = _play_all(config, game, scenario, entrants, store, show_progress)
    finally:
        store.close()
    names = [entrant.name for entrant in entrants]
    games, distinct = _collect(matches, len(entrants))
    ratings = rate(names, games, config.seed)
    table = make_table(names, games, ratings, distinct)
    text = describe_league(table)
    write_report(folder, table, text)
    return LeagueResult(tuple(ratings), text, folder)


def _load_entrants(
    config: LeagueConfig, game: Game, scenario: Any, load: Callable[..., Agent]
) -> list[Entrant]:
    """All agents by short, unique names, in the order of those names."""
    sources: dict[str, str] = {}
    entrants = []
    for source, name in zip(config.agents, _short_names(config.agents, game), strict=True):
        agent = load(source, game=game.name, scenario=scenario)
        fingerprint = find_fingerprint(agent, game)
        if fingerprint in sources:
            raise ValueError(
                f"{sources[fingerprint]} and {source} are the same agent: name it once"
            )
        sources[fingerprint] = source
        entrants.append(Entrant(name, fingerprint, agent))
    return sorted(entrants, key=lambda entrant: entrant.name)


def _short_names(sources: Sequence[str], game: Game) -> list[str]:
    """Bots by their names, folders by the fewest last parts of their paths that tell them apart.

    A folder's `latest` is left out, as it says nothing, and no folder takes the name of a bot.
    """
    bots = {source: source.rpartition("/")[2] for source in sources if not is_checkpoint(source)}
    parts = {
        source: [part for part in Path(source).absolute().parts if part not in ("/", "latest")]
        for source in sources
        if source not in bots
    }
    for depth in range(1, max(map(len, parts.values()), default=0) + 1):
        short = {source: "/".join(path[-depth:]) for source, path in parts.items()}
        if len({*short.values(), *game.bots}) == len(short) + len(game.bots):
            return [{**bots, **short}[source] for source in sources]
    return [bots.get(source, source) for source in sources]


def _play_all(
    config: LeagueConfig,
    game: Game,
    scenario: Any,
    entrants: list[Entrant],
    store: LeagueStore,
    show_progress: bool,
) -> dict[tuple[int, int], MatchResult]:
    """The games of each pair of entrants (indices), the pair in the order of fingerprints."""
    numbers = [store.add_agent(entrant.name, entrant.fingerprint) for entrant in entrants]
    # A pair is stored one way round, whatever the agents are called today.
    places = sorted(range(len(entrants)), key=lambda place: entrants[place].fingerprint)
    pairs = list(itertools.combinations(places, 2))
    chunks = range(-(-config.games_per_pair // GAMES_PER_CHUNK))
    matches = {}
    with tqdm(
        total=len(pairs) * config.games_per_pair, unit=" games", disable=not show_progress
    ) as bar:
        for pair in pairs:
            one, two = (entrants[place] for place in pair)
            bar.set_postfix_str(f"{one.name} v {two.name}")
            first, second = (numbers[place] for place in pair)
            stored = store.read_match(first, second).results
            held = {result.block // BLOCKS_PER_CHUNK for result in stored}
            missing = [chunk for chunk in chunks if chunk not in held]
            for start in range(0, len(missing), CHUNKS_AT_ONCE):
                match = play_chunks(
                    one.agent,
                    two.agent,
                    game,
                    scenario,
                    config.seed,
                    missing[start : start + CHUNKS_AT_ONCE],
                    (one.fingerprint, two.fingerprint),
                )
                store.add_match(first, second, match)
            results = store.read_match(first, second).results[: config.games_per_pair]
            matches[pair] = MatchResult(results)
            bar.update(config.games_per_pair)
    return matches


def _collect(
    matches: Mapping[tuple[int, int], MatchResult], num_agents: int
) -> tuple[Games, NDArray[np.int64]]:
    """Games [N, 4] of `rate`, and the number of distinct games of each pair, [n, n]."""
    rows: list[tuple[int, int, int, float]] = []
    distinct = np.zeros((num_agents, num_agents), np.int64)
    for (first, second), match in matches.items():
        rows += [(first, second, result.block, result.score) for result in match.results]
        distinct[first, second] = distinct[second, first] = match.distinct_games
    return np.array(rows, np.float64), distinct
