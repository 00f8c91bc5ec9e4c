"""Maps: tiles and spawns, how each seat looks at them, and the files that they come from."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from marl_cair.files import write_atomically
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.maps.formats import (
    COMMENT,
    LEGEND,
    MAX_PLAYERS,
    MapError,
    read_text_rows,
    read_tiled_layers,
)
from marl_cair.lookup import find_by_name

__all__ = [
    "BUILT_IN_MAPS",
    "MAX_PLAYERS",
    "GameMap",
    "MapError",
    "check_map",
    "compose_frames",
    "from_own",
    "load_map",
    "make_map",
    "read_map",
    "read_text_map",
    "read_tiled_map",
    "resource_distances",
    "seat_frames",
    "symmetries",
    "to_own",
    "transform_tiles",
    "walking_distances",
    "write_text_map",
]

MIN_SIDE, MAX_SIDE = 8, 128
MIN_SPAWN_DISTANCE = 4  # in tiles, the longer of both sides: two 3x3 halls with a way between them

NUM_FRAMES = 8
MIRROR_COLUMNS, MIRROR_ROWS, SWAP = 1, 2, 4  # the bits of a frame
# Turns before mirrors: on a map that has both, the seats' frames then form a group.
_FRAMES_BY_PREFERENCE = (0, 3, 5, 6, 1, 2, 4, 7)

BUILT_IN_MAPS = {
    path.stem: path for path in sorted((Path(__file__).parent / "files").glob("*.txt"))
}

_IS_WALKABLE = np.isin(np.arange(256), t.WALKABLE_TILES)
_RESOURCE = np.full(256, t.NO_RESOURCE, dtype=np.int8)
_RESOURCE[: t.NUM_TILE_KINDS] = t.TILE_RESOURCE


@dataclass(frozen=True, eq=False)
class GameMap:
    """The ground that a game starts on; `make_map` and the readers make checked ones."""

    name: str
    tiles: NDArray[np.uint8]  # [H, W] kinds of tables.TILE_NAMES, read-only
    spawns: tuple[tuple[int, int], ...]  # (row, column) of each seat
    frames: tuple[int, ...]  # how each seat looks at the board, see `seat_frames`

    @property
    def num_players(self) -> int:
        """Seats, 1..8."""
        return len(self.spawns)


# --- the eight ways to look at a board -----------------------------------------------------------


def to_own(frame: int, row: int, column: int, rows: int, columns: int) -> tuple[int, int]:
    """Where a cell of a world of `rows` x `columns` lies in the view of `frame`.

    A frame swaps rows and columns (bit 2), then mirrors rows (bit 1) and columns (bit 0). A view
    with a swap has `columns` rows, so that all seats share one shape only on square maps.
    """
    if frame & SWAP:
        row, column, rows, columns = column, row, columns, rows
    if frame & MIRROR_ROWS:
        row = rows - 1 - row
    if frame & MIRROR_COLUMNS:
        column = columns - 1 - column
    return row, column


def from_own(frame: int, row: int, column: int, rows: int, columns: int) -> tuple[int, int]:
    """Where a cell of the view of `frame` lies in its world of `rows` x `columns`."""
    if frame & SWAP:
        rows, columns = columns, rows
    if frame & MIRROR_ROWS:
        row = rows - 1 - row
    if frame & MIRROR_COLUMNS:
        column = columns - 1 - column
    return (column, row) if frame & SWAP else (row, column)


def transform_tiles(tiles: NDArray[np.uint8], frame: int) -> NDArray[np.uint8]:
    """The board [H, W] as `frame` shows it: a view of the same memory, [W, H] after a swap."""
    own = tiles.T if frame & SWAP else tiles
    row_step = -1 if frame & MIRROR_ROWS else 1
    column_step = -1 if frame & MIRROR_COLUMNS else 1
    return own[::row_step, ::column_step]


def compose_frames(first: int, second: int) -> int:
    """The frame that does `first` and then `second`."""
    mirrors = first & (MIRROR_ROWS | MIRROR_COLUMNS)
    if second & SWAP:
        mirrors = (mirrors & 1) << 1 | mirrors >> 1
    return mirrors ^ (first & SWAP) ^ second


def symmetries(game_map: GameMap) -> tuple[tuple[int, tuple[int, ...]], ...]:
    """All (frame, seats) that leave the map as it is: `seats[k]` starts where seat k is moved to.

    The first is always the identity; frames with a swap occur on square maps only.
    """
    seat_at = {spawn: seat for seat, spawn in enumerate(game_map.spawns)}
    found = []
    for frame in _find_invariant_frames(game_map.tiles):
        moved = _move_spawns(frame, game_map.spawns, game_map.tiles.shape)
        if seat_at.keys() == set(moved):
            found.append((frame, tuple(seat_at[spawn] for spawn in moved)))
    return tuple(sorted(found))


def _find_invariant_frames(tiles: NDArray[np.uint8]) -> list[int]:
    return [
        frame
        for frame in _FRAMES_BY_PREFERENCE
        if np.array_equal(transform_tiles(tiles, frame), tiles)
    ]


def _move_spawns(
    frame: int, spawns: Sequence[tuple[int, int]], shape: tuple[int, ...]
) -> list[tuple[int, int]]:
    return [to_own(frame, row, column, shape[0], shape[1]) for row, column in spawns]


def seat_frames(tiles: NDArray[np.uint8], spawns: Sequence[tuple[int, int]]) -> tuple[int, ...]:
    """The frame of each seat, in which its base lies where seat 0's does.

    Seat 0 mirrors its base into the top left quadrant. A seat that a symmetry of the map takes to
    seat 0 sees the very board that seat 0 sees, or, where a symmetry of the tiles alone does, the
    same ground; others mirror their base into the same quadrant.
    """
    rows, columns = tiles.shape
    by_frame = {
        frame: _move_spawns(frame, spawns, tiles.shape) for frame in _find_invariant_frames(tiles)
    }
    whole = [frame for frame, moved in by_frame.items() if set(moved) == set(spawns)]
    mirrors = [
        (MIRROR_ROWS if 2 * row > rows - 1 else 0)
        | (MIRROR_COLUMNS if 2 * column > columns - 1 else 0)
        for row, column in spawns
    ]
    frames = []
    for seat, mirror in enumerate(mirrors):
        to_first = [frame for frame in (*whole, *by_frame) if by_frame[frame][seat] == spawns[0]]
        frames.append(compose_frames(to_first[0], mirrors[0]) if to_first else mirror)
    return tuple(frames)


# --- walking ---------------------------------------------------------------------------------


def walking_distances(tiles: NDArray[np.uint8], row: int, column: int) -> NDArray[np.int32]:
    """Steps from a cell to every cell, int32 [H, W], -1 where no way leads.

    Steps go to all eight neighbours that can be walked on; a diagonal one needs both cells beside
    it free. Lava can be walked on.
    """
    rows, columns = tiles.shape
    free = np.zeros((rows + 2, columns + 2), dtype=np.bool_)
    free[1:-1, 1:-1] = _IS_WALKABLE[tiles]
    up, down, left, right = free[:-2, 1:-1], free[2:, 1:-1], free[1:-1, :-2], free[1:-1, 2:]
    corners = (up & left, up & right, down & left, down & right)
    distances = np.full((rows, columns), -1, dtype=np.int32)
    unseen = free[1:-1, 1:-1].copy()
    front = np.zeros_like(free)
    wave = front[1:-1, 1:-1]
    wave[row, column] = unseen[row, column]
    steps = 0
    while wave.any():
        distances[wave] = steps
        unseen &= ~wave
        spread = front[:-2, 1:-1] | front[2:, 1:-1] | front[1:-1, :-2] | front[1:-1, 2:]
        spread |= front[:-2, :-2] & corners[0]
        spread |= front[:-2, 2:] & corners[1]
        spread |= front[2:, :-2] & corners[2]
        spread |= front[2:, 2:] & corners[3]
        wave[:] = spread & unseen
        steps += 1
    return distances


def resource_distances(tiles: NDArray[np.uint8], row: int, column: int) -> tuple[int, ...]:
    """Steps from a cell to the nearest cell beside a tile of each of RESOURCE_NAMES; -1: no way."""
    distances = walking_distances(tiles, row, column)
    nearest = []
    for resource in range(t.NUM_RESOURCES):
        reached = distances[_is_beside(_RESOURCE[tiles] == resource) & (distances >= 0)]
        nearest.append(int(reached.min()) if reached.size else -1)
    return tuple(nearest)


def _is_beside(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The cells of a mask [H, W] and all their eight neighbours."""
    padded = np.pad(mask, 1)
    tall = padded[:-2] | padded[1:-1] | padded[2:]
    return tall[:, :-2] | tall[:, 1:-1] | tall[:, 2:]


