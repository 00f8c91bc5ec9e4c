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

from marl_cair.cluster import LOCAL, check_cluster, choose_pool
from marl_cair.files import claim_output_folder
from marl_cair.games import GAMES
from marl_cair.games.game import Game
from marl_cair.league.agents import load as agents
from marl_cair.league.agents.allowed_code import PREFIX, is_process
from marl_cair.league.agents.load import load_agent
from marl_cair.league.play import adaptive
from marl_cair.league.play.arena import Arena, Load, Rules
from marl_cair.league.play.blocks import Entrant
from marl_cair.league.play.match import require_rivals
from marl_cair.league.play.schedule import Job, schedule_meetings
from marl_cair.league.ratings.games import Games
from marl_cair.league.ratings.rate import rate
from marl_cair.league.report import report
from marl_cair.league.report.background import COMMANDS, VERSIONS, list_versions
from marl_cair.league.report.report import LeagueResult
from marl_cair.league.store.store import STORE_FILE, LeagueStore, StoredGames
from marl_cair.lookup import check_name, find_by_name
from marl_cair.text import clean_text


@dataclass(frozen=True)
class LeagueConfig:
    """Settings of a league.

    Raises ValueError for fewer than two agents, a repeated one, or a number that is out of range.
    """

    agents: tuple[str, ...]  # checkpoint folders, bots, module:function, process:COMMAND
    game: str = "deep_line_wars"
    scenario: str = "10x15"
    scenario_options: Mapping[str, Any] = field(default_factory=dict)  # fields of it to change
    games_per_pair: int = 40  # even with two teams: each map seed is played in both seats
    seed: int = 0
    out: str = "runs/league"
    ladder: tuple[str, ...] = ()  # further agents, which do not play each other again
    seating: str = ""  # "ring" or "all", see `blocks.make_design`; "": all with up to three teams
    workers: int = 1  # processes that play; results do not depend on it
    cluster: str = LOCAL  # where they run, see `cluster.check_cluster`
    half_width_elo: float = 0.0  # above 0: play until no 95 % interval is wider either way
    max_seconds: float = 0.0  # above 0: choose no further games then
    replays: bool = True  # whether the report shows a few games
    zero: str = ""  # the agent that is rated 0; "": the mean of those that are connected
    command: str = ""  # the command line, for the report
    record: str = ""  # folder to record the games in that are played now; "": none

    def __post_init__(self) -> None:
        check_cluster(self.cluster)
        sources = list(self.sources)
        if len(sources) < 2:
            raise ValueError(f"agents are {sources}, a league needs two or more")
        if twice := sorted({name for name in sources if sources.count(name) > 1}):
            raise ValueError(f"{', '.join(twice)} is given twice: name each agent once")
        for name, value, least in (
            ("games_per_pair (--games)", self.games_per_pair, 1),
            ("workers", self.workers, 1),
            ("seed", self.seed, 0),
        ):
            if value < least:
                raise ValueError(f"{name} is {value}, it must be {least} or more")
        limits = (
            ("half_width_elo (--ci)", self.half_width_elo),
            ("max_seconds (--time)", self.max_seconds),
        )
        for name, limit in limits:
            if not 0.0 <= limit < math.inf:  # NaN too
                raise ValueError(f"{name} is {limit}, it must be a finite number, 0 or more")

    @property
    def sources(self) -> tuple[str, ...]:
        """All agents, those of the ladder last."""
        return (*self.agents, *self.ladder)

    @property
    def is_adaptive(self) -> bool:
        """Whether intervals or time end the league."""
        return self.half_width_elo > 0.0 or self.max_seconds > 0.0


