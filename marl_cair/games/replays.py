"""Recorded games: a file of seed, scenario and actions, from which the exact game is played again.

A file is a line of JSON (the head) and records, each appended whole:

    kind 1 byte | bytes of the payload u32 | CRC-32 of the rest u32 | payload

    s  steps: the next bytes of one deflate stream. A step is the actions of all seats, in the
       smallest unsigned type, then the values of viewers, float16, in the order of their names
    v  names and shapes of these values, as JSON
    h  number of steps so far u32 | hash of the state after them
    e  the end: the winner, as JSON
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import struct
import time
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from marl_cair.files import shorten_value
from marl_cair.games.checks.scenario import restore_fields
from marl_cair.games.game import NO_WINNER, GameSpec
from marl_cair.games.registry import GAMES
from marl_cair.lookup import UnknownNameError, find_by_name
from marl_cair.stored import REPLAY, DamagedFileError, open_stored

if TYPE_CHECKING:
    from marl_cair.games.engine import BatchedEngine

REPLAY_SUFFIX = ".replay"
FORMAT, FORMAT_VERSION = "marl_cair replay", 1
HASH_EVERY_STEPS = 128
FLUSH_SECONDS = 1.0
HASH_BYTES = 8
MAX_GAME_BYTES = 512 << 20  # of all steps of one game, as they are held when a file is read

_STEPS, _VALUES, _HASH, _END = b"s", b"v", b"h", b"e"
_FRAME = struct.Struct("<cII")
_HASHED = struct.Struct(f"<I{HASH_BYTES}s")
_CHECKED = struct.Struct("<cI")  # of a frame, beside the payload


class ReplayError(DamagedFileError):
    """A file that is no replay, a damaged one, or one that this program cannot play again."""


@dataclass(frozen=True, eq=False)
class Replay:
    """One recorded game.

    Attributes:
        game, scenario, rules_version, map_seed: what was played; `scenario` is the dataclass.
        players: names [P], by seat.
        actions: int32 [T, P, *action_shape].
        winner: the first seat of the winning team; None for none, a draw, or an unknown one.
        is_complete: False if the recording was cut off: all steps up to there are in `actions`.
        values: float16 [T, P, ...] by name, kept for viewers; None where there are none.
        hashes: of the state after so many steps; see `hash_state`.
        extra: plain data of the program that recorded it.
    """

    game: str
    scenario: Any
    rules_version: str
    map_seed: int
    players: tuple[str, ...]
    actions: NDArray[np.int32]
    winner: int | None
    is_complete: bool
    values: Mapping[str, NDArray[np.float16]] | None = None
    hashes: Mapping[int, bytes] = field(default_factory=dict)
    extra: Mapping[str, Any] = field(default_factory=dict)

    @property
    def spec(self) -> GameSpec:
        """Of the scenario."""
        return GAMES[self.game].make_spec(self.scenario)


class ReplayWriter:
    """Records a game as it is played: a crash loses one second at most. A context manager.

    Args:
        path: of the file, which is replaced; missing folders are made.
        engine: the game at its start, after `reset`.
        map_seed: the seed of that reset.
        players: names of the players, one for each seat.
        extra: plain data to keep with the game.
        world: of the engine.

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
    ) -> None:
        self.path, self._engine, self._world = Path(path), engine, world
        spec = engine.spec
        if len(players) != spec.num_players:
            raise ValueError(
                f"players are {list(players)}, the game has {spec.num_players} seats: name one "
                "player for each"
            )
        head = {
            "format": FORMAT,
            "format_version": FORMAT_VERSION,
            "game": engine.game.name,
            "rules_version": engine.game.version,
            "scenario": dataclasses.asdict(engine.scenario),
            "map_seed": int(map_seed),
            "players": list(players),
            "extra": dict(extra or {}),
        }
        self._shape, self._dtype = (spec.num_players, *spec.action_shape), _action_dtype(spec)
        self._shapes: dict[str, tuple[int, ...]] | None = None  # of values, from the first step on
        self._deflate = zlib.compressobj(wbits=12, memLevel=5)
        self._pending = bytearray()
        self._steps = self._hashed = 0
        self._flushed = time.monotonic()
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self._file = self.path.open("wb")
        self._file.write(json.dumps(head).encode() + b"\n")
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
            self._write(_END, json.dumps(end).encode())
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
            self._write(_VALUES, json.dumps(self._shapes).encode())

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
            self._write(_STEPS, packed + self._deflate.flush(zlib.Z_SYNC_FLUSH))
            self._pending.clear()

    def _write_hash(self) -> None:
        """Write the steps so far, and the hash of the state after them."""
        self._write_steps()
        self._hashed = self._steps
        self._write(_HASH, _HASHED.pack(self._steps, hash_state(self._engine, self._world)))

    def _write(self, kind: bytes, payload: bytes) -> None:
        self._file.write(_FRAME.pack(kind, len(payload), _checksum(kind, payload)) + payload)


