"""Read map files, plain text and JSON of the Tiled editor, to tile kinds and spawns."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.deep_rts import tables as t
from marl_cair.stored import MAP, DamagedFileError, read_json, read_text

LEGEND = ".,^#~TGSO"  # one character per tile kind, in the order of TILE_NAMES
COMMENT = ";"
MAX_TILED_SIDE = 1024  # of a file that is read at all; the limits of a game are checked later

_EMPTY, _SPAWN = 255, 254  # beside the tile kinds, while a map is read
_FLIP_FLAGS = 0xF000_0000  # Tiled keeps mirrored and turned tiles in the top bits of an id
_KIND_OF_NAME = {name: kind for kind, name in enumerate(t.TILE_NAMES)} | {"spawn": _SPAWN}
# Ids within the tileset that the maps of the original game were drawn with.
_ORIGINAL_IDS = (
    (range(16, 17), _SPAWN),
    (range(17, 88), t.WALL),
    (range(88, 102), t.GOLD_TILE),
    (range(102, 142), t.LUMBER_TILE),
    (range(142, 180), t.STONE_TILE),
    (range(180, 206), t.DESERT),
    (range(238, 270), t.GRASS),
    (range(300, 334), t.WATER),
    (range(334, 356), t.DESERT),
    (range(356, 372), t.GRASS),
    (range(372, 373), t.LAVA),
)
_UNREADABLE = (KeyError, TypeError, ValueError, AttributeError, ArithmeticError)

Spawns = list[tuple[int, int]]  # (row, column) by seat


class MapError(ValueError):
    """A map that cannot be played or read; the message names the map, the place and the fix."""


def read_text_rows(path: str | os.PathLike[str]) -> tuple[NDArray[np.uint8], Spawns, list[int]]:
    """Return the tile kinds [H, W], the spawns by seat and the line, from 1, of each row.

    Rows are of LEGEND's characters; the digits 1..8 are spawns on grass, `;` begins a comment line.
    Raises MapError with the file, the line and the column, OSError where it cannot be read.
    """
    try:
        text = read_text(path, MAP)
    except DamagedFileError as error:
        raise MapError(f"map {error}") from error
    numbered = enumerate(text.rstrip().splitlines(), 1)
    lines = [(number, line) for number, line in numbered if not line.startswith(COMMENT)]
    width = len(lines[0][1]) if lines else 0
    tiles = np.full((len(lines), width), t.GRASS, np.uint8)
    spawn_of: dict[int, tuple[int, int]] = {}
    for row, (number, line) in enumerate(lines):
        place = f"map {path}: line {number}"
        if len(line) != width:
            raise MapError(f"{place} has {len(line)} characters, the first row {width}")
        for column, character in enumerate(line):
            if character in LEGEND:
                tiles[row, column] = LEGEND.index(character)
            elif character not in "12345678":
                raise MapError(
                    f"{place}, column {column + 1} holds {character!r}, allowed are '{LEGEND}' and "
                    f"the spawns 1..{t.MAX_PLAYERS}"
                )
            elif int(character) in spawn_of:
                raise MapError(
                    f"{place}, column {column + 1} is a second spawn of seat {character}"
                )
            else:
                spawn_of[int(character)] = (row, column)
    seats = sorted(spawn_of)
    if seats != [*range(1, len(seats) + 1)]:
        raise MapError(f"map {path}: it has spawns {seats}: number them from 1 without a gap")
    return tiles, [spawn_of[seat] for seat in seats], [number for number, _ in lines]


def read_tiled_layers(path: str | os.PathLike[str]) -> tuple[NDArray[np.uint8], Spawns]:
    """Return the tile kinds [H, W] and the spawns by seat of a Tiled JSON map.

    A later tile layer covers an earlier one where it is not empty. Spawns are tiles named `spawn`,
    by rows, or objects of type `spawn`, in the order of their property `seat` (from 1) or else of
    the file; the ground under a spawn becomes grass where it can be walked on.
    Raises MapError with the file and the layer, OSError where the file cannot be read.
    """
    name = str(path)
    board = _read_board(path)
    kind_of_gid = _read_tilesets(name, board)
    rows, columns = board["height"], board["width"]
    tiles = np.full((rows, columns), _EMPTY, dtype=np.uint8)
    objects: list[tuple[Any, int, int]] = []
    layers = board["layers"]
    for layer in layers if isinstance(layers, list) else []:
        if not isinstance(layer, dict):
            continue
        title = f"map {name}: layer {str(layer.get('name', ''))!r}"
        if layer.get("type") == "tilelayer":
            kinds = _read_tile_layer(title, layer, (rows, columns), kind_of_gid)
            tiles = np.where(kinds == _EMPTY, tiles, kinds)
        elif layer.get("type") == "objectgroup":
            objects += _read_objects(title, layer, board, (rows, columns))
        elif layer.get("type") == "group":
            raise MapError(f"{title} is a group: ungroup it in Tiled, then save")
    empty = np.argwhere(tiles == _EMPTY)
    if len(empty):
        row, column = empty[0].tolist()
        raise MapError(
            f"map {name}: no tile layer fills row {row}, column {column} (from 0): fill it in Tiled"
        )
    return tiles, _place_spawns(name, tiles, objects)


def _read_board(path: str | os.PathLike[str]) -> dict[str, Any]:
    try:
        board = read_json(path, MAP)
    except DamagedFileError as error:
        raise MapError(f"map {error}") from error
    if not isinstance(board, dict) or "layers" not in board:
        raise MapError(f"map {path}: no Tiled map, it has no 'layers': export it as JSON map file")
    if (orientation := board.get("orientation", "orthogonal")) != "orthogonal":
        raise MapError(
            f"map {path}: its orientation is {orientation!r}: choose 'orthogonal' in Map > Map "
            "Properties"
        )
    if board.get("infinite"):
        raise MapError(f"map {path}: it is infinite: untick Infinite in Map > Map Properties")
    for side in ("height", "width"):
        value: Any = board.get(side)
        if not (_is_whole(value) and 1 <= value <= MAX_TILED_SIDE):
            raise MapError(
                f"map {path}: its {side} is {value!r}, it must be a whole number in "
                f"1..{MAX_TILED_SIDE}: resize it in Map > Resize Map"
            )
    return board


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _read_tilesets(name: str, board: Mapping[str, Any]) -> Callable[[int], int | None]:
    """A function from a tile's id, without flip flags, to its kind, or None where it is unknown."""
    tilesets: list[tuple[int, dict[int, int]]] = []
    try:
        for tileset in board.get("tilesets", ()):
            entries = tileset.get("tiles", ())
            named = {int(entry["id"]): _kind_of_tile(entry) for entry in entries}
            known = {number: kind for number, kind in named.items() if kind is not None}
            tilesets.append((int(tileset["firstgid"]), known))
    except _UNREADABLE as error:
        raise MapError(
            f"map {name}: a tileset cannot be read ({error!r}): embed it in Tiled, save it again"
        ) from error
    tilesets.sort(key=lambda pair: pair[0])

    def kind_of_gid(gid: int) -> int | None:
        first, known = next((pair for pair in reversed(tilesets) if pair[0] <= gid), (1, {}))
        if known:
            return known.get(gid - first)
        return next((kind for ids, kind in _ORIGINAL_IDS if gid - first in ids), None)

    return kind_of_gid


