"""Plays the jobs of a league, here or in worker processes, and stores each batch when it ends."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import Executor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from tqdm import tqdm

from marl_cair.cluster import MakePool
from marl_cair.games import GAMES
from marl_cair.games.checks.scenario import restore_fields
from marl_cair.games.game import Agent, Game
from marl_cair.league.agents.load import find_fingerprint
from marl_cair.league.play import blocks
from marl_cair.league.play.blocks import Entrant
from marl_cair.league.play.playing import CHUNKS_AT_ONCE, line_up_seed, size_chunk
from marl_cair.league.play.recording import Recording
from marl_cair.league.play.schedule import Job
from marl_cair.league.store.schema import PlayedGame
from marl_cair.league.store.store import LeagueStore
from marl_cair.lookup import find_by_name

Load = Callable[..., Agent]


class Batch(NamedTuple):
    """Chunks of one line-up that are played and stored together."""

    line_up: tuple[int, ...]
    chunks: tuple[int, ...]


@contextmanager
def torch_threads(number: int | None) -> Iterator[None]:
    """Compute networks on `number` threads (None: as before), which changes how sums are rounded,
    and so, rarely, a game; afterwards the process has its own number again.
    """
    import torch  # seconds

    usual = torch.get_num_threads()
    if number is not None:
        torch.set_num_threads(number)
    try:
        yield
    finally:
        torch.set_num_threads(usual)


@dataclass(frozen=True)
class Rules:
    """Settings that all games of a league share."""

    game: Game
    scenario: Any
    seed: int
    seating: str

    @property
    def num_teams(self) -> int:
        return self.game.make_spec(self.scenario).num_teams

    @property
    def design(self) -> blocks.Design:
        """Which entry plays which team; see `blocks.make_design`."""
        return blocks.make_design(self.num_teams, self.seating, self.seed)

    @property
    def games_per_block(self) -> int:
        return len(self.design(0))

    @property
    def blocks_per_chunk(self) -> int:
        return max(1, size_chunk(self.game, blocks.GAMES_PER_CHUNK) // self.games_per_block)

    @property
    def plan(self) -> blocks.Plan:
        """The games of a chunk."""
        return blocks.Plan(self.design, self.blocks_per_chunk)

    @property
    def games_per_chunk(self) -> int:
        return self.games_per_block * self.blocks_per_chunk

    @classmethod
    def read(cls, settings: Mapping[str, Any]) -> Rules:
        """Read the settings of a league file. Raises ValueError for an unknown game or scenario."""
        game = find_by_name("game", str(settings["game"]), GAMES)
        scenario = game.scenario(None, **restore_fields(settings["scenario"]))
        return cls(game, scenario, int(settings["seed"]), str(settings["seating"]))

    def play(
        self, line_up: Sequence[Entrant], chunks: Sequence[int], record: Path | None = None
    ) -> list[PlayedGame]:
        """Games of whole chunks; see `blocks.play_blocks`. record: folder to record them in."""
        prints = [entrant.fingerprint for entrant in line_up]
        with torch_threads(1):  # worker processes share the cores
            return blocks.play_blocks(
                blocks.seat_line_up(line_up),
                self.game,
                self.scenario,
                self.seed,
                chunks,
                self.plan,
                line_up_seed(self.seed, prints),
                Recording(record, tuple(one.name for one in line_up)) if record else None,
            )


class Arena:
    """Plays and stores the games that the league file does not hold yet; must be closed.

    Args:
        rules: of the league.
        entrants: sorted by fingerprint; jobs name them by their places.
        ids: of the entrants in the store.
        store: of the league; this process alone writes to it.
        make_pool: starts workers, when several batches are to be played; None: this process plays.
            Results do not depend on it.
        load: loads the entrants in a worker: `load(source, game=..., scenario=...)`.
        record: folder to record all games in, if any.
    """

    def __init__(
        self,
        rules: Rules,
        entrants: Sequence[Entrant],
        ids: Sequence[int],
        store: LeagueStore,
        make_pool: MakePool | None,
        load: Load,
        record: Path | None = None,
    ) -> None:
        self.rules, self.entrants, self.ids = rules, entrants, ids
        self._store, self._make_pool, self._load = store, make_pool, load
        self._record = record
        self._pool: Executor | None = None

    def play(
        self, jobs: Sequence[Job], bar: tqdm[Any], is_time_up: Callable[[], bool] = lambda: False
    ) -> None:
        """Play the jobs whose blocks are not stored; `bar` counts the games of all jobs.

        is_time_up: called after each batch; true leaves the other batches out.

        Raises OSError: a worker process has died, or has loaded another agent from a source than
        this process (ClusterError: a cluster cannot be used); games that are stored stay.
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
        if self._make_pool is None or len(batches) < 2:
            for batch in batches:
                line_up = [self.entrants[number] for number in batch.line_up]
                yield batch, self.rules.play(line_up, batch.chunks, self._record)
            return
        self._pool = self._pool or self._make_pool()  # kept: a worker takes seconds to start
        context = pickle.dumps((self.rules, self._load, self._record))
        futures = {}
        for batch in batches:
            line_up = [self.entrants[number] for number in batch.line_up]
            about = [(one.name, one.fingerprint, one.source) for one in line_up]
            futures[self._pool.submit(_play_in_worker, context, about, batch.chunks)] = batch
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        except BrokenProcessPool as error:
            raise OSError(
                f"a worker process has died ({error}): see whether memory is short, or give "
                "--workers 1; the same command resumes it"
            ) from error
        finally:  # time may be up
            for future in futures:
                future.cancel()

    def close(self) -> None:
        """End the worker processes after their current batches."""
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)


def _play_in_worker(
    context: bytes, about: Sequence[tuple[str, str, str]], chunks: Sequence[int]
) -> list[PlayedGame]:
    rules, _, record = _read_context(context)
    line_up = [_load_entrant(context, *one) for one in about]
    played: list[PlayedGame] = rules.play(line_up, chunks, record)
    return played


@cache
def _read_context(context: bytes) -> tuple[Rules, Load, Path | None]:
    found: tuple[Rules, Load, Path | None] = pickle.loads(context)  # noqa: S301  # of `Arena`
    return found


@cache
def _load_entrant(context: bytes, name: str, fingerprint: str, source: str) -> Entrant:
    """Load an agent once in each worker."""
    rules, load, _ = _read_context(context)
    agent = load(source, game=rules.game.name, scenario=rules.scenario)
    if find_fingerprint(agent, rules.game) != fingerprint:
        raise OSError(
            f"{source} changed while the league was starting its workers: name no checkpoint "
            "that is being trained, or give --workers 1; the same command resumes the league"
        )
    return Entrant(name, fingerprint, agent, source)
