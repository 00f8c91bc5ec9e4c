"""Records the games of matches and leagues, each in a replay file, while they are played."""

from __future__ import annotations

import hashlib
import math
import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import NO_WINNER
from marl_cair.games.replays import FLUSH_SECONDS, REPLAY_SUFFIX, ReplayWriter, describe_engine
from marl_cair.games.replays.layout import action_type
from marl_cair.league.play.playing import Chunk, Step, find_remaining

if TYPE_CHECKING:
    from marl_cair.games.engine import BatchedEngine

_MOST_LETTERS = 80  # of the players in a file's name
_MOST_STEPS, _MOST_BYTES = 256, 16 << 20  # that are gathered before they reach the files' buffers


class Recording(NamedTuple):
    """Where games are recorded.

    folder: of the files; a game that is there is written again.
    names: of the entries of the line-up.
    num_blocks: only games of the first blocks; None: all.
    """

    folder: Path
    names: tuple[str, ...]
    num_blocks: int | None = None

    def limit(self, num_blocks: int) -> Recording:
        """The same, of at most `num_blocks` blocks."""
        held = num_blocks if self.num_blocks is None else min(num_blocks, self.num_blocks)
        return self._replace(num_blocks=held)


@contextmanager
def recording(
    record: Recording | None,
    engine: BatchedEngine,
    chunks: Sequence[Chunk],
    seeds: NDArray[np.uint64],
) -> Iterator[Callable[[Step], None] | None]:
    """Record all games of an engine at their start; yields the `watch` of `playing.play_out`.

    seeds [B]: of the engine's worlds. Without `record` nothing is recorded.
    """
    if record is None:
        yield None
        return
    with ExitStack() as files:
        writers = _open_files(record, engine, chunks, seeds)
        for writer in writers.values():
            files.enter_context(writer)
        yield _Recorder(engine, writers).note


class _Recorder:
    """Gathers the steps of all worlds, and writes them to their files about once a second."""

    def __init__(self, engine: BatchedEngine, writers: dict[int, ReplayWriter]) -> None:
        self._engine, self._writers = engine, writers
        self._is_open = np.zeros(engine.num_worlds, np.bool_)
        self._is_open[list(writers)] = True
        shape = (engine.num_worlds, engine.num_players, *engine.spec.action_shape)
        kind = action_type(engine.spec)
        most = max(1, min(_MOST_STEPS, _MOST_BYTES // (math.prod(shape) * kind.itemsize)))
        self._steps, self._count = np.empty((most, *shape), kind), 0  # since the last gathering
        self._flushed = time.monotonic()

    def note(self, step: Step) -> None:
        """Note one step of all worlds; close the files of games that have ended by it."""
        self._steps[self._count] = step.actions
        self._count += 1
        over = self._engine.terminated | self._engine.truncated
        given_up = [world for world, _ in step.forfeits]
        if given_up:
            over[given_up] = True
        over &= self._is_open
        for world in over.nonzero()[0].tolist():
            winner = _find_survivor(self._engine, step, world) if world in given_up else None
            self._writers[world].extend(self._steps[: self._count, world])
            self._writers[world].close(winner)
            self._is_open[world] = False
        is_late = time.monotonic() >= self._flushed + FLUSH_SECONDS
        if is_late or self._count == len(self._steps):
            for world in self._is_open.nonzero()[0].tolist():
                self._writers[world].extend(self._steps[: self._count, world])
                if is_late:
                    self._writers[world].flush()
            self._count = 0
        if is_late:
            self._flushed = time.monotonic()


def _find_survivor(engine: BatchedEngine, step: Step, world: int) -> int:
    """The first seat of the team that is left after a forfeit, or NO_WINNER."""
    teams = engine.spec.team_of_seat
    forfeited = np.zeros(int(teams.max()) + 1, np.bool_)
    forfeited[[teams[seat] for place, seat in step.forfeits if place == world]] = True
    left = find_remaining(~step.out[world], forfeited, teams)
    return int(np.flatnonzero(teams == left[0])[0]) if len(left) == 1 else NO_WINNER


def _open_files(
    record: Recording, engine: BatchedEngine, chunks: Sequence[Chunk], seeds: NDArray[np.uint64]
) -> dict[int, ReplayWriter]:
    """The file of each world that is recorded."""
    blocks = np.concatenate([chunk.blocks for chunk in chunks])
    turns = (
        np.arange(len(blocks))
        - np.unique(blocks, return_index=True)[1][np.unique(blocks, return_inverse=True)[1]]
    )
    players = _name_players(record, engine, chunks)
    common = describe_engine(engine)
    digest = hashlib.sha256(common.encode())
    record.folder.mkdir(parents=True, exist_ok=True)
    letters = "-v-".join(re.sub(r"[^\w.]+", "_", name).strip("_") for name in record.names)
    place = record.folder / letters[:_MOST_LETTERS]
    writers = {}
    for world, (block, turn) in enumerate(zip(blocks.tolist(), turns.tolist(), strict=True)):
        if record.num_blocks is not None and block >= record.num_blocks:
            continue
        # Other agents and scenarios may have names as these in the same folder.
        own = digest.copy()
        own.update(f"{seeds[world]} {players[world]}".encode())
        ending = f"{block:04}-{turn}-{own.hexdigest()[:8]}{REPLAY_SUFFIX}"
        writers[world] = ReplayWriter(
            f"{place}-{ending}",
            engine,
            map_seed=int(seeds[world]),
            players=players[world],
            extra={"block": block, "game": turn},
            world=world,
            common=common,
        )
    return writers


def _name_players(
    record: Recording, engine: BatchedEngine, chunks: Sequence[Chunk]
) -> list[list[str]]:
    """The name of the player in each seat of each world, [B][P]."""
    entries = np.zeros((engine.num_worlds, engine.num_players), np.int64)
    start = 0
    for chunk in chunks:
        for entry, (games, seats) in enumerate(chunk.places):
            entries[start + games, seats] = entry
        start += len(chunk.blocks)
    return [[record.names[entry] for entry in row] for row in entries.tolist()]