def _kind_of_tile(entry: Mapping[str, Any]) -> int | None:
    """The kind of a tile of an embedded tileset by type, class or property; None: none."""
    words = [entry.get("type"), entry.get("class")]
    words += [_property(entry, key) for key in ("type", "class", "name")]
    kinds = [_KIND_OF_NAME.get(word.strip().lower()) for word in words if isinstance(word, str)]
    return next((kind for kind in kinds if kind is not None), None)


def _property(entry: Mapping[str, Any], name: str) -> Any:
    properties = entry.get("properties") or ()
    return next((item["value"] for item in properties if item["name"] == name), None)


def _read_tile_layer(
    title: str,
    layer: Mapping[str, Any],
    shape: tuple[int, int],
    kind_of_gid: Callable[[int], int | None],
) -> NDArray[np.uint8]:
    data = layer.get("data")
    if layer.get("encoding", "csv") != "csv" or layer.get("compression") or isinstance(data, str):
        raise MapError(
            f"{title} is encoded or compressed: choose CSV as Tile Layer Format in Map > Map "
            "Properties"
        )
    rows, columns = shape
    if not isinstance(data, list) or len(data) != rows * columns:
        found = f"{len(data)} tiles" if isinstance(data, list) else "no list of tiles"
        raise MapError(f"{title} has {found}, a map of {rows}x{columns} needs {rows * columns}")
    kinds = np.full(rows * columns, _EMPTY, dtype=np.uint8)
    kind_of: dict[Any, int | None] = {0: _EMPTY}
    for cell, raw in enumerate(data):
        is_id = _is_whole(raw) and raw >= 0
        gid = raw & ~_FLIP_FLAGS if is_id else raw
        kind = kind_of.setdefault(gid, kind_of_gid(gid)) if is_id else None
        if kind is None:
            row, column = divmod(cell, columns)
            raise MapError(
                f"{title} has the unknown tile {gid!r} at row {row}, column {column} (from "
                "0): use the original's tileset, or an embedded one whose tiles have one of "
                f"the classes {', '.join(_KIND_OF_NAME)}"
            )
        kinds[cell] = kind
    return kinds.reshape(rows, columns)


