"""Plays a league: seat-balanced games of agents, stored in one file and rated with intervals."""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from marl_cair.files import claim_output_folder
from marl_cair.games import GAMES
from marl_cair.games.game import Game
from marl_cair.league.agents.allowed_code import PREFIX, is_process
from marl_cair.league.agents.load import (
    describe_agent,
    find_fingerprint,
    is_checkpoint,
    load_agent,
    shorten_paths,
)
from marl_cair.league.play.adaptive import Played, Target, measure_ladder, play_adaptively
from marl_cair.league.play.arena import Arena, Load, Rules
from marl_cair.league.play.blocks import Entrant
from marl_cair.league.play.match import require_rivals
from marl_cair.league.play.schedule import Job, schedule_meetings
from marl_cair.league.play.stopping import Clock, describe_ending
from marl_cair.league.ratings.games import Games
from marl_cair.league.ratings.rate import rate
from marl_cair.league.report.background import COMMANDS, VERSIONS, list_versions
from marl_cair.league.report.report import (
    LeagueResult,
    ReportOptions,
    number_agents,
    rate_and_report,
)
from marl_cair.league.store.store import STORE_FILE, LeagueStore, StoredGames
from marl_cair.lookup import find_by_name
from marl_cair.text import clean_text


@dataclass(frozen=True)
class LeagueConfig:
    """A league.

    Raises:
        ValueError: fewer than two agents, one named twice, or a number that is not allowed.
    """

    agents: tuple[str, ...]  # checkpoint folders, bots, module:function, process:COMMAND
    game: str = "deep_line_wars"
    scenario: str = "10x15"
    scenario_options: Mapping[str, Any] = field(default_factory=dict)  # fields of it to change
    games_per_pair: int = 40  # even between two teams: each map seed is played in both seats
    seed: int = 0
    out: str = "runs/league"
    ladder: tuple[str, ...] = ()  # further agents, that do not play each other again
    seating: str = ""  # "ring" or "all", see `blocks.make_design`; "": all of up to three teams
    workers: int = 1  # processes that play; results do not depend on it
    half_width_elo: float = 0.0  # above 0: play on until no 95 % interval is wider either way
    max_seconds: float = 0.0  # above 0: choose no further games then
    replays: bool = True  # whether the report shows a few games
    zero: str = ""  # the agent that is rated 0; "": the mean of those that are connected
    command: str = ""  # what was typed, for the report

    def __post_init__(self) -> None:
        everyone = self.sources
        if len(everyone) < 2:
            raise ValueError(f"agents are {list(everyone)}, a league needs two or more")
        twice = sorted({name for name in everyone if everyone.count(name) > 1})
        if twice:
            raise ValueError(f"{', '.join(twice)} is given twice: name each agent once")
        for name, value in (
            ("games_per_pair (--games)", self.games_per_pair),
            ("workers", self.workers),
        ):
            if value < 1:
                raise ValueError(f"{name} is {value}, it must be 1 or more")
        if self.seed < 0:
            raise ValueError(f"seed is {self.seed}, it must be 0 or more")
        for name, limit in (
            ("half_width_elo (--ci)", self.half_width_elo),
            ("max_seconds (--time)", self.max_seconds),
        ):
            if not 0.0 <= limit < math.inf:  # NaN too
                raise ValueError(f"{name} is {limit}, it must be a finite number, 0 or more")

    @property
    def sources(self) -> tuple[str, ...]:
        """Of all agents, those of the ladder last."""
        return (*self.agents, *self.ladder)


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
    with _open_league(config, load) as (rules, entrants, store):
        clock = Clock(config.max_seconds)
        id_of, jobs = _play(config, rules, entrants, store, load, show_progress, clock)
        stored = _choose_rated(config, rules, list(id_of.values()), jobs, store.read_games())
        result = rate_and_report(
            store,
            stored,
            {id_of[entrant.fingerprint]: entrant.name for entrant in entrants},
            Path(config.out),
            ReportOptions(
                config.replays,
                load,
                frozenset(config.sources),
                show_progress=show_progress,
                zero=config.zero,
            ),
        )
        ending = describe_ending(config.half_width_elo, result.ratings, clock.has_ended)
        return dataclasses.replace(result, ending=ending)


def play_league(
    config: LeagueConfig,
    load: Load = load_agent,
    show_progress: bool = True,
) -> None:
    """Play as `run_league` does, and rate nothing. Raises as that."""
    with _open_league(config, load) as (rules, entrants, store):
        _play(config, rules, entrants, store, load, show_progress, Clock(config.max_seconds))


@contextmanager
def _open_league(
    config: LeagueConfig, load: Load
) -> Iterator[tuple[Rules, list[Entrant], LeagueStore]]:
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
    teams = game.make_spec(rules.scenario).team_of_seat.tolist()
    more = {**settings, "seating": rules.seating, "team_of_seat": teams}
    with (
        claim_output_folder(folder, "league", settings, resume=True),
        closing(LeagueStore(folder / STORE_FILE, more)) as store,
    ):
        yield rules, entrants, store


def _find_rules(config: LeagueConfig, game: Game, scenario: Any) -> Rules:
    num_teams = require_rivals(game, scenario)
    seating = config.seating or ("all" if num_teams < 4 else "ring")
    rules = Rules(game, scenario, config.seed, seating)
    if num_teams == 2 and config.games_per_pair % rules.games_per_block:
        raise ValueError(
            f"games_per_pair (--games) is {config.games_per_pair}, it must be even: every map seed "
            "is played once in each seat"
        )
    return rules


