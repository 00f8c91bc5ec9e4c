"""Maps: tiles and spawns, how each seat looks at them, and the files that they come from."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from marl_cair.files import write_atomically
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.maps import formats
from marl_cair.games.deep_rts.maps.formats import MapError
from marl_cair.lookup import find_by_name

MIN_SIDE, MAX_SIDE = 8, 128
MIN_SPAWN_DISTANCE = 4  # in tiles, the longer of both sides: two 3x3 halls with a way between them

MIRROR_COLUMNS, MIRROR_ROWS, SWAP = 1, 2, 4  # the bits of a frame
# Turns before mirrors: on a map that has both, the seats' frames then form a group.
_FRAMES_BY_PREFERENCE = (0, 3, 5, 6, 1, 2, 4, 7)

BUILT_IN_MAPS = {
    path.stem: path for path in sorted((Path(__file__).parent / "files").glob("*.txt"))
}


@dataclass(frozen=True, eq=False)
class GameMap:
    """The ground that a game starts on; `make_map` and the readers make checked ones."""

    name: str
    tiles: NDArray[np.uint8]  # [H, W] kinds of tables.TILE_NAMES, read-only
    spawns: tuple[tuple[int, int], ...]  # (row, column) of each seat
    frames: tuple[int, ...]  # how each seat looks at the board, see `seat_frames`


# --- the eight ways to look at a board -----------------------------------------------------------


def to_own(frame: int, row: int, column: int, rows: int, columns: int) -> tuple[int, int]:
    """Transform a cell of a world of `rows` x `columns` to the view of `frame`.

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


def seat_frames(tiles: NDArray[np.uint8], spawns: Sequence[tuple[int, int]]) -> tuple[int, ...]:
    """The frame of each seat, in which its base lies where seat 0's does.

    Seat 0 mirrors its base into the top left quadrant. A seat that a symmetry of the map takes to
    seat 0 sees the very board that seat 0 sees, or, where a symmetry of the tiles alone does, the
    same ground; others mirror their base into the same quadrant.
    """
    rows, columns = tiles.shape
    moved = {
        frame: [to_own(frame, *spawn, rows, columns) for spawn in spawns]
        for frame in _FRAMES_BY_PREFERENCE
        if np.array_equal(transform_tiles(tiles, frame), tiles)
    }
    whole = [frame for frame, places in moved.items() if set(places) == set(spawns)]
    mirrors = [
        (MIRROR_ROWS if 2 * row > rows - 1 else 0)
        | (MIRROR_COLUMNS if 2 * column > columns - 1 else 0)
        for row, column in spawns
    ]
    frames = []
    for seat, mirror in enumerate(mirrors):
        to_first = [frame for frame in (*whole, *moved) if moved[frame][seat] == spawns[0]]
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
    free[1:-1, 1:-1] = np.isin(tiles, t.WALKABLE_TILES)
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


# --- checks --------------------------------------------------------------------------------------


def make_map(
    name: str,
    tiles: NDArray[np.uint8],
    spawns: Sequence[tuple[int, int]],
    file: str | None = None,
    lines: Sequence[int] | None = None,
) -> GameMap:
    """Return a checked map with its seats' frames; `tiles`, uint8 [H, W], is copied.

    Raises MapError where no game can be played on it. The message calls the map `file` where that
    is given, and a row by its number in `lines`.
    """
    title = f"map {file or name}"
    rows, columns = tiles.shape
    if not (MIN_SIDE <= rows <= MAX_SIDE and MIN_SIDE <= columns <= MAX_SIDE):
        raise MapError(
            f"{title}: it has {rows} rows and {columns} columns, allowed are "
            f"{MIN_SIDE}..{MAX_SIDE} each: crop or extend it"
        )
    if not 1 <= len(spawns) <= t.MAX_PLAYERS:
        raise MapError(f"{title}: it has {len(spawns)} spawns, allowed are 1..{t.MAX_PLAYERS}")
    places = [
        f"{title}: the spawn of seat {seat} at "
        + (f"line {lines[row]}, column {column + 1}" if lines else f"{row}, {column} (from 0)")
        for seat, (row, column) in enumerate(spawns, 1)
    ]
    for seat, spawn in enumerate(spawns):
        _check_spawn(tiles, spawns[:seat], spawn, places[seat])
    distances = walking_distances(tiles, *spawns[0])
    for place, spawn in zip(places, spawns, strict=True):
        if distances[spawn] < 0:
            raise MapError(
                f"{place} cannot be reached from that of seat 1: open a way of grass, desert or "
                "lava (a diagonal step needs both tiles beside it free)"
            )
    resources = np.array(t.TILE_RESOURCE)[tiles] != t.NO_RESOURCE
    near = np.pad(distances >= 0, 1)
    near = near[:-2] | near[1:-1] | near[2:]
    if not (resources & (near[:, :-2] | near[:, 1:-1] | near[:, 2:])).any():
        raise MapError(
            f"{title}: no resource can be reached from the spawn of seat 1: put gold, lumber, "
            "stone or oil beside ground that it can walk to"
        )
    own_tiles = tiles.copy()
    own_tiles.flags.writeable = False
    own_spawns = tuple((int(row), int(column)) for row, column in spawns)
    return GameMap(name, own_tiles, own_spawns, seat_frames(own_tiles, own_spawns))


