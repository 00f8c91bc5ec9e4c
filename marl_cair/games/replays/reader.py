"""Reads replay files; nothing in them is run."""

from __future__ import annotations

import json
import os
import struct
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.files import shorten_value
from marl_cair.games.checks.scenario import restore_fields
from marl_cair.games.game import GameSpec
from marl_cair.games.registry import GAMES
from marl_cair.games.replays import layout
from marl_cair.games.replays.replay import Replay, ReplayError
from marl_cair.lookup import UnknownNameError, find_by_name
from marl_cair.stored import REPLAY, open_stored

MAX_GAME_BYTES = 512 << 20  # of all steps of one game, as they are held when a file is read


def read_replay(path: str | os.PathLike[str]) -> Replay:
    """Read a recorded game. Nothing in the file is run.

    Raises:
        ReplayError: no replay, a damaged one, of another version of the rules (both are named),
            or a game that is not installed.
        ValueError: a scenario that cannot be read, as one whose map file is missing.
        OSError: the file cannot be opened.
    """
    head, body = _read_parts(path)
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
    records = _Records(spec)
    try:
        for kind, payload in layout.list_records(body):
            records.read(kind, payload)
        actions, values = records.unpack()
    except (ValueError, KeyError, TypeError, AttributeError, zlib.error, struct.error) as error:
        raise _damaged(path, _describe(error)) from error
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


def is_whole(path: str | os.PathLike[str]) -> bool:
    """Whether a replay has its end, by its records alone: the game need not be installed.

    Raises ReplayError for no replay, or a damaged one.
    """
    _, body = _read_parts(path)
    try:
        kinds = [kind for kind, _ in layout.list_records(body)]
    except ValueError as error:
        raise _damaged(path, _describe(error)) from error
    return layout.END in kinds


def _read_parts(path: str | os.PathLike[str]) -> tuple[dict[str, Any], bytes]:
    """The head, and the records."""
    with open_stored(path, REPLAY) as file:
        line, mark, body = file.read().partition(b"\n")
    return _read_head(path, line, mark), body


def _read_head(path: str | os.PathLike[str], line: bytes, mark: bytes) -> dict[str, Any]:
    """The head as plain data, each entry of its type."""
    try:
        head: dict[str, Any] = json.loads(line)
        if head["format"] != layout.FORMAT:
            raise ValueError(f"its format is {shorten_value(head['format'])}")
        if head["format_version"] != layout.FORMAT_VERSION:
            raise ValueError(
                f"its format has version {shorten_value(head['format_version'])}, this program "
                f"reads {layout.FORMAT_VERSION}"
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


class _Records:
    """What the records of a file hold, so far."""

    def __init__(self, spec: GameSpec) -> None:
        self._spec = spec
        self._inflate, self._steps = zlib.decompressobj(wbits=layout.WINDOW_BITS), bytearray()
        self._shapes: dict[str, tuple[int, ...]] = {}
        self.hashes: dict[int, bytes] = {}
        self.winner: int | None = None
        self.is_complete = False

    def read(self, kind: bytes, payload: bytes) -> None:
        """Read one record. Raises ValueError and others, for what no writer writes."""
        if self.is_complete:
            raise ValueError("there are records after its end")
        if kind == layout.STEPS:
            self._read_steps(payload)
        elif kind == layout.VALUES and not self._steps:
            self._shapes = {
                str(name): tuple(int(size) for size in shape)
                for name, shape in json.loads(payload).items()
            }
        elif kind == layout.HASH:
            step, digest = layout.HASHED.unpack(payload)
            self.hashes[step] = digest
        elif kind == layout.END:
            self._read_end(json.loads(payload))
        else:
            raise ValueError(f"it has a record of the kind {kind!r}")

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
        step = layout.step_type(spec, self._shapes)
        if len(self._steps) % step.itemsize:
            raise ValueError("its last step is not whole")
        steps = np.frombuffer(self._steps, step)
        actions = steps["actions"].astype(np.int32)
        if (actions >= spec.num_actions).any():
            raise ValueError(f"an action is {actions.max()} of {spec.num_actions}")
        values = {name: steps["values"][name].copy() for name in self._shapes}
        return actions, values or None


def _describe(error: Exception) -> str:
    return f"{error}" if type(error) is ValueError else f"{type(error).__name__}: {error}"


def _damaged(path: str | os.PathLike[str], problem: str) -> ReplayError:
    return ReplayError(f"{path} is a damaged replay, {problem}: restore it from a copy")