def run_league(
    config: LeagueConfig, load: Load = load_agent, show_progress: bool = True
) -> LeagueResult:
    """Play the games that `<out>/league.sqlite` does not hold, rate all agents, write the report.

    The same agents, seed and number of games give the same tables, for any order of the agents and
    any number of workers, however often the league was interrupted, and also if it had fewer games
    before. With two teams it may have had other agents before, too.

    Raises:
        CheckpointError, ForeignAgentError, UnknownNameError: an agent cannot be loaded; before any
            game.
        ValueError: two of the agents are the same, the scenario has only one team, or the number of
            games does not fit.
        ClusterError: the cluster cannot be used; before any game.
        OutputFolderError, LeagueStoreError: the folder holds something else, or a league with other
            settings; or its file cannot be written.
    """
    with _open_league(config, load, show_progress) as league:
        stored = league.choose_rated(league.play())
        options = report.ReportOptions(
            config.replays,
            load,
            frozenset(config.sources),
            show_progress=show_progress,
            zero=config.zero,
        )
        names = dict(zip(league.ids, league.names, strict=True))
        result = report.rate_and_report(league.store, stored, names, Path(config.out), options)
        is_time_up = league.clock.has_ended
        ending = adaptive.describe_ending(config.half_width_elo, result.ratings, is_time_up)
        return dataclasses.replace(result, ending=ending)


def play_league(config: LeagueConfig, load: Load = load_agent, show_progress: bool = True) -> None:
    """Play as `run_league`, without rating. Raises as `run_league`."""
    with _open_league(config, load, show_progress) as league:
        league.play()


@contextmanager
def _open_league(config: LeagueConfig, load: Load, show_progress: bool) -> Iterator[_League]:
    game = find_by_name("game", config.game, GAMES)
    options = {**config.scenario_options, "reward": game.rated_reward}
    rules = _find_rules(config, game, game.scenario(config.scenario, **options))
    entrants = _load_entrants(config, game, rules.scenario, load)
    settings = {
        "game": game.name,
        "game_version": game.version,
        "scenario": dataclasses.asdict(rules.scenario),
        "seed": config.seed,
    }
    teams = game.make_spec(rules.scenario).team_of_seat.tolist()
    more = {**settings, "seating": rules.seating, "team_of_seat": teams}
    folder = Path(config.out)
    if config.zero:
        check_name("agent (--zero)", config.zero, sorted(entrant.name for entrant in entrants))
    with (
        claim_output_folder(folder, "league", settings, resume=True),
        closing(LeagueStore(folder / STORE_FILE, more)) as store,
    ):
        yield _League(config, rules, entrants, store, load, show_progress)


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
    """All agents with short, unique names, sorted by fingerprint: names have no influence."""
    sources: dict[str, str] = {}
    entrants = []
    for source, name in zip(config.sources, _short_names(config.sources, game), strict=True):
        agent = load(source, game=game.name, scenario=scenario)
        fingerprint = agents.find_fingerprint(agent, game)
        if fingerprint in sources:
            raise ValueError(
                f"{sources[fingerprint]} and {source} are the same agent: name it once"
            )
        sources[fingerprint] = source
        entrants.append(Entrant(clean_text(name), fingerprint, agent, source))
    return sorted(entrants, key=lambda entrant: entrant.fingerprint)


def _short_names(sources: Sequence[str], game: Game) -> list[str]:
    """Unique names: bots by their names, which no other agent has; commands whole; folders by the
    fewest last parts of their paths.
    """
    code = {
        source: source.removeprefix(PREFIX) if is_process(source) else source.rpartition("/")[2]
        for source in sources
        if not agents.is_checkpoint(source)
    }
    count = Counter((*code.values(), *game.bots))
    code = {  # a bot keeps its own
        source: source if count[name] > 1 and source.rpartition("/")[2] != name else name
        for source, name in code.items()
    }
    folders = [source for source in sources if source not in code]
    short = {**code, **agents.shorten_paths(folders, {*game.bots, *code.values()})}
    return [short[source] for source in sources]