# --- what a map must be ----------------------------------------------------------------------


def make_map(
    name: str,
    tiles: NDArray[np.uint8],
    spawns: Sequence[tuple[int, int]],
    file: str | None = None,
    place: Callable[[int, int], str] | None = None,
) -> GameMap:
    """Return a checked map with its seats' frames; `tiles` is copied.

    Raises MapError as `check_map` does, which calls the map `file` where that is given.
    """
    check_map(tiles, spawns, file or name, place=place)
    own_tiles = tiles.copy()
    own_tiles.flags.writeable = False
    places = tuple((int(row), int(column)) for row, column in spawns)
    return GameMap(name, own_tiles, places, seat_frames(own_tiles, places))


def check_map(
    tiles: NDArray[np.uint8],
    spawns: Sequence[tuple[int, int]],
    name: str,
    min_players: int = 1,
    place: Callable[[int, int], str] | None = None,
) -> None:
    """Raise MapError unless a game can be played on `tiles`, uint8 [H, W], from `spawns`.

    name: the map or its file, for the message; place: how the message calls a (row, column), by
    default both counted from 0.
    """
    if tiles.ndim != 2 or tiles.dtype != np.uint8:
        raise MapError(
            f"map {name}: its tiles are {tiles.dtype} of shape {tiles.shape}, they must be uint8 "
            "in rows of one length"
        )
    rows, columns = tiles.shape
    if not (MIN_SIDE <= rows <= MAX_SIDE and MIN_SIDE <= columns <= MAX_SIDE):
        raise MapError(
            f"map {name}: it has {rows} rows and {columns} columns, allowed are "
            f"{MIN_SIDE}..{MAX_SIDE} each: crop or extend it"
        )
    place = place or _describe_place
    unknown = np.argwhere(tiles >= t.NUM_TILE_KINDS)
    if len(unknown):
        row, column = unknown[0].tolist()
        raise MapError(
            f"map {name}: {place(row, column)} holds tile {tiles[row, column]}, known "
            f"are 0..{t.NUM_TILE_KINDS - 1}: {', '.join(t.TILE_NAMES)}"
        )
    _check_spawns(tiles, spawns, name, min_players, place)
    _check_ways(tiles, spawns, name, place)