def _check_spawn(
    tiles: NDArray[np.uint8],
    others: Sequence[tuple[int, int]],
    spawn: tuple[int, int],
    place: str,
) -> None:
    (row, column), (rows, columns) = spawn, tiles.shape
    if not (1 <= row < rows - 1 and 1 <= column < columns - 1):
        raise MapError(f"{place} is at the edge or outside: move it at least one tile inside")
    if tiles[spawn] != t.GRASS:
        raise MapError(f"{place} lies on {t.TILE_NAMES[tiles[spawn]]}: move it to grass")
    if not np.isin(tiles[row - 1 : row + 2, column - 1 : column + 2], t.WALKABLE_TILES).all():
        raise MapError(
            f"{place} has no room for a town hall: the eight tiles around it must be grass, "
            "desert or lava"
        )
    for other, (other_row, other_column) in enumerate(others, 1):
        distance = max(abs(row - other_row), abs(column - other_column))
        if distance < MIN_SPAWN_DISTANCE:
            raise MapError(
                f"{place} is {distance} tiles from the one of seat {other}: move them at least "
                f"{MIN_SPAWN_DISTANCE} apart"
            )


# --- files and mixtures --------------------------------------------------------------------------


def load_map(name: str) -> GameMap:
    """Read a built-in map by its name; raises UnknownNameError with the nearest names."""
    return read_map(find_by_name("deep_rts map", name, BUILT_IN_MAPS))


def read_map(path: str | os.PathLike[str]) -> GameMap:
    """Read a map by its suffix: .txt as text, .json and .tmj as Tiled; its name is the file's.

    Raises MapError for a file that is no map or that no game can be played on, OSError where the
    file cannot be read.
    """
    place, lines = Path(path), None
    if place.suffix.lower() == ".txt":
        tiles, spawns, lines = formats.read_text_rows(path)
    elif place.suffix.lower() in (".json", ".tmj"):
        tiles, spawns = formats.read_tiled_layers(path)
    else:
        raise MapError(
            f"map {path}: unknown format {place.suffix!r}: name text maps .txt and Tiled maps "
            ".json or .tmj"
        )
    return make_map(place.stem, tiles, spawns, file=str(path), lines=lines)


def write_text_map(game_map: GameMap, path: str | os.PathLike[str]) -> None:
    """Write a map as text, whole or not at all; `read_map` reads it from a file `*.txt`."""
    rows = [[formats.LEGEND[kind] for kind in row] for row in game_map.tiles]
    for seat, (row, column) in enumerate(game_map.spawns):
        rows[row][column] = str(seat + 1)
    lines = [f"{formats.COMMENT} {game_map.name}", *("".join(row) for row in rows)]
    write_atomically(path, "\n".join(lines) + "\n")


def pad_maps(maps: Sequence[GameMap]) -> tuple[GameMap, ...]:
    """The maps on boards of one size, the largest rows and columns among them: smaller ones stand
    in the middle of walls. Raises MapError where one cannot stand in the very middle, which keeps
    its symmetries.
    """
    rows = max(game_map.tiles.shape[0] for game_map in maps)
    columns = max(game_map.tiles.shape[1] for game_map in maps)
    padded = []
    for game_map in maps:
        height, width = game_map.tiles.shape
        above, left = (rows - height) // 2, (columns - width) // 2
        if (height + 2 * above, width + 2 * left) != (rows, columns):
            raise MapError(
                f"deep_rts: the map {game_map.name} has {height}x{width} cells, it cannot stand in "
                f"the middle of {rows}x{columns}; mix sizes that are all odd or all even"
            )
        margins = ((above, above), (left, left))
        tiles = np.pad(game_map.tiles, margins, constant_values=t.WALL)
        spawns = [(row + above, column + left) for row, column in game_map.spawns]
        padded.append(make_map(game_map.name, tiles, spawns))
    return tuple(padded)
