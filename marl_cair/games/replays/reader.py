"""Reads replay files; nothing in them is run."""

from __future__ import annotations

import json
import os
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.files import shorten_value
from marl_cair.games.checks.scenario import restore_fields
from marl_cair.games.game import NO_WINNER, GameSpec
from marl_cair.games.registry import GAMES
from marl_cair.games.replays import layout
from marl_cair.games.replays.replay import Replay, ReplayError
from marl_cair.lookup import UnknownNameError, find_by_name
from marl_cair.memory import NotEnoughMemoryError, require_memory
from marl_cair.stored import REPLAY, open_stored

MAX_GAME_BYTES = 512 << 20  # of all steps of one game, and of those in one record


def read_replay(path: str | os.PathLike[str]) -> Replay:
    """Read a recorded game. Nothing in the file is run. `FILE#2` is game 2, from 0, of a file with
    several.

    Raises:
        ReplayError: no replay, a damaged one, of another version of the rules (both are named),
            or a game that is not installed.
        ValueError: a file of several games without a number, a number that it does not have, or a
            scenario that cannot be read, as one whose map file is missing.
        OSError: the file cannot be opened.
    """
    return _read_games(*split_number(path))[0]


def split_number(path: str | os.PathLike[str]) -> tuple[str, int | None]:
    """The file of `FILE#2` and the number of its game; None where the path ends without one."""
    name = os.fspath(path)
    file, mark, number = name.rpartition("#")
    if not mark or not number.isdecimal() or Path(name).exists():
        return name, None
    return file, int(number)


def read_replays(path: str | os.PathLike[str]) -> list[Replay]:
    """Read all games of a file. Raises as `read_replay`."""
    return _read_games(path, slice(None))


def count_games(path: str | os.PathLike[str]) -> int:
    """How many games a replay holds, by its head alone. Raises ReplayError for no replay."""
    with open_stored(path, REPLAY) as file:
        return len(_read_head(path, file.readline())["games"])


def is_whole(path: str | os.PathLike[str]) -> bool:
    """Whether all games of a replay have their ends, by its records alone: the game need not be
    installed.

    Raises ReplayError for no replay, or a damaged one.
    """
    head, body = _read_parts(path)
    try:
        records = list(layout.list_records(body))
        ends = [layout.ENDED.unpack(load) for kind, load in records if kind == layout.END]
        counts = [
            layout.COUNTED.unpack_from(load)[0] for kind, load in records if kind == layout.STEPS
        ]
    except (ValueError, struct.error) as error:
        raise _damaged(path, _describe(error)) from error
    ended = {game for game, steps, _ in ends if steps <= max(counts, default=0)}
    return ended == set(range(len(head["games"])))


def _read_games(path: str | os.PathLike[str], chosen: int | slice | None) -> list[Replay]:
    """The chosen games; None: the only one."""
    head, body = _read_parts(path)
    num_games = len(head["games"])
    if chosen is None:
        if num_games > 1:
            raise ValueError(f"{path} holds {num_games} games: name one, {path}#0 is the first")
        chosen = 0
    if isinstance(chosen, int):
        if chosen >= num_games:
            raise ValueError(f"{path} has no game {chosen}, only 0..{num_games - 1}")
        chosen = slice(chosen, chosen + 1)
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
    for one in head["games"]:
        if len(one["players"]) != spec.num_players:
            raise _damaged(path, f"it names {len(one['players'])} players, not {spec.num_players}")
    records = _Records(os.fspath(path), spec, num_games, chosen)
    try:
        for kind, payload in layout.list_records(body):
            records.read(kind, payload)
        records.check_ends()
        played = records.unpack()
    except NotEnoughMemoryError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, zlib.error, struct.error) as error:
        raise _damaged(path, _describe(error)) from error
    return [
        Replay(
            game.name,
            scenario,
            game.version,
            one["map_seed"],
            tuple(one["players"]),
            actions,
            records.winners.get(number),
            number in records.winners,
            values,
            records.hashes[number],
            one["extra"],
        )
        for (number, one), (actions, values) in zip(
            list(enumerate(head["games"]))[chosen], played, strict=True
        )
    ]


def _read_parts(path: str | os.PathLike[str]) -> tuple[dict[str, Any], bytes]:
    """The head, and the records."""
    with open_stored(path, REPLAY) as file:
        return _read_head(path, file.readline()), file.read()


def _read_head(path: str | os.PathLike[str], line: bytes) -> dict[str, Any]:
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
        if not line.endswith(b"\n"):
            raise ValueError("it ends within its first line")
        _check_types(head, game=str, rules_version=str, scenario=dict, games=list)
        if not head["games"]:
            raise ValueError("it has no games")
        for one in head["games"]:
            _check_types(one, map_seed=int, players=list, extra=dict)
            if not 0 <= one["map_seed"] < 1 << 64:
                raise ValueError("map_seed is wrong")
            one["players"] = [str(name) for name in one["players"]]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise ReplayError(
            f"{path} is no replay of marl_cair ({_describe(error)}): give a file that --record, or "
            "`marl-cair league replay`, has written"
        ) from error
    return head


