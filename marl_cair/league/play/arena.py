"""Plays the jobs of a league, here or in worker processes, and stores each batch as it is done."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import cached_property
from multiprocessing import get_context
from typing import Any, NamedTuple

from tqdm import tqdm

from marl_cair.games import GAMES
from marl_cair.games.checks.scenario import restore_fields
from marl_cair.games.game import Agent, Game
from marl_cair.league.agents.load import find_fingerprint
from marl_cair.league.play.blocks import (
    Design,
    Entrant,
    count_blocks_per_chunk,
    make_design,
    play_blocks,
    seat_line_up,
)
from marl_cair.league.play.playing import CHUNKS_AT_ONCE, line_up_seed
from marl_cair.league.play.schedule import Job
from marl_cair.league.store.records import PlayedGame
from marl_cair.league.store.store import LeagueStore
from marl_cair.lookup import find_by_name

Load = Callable[..., Agent]


class Batch(NamedTuple):
    """Chunks of one line-up that are played, and stored, at once."""

    line_up: tuple[int, ...]
    chunks: tuple[int, ...]


@dataclass(frozen=True)
class Rules:
    """What all games of a league share."""

    game: Game
    scenario: Any
    seed: int
    seating: str

    @property
    def num_teams(self) -> int:
        """T."""
        return self.game.make_spec(self.scenario).num_teams

    @property
    def design(self) -> Design:
        """Who plays which team."""
        return make_design(self.num_teams, self.seating, self.seed)

    @property
    def games_per_block(self) -> int:
        """Of every block."""
        return len(self.design(0))

    @property
    def blocks_per_chunk(self) -> int:
        """Of every chunk."""
        return count_blocks_per_chunk(self.games_per_block)

    @property
    def games_per_chunk(self) -> int:
        """Of every chunk."""
        return self.games_per_block * self.blocks_per_chunk

    @classmethod
    def read(cls, settings: Mapping[str, Any]) -> Rules:
        """As a league file keeps them (`LeagueStore.settings`). Raises ValueError where it is of a
        game or a scenario that there is not.
        """
        game = find_by_name("game", str(settings["game"]), GAMES)
        scenario = game.scenario(None, **restore_fields(settings["scenario"]))
        return cls(game, scenario, int(settings["seed"]), str(settings["seating"]))

    def play(self, line_up: Sequence[Entrant], chunks: Sequence[int]) -> list[PlayedGame]:
        """Games of whole chunks; see `blocks.play_blocks`."""
        return play_blocks(
            seat_line_up(line_up),
            self.game,
            self.scenario,
            self.seed,
            chunks,
            self.design,
            self.blocks_per_chunk,
            line_up_seed(self.seed, [entrant.fingerprint for entrant in line_up]),
        )


class Arena:
    """Plays and stores what the league file does not hold yet; to be closed in the end.

    Args:
        rules: of the league.
        entrants: by number: in the order of their fingerprints.
        ids: of the entrants in the store.
        store: of the league; this process alone writes to it.
        num_workers: processes that play; with 1 this one does. Results do not depend on it.
        load: how a worker gets the entrants: `load(source, game=..., scenario=...)`.
    """

    def __init__(
        self,
        rules: Rules,
        entrants: Sequence[Entrant],
        ids: Sequence[int],
        store: LeagueStore,
        num_workers: int,
        load: Load,
    ) -> None:
        self.rules, self.entrants, self.ids = rules, entrants, ids
        self._store, self._num_workers = store, num_workers
        self._pool: ProcessPoolExecutor | None = None
        prints = {entrant.source: entrant.fingerprint for entrant in entrants}
        self._workshop = _Workshop(
            rules.game.name, rules.scenario, rules.seed, rules.seating, prints, load
        )

    def play(
        self, jobs: Sequence[Job], bar: tqdm[Any], is_time_up: Callable[[], bool] = lambda: False
    ) -> None:
        """Play those jobs whose blocks are not stored; `bar` counts the games of all.

        is_time_up: asked after each batch; where it is, the others are left out.

        Raises:
            OSError: a worker process has died, or has found another agent where one of these was
                loaded from; what was stored before stays.
        """
        batches = list(self._find_missing(jobs))
        left = sum(len(batch.chunks) for batch in batches)
        bar.update((len(jobs) - left) * self.rules.games_per_chunk)
        with closing(self._play_batches(batches)) as played:
            for batch, games in played:
                self._store.add_games([self.ids[number] for number in batch.line_up], games)
                names = [self.entrants[number].name for number in batch.line_up]
                bar.set_postfix_str(" v ".join(names))
                bar.update(len(batch.chunks) * self.rules.games_per_chunk)
                if is_time_up():
                    return

    def _find_missing(self, jobs: Sequence[Job]) -> Iterator[Batch]:
        held = self._store.read_blocks()
        wanted: dict[tuple[int, ...], list[int]] = {}
        for line_up, chunk in jobs:
            stored = held.get(tuple(self.ids[number] for number in line_up), set())
            if chunk * self.rules.blocks_per_chunk not in stored:
                wanted.setdefault(line_up, []).append(chunk)
        for line_up, chunks in wanted.items():
            for start in range(0, len(chunks), CHUNKS_AT_ONCE):
                yield Batch(line_up, tuple(chunks[start : start + CHUNKS_AT_ONCE]))

    def _play_batches(
        self, batches: Sequence[Batch]
    ) -> Generator[tuple[Batch, list[PlayedGame]], None, None]:
        if self._num_workers == 1 or len(batches) < 2:
            for batch in batches:
                line_up = [self.entrants[number] for number in batch.line_up]
                with one_torch_thread():
                    games = self.rules.play(line_up, batch.chunks)
                yield batch, games
            return
        if self._pool is None:  # kept for later jobs: a worker takes seconds to start
            # Spawned, not forked: torch and numba hold threads.
            context = get_context("spawn")
            self._pool = ProcessPoolExecutor(
                self._num_workers, context, _start_worker, (self._workshop,)
            )
        try:
            yield from _collect(self._pool, batches)
        except BrokenProcessPool as error:
            raise OSError(
                f"a worker process has died ({error}): see whether memory is short, or give "
                "--workers 1; the same command resumes it"
            ) from error

    def close(self) -> None:
        """End the worker processes, after the batches that they are at."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def one_torch_thread() -> Iterator[None]:
    """Networks compute on one thread inside: how many there are changes how sums are rounded, and
    so, now and then, a game.
    """
    import torch  # seconds

    usual = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(usual)