def hash_state(engine: BatchedEngine, world: int = 0) -> bytes:
    """The first HASH_BYTES of SHA-256 of all state arrays of one world and its outcome, in their
    order. Of games without snapshots: of the outcome alone.
    """
    digest = hashlib.sha256()
    if engine.game.has_snapshots:
        held = engine.snapshot([world])
        arrays: Sequence[NDArray[Any]] = (*held.world, *held.outcome)
    else:
        reported = engine.rewards, engine.terminated, engine.truncated, engine.winner
        arrays = [values[world] for values in reported]
    for values in arrays:
        digest.update(np.ascontiguousarray(values).data)
    return digest.digest()[:HASH_BYTES]


def replay_steps(replay: Replay) -> Iterator[BatchedEngine]:
    """Play the game again: yields one engine of one world at its start and after each step, T + 1
    times.

    Raises ReplayError where the state differs from the recorded one.
    """
    from marl_cair.games.engine import BatchedEngine  # numba only from here on

    engine = BatchedEngine(GAMES[replay.game], replay.scenario)
    try:
        engine.reset(np.array([replay.map_seed], np.uint64))
        for step in range(len(replay.actions) + 1):
            if step:
                engine.step(replay.actions[step - 1][None])
            if replay.hashes.get(step, b"") not in (b"", hash_state(engine)):
                raise ReplayError(
                    f"the {replay.game} game differs from the recorded one at step {step}: its "
                    "map file, or another file that the scenario names, has changed, or the "
                    "replay was edited"
                )
            yield engine
    finally:
        engine.close()


def write_replay(path: str | os.PathLike[str], replay: Replay) -> None:
    """Write a replay that was not recorded, without `values`: it is played again for the hashes.

    Raises as `ReplayWriter`.
    """
    steps = replay_steps(replay)
    seed, players, extra = replay.map_seed, replay.players, replay.extra
    with ReplayWriter(path, next(steps), map_seed=seed, players=players, extra=extra) as writer:
        for actions, _ in zip(replay.actions, steps, strict=True):
            writer.add(actions)
        writer.close(NO_WINNER if replay.winner is None else replay.winner)


def read_replay(path: str | os.PathLike[str]) -> Replay:
    """Read a recorded game. Nothing in the file is run.

    Raises:
        ReplayError: no replay, a damaged one, of another version of the rules (both are named),
            or a game that is not installed.
        ValueError: a scenario that cannot be read, as one whose map file is missing.
        OSError: the file cannot be opened.
    """
    with open_stored(path, REPLAY) as file:
        content = file.read()
    line, mark, body = content.partition(b"\n")
    head = _read_head(path, line, mark)
    try:
        game = find_by_name("game", head["game"], GAMES)
    except UnknownNameError as error:
        raise ReplayError(f"{path}: {error}. Install the package that adds this game") from error
    if head["rules_version"] != game.version:
        raise ReplayError(
            f"{path} was played by version {head['rules_version']} of the rules of {game.name}, "
            f"this is version {game.version}: play it again with the marl_cair that recorded it"
        )
    scenario = game.scenario(None, **restore_fields(head["scenario"]))
    spec = game.make_spec(scenario)
    if len(head["players"]) != spec.num_players:
        raise _damaged(path, f"it names {len(head['players'])} players, not {spec.num_players}")
    records = _Records(path, spec)
    for kind, payload in _list_frames(path, body):
        records.read(kind, payload)
    actions, values = records.unpack()
    return Replay(
        game.name,
        scenario,
        game.version,
        head["map_seed"],
        tuple(head["players"]),
        actions,
        records.winner,
        records.is_complete,
        values,
        records.hashes,
        head["extra"],
    )


def _read_head(path: str | os.PathLike[str], line: bytes, mark: bytes) -> dict[str, Any]:
    """The head as plain data, each entry of its type."""
    try:
        head: dict[str, Any] = json.loads(line)
        if head["format"] != FORMAT:
            raise ValueError(f"its format is {shorten_value(head['format'])}")
        if head["format_version"] != FORMAT_VERSION:
            raise ValueError(
                f"its format has version {shorten_value(head['format_version'])}, this program "
                f"reads {FORMAT_VERSION}"
            )
        for name, kind in (
            ("game", str),
            ("rules_version", str),
            ("scenario", dict),
            ("map_seed", int),
            ("players", list),
            ("extra", dict),
        ):
            if not isinstance(head[name], kind):
                raise TypeError(f"{name} is {shorten_value(head[name])}")
        if not 0 <= head["map_seed"] < 1 << 64 or not mark:
            raise ValueError("it ends within its first line" if not mark else "map_seed is wrong")
        head["players"] = [str(name) for name in head["players"]]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ReplayError(
            f"{path} is no replay of marl_cair ({_describe(error)}): give a file that --record, or "
            "`marl-cair league replay`, has written"
        ) from error
    return head


