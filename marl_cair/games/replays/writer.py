"""Writes a game to a replay file while it is played."""

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


def describe_engine(engine: BatchedEngine) -> str:
    """The part of a head that all games on one engine share, as JSON."""
    values = {
        "format": layout.FORMAT,
        "format_version": layout.FORMAT_VERSION,
        "game": engine.game.name,
        "rules_version": engine.game.version,
        "scenario": dataclasses.asdict(engine.scenario),
    }
    return json.dumps(values)


class ReplayWriter:
    """Records a game as it is played: a crash loses one second at most. A context manager.

    Args:
        path: of the file, which is replaced; missing folders are made.
        engine: the game at its start, after `reset`.
        map_seed: the seed of that reset.
        players: names of the players, one for each seat.
        extra: plain data to keep with the game.
        world: of the engine.
        common: `describe_engine`, computed once for many games on `engine`. Files that are given it
            are written faster, as a league needs it: they are not synced to the disk one by one.

    Raises ValueError for another number of players, OSError where the file cannot be written.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        engine: BatchedEngine,
        *,
        map_seed: int,
        players: Sequence[str],
        extra: Mapping[str, Any] | None = None,
        world: int = 0,
        common: str | None = None,
    ) -> None:
        self._engine, self._world = engine, world
        spec = engine.spec
        if len(players) != spec.num_players:
            raise ValueError(
                f"players are {list(players)}, the game has {spec.num_players} seats: name one "
                "player for each"
            )
        own = {"map_seed": int(map_seed), "players": list(players), "extra": dict(extra or {})}
        head = f"{(common or describe_engine(engine))[:-1]}, {json.dumps(own)[1:]}\n"
        self._shape, self._dtype = (spec.num_players, *spec.action_shape), layout.action_type(spec)
        self._shapes: dict[str, tuple[int, ...]] | None = None  # of values, from the first step on
        self._deflate = zlib.compressobj(1, wbits=layout.WINDOW_BITS, memLevel=5)
        self._pending = bytearray()
        self._steps = self._hashed = 0
        self._flushed = time.monotonic()
        self._is_synced = common is None
        if self._is_synced:
            Path(path).parent.mkdir(parents=True, exist_ok=True)
        self._file = open(path, "wb")  # noqa: PTH123, SIM115  # closed by `close`; faster than Path's
        self._file.write(head.encode())
        if self._is_synced:
            self._write_hash()
            self._file.flush()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        """Close; after an exception without an end, as the game was cut off."""
        if kind is None:
            self.close()
        elif not self._file.closed:
            with self._file:
                self._write_steps()

    def add(self, actions: NDArray[Any], values: Mapping[str, NDArray[Any]] | None = None) -> None:
        """Record one step, after `engine.step`: actions [P, *action_shape] and, for viewers,
        numbers [P, ...] by name, of the same names and shapes at each step (NaN where there are
        none). float16 keeps three digits of them.

        Raises ValueError for other shapes, or names than at the first step.
        """
        chosen = np.asarray(actions)
        if chosen.shape != self._shape:
            raise ValueError(f"actions have shape {chosen.shape}, the game's are {self._shape}")
        if self._shapes is None:
            self._declare_values(values or {})
        self._pending += chosen.astype(self._dtype).tobytes()
        self._pending += self._pack_values(values or {})
        self._steps += 1
        if self._steps >= self._hashed + HASH_EVERY_STEPS:
            self._write_hash()
        if time.monotonic() >= self._flushed + FLUSH_SECONDS:
            self.flush()

    def extend(self, actions: NDArray[Any]) -> None:
        """Record steps without values, after the last of them: actions [T, P, *action_shape].
        They are not checked.
        """
        self._shapes = self._shapes or {}
        self._pending += actions.astype(self._dtype).tobytes()
        self._steps += len(actions)
        if self._steps >= self._hashed + HASH_EVERY_STEPS:
            self._write_hash()

    def flush(self) -> None:
        """Write all steps so far to the file."""
        self._write_steps()
        self._file.flush()
        self._flushed = time.monotonic()

    def close(self, winner: int | None = None) -> None:
        """End the recording, before the engine's next step or reset. `winner`: the first seat of
        the winning team, where it is not the engine's, as after a forfeit.
        """
        if self._file.closed:
            return
        if winner is None:
            winner = int(self._engine.winner[self._world])
        with self._file:
            self._write_hash()
            end = {"winner": None if winner == NO_WINNER else winner}
            self._write(layout.END, json.dumps(end).encode())
            if self._is_synced:
                self._file.flush()
                os.fsync(self._file.fileno())

    def _declare_values(self, values: Mapping[str, NDArray[Any]]) -> None:
        self._shapes = {name: np.shape(values[name]) for name in sorted(values)}
        for name, shape in self._shapes.items():
            if shape[:1] != self._shape[:1]:
                raise ValueError(
                    f"values of {name!r} have shape {shape}, it must begin with the number of "
                    f"seats, {self._shape[0]}"
                )
        if self._shapes:
            self._write(layout.VALUES, json.dumps(self._shapes).encode())

    def _pack_values(self, values: Mapping[str, NDArray[Any]]) -> bytes:
        shapes = {name: np.shape(values[name]) for name in sorted(values)}
        if shapes != self._shapes:
            raise ValueError(
                f"values have the names and shapes {shapes}, at the first step {self._shapes}: "
                "give the same at each step"
            )
        with np.errstate(over="ignore"):
            packed = [np.asarray(values[name]).astype("<f2").tobytes() for name in shapes]
        return b"".join(packed)

    def _write_steps(self) -> None:
        if self._pending:
            packed = self._deflate.compress(self._pending)
            self._write(layout.STEPS, packed + self._deflate.flush(zlib.Z_SYNC_FLUSH))
            self._pending.clear()

    def _write_hash(self) -> None:
        """Write the steps so far, and the hash of the state after them."""
        self._write_steps()
        self._hashed = self._steps
        self._write(
            layout.HASH, layout.HASHED.pack(self._steps, hash_state(self._engine, self._world))
        )

    def _write(self, kind: bytes, payload: bytes) -> None:
        self._file.write(layout.pack_record(kind, payload))


def write_replay(path: str | os.PathLike[str], replay: Replay) -> None:
    """Write a replay that was not recorded: it is played again for the hashes.

    Raises as `ReplayWriter`.
    """
    steps = replay_steps(replay)
    seed, players, extra = replay.map_seed, replay.players, replay.extra
    with ReplayWriter(path, next(steps), map_seed=seed, players=players, extra=extra) as writer:
        for step, _ in enumerate(steps):
            values = {name: numbers[step] for name, numbers in (replay.values or {}).items()}
            writer.add(replay.actions[step], values)
        writer.close(NO_WINNER if replay.winner is None else replay.winner)