def _describe_place(row: int, column: int) -> str:
    return f"row {row}, column {column} (from 0)"


def _check_spawns(
    tiles: NDArray[np.uint8],
    spawns: Sequence[tuple[int, int]],
    name: str,
    min_players: int,
    place: Callable[[int, int], str],
) -> None:
    if not min_players <= len(spawns) <= MAX_PLAYERS or not spawns:
        raise MapError(
            f"map {name}: it has {len(spawns)} spawns, this takes {max(min_players, 1)}.."
            f"{MAX_PLAYERS}: add or remove some"
        )
    rows, columns = tiles.shape
    for seat, (row, column) in enumerate(spawns):
        if not (1 <= row < rows - 1 and 1 <= column < columns - 1):
            raise MapError(
                f"map {name}: the spawn of seat {seat + 1} at {place(row, column)} is at "
                "the edge or outside: move it at least one tile inside"
            )
        title = f"map {name}: the spawn of seat {seat + 1} at {place(row, column)}"
        if tiles[row, column] != t.GRASS:
            raise MapError(
                f"{title} lies on {t.TILE_NAMES[tiles[row, column]]}: put it on grass, or turn "
                "that tile into grass"
            )
        if not _IS_WALKABLE[tiles[row - 1 : row + 2, column - 1 : column + 2]].all():
            raise MapError(
                f"{title} has no room for a town hall: clear the eight tiles around it of all "
                "but grass, desert and lava"
            )
        for other, (other_row, other_column) in enumerate(spawns[:seat]):
            distance = max(abs(row - other_row), abs(column - other_column))
            if distance < MIN_SPAWN_DISTANCE:
                raise MapError(
                    f"{title} is {distance} tiles from the one of seat {other + 1}: move them at "
                    f"least {MIN_SPAWN_DISTANCE} apart"
                )


