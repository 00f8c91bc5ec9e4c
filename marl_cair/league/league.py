"""`run_league`: seat-balanced games of any agents, stored in one file, rated with intervals."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from marl_cair.files import claim_output_folder
from marl_cair.games import GAMES
from marl_cair.games.game import Game
from marl_cair.league.agents import describe_agent, find_fingerprint, is_checkpoint, load_agent
from marl_cair.league.arena import Arena, Load, Rules
from marl_cair.league.blocks import Entrant
from marl_cair.league.match import require_rivals
from marl_cair.league.ratings import Games, Rating, rate
from marl_cair.league.report import describe_league, make_table, write_report
from marl_cair.league.schedule import Job, schedule_meetings
from marl_cair.league.store import STORE_FILE, LeagueStore, StoredGames
from marl_cair.lookup import find_by_name


@dataclass(frozen=True)
class LeagueConfig:
    """A league.

    Raises:
        ValueError: fewer than two agents, one named twice, or a number that is not allowed.
    """

    agents: tuple[str, ...]  # checkpoint folders, bot names, module:function
    game: str = "deep_line_wars"
    scenario: str = "10x15"
    scenario_options: Mapping[str, Any] = field(default_factory=dict)  # fields of it to change
    games_per_pair: int = 40  # even between two teams: each map seed is played in both seats
    seed: int = 0
    out: str = "runs/league"
    ladder: tuple[str, ...] = ()  # further agents, that do not play each other anew
    seating: str = ""  # "ring" or "all", see `blocks.make_design`; "": all of up to three teams
    workers: int = 1  # processes that play; results do not depend on it

    def __post_init__(self) -> None:
        everyone = [*self.agents, *self.ladder]
        if len(everyone) < 2:
            raise ValueError(f"agents are {everyone}, a league needs two or more")
        twice = sorted({name for name in everyone if everyone.count(name) > 1})
        if twice:
            raise ValueError(f"{', '.join(twice)} is given twice: name each agent once")
        for name, value in (
            ("games_per_pair (--games)", self.games_per_pair),
            ("workers", self.workers),
        ):
            if value < 1:
                raise ValueError(f"{name} is {value}, it must be 1 or more")


@dataclass(frozen=True)
class LeagueResult:
    """What a league found."""

    ratings: tuple[Rating, ...]  # best first
    text: str  # ladder, matrix and plain words
    folder: Path


def run_league(
    config: LeagueConfig,
    load: Load = load_agent,
    show_progress: bool = True,
) -> LeagueResult:
    """Play what is not yet stored in `<out>/league.sqlite`, rate all agents, write the report.

    The same agents, seed and number of games give the same tables, in whatever order the agents are
    given, with any number of workers, however often the league was interrupted, and whether it had
    fewer games before. Between two teams it may have had other agents before, too.

    Raises:
        CheckpointError, ForeignAgentError, UnknownNameError: an agent cannot be loaded; before any
            game.
        ValueError: two of the agents are one and the same, the scenario has but one team, or the
            number of games does not fit.
        OutputFolderError, LeagueStoreError: the folder holds something else, or a league of other
            settings; or its file cannot be written.
    """
    game = find_by_name("game", config.game, GAMES)
    options = {**config.scenario_options, "reward": game.rated_reward}
    rules = _find_rules(config, game, game.scenario(config.scenario, **options))
    entrants = _load_entrants(config, game, rules.scenario, load)
    folder = Path(config.out)
    settings = {
        "game": game.name,
        "game_version": game.version,
        "scenario": dataclasses.asdict(rules.scenario),
        "seed": config.seed,
    }
    claim_output_folder(folder, "league", settings, resume=True)
    teams = game.make_spec(rules.scenario).team_of_seat.tolist()
    more = {"seating": rules.seating, "team_of_seat": teams}
    store = LeagueStore(folder / STORE_FILE, {**settings, **more})
    try:
        games, ids = _play_all(config, rules, entrants, store, load, show_progress)
    finally:
        store.close()
    names = [entrant.name for entrant in entrants]
    rows, distinct = _as_pairs(games, ids)
    ratings = rate(names, rows, config.seed)
    table = make_table(names, rows, ratings, distinct)
    text = describe_league(table)
    write_report(folder, table, text)
    return LeagueResult(tuple(ratings), text, folder)


def _find_rules(config: LeagueConfig, game: Game, scenario: Any) -> Rules:
    if (num_teams := require_rivals(game, scenario)) != 2:
        raise ValueError(
            f"{game.name} {config.scenario} has {num_teams} teams: a league is of games between "
            "two; compare two agents by `marl-cair match`"
        )
    rules = Rules(
        game, scenario, config.seed, config.seating or ("all" if num_teams < 4 else "ring")
    )
    size = rules.games_per_block
    if num_teams == 2 and config.games_per_pair % size:
        raise ValueError(
            f"games_per_pair (--games) is {config.games_per_pair}, it must be even: every map seed "
            "is played once in each seat"
        )
    return rules


def _load_entrants(config: LeagueConfig, game: Game, scenario: Any, load: Load) -> list[Entrant]:
    """All agents by short, unique names, in the order of those names."""
    sources: dict[str, str] = {}
    entrants = []
    everyone = (*config.agents, *config.ladder)
    for source, name in zip(everyone, _short_names(everyone, game), strict=True):
        agent = load(source, game=game.name, scenario=scenario)
        fingerprint = find_fingerprint(agent, game)
        if fingerprint in sources:
            raise ValueError(
                f"{sources[fingerprint]} and {source} are the same agent: name it once"
            )
        sources[fingerprint] = source
        entrants.append(Entrant(name, fingerprint, agent, source))
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
    rules: Rules,
    entrants: list[Entrant],
    store: LeagueStore,
    load: Load,
    show_progress: bool,
) -> tuple[StoredGames, list[int]]:
    """The games to rate, and the ids of the entrants in the store."""
    # Numbered by fingerprint: a line-up is the same whatever its agents are called today.
    numbered = sorted(entrants, key=lambda entrant: entrant.fingerprint)
    ids = [store.add_agent(describe_agent(one.name, one.agent, rules.game)) for one in numbered]
    arena = Arena(rules, numbered, ids, store, config.workers, load)
    jobs = schedule_meetings(
        len(numbered),
        rules.num_teams,
        config.games_per_pair,
        rules.games_per_chunk,
        frozenset(n for n, one in enumerate(numbered) if one.source in config.ladder),
    )
    total = len(jobs) * rules.games_per_chunk
    with tqdm(total=total, unit=" games", disable=not show_progress) as bar:
        arena.play(jobs, bar)
    id_of = {one.fingerprint: number for one, number in zip(numbered, ids, strict=True)}
    return _choose_games(config, rules, ids, jobs, store), [id_of[e.fingerprint] for e in entrants]


def _choose_games(
    config: LeagueConfig, rules: Rules, ids: Sequence[int], jobs: Sequence[Job], store: LeagueStore
) -> StoredGames:
    """The games of these agents that the jobs name; beside a ladder all that are stored."""
    games = store.read_games()
    is_ours = np.asarray(np.isin(games.agents, ids).all(axis=1), np.bool_)
    if not config.ladder:
        size = rules.blocks_per_chunk
        ends: dict[tuple[int, ...], int] = {}
        for line_up, chunk in jobs:
            key = tuple(sorted(ids[number] for number in line_up))
            ends[key] = max(ends.get(key, 0), (chunk + 1) * size)
        if rules.num_teams == 2:  # to the game; chunks are played whole
            ends = dict.fromkeys(ends, config.games_per_pair // rules.games_per_block)
        keys = map(tuple, np.sort(games.agents, axis=1).tolist())
        limits = np.array([ends.get(key, 0) for key in keys], np.int64)
        is_ours = is_ours & (games.numbers < limits)
    return games.select(is_ours)


def _as_pairs(games: StoredGames, ids: Sequence[int]) -> tuple[Games, NDArray[np.int64]]:
    """Games [N, 4] of `rate` between two teams, and the distinct games of each pair, [n, n]."""
    places = {number: place for place, number in enumerate(ids)}
    agents = np.array([[places[one] for one in row] for row in games.agents.tolist()], np.int64)
    agents = agents.reshape(-1, 2)
    first, second = agents.min(1), agents.max(1)
    scores = np.where(agents[:, 0] == first, games.points[:, 0], games.points[:, 1])
    counted = ~games.is_repeat
    distinct = np.zeros((len(ids), len(ids)), np.int64)
    np.add.at(distinct, (first[counted], second[counted]), 1)
    rows = np.column_stack((first, second, games.numbers, scores)).astype(np.float64)
    return rows, distinct + distinct.T