def _list_frames(path: str | os.PathLike[str], body: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Kind and payload of each record up to the tear, if there is one."""
    at = 0
    while at + _FRAME.size <= len(body) and any(body[at : at + _FRAME.size]):
        kind, size, checksum = _FRAME.unpack_from(body, at)
        end = at + _FRAME.size + size
        if end > len(body):
            return
        payload = body[at + _FRAME.size : end]
        if _checksum(kind, payload) != checksum:
            raise _damaged(path, f"the record at byte {at} of its records has another checksum")
        yield kind, payload
        at = end


class _Records:
    """What the records of a file hold, so far."""

    def __init__(self, path: str | os.PathLike[str], spec: GameSpec) -> None:
        self._path, self._spec = path, spec
        self._inflate, self._steps = zlib.decompressobj(wbits=12), bytearray()
        self._shapes: dict[str, tuple[int, ...]] = {}
        self.hashes: dict[int, bytes] = {}
        self.winner: int | None = None
        self.is_complete = False

    def read(self, kind: bytes, payload: bytes) -> None:
        """Read one record. Raises ReplayError."""
        try:
            if self.is_complete:
                raise ValueError("there are records after its end")
            if kind == _STEPS:
                self._read_steps(payload)
            elif kind == _VALUES and not self._steps:
                self._shapes = {
                    str(name): tuple(int(size) for size in shape)
                    for name, shape in json.loads(payload).items()
                }
            elif kind == _HASH:
                step, digest = _HASHED.unpack(payload)
                self.hashes[step] = digest
            elif kind == _END:
                self._read_end(json.loads(payload))
            else:
                raise ValueError(f"it has a record of the kind {kind!r}")
        except (ValueError, KeyError, TypeError, AttributeError, zlib.error, struct.error) as error:
            raise _damaged(self._path, _describe(error)) from error

    def _read_steps(self, payload: bytes) -> None:
        room = MAX_GAME_BYTES - len(self._steps)
        self._steps += self._inflate.decompress(payload, room)
        if self._inflate.unconsumed_tail:
            raise ValueError(f"its steps have more than {MAX_GAME_BYTES >> 20} MiB")

    def _read_end(self, end: dict[str, Any]) -> None:
        winner = end["winner"]
        if winner is not None and winner not in range(self._spec.num_players):
            raise ValueError(f"its winner is {shorten_value(winner)}")
        self.winner, self.is_complete = winner, True

    def unpack(self) -> tuple[NDArray[np.int32], dict[str, NDArray[np.float16]] | None]:
        """The actions int32 [T, P, *action_shape], and the values [T, P, ...] by name."""
        spec = self._spec
        try:
            step = _step_type(spec, self._shapes)
        except ValueError as error:
            raise _damaged(self._path, f"its values have the shapes {self._shapes}") from error
        if len(self._steps) % step.itemsize:
            raise _damaged(self._path, "its last step is not whole")
        steps = np.frombuffer(self._steps, step)
        actions = steps["actions"].astype(np.int32)
        if (actions >= spec.num_actions).any():
            raise _damaged(self._path, f"an action is {actions.max()} of {spec.num_actions}")
        values = {name: steps["values"][name].copy() for name in self._shapes}
        return actions, values or None


def _step_type(spec: GameSpec, shapes: Mapping[str, tuple[int, ...]]) -> np.dtype[Any]:
    """One step as it is packed."""
    values = np.dtype([(name, "<f2", shape) for name, shape in shapes.items()])
    shape = (spec.num_players, *spec.action_shape)
    return np.dtype([("actions", _action_dtype(spec), shape), ("values", values)])


def _action_dtype(spec: GameSpec) -> np.dtype[Any]:
    return np.min_scalar_type(spec.num_actions - 1).newbyteorder("<")


def _checksum(kind: bytes, payload: bytes) -> int:
    return zlib.crc32(payload, zlib.crc32(_CHECKED.pack(kind, len(payload))))


def _describe(error: Exception) -> str:
    return f"{type(error).__name__}: {error}"


def _damaged(path: str | os.PathLike[str], problem: str) -> ReplayError:
    return ReplayError(f"{path} is a damaged replay, {problem}: restore it from a copy")