def _check_ways(
    tiles: NDArray[np.uint8],
    spawns: Sequence[tuple[int, int]],
    name: str,
    place: Callable[[int, int], str],
) -> None:
    reached = walking_distances(tiles, *spawns[0]) >= 0
    for seat, (row, column) in enumerate(spawns):
        if not reached[row, column]:
            raise MapError(
                f"map {name}: no way leads from the spawn of seat 1 to that of seat {seat + 1} at "
                f"{place(row, column)}: open one of grass, desert or lava (a diagonal "
                "step needs both tiles beside it free)"
            )
    if not (_is_beside(reached) & (_RESOURCE[tiles] != t.NO_RESOURCE)).any():
        raise MapError(
            f"map {name}: no resource can be reached from the spawn of seat 1: put gold, lumber, "
            "stone or oil beside ground that it can walk to"
        )


# --- files -------------------------------------------------------------------------------------


def load_map(name: str) -> GameMap:
    """Read a built-in map by its name; raises UnknownNameError with the nearest names."""
    return read_map(find_by_name("deep_rts map", name, BUILT_IN_MAPS))


def read_map(path: str | os.PathLike[str]) -> GameMap:
    """Read a map by its suffix: .txt as text, .json and .tmj as Tiled.

    Raises MapError for what is no map that can be played, OSError where the file cannot be read.
    """
    readers = {".txt": read_text_map, ".json": read_tiled_map, ".tmj": read_tiled_map}
    suffix = Path(path).suffix.lower()
    if suffix not in readers:
        raise MapError(
            f"map {path}: the suffix {suffix!r} is no known format: name text maps .txt and Tiled "
            "maps .json or .tmj"
        )
    return readers[suffix](path)


def read_tiled_map(path: str | os.PathLike[str]) -> GameMap:
    """Read a map of the Tiled editor, see `read_tiled_layers`; its name is that of the file."""
    tiles, spawns = read_tiled_layers(path)
    return make_map(Path(path).stem, tiles, spawns, file=str(path))


def read_text_map(path: str | os.PathLike[str]) -> GameMap:
    """Read a map of rows of characters, see `read_text_rows`; its name is that of the file."""
    tiles, spawns, lines = read_text_rows(path)

    def place(row: int, column: int) -> str:
        return f"line {lines[row]}, column {column + 1}"

    return make_map(Path(path).stem, tiles, spawns, file=str(path), place=place)


def write_text_map(game_map: GameMap, path: str | os.PathLike[str]) -> None:
    """Write a map as `read_text_map` reads it, whole or not at all."""
    rows = [[LEGEND[kind] for kind in row] for row in game_map.tiles]
    for seat, (row, column) in enumerate(game_map.spawns):
        rows[row][column] = str(seat + 1)
    lines = [f"{COMMENT} {game_map.name}", *("".join(row) for row in rows)]
    write_atomically(path, "\n".join(lines) + "\n")