class _League:
    """An open league. Entrants are sorted by fingerprint; `ids` are theirs in the store."""

    def __init__(
        self,
        config: LeagueConfig,
        rules: Rules,
        entrants: list[Entrant],
        store: LeagueStore,
        load: Load,
        show_progress: bool,
    ) -> None:
        self.config, self.rules, self.entrants, self.store = config, rules, entrants, store
        self.clock = adaptive.Clock(config.max_seconds)
        self.names = [entrant.name for entrant in entrants]
        self._load, self._show_progress = load, show_progress
        self.ids = [
            store.add_agent(agents.describe_agent(one.name, one.agent, rules.game, one.source))
            for one in entrants
        ]

    def play(self) -> list[Job]:
        """Play the missing games of the schedule; returns its jobs."""
        config, rules = self.config, self.rules
        ladder = frozenset(n for n, one in enumerate(self.entrants) if one.source in config.ladder)
        record = Path(config.record) if config.record else None
        # Workers write the records, this process the store.
        records = Path(config.record or ".").absolute()
        shared = next((one for one in (records, *records.parents) if one.is_dir()), Path())
        make_pool = choose_pool(config.cluster, config.workers, shared)
        arena = Arena(rules, self.entrants, self.ids, self.store, make_pool, self._load, record)
        with closing(arena), tqdm(unit=" games", disable=not self._show_progress) as bar:
            if config.is_adaptive:
                jobs = self._play_adaptively(arena, bar, ladder)
            else:
                size, num_agents = rules.games_per_chunk, len(self.ids)
                per_pair = config.games_per_pair
                jobs = schedule_meetings(num_agents, rules.num_teams, per_pair, size, ladder)
                bar.total = len(jobs) * size
                arena.play(jobs, bar)
        for key, value in ((COMMANDS, config.command), (VERSIONS, list_versions())):
            if value:
                self.store.note(key, value)
        return jobs

    def _play_adaptively(self, arena: Arena, bar: tqdm[Any], ladder: frozenset[int]) -> list[Job]:
        config, rules, clock = self.config, self.rules, self.clock
        clock.start()
        done, of_ladder = 0, [self.ids[number] for number in ladder]

        def play(jobs: Sequence[Job]) -> tuple[Games, NDArray[np.int64]]:
            nonlocal done
            arena.play(jobs[done:], bar, clock.is_time_up)
            done = len(jobs)
            stored = self._choose_games(jobs, self.store.read_games(), always=of_ladder)
            return report.number_agents(stored, self.ids), stored.numbers

        def measure(games: Games) -> NDArray[np.float64]:
            ratings = rate(self.names, games, rules.seed, config.zero).ratings
            return adaptive.measure_ladder(ratings, self.names, config.zero)

        plan = adaptive.AdaptivePlan(
            len(self.ids),
            rules.num_teams,
            rules.blocks_per_chunk,
            rules.games_per_chunk,
            config.half_width_elo,
            config.games_per_pair,
            clock.is_time_up,
            measure,
            ladder,
        )
        return adaptive.play_adaptively(plan, play)

    def choose_rated(self, jobs: Sequence[Job]) -> StoredGames:
        """The stored games that are rated; with a ladder also its earlier games."""
        stored = self.store.read_games()
        if self.config.ladder:
            both = np.isin(stored.agents, self.ids).all(axis=1)
            return stored.select(np.asarray(both, np.bool_))
        if self.rules.num_teams > 2 or self.config.is_adaptive:
            return self._choose_games(jobs, stored)
        end = self.config.games_per_pair // self.rules.games_per_block
        return self._choose_games(jobs, stored, end)

    def _choose_games(
        self,
        jobs: Sequence[Job],
        games: StoredGames,
        end: int | None = None,
        always: Sequence[int] = (),
    ) -> StoredGames:
        """The games of the jobs, of each line-up those before block `end` (chunks are whole); and
        those among the agents `always`.
        """
        ends: dict[tuple[int, ...], int] = {}
        for line_up, chunk in jobs:
            key = tuple(sorted(self.ids[number] for number in line_up))
            last = (chunk + 1) * self.rules.blocks_per_chunk
            ends[key] = max(ends.get(key, 0), last if end is None else min(end, last))
        keys = map(tuple, np.sort(games.agents, axis=1).tolist())
        limits = np.array([ends.get(key, 0) for key in keys], np.int64)
        return games.select((games.numbers < limits) | np.isin(games.agents, always).all(axis=1))