def _load_entrants(config: LeagueConfig, game: Game, scenario: Any, load: Load) -> list[Entrant]:
    """All agents by short, unique names, in the order of their fingerprints: no number depends on
    what they are called.
    """
    sources: dict[str, str] = {}
    entrants = []
    everyone = config.sources
    for source, name in zip(everyone, _short_names(everyone, game), strict=True):
        agent = load(source, game=game.name, scenario=scenario)
        fingerprint = find_fingerprint(agent, game)
        if fingerprint in sources:
            raise ValueError(
                f"{sources[fingerprint]} and {source} are the same agent: name it once"
            )
        sources[fingerprint] = source
        entrants.append(Entrant(clean_text(name), fingerprint, agent, source))
    return sorted(entrants, key=lambda entrant: entrant.fingerprint)


def _short_names(sources: Sequence[str], game: Game) -> list[str]:
    """Bots by their names, commands whole, folders by the fewest last parts of their paths that
    distinguish them; nothing else has the name of a bot, or of another agent.
    """
    code = {
        source: source.removeprefix(PREFIX) if is_process(source) else source.rpartition("/")[2]
        for source in sources
        if not is_checkpoint(source)
    }
    count = Counter((*code.values(), *game.bots))
    code = {  # a bot keeps its own
        source: source if count[name] > 1 and source.rpartition("/")[2] != name else name
        for source, name in code.items()
    }
    folders = [source for source in sources if source not in code]
    short = {**code, **shorten_paths(folders, {*game.bots, *code.values()})}
    return [short[source] for source in sources]


def _play(
    config: LeagueConfig,
    rules: Rules,
    entrants: list[Entrant],
    store: LeagueStore,
    load: Load,
    show_progress: bool,
    clock: Clock,
) -> tuple[dict[str, int], list[Job]]:
    """Play what the schedule says; returns the agents' numbers in the store by fingerprint, and the
    jobs.
    """
    ids = [
        store.add_agent(describe_agent(one.name, one.agent, rules.game, one.source))
        for one in entrants
    ]
    ladder = frozenset(n for n, one in enumerate(entrants) if one.source in config.ladder)
    with closing(Arena(rules, entrants, ids, store, config.workers, load)) as arena:
        jobs = _play_jobs(config, rules, arena, store, ladder, show_progress, clock)
    for key, value in ((COMMANDS, config.command), (VERSIONS, list_versions())):
        if value:
            store.note(key, value)
    return {one.fingerprint: number for one, number in zip(entrants, ids, strict=True)}, jobs


def _choose_rated(
    config: LeagueConfig, rules: Rules, ids: list[int], jobs: list[Job], stored: StoredGames
) -> StoredGames:
    """The games that ratings are of."""
    if config.ladder:  # what it has played before counts too
        return stored.select(np.asarray(np.isin(stored.agents, ids).all(axis=1), np.bool_))
    is_adaptive = config.half_width_elo > 0.0 or config.max_seconds > 0.0
    exact = rules.num_teams == 2 and not is_adaptive
    end = config.games_per_pair // rules.games_per_block if exact else None
    return _choose_games(rules, ids, jobs, stored, end)


def _play_jobs(
    config: LeagueConfig,
    rules: Rules,
    arena: Arena,
    store: LeagueStore,
    ladder: frozenset[int],
    show_progress: bool,
    clock: Clock,
) -> list[Job]:
    """Play what the schedule says; returns its jobs."""
    num_agents, size = len(arena.entrants), rules.games_per_chunk
    with tqdm(unit=" games", disable=not show_progress) as bar:
        if config.half_width_elo <= 0.0 and config.max_seconds <= 0.0:
            jobs = schedule_meetings(
                num_agents, rules.num_teams, config.games_per_pair, size, ladder
            )
            bar.total = len(jobs) * size
            arena.play(jobs, bar)
            return jobs
        clock.start()
        done = 0

        def play(jobs: Sequence[Job]) -> Played:
            nonlocal done
            arena.play(jobs[done:], bar, clock.is_time_up)
            done = len(jobs)
            return _as_played(_choose_games(rules, arena.ids, jobs, store.read_games()), arena.ids)

        names = [entrant.name for entrant in arena.entrants]

        def measure(games: Games) -> NDArray[np.float64]:
            return measure_ladder(rate(names, games, rules.seed, config.zero).ratings, names)

        return play_adaptively(
            num_agents,
            rules.num_teams,
            rules.blocks_per_chunk,
            size,
            Target(config.half_width_elo, config.games_per_pair, clock.is_time_up, measure),
            play,
            ladder,
        )


def _as_played(stored: StoredGames, ids: Sequence[int]) -> Played:
    """The games with agents by their numbers in the league."""
    games = number_agents(stored, ids)
    return Played(games, np.sort(games.agents, axis=1), stored.numbers)


def _choose_games(
    rules: Rules,
    ids: Sequence[int],
    jobs: Sequence[Job],
    games: StoredGames,
    end: int | None = None,
) -> StoredGames:
    """The games of the jobs, of each line-up to the block `end`: chunks are played whole."""
    ends: dict[tuple[int, ...], int] = {}
    for line_up, chunk in jobs:
        key = tuple(sorted(ids[number] for number in line_up))
        last = (chunk + 1) * rules.blocks_per_chunk
        ends[key] = max(ends.get(key, 0), last if end is None else min(end, last))
    keys = map(tuple, np.sort(games.agents, axis=1).tolist())
    limits = np.array([ends.get(key, 0) for key in keys], np.int64)
    return games.select(games.numbers < limits)
