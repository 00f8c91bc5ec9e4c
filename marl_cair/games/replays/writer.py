"""Writes the games of an engine to a replay file while they are played."""

from __future__ import annotations

import dataclasses
import json
import os
import time
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import NO_WINNER
from marl_cair.games.replays import layout
from marl_cair.games.replays.replay import Replay, hash_state, replay_steps

if TYPE_CHECKING:
    from marl_cair.games.engine import BatchedEngine

HASH_EVERY_STEPS = 256
FLUSH_SECONDS = 1.0
_MOST_BYTES = 16 << 20  # of steps, before they are written


class ReplayWriter:
    """Records games as they are played: a crash loses one second at most. A context manager.

    A game ends with the step after which the engine says so; later steps of its world are not kept.

    Args:
        path: of the file, which is replaced; missing folders are made.
        engine: the games at their start, after `reset`.
        map_seeds: the seed of that reset, of each game.
        players: of each game, the names of the players, one for each seat.
        extras: plain data to keep with each game.
        worlds: of the engine, those of the games; by default all.

    Raises ValueError for another number of games or players, OSError where the file cannot be
    written.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        engine: BatchedEngine,
        *,
        map_seeds: Sequence[int],
        players: Sequence[Sequence[str]],
        extras: Sequence[Mapping[str, Any]] | None = None,
        worlds: Sequence[int] | NDArray[np.int64] | None = None,
    ) -> None:
        self._engine, spec = engine, engine.spec
        self._worlds = np.arange(engine.num_worlds) if worlds is None else np.asarray(worlds)
        num_games = len(self._worlds)
        extras = [{}] * num_games if extras is None else extras
        if {len(map_seeds), len(players), len(extras)} != {num_games}:
            raise ValueError(
                f"there are {len(map_seeds)} map seeds, {len(players)} rows of players and "
                f"{len(extras)} extras for {num_games} games: give one of each for a game"
            )
        for row in players:
            if len(row) != spec.num_players:
                raise ValueError(
                    f"players are {list(row)}, the game has {spec.num_players} seats: name one "
                    "player for each"
                )
        head = {
            "format": layout.FORMAT,
            "format_version": layout.FORMAT_VERSION,
            "game": engine.game.name,
            "rules_version": engine.game.version,
            "scenario": dataclasses.asdict(engine.scenario),
            "games": [
                {"map_seed": int(seed), "players": list(row), "extra": dict(extra)}
                for seed, row, extra in zip(map_seeds, players, extras, strict=True)
            ],
        }
        self._shape = (num_games, spec.num_players, *spec.action_shape)
        self._shapes: dict[str, tuple[int, ...]] | None = None  # of values, from the first step on
        self._is_open = np.ones(num_games, np.bool_)
        self._deflate = zlib.compressobj(1)
        self._records = bytearray()  # hashes and ends of the steps that are held
        self._steps = self._held = 0  # in all, and of those in `_held_steps`
        self._declare(layout.step_type(spec, {}))
        self._flushed = time.monotonic()
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        self._file = open(path, "wb")  # noqa: PTH123, SIM115  # closed by `close`
        self._file.write(json.dumps(head).encode() + b"\n")
        self._file.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        """Close; after an exception without ends, as the games were cut off."""
        if kind is None:
            self.close()
        elif not self._file.closed:
            with self._file:
                self._write_steps()

    def add(
        self,
        actions: NDArray[Any],
        values: Mapping[str, NDArray[Any]] | None = None,
        winners: Mapping[int, int] | None = None,
    ) -> None:
        """Record one step, after `engine.step` and before the next one.

        actions: [G, P, *action_shape] of the games.
        values: for viewers, numbers [G, P, ...] by name, of the same names and shapes at each step
            (NaN where there are none). float16 keeps three digits of them.
        winners: of games that end here whatever the engine says, as after a forfeit: by the number
            of the game the first seat of the winning team, or NO_WINNER.

        Raises ValueError for other shapes, or names than at the first step.
        """
        chosen = np.asarray(actions)
        if chosen.shape != self._shape:
            raise ValueError(f"actions have shape {chosen.shape}, the games' are {self._shape}")
        if not self._is_open.any():
            return
        self._check_values(values or {})
        step = self._held_steps[:, self._held]
        step["actions"] = chosen
        for name, numbers in (values or {}).items():
            with np.errstate(over="ignore"):
                step["values"][name] = numbers
        self._held += 1
        self._steps += 1
        over = (self._engine.terminated | self._engine.truncated)[self._worlds]
        if winners:
            over[list(winners)] = True
        for game in (over & self._is_open).nonzero()[0].tolist():
            self._end(game, (winners or {}).get(game))
        if not self._steps % HASH_EVERY_STEPS:
            for game in self._is_open.nonzero()[0].tolist():
                self._hash_state(game)
        if self._held == self._held_steps.shape[1]:
            self._write_steps()
        if time.monotonic() >= self._flushed + FLUSH_SECONDS:
            self.flush()

    def flush(self) -> None:
        """Write all steps so far to the file."""
        self._write_steps()
        self._file.flush()
        self._flushed = time.monotonic()

    def close(self, winner: int | None = None) -> None:
        """End all games that are open, with the engine's winner or this one, and the file, before
        the engine's next step or reset.
        """
        if self._file.closed:
            return
        with self._file:
            for game in self._is_open.nonzero()[0].tolist():
                self._end(game, winner)
            self._write_steps()

    def _declare(self, kind: np.dtype[Any]) -> None:
        """Make room for steps of this type."""
        num_bytes = max(1, self._shape[0] * kind.itemsize)
        most = min(HASH_EVERY_STEPS, max(1, _MOST_BYTES // num_bytes))
        self._held_steps = np.zeros((self._shape[0], most), kind)

    def _check_values(self, values: Mapping[str, NDArray[Any]]) -> None:
        """Compare names and shapes with those of the first step, which declares them."""
        shapes = {name: np.shape(values[name])[1:] for name in sorted(values)}
        if self._shapes is None:
            for name, numbers in values.items():
                if np.shape(numbers)[:2] != self._shape[:2]:
                    raise ValueError(
                        f"values of {name!r} have shape {np.shape(numbers)}, it must begin with "
                        f"the numbers of games and seats, {self._shape[:2]}"
                    )
            self._shapes = shapes
            if shapes:
                self._declare(layout.step_type(self._engine.spec, shapes))
                self._file.write(layout.pack_record(layout.VALUES, json.dumps(shapes).encode()))
        if shapes != self._shapes:
            raise ValueError(
                f"values have the names and shapes {shapes}, at the first step {self._shapes}: "
                "give the same at each step"
            )

    def _write_steps(self) -> None:
        """Write the steps since the last time, after the hashes and ends in them."""
        held, self._held = self._held_steps[:, : self._held], 0
        records, self._records = self._records, bytearray()  # nothing is written a second time
        if held.size:
            packed = self._deflate.compress(held.tobytes())
            packed += self._deflate.flush(zlib.Z_SYNC_FLUSH)
            records += layout.pack_record(layout.STEPS, layout.COUNTED.pack(self._steps) + packed)
        self._file.write(records)

    def _end(self, game: int, winner: int | None) -> None:
        """End a game now, with this winner or the engine's."""
        self._hash_state(game)
        if winner is None:
            winner = int(self._engine.winner[self._worlds[game]])
        record = layout.ENDED.pack(game, self._steps, winner)
        self._records += layout.pack_record(layout.END, record)
        self._is_open[game] = False

    def _hash_state(self, game: int) -> None:
        digest = hash_state(self._engine, int(self._worlds[game]))
        record = layout.HASHED.pack(game, self._steps, digest)
        self._records += layout.pack_record(layout.HASH, record)


def write_replay(path: str | os.PathLike[str], replay: Replay) -> None:
    """Write a replay that was not recorded: it is played again for the hashes.

    Raises as `ReplayWriter`.
    """
    steps = replay_steps(replay)
    seeds, players, extras = [replay.map_seed], [replay.players], [replay.extra]
    engine = next(steps)
    with ReplayWriter(path, engine, map_seeds=seeds, players=players, extras=extras) as writer:
        winner = NO_WINNER if replay.winner is None else replay.winner
        for step, _ in enumerate(steps):
            values = {name: numbers[None, step] for name, numbers in (replay.values or {}).items()}
            ended = {0: winner} if step == len(replay.actions) - 1 else None
            writer.add(replay.actions[None, step], values, ended)
        writer.close(winner)
