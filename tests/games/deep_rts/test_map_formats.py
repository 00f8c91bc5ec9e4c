"""Map files: text and Tiled read to the same maps, and errors say where the file is wrong."""

import json
import re

import numpy as np
import pytest

from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.maps.formats import LEGEND, MAX_TILED_SIDE, MapError
from marl_cair.games.deep_rts.maps.generator import generate_map
from marl_cair.games.deep_rts.maps.maps import BUILT_IN_MAPS, load_map, read_map, write_text_map
from marl_cair.lookup import UnknownNameError
from tests.games.deep_rts.boards import PLAIN, plain_board


def write(tmp_path, text, name="plain.txt"):
    path = tmp_path / name
    path.write_bytes(text.encode())
    return path


def refused(path, message):
    with pytest.raises(MapError, match=re.escape(f"map {path}{message}")):
        read_map(path)


# --- text files --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*BUILT_IN_MAPS, "generated-20x33-5p-3"])
def test_a_written_map_reads_back_the_same(name, tmp_path):
    game_map = load_map(name) if name in BUILT_IN_MAPS else generate_map(20, 33, 5, 3)
    path = tmp_path / f"{name}.txt"
    write_text_map(game_map, path)
    again = read_map(path)
    assert np.array_equal(again.tiles, game_map.tiles)
    assert (again.name, again.spawns, again.frames) == (name, game_map.spawns, game_map.frames)
    assert path.read_text(encoding="utf-8").startswith(f"; {name}\n")


def test_each_character_is_a_tile_and_comments_and_blank_lines_at_the_end_are_skipped(tmp_path):
    text = PLAIN.replace("........G", LEGEND)
    game_map = read_map(write(tmp_path, f";a comment\r\n{text}; the end\n\n\n"))
    assert game_map.name == "plain"
    assert game_map.tiles.shape == (8, 9)
    assert game_map.spawns == ((1, 1), (6, 7))
    assert game_map.tiles[0].tolist() == [*range(9)]


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (".1.......", ".1......", ": line 3 has 8 characters, the first row 9"),
        (".1.......\n", "\n", ": line 3 has 0 characters, the first row 9"),
        (".1.......", ".1....x..", ": line 3, column 7 holds 'x', allowed are '.,^#~TGSO'"),
        (".1.......", ".1....9..", ": line 3, column 7 holds '9', allowed are"),
        (".1.......", ".1....2..", ": line 8, column 8 is a second spawn of seat 2"),
        (".1.......", ".3.......", ": it has spawns [2, 3]: number them from 1"),
        (".1.......", "1........", ": the spawn of seat 1 at line 3, column 1 is at the edge"),
        ("........G", "#.......G", ": the spawn of seat 1 at line 3, column 2 has no room"),
        (PLAIN, "; nothing\n", ": it has 0 rows and 0 columns, allowed are 8..128 each"),
    ],
)
def test_errors_in_text_maps_name_file_line_and_column(old, new, message, tmp_path):
    refused(write(tmp_path, PLAIN.replace(old, new)), message)


def test_files_of_another_encoding_or_suffix_and_missing_ones_are_refused(tmp_path):
    latin = tmp_path / "latin.txt"
    latin.write_bytes("; M\xfchle\n".encode("latin-1"))
    refused(latin, " is no UTF-8 text (")
    refused(tmp_path / "map.png", ": unknown format '.png'")
    with pytest.raises(FileNotFoundError):
        read_map(tmp_path / "none.txt")
    with pytest.raises(UnknownNameError, match="'15x15-2p-crosing': nearest are '15x15-2p-cross"):
        load_map("15x15-2p-crosing")


# --- Tiled files -------------------------------------------------------------------------------

GRASS_GID, GOLD_GID, SPAWN_GID = 239, 89, 17  # of the original's tileset


def tiled_board(**changes):
    """The plain map as Tiled writes it, with the ids of the original."""
    tiles, spawns = plain_board()
    gids = np.where(tiles == t.GOLD_TILE, GOLD_GID, GRASS_GID)
    for spawn in spawns:
        gids[spawn] = SPAWN_GID
    layer = {"type": "tilelayer", "name": "ground", "data": gids.ravel().tolist()}
    board = {"orientation": "orthogonal", "infinite": False, "layers": [layer]}
    board |= {"width": 9, "height": 8, "tilewidth": 32, "tileheight": 16}
    return board | {"tilesets": [{"firstgid": 1, "source": "tiles.tsx"}]} | changes


