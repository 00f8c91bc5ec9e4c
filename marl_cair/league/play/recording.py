"""Records the games of matches and leagues in replay files, while they are played."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import NO_WINNER
from marl_cair.games.replays import REPLAY_SUFFIX, ReplayWriter
from marl_cair.league.play.playing import Chunk, Step, find_remaining

if TYPE_CHECKING:
    from marl_cair.games.engine import BatchedEngine

_MOST_LETTERS = 80  # of the players in a file's name


class Recording(NamedTuple):
    """Where games are recorded.

    folder: of the files, one for the games that are played at once; a file of the same games is
        replaced.
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
    blocks = np.concatenate([chunk.blocks for chunk in chunks])
    most = math.inf if record is None or record.num_blocks is None else record.num_blocks
    worlds = np.flatnonzero(blocks < most)
    game_of = {world: game for game, world in enumerate(worlds.tolist())}
    if record is None or not len(worlds):
        yield None
        return
    players = _name_players(record, engine, chunks)
    with _open_file(record, engine, blocks, players, worlds, seeds) as writer:

        def note(step: Step) -> None:
            winners = {
                game_of[world]: _find_survivor(engine, step, world)
                for world, _ in step.forfeits
                if world in game_of
            }
            writer.add(step.actions[worlds], winners=winners)

        yield note


def _find_survivor(engine: BatchedEngine, step: Step, world: int) -> int:
    """The first seat of the team that is left after a forfeit, or NO_WINNER."""
    teams = engine.spec.team_of_seat
    forfeited = np.zeros(int(teams.max()) + 1, np.bool_)
    forfeited[[teams[seat] for place, seat in step.forfeits if place == world]] = True
    left = find_remaining(~step.out[world], forfeited, teams)
    return int(np.flatnonzero(teams == left[0])[0]) if len(left) == 1 else NO_WINNER


def _open_file(
    record: Recording,
    engine: BatchedEngine,
    blocks: NDArray[np.int64],
    players: list[list[str]],
    worlds: NDArray[np.int64],
    seeds: NDArray[np.uint64],
) -> ReplayWriter:
    """The file of the games of these worlds; blocks [B] and players [B][P] are of all."""
    firsts, places = np.unique(blocks, return_index=True, return_inverse=True)[1:]
    turns = np.arange(len(blocks)) - firsts[places]
    letters = "-v-".join(re.sub(r"[^\w.]+", "_", name).strip("_") for name in record.names)
    # Other agents and scenarios may have names as these in the same folder.
    about = f"{engine.game.version} {engine.scenario} {seeds[worlds].tolist()} {players}"
    digest = hashlib.sha256(about.encode()).hexdigest()[:8]
    name = f"{letters[:_MOST_LETTERS]}-{blocks[worlds[0]]:04}-{digest}{REPLAY_SUFFIX}"
    return ReplayWriter(
        record.folder / name,
        engine,
        map_seeds=seeds[worlds].tolist(),
        players=[players[world] for world in worlds],
        extras=[{"block": int(blocks[world]), "game": int(turns[world])} for world in worlds],
        worlds=worlds,
    )


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