def _collect(
    pool: ProcessPoolExecutor, batches: Sequence[Batch]
) -> Iterator[tuple[Batch, list[PlayedGame]]]:
    futures: dict[Future[list[PlayedGame]], Batch] = {
        pool.submit(_play_in_worker, batch): batch for batch in batches
    }
    try:
        for future in as_completed(futures):
            yield futures[future], future.result()
    finally:  # time may be up
        for future in futures:
            future.cancel()


@dataclass(frozen=True)
class _Workshop:
    """What a worker process plays with: agents are loaded at the first batch."""

    game_name: str
    scenario: Any
    seed: int
    seating: str
    prints: Mapping[str, str]  # fingerprints by source, in the order of the entrants' numbers
    load: Load

    @cached_property
    def rules(self) -> Rules:
        return Rules(GAMES[self.game_name], self.scenario, self.seed, self.seating)

    @cached_property
    def entrants(self) -> list[Entrant]:
        entrants = []
        for source, fingerprint in self.prints.items():
            agent = self.load(source, game=self.game_name, scenario=self.scenario)
            if find_fingerprint(agent, self.rules.game) != fingerprint:
                raise OSError(
                    f"{source} changed while the league was starting its workers: name no "
                    "checkpoint that is being trained, or give --workers 1; the same command goes "
                    "on"
                )
            entrants.append(Entrant("", fingerprint, agent, source))
        return entrants


_workshops: list[_Workshop] = []  # of this worker: it can be handed one only when it starts


def _start_worker(workshop: _Workshop) -> None:
    _workshops[:] = [workshop]


def _play_in_worker(batch: Batch) -> list[PlayedGame]:
    workshop = _workshops[0]
    line_up = [workshop.entrants[number] for number in batch.line_up]
    # Workers share the cores: torch would give each as many threads as there are cores.
    with one_torch_thread():
        return workshop.rules.play(line_up, batch.chunks)