def read_tiled(tmp_path, board, name="board.json"):
    return read_map(write(tmp_path, json.dumps(board), name))


@pytest.mark.parametrize("suffix", [".json", ".tmj"])
def test_a_tiled_map_with_the_original_ids_reads_as_the_text(suffix, tmp_path):
    board, (tiles, spawns) = tiled_board(), plain_board()
    # Mirrored and turned tiles have flags in the top bits of their ids.
    data = board["layers"][0]["data"]
    board["layers"][0]["data"] = [gid | (cell % 16) << 28 for cell, gid in enumerate(data)]
    game_map = read_tiled(tmp_path, board, f"board{suffix}")
    assert np.array_equal(game_map.tiles, tiles)
    assert game_map.spawns == tuple(spawns)
    assert game_map.name == "board"


def test_the_original_ids_are_the_tiles_of_the_original(tmp_path):
    board = tiled_board()
    ids = [17, 87, 88, 101, 102, 141, 142, 179, 180, 205, 238, 269, 300, 333, 334, 355, 356, 371]
    board["layers"][0]["data"][27:46] = [number + 1 for number in [*ids, 372]]
    kinds = [t.WALL, t.GOLD_TILE, t.LUMBER_TILE, t.STONE_TILE, t.DESERT, t.GRASS, t.WATER]
    expected = [*np.repeat([*kinds, t.DESERT, t.GRASS], 2), t.LAVA]
    assert read_tiled(tmp_path, board).tiles.ravel()[27:46].tolist() == expected


@pytest.mark.parametrize("place", ["type", "class", "properties"])
def test_tiles_of_an_embedded_tileset_have_their_kind(place, tmp_path):
    names = [*t.TILE_NAMES, "Spawn"]
    entries = [{"id": number, place: name} for number, name in enumerate(names)]
    if place == "properties":
        for entry in entries:
            entry[place] = [{"name": "type", "type": "string", "value": entry[place]}]
    board = tiled_board(tilesets=[{"firstgid": 1000, "tiles": entries}, {"firstgid": 1}])
    layer = board["layers"][0]
    number_of = {GRASS_GID: 1000, GOLD_GID: 1000 + t.GOLD_TILE, SPAWN_GID: 1000 + len(t.TILE_NAMES)}
    layer["data"] = [number_of[gid] for gid in layer["data"]]
    layer["data"][40] = 1000 + t.OIL_TILE
    game_map = read_tiled(tmp_path, board)
    assert game_map.tiles.ravel()[40] == t.OIL_TILE
    assert game_map.spawns == ((1, 1), (6, 7))


def test_a_later_layer_covers_an_earlier_one_where_it_is_filled(tmp_path):
    board = tiled_board()
    over = [0] * 72
    over[40] = GOLD_GID
    board["layers"].append({"type": "tilelayer", "name": "over", "data": over})
    board["layers"].append({"type": "imagelayer", "name": "picture"})
    tiles, _ = plain_board()
    tiles.ravel()[40] = t.GOLD_TILE
    assert np.array_equal(read_tiled(tmp_path, board).tiles, tiles)


def spawn_objects(seats=(None, None), x=(40, 240), y=(20, 100)):
    return [
        {"type": "spawn", "x": left, "y": top}
        | ({} if seat is None else {"properties": [{"name": "seat", "value": seat}]})
        for seat, left, top in zip(seats, x, y, strict=True)
    ]


def board_with_objects(objects):
    board = tiled_board()
    data = board["layers"][0]["data"]
    board["layers"][0]["data"] = [GRASS_GID if gid == SPAWN_GID else gid for gid in data]
    board["layers"].append({"type": "objectgroup", "name": "seats", "objects": objects})
    return board


@pytest.mark.parametrize(
    ("seats", "spawns"), [((None, None), ((1, 1), (6, 7))), ((2, 1), ((6, 7), (1, 1)))]
)
def test_objects_are_spawns_by_their_seat_or_in_order(seats, spawns, tmp_path):
    objects = [*spawn_objects(seats), {"type": "note", "x": 0, "y": 0}]
    assert read_tiled(tmp_path, board_with_objects(objects)).spawns == spawns