def _check_types(entries: dict[str, Any], **kinds: type) -> None:
    for name, kind in kinds.items():
        if not isinstance(entries[name], kind):
            raise TypeError(f"{name} is {shorten_value(entries[name])}")


class _Records:
    """What the records of a file hold, so far; the steps of the chosen games alone."""

    def __init__(self, name: str, spec: GameSpec, num_games: int, chosen: slice) -> None:
        self._name, self._spec, self._num_games, self._chosen = name, spec, num_games, chosen
        self._inflate = zlib.decompressobj()
        self._step = layout.step_type(spec, {})
        self._steps: list[NDArray[Any]] = []  # [games, steps]
        self._num_steps = 0
        self._num_bytes = 0  # as they are unpacked
        self._lengths: dict[int, int] = {}
        self.hashes: list[dict[int, bytes]] = [{} for _ in range(num_games)]
        self.winners: dict[int, int | None] = {}  # of the games that have ended

    def read(self, kind: bytes, payload: bytes) -> None:
        """Read one record. Raises ValueError and others, for what no writer writes."""
        if kind == layout.STEPS:
            self._read_steps(payload)
        elif kind == layout.VALUES and not self._steps:
            shapes = json.loads(payload).items()
            self._step = layout.step_type(
                self._spec, {str(name): tuple(int(one) for one in shape) for name, shape in shapes}
            )
        elif kind == layout.HASH:
            game, step, digest = layout.HASHED.unpack(payload)
            self.hashes[self._check_game(game)][step] = digest
        elif kind == layout.END:
            self._read_end(*layout.ENDED.unpack(payload))
        else:
            raise ValueError(f"it has a record of the kind {kind!r}")

    def _read_steps(self, payload: bytes) -> None:
        raw = self._inflate.decompress(payload[layout.COUNTED.size :], MAX_GAME_BYTES + 1)
        most = MAX_GAME_BYTES // self._step.itemsize
        if len(raw) > MAX_GAME_BYTES or self._num_steps > most:
            raise ValueError(f"a game has more than {MAX_GAME_BYTES >> 20} MiB of steps")
        if len(raw) % (self._num_games * self._step.itemsize):
            raise ValueError("its last step is not whole")
        steps = np.frombuffer(raw, self._step).reshape(self._num_games, -1)
        self._steps.append(steps[self._chosen].copy())
        self._num_steps += steps.shape[1]
        actions = self._step["actions"].base
        self._num_bytes += self._steps[-1].nbytes * (actions.itemsize + 4) // actions.itemsize
        if self._num_bytes > MAX_GAME_BYTES:
            require_memory(f"the games of {self._name}", self._num_bytes)
        if self._num_steps != layout.COUNTED.unpack_from(payload)[0]:
            raise ValueError(f"it has {self._num_steps} steps in place of those that it counts")

    def _read_end(self, game: int, steps: int, winner: int) -> None:
        self._check_game(game)
        if winner not in range(NO_WINNER, self._spec.num_players):
            raise ValueError(f"its winner is {winner}")
        if steps not in self.hashes[game]:
            raise ValueError(f"game {game} ends after {steps} steps without a hash of the state")
        self.winners[game] = None if winner == NO_WINNER else winner
        self._lengths[game] = steps

    def _check_game(self, game: int) -> int:
        if game not in range(self._num_games) or game in self.winners:
            raise ValueError(f"a record is of game {game}")
        return game

    def check_ends(self) -> None:
        """Forget ends and hashes of steps that the file does not hold any more."""
        for game, steps in list(self._lengths.items()):
            if steps > self._num_steps:
                del self._lengths[game], self.winners[game]
        for hashes in self.hashes:
            for step in [one for one in hashes if one > self._num_steps]:
                del hashes[step]

    def unpack(self) -> list[tuple[NDArray[np.int32], dict[str, NDArray[np.float16]] | None]]:
        """Of each chosen game, the actions int32 [T, P, *action_shape], and the values
        [T, P, ...] by name.
        """
        numbers = range(self._num_games)[self._chosen]
        empty = np.zeros((len(numbers), 0), self._step)
        steps = np.concatenate([empty, *self._steps], 1)
        played = []
        for number, row in zip(numbers, steps, strict=True):
            own = row[: self._lengths.get(number, len(row))]
            actions = own["actions"].astype(np.int32)
            if (actions >= self._spec.num_actions).any():
                raise ValueError(f"an action is {actions.max()} of {self._spec.num_actions}")
            names = self._step["values"].names or ()
            played.append((actions, {name: own["values"][name].copy() for name in names} or None))
        return played


def _describe(error: Exception) -> str:
    return f"{error}" if type(error) is ValueError else f"{type(error).__name__}: {error}"


def _damaged(path: str | os.PathLike[str], problem: str) -> ReplayError:
    return ReplayError(f"{path} is a damaged replay, {problem}: restore it from a copy")