def _read_objects(
    title: str, layer: Mapping[str, Any], board: Mapping[str, Any], shape: tuple[int, int]
) -> list[tuple[Any, int, int]]:
    """The objects of type `spawn` as (seat or None, row, column)."""
    spawns = []
    try:
        for item in layer.get("objects", ()):
            if "spawn" not in (item.get("type"), item.get("class")):
                continue
            # The origin of a tile object is its bottom edge, of all others the top.
            y = item["y"] - (1 if "gid" in item else 0)
            row, column = int(y // board["tileheight"]), int(item["x"] // board["tilewidth"])
            spawns.append((_property(item, "seat"), row, column))
    except _UNREADABLE as error:
        raise MapError(f"{title} has an object that cannot be read ({error!r})") from error
    for _, row, column in spawns:
        if not (0 <= row < shape[0] and 0 <= column < shape[1]):
            raise MapError(f"{title} has a spawn at row {row}, column {column}, outside the map")
    return spawns


def _place_spawns(
    name: str, tiles: NDArray[np.uint8], objects: list[tuple[Any, int, int]]
) -> Spawns:
    """The spawns; `tiles` gets grass under them."""
    spawns = [(int(row), int(column)) for row, column in np.argwhere(tiles == _SPAWN)]
    tiles[tiles == _SPAWN] = t.GRASS
    if spawns and objects:
        raise MapError(f"map {name}: it has spawns as tiles and as objects: keep one kind")
    seats = [seat for seat, _, _ in objects if seat is not None]
    if seats:
        if not all(map(_is_whole, seats)) or sorted(seats) != [*range(1, len(objects) + 1)]:
            raise MapError(
                f"map {name}: the property 'seat' of its spawns holds {seats}, it must number "
                f"all of them from 1 to {len(objects)}, or none"
            )
        objects = sorted(objects, key=lambda spawn: spawn[0])
    spawns = spawns or [(row, column) for _, row, column in objects]
    for spawn in spawns:
        if tiles[spawn] in t.WALKABLE_TILES:
            tiles[spawn] = t.GRASS
    return spawns