def test_a_tile_object_is_placed_by_its_bottom_edge_and_grass_grows_under_it(tmp_path):
    objects = spawn_objects(x=(32, 224), y=(32, 112))
    board = board_with_objects([item | {"gid": 17} for item in objects])
    board["layers"][0]["data"][10] = 373
    game_map = read_tiled(tmp_path, board)
    assert game_map.spawns == ((1, 1), (6, 7))
    assert game_map.tiles[1, 1] == t.GRASS


def with_layer(**changes):
    board = tiled_board()
    board["layers"][0] |= changes
    return board


def with_both_spawns():
    layer = {"type": "objectgroup", "name": "seats", "objects": spawn_objects()}
    return tiled_board(layers=[*tiled_board()["layers"], layer])


ENCODED = "layer 'ground' is encoded or compressed: choose CSV"
UNKNOWN = "layer 'ground' has the unknown tile"
SEATS = "the property 'seat' of its spawns holds"


@pytest.mark.parametrize(
    ("board", "message"),
    [
        (tiled_board(orientation="isometric"), "its orientation is 'isometric': choose 'orthogo"),
        (tiled_board(infinite=True), "it is infinite: untick Infinite in Map > Map Properties"),
        (tiled_board(width=0), f"its width is 0, it must be a whole number in 1..{MAX_TILED_SIDE}"),
        (tiled_board(height=8.0), "its height is 8.0, it must be a whole number"),
        (tiled_board(tilesets=[{}]), "a tileset cannot be read (KeyError('firstgid')): embed"),
        (tiled_board(tilesets=3), "a tileset cannot be read (TypeError("),
        (tiled_board(layers=[]), "no tile layer fills row 0, column 0 (from 0): fill it in Tiled"),
        (tiled_board(layers=[{"type": "group", "name": "all"}]), "layer 'all' is a group: ungroup"),
        (with_layer(encoding="base64", data="AAAA"), ENCODED),
        (with_layer(compression="zlib"), ENCODED),
        (with_layer(data="1,2"), ENCODED),
        (with_layer(data=None), "layer 'ground' has no list of tiles, a map of 8x9 needs 72"),
        (with_layer(data=[1] * 71), "layer 'ground' has 71 tiles, a map of 8x9 needs 72"),
        (with_layer(data=[239] * 10 + [207] * 62), f"{UNKNOWN} 207 at row 1, column 1 (from 0): u"),
        (with_layer(data=["a"] * 72), f"{UNKNOWN} 'a' at row 0, column 0"),
        (with_layer(data=[-1] * 72), f"{UNKNOWN} -1 at row 0, column 0"),
        (
            board_with_objects([{"type": "spawn", "x": 1}]),
            "layer 'seats' has an object that cannot",
        ),
        (
            board_with_objects(spawn_objects(x=(40, 300))),
            "layer 'seats' has a spawn at row 6, colum",
        ),
        (board_with_objects(spawn_objects((1, 3))), f"{SEATS} [1, 3], it must number all of them"),
        (board_with_objects(spawn_objects((1, None))), f"{SEATS} [1], it must number"),
        (board_with_objects(spawn_objects((1, "2"))), f"{SEATS} [1, '2'], it must number"),
        (board_with_objects([]), "it has 0 spawns, allowed are 1..8"),
        (with_both_spawns(), "it has spawns as tiles and as objects: keep one"),
        (
            with_layer(data=[SPAWN_GID, *[GRASS_GID] * 71]),
            "the spawn of seat 1 at 0, 0 (from 0) is",
        ),
    ],
)
def test_tiled_maps_with_an_error_are_refused(board, message, tmp_path):
    refused(write(tmp_path, json.dumps(board), "board.json"), f": {message}")


@pytest.mark.parametrize(
    ("text", "message"), [("{", " is no JSON ("), ("[]", ": no Tiled map, it has no 'layers'")]
)
def test_json_that_is_no_tiled_map_is_refused(text, message, tmp_path):
    refused(write(tmp_path, text, "bad.json"), message)
