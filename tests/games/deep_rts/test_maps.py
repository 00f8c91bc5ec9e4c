"""Maps: the eight views of a board, the built-in ones, and what a map must be."""

import re

import numpy as np
import pytest

from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.maps.maps import (
    BUILT_IN_MAPS,
    NUM_FRAMES,
    SWAP,
    MapError,
    check_map,
    compose_frames,
    from_own,
    load_map,
    make_map,
    resource_distances,
    seat_frames,
    symmetries,
    to_own,
    transform_tiles,
    walking_distances,
)
from tests.games.deep_rts.boards import board_of, plain_board

MAZES = ("lava-maze-15", "lava-maze-31")


# --- views -------------------------------------------------------------------------------------


@pytest.mark.parametrize("frame", range(NUM_FRAMES))
def test_a_view_and_back_is_the_same_cell(frame):
    rows, columns = 3, 5
    cells = {(row, column) for row in range(rows) for column in range(columns)}
    views = {to_own(frame, *cell, rows, columns) for cell in cells}
    shape = (columns, rows) if frame & SWAP else (rows, columns)
    assert views == {(row, column) for row in range(shape[0]) for column in range(shape[1])}
    for cell in cells:
        assert from_own(frame, *to_own(frame, *cell, rows, columns), rows, columns) == cell


@pytest.mark.parametrize("frame", range(NUM_FRAMES))
def test_a_view_shows_each_cell_where_to_own_says(frame):
    tiles = np.arange(15, dtype=np.uint8).reshape(3, 5)
    own = transform_tiles(tiles, frame)
    for row in range(3):
        for column in range(5):
            assert own[to_own(frame, row, column, 3, 5)] == tiles[row, column]


def test_composed_frames_show_what_one_after_the_other_shows():
    tiles = np.arange(16, dtype=np.uint8).reshape(4, 4)
    for first in range(NUM_FRAMES):
        for second in range(NUM_FRAMES):
            expected = transform_tiles(transform_tiles(tiles, first), second)
            assert np.array_equal(transform_tiles(tiles, compose_frames(first, second)), expected)


def test_the_eight_frames_are_eight_views():
    tiles = np.arange(16, dtype=np.uint8).reshape(4, 4)
    assert len({transform_tiles(tiles, frame).tobytes() for frame in range(NUM_FRAMES)}) == 8


def test_the_first_seat_looks_from_the_top_left():
    tiles = np.zeros((9, 12), dtype=np.uint8)
    for spawn, frame in (((2, 2), 0), ((2, 9), 1), ((6, 2), 2), ((6, 9), 3), ((4, 2), 0)):
        assert seat_frames(tiles, [spawn]) == (frame,)


def test_seats_of_an_unsymmetric_map_mirror_their_base_to_the_top_left():
    tiles, _ = plain_board()
    tiles[0, 0] = t.WALL
    assert seat_frames(tiles, [(1, 1), (6, 7), (1, 7)]) == (0, 3, 1)


@pytest.mark.parametrize("first", [(2, 3), (3, 9), (9, 8), (8, 2)])
def test_seats_of_a_turned_map_take_turned_frames(first):
    spawns = [(2, 3), (3, 9), (9, 8), (8, 2)]  # each a quarter turn from the one before
    spawns = spawns[spawns.index(first) :] + spawns[: spawns.index(first)]
    tiles = np.zeros((12, 12), dtype=np.uint8)
    for row, column in spawns:
        tiles[column, 11 - row] = t.GRASS
    tiles[0, 1] = tiles[1, 11] = tiles[11, 10] = tiles[10, 0] = t.GOLD_TILE
    frames = seat_frames(tiles, spawns)
    own = {to_own(frame, *spawn, 12, 12) for frame, spawn in zip(frames, spawns, strict=True)}
    views = {transform_tiles(tiles, frame).tobytes() for frame in frames}
    assert len(own) == len(views) == 1
    assert len(set(frames)) == 4


def test_ground_that_is_symmetric_turns_the_view_even_where_a_base_is_free():
    spawns = [(2, 3), (3, 9), (9, 8)]
    tiles = np.zeros((12, 12), dtype=np.uint8)
    tiles[0, 1] = tiles[1, 11] = tiles[11, 10] = tiles[10, 0] = t.GOLD_TILE
    frames = seat_frames(tiles, spawns)
    own = {to_own(frame, *spawn, 12, 12) for frame, spawn in zip(frames, spawns, strict=True)}
    assert own == {(2, 3)}


@pytest.mark.parametrize("name", BUILT_IN_MAPS)
def test_symmetries_leave_the_map_and_permute_the_seats(name):
    game_map = load_map(name)
    found = symmetries(game_map)
    assert found[0] == (0, tuple(range(game_map.num_players)))
    for frame, seats in found:
        assert np.array_equal(transform_tiles(game_map.tiles, frame), game_map.tiles)
        for seat, spawn in enumerate(game_map.spawns):
            moved = to_own(frame, *spawn, *game_map.tiles.shape)
            assert moved == game_map.spawns[seats[seat]]


# --- the built-in maps -------------------------------------------------------------------------


@pytest.mark.parametrize("name", BUILT_IN_MAPS)
def test_names_tell_size_and_players(name):
    game_map = load_map(name)
    rows, columns = game_map.tiles.shape
    if name in MAZES:
        assert name == f"lava-maze-{rows}"
    else:
        assert name.startswith(f"{rows}x{columns}-{game_map.num_players}p-")
    assert game_map.name == name
    assert not game_map.tiles.flags.writeable


def test_there_is_a_map_of_each_size_and_number_of_players():
    sizes = {name.rsplit("-", 1)[0] for name in BUILT_IN_MAPS}
    assert sizes >= {"10x10-2p", "15x15-1p", "15x15-2p", "21x21-1p", "21x21-2p", "30x30-4p"}
    assert sizes >= {"31x31-2p", "31x31-4p", "31x31-6p", "lava-maze"}


@pytest.mark.parametrize("name", BUILT_IN_MAPS)
def test_built_in_maps_are_fair(name):
    """Two and four seats share one view of the map; six at least walk as far for all they need."""
    game_map = load_map(name)
    walks = {resource_distances(game_map.tiles, *spawn) for spawn in game_map.spawns}
    assert len(walks) == 1
    if game_map.num_players in (2, 4):
        views = {transform_tiles(game_map.tiles, frame).tobytes() for frame in game_map.frames}
        assert len(views) == 1
    if game_map.num_players == 6:
        assert [frame for frame, _ in symmetries(game_map)] == [0, 1, 2, 3]


@pytest.mark.parametrize("name", [name for name in BUILT_IN_MAPS if name not in MAZES])
def test_bases_have_room_and_all_resources_near(name):
    game_map = load_map(name)
    room = 3 if min(game_map.tiles.shape) > 10 else 1
    farthest = 8 if game_map.num_players > 1 else 15
    for row, column in game_map.spawns:
        block = game_map.tiles[row - room : row + room + 1, column - room : column + room + 1]
        assert block.shape == (2 * room + 1, 2 * room + 1)
        assert np.isin(block, t.WALKABLE_TILES).all()
        walks = resource_distances(game_map.tiles, row, column)
        assert all(0 < steps <= farthest for steps in walks)


@pytest.mark.parametrize("name", MAZES)
def test_a_maze_can_be_solved_without_touching_lava(name):
    game_map = load_map(name)
    spawn = game_map.spawns[0]
    straight = resource_distances(game_map.tiles, *spawn)[0]
    safe = np.where(game_map.tiles == t.LAVA, t.WALL, game_map.tiles).astype(np.uint8)
    assert resource_distances(safe, *spawn)[0] > 2 * straight > 0


# --- walking -----------------------------------------------------------------------------------


def test_walkers_go_round_the_corners_of_blocked_tiles():
    tiles, _ = board_of(".#.. ..#. .... ....")
    assert walking_distances(tiles, 0, 0).tolist() == [
        [0, -1, 7, 6],
        [1, 2, -1, 5],
        [2, 2, 3, 4],
        [3, 3, 3, 4],
    ]


def test_lava_can_be_walked_and_water_cannot():
    tiles, _ = board_of("..^. ~~^~ ....")
    assert walking_distances(tiles, 0, 0).tolist() == [[0, 1, 2, 3], [-1, -1, 3, -1], [6, 5, 4, 5]]


def test_resource_distances_end_beside_the_tile():
    tiles, _ = board_of("....G #.... ##.S. ##..# O#..T")
    assert dict(zip(t.RESOURCE_NAMES, resource_distances(tiles, 0, 0), strict=True)) == {
        "gold": 3,
        "lumber": 5,
        "stone": 2,
        "oil": -1,
    }


# --- what a map must be ------------------------------------------------------------------------


def test_a_plain_board_is_a_map():
    tiles, spawns = plain_board()
    game_map = make_map("plain", tiles, spawns)
    assert game_map.spawns == ((1, 1), (6, 7))
    assert game_map.frames == (0, 3)
    tiles[0, 0] = t.WALL
    assert game_map.tiles[0, 0] == t.GRASS


@pytest.mark.parametrize(
    ("tiles", "message"),
    [
        (np.zeros(9, np.uint8), "its tiles are uint8 of shape (9,), they must be uint8 in rows"),
        (np.zeros((9, 9), np.int64), "its tiles are int64 of shape (9, 9), they must be uint8"),
        (np.zeros((7, 9), np.uint8), "it has 7 rows and 9 columns, allowed are 8..128 each: crop"),
        (np.zeros((9, 129), np.uint8), "it has 9 rows and 129 columns, allowed are 8..128 each"),
        (np.full((9, 9), 9, np.uint8), "row 0, column 0 (from 0) holds tile 9, known are 0..8: "),
    ],
)
def test_boards_that_are_none_are_refused(tiles, message):
    with pytest.raises(MapError, match=re.escape(f"map odd: {message}")):
        check_map(tiles, [(1, 1)], "odd")


@pytest.mark.parametrize(
    ("spawns", "message"),
    [
        ([], "it has 0 spawns, this takes 1..8: add or remove some"),
        ([(1, 1)] * 9, "it has 9 spawns, this takes 1..8"),
        ([(0, 1)], "the spawn of seat 1 at row 0, column 1 (from 0) is at the edge or outside"),
        ([(1, 1), (6, 9)], "the spawn of seat 2 at row 6, column 9 (from 0) is at the edge"),
        ([(1, 1), (4, 3)], "column 3 (from 0) is 3 tiles from the one of seat 1: move them at le"),
        ([(0 + 7, 1)], "the spawn of seat 1 at row 7, column 1 (from 0) is at the edge"),
        ([(1, 7)], "the spawn of seat 1 at row 1, column 7 (from 0) has no room for a town hall"),
    ],
)
def test_spawns_in_bad_places_are_refused(spawns, message):
    tiles, _ = plain_board()
    with pytest.raises(MapError, match=re.escape(message)):
        check_map(tiles, spawns, "odd")


def test_too_few_spawns_for_the_players_are_refused():
    tiles, spawns = plain_board()
    check_map(tiles, spawns, "plain", min_players=2)
    with pytest.raises(MapError, match=re.escape("map plain: it has 2 spawns, this takes 3..8")):
        check_map(tiles, spawns, "plain", min_players=3)


@pytest.mark.parametrize(
    "kind", [t.DESERT, t.LAVA, t.WALL, t.WATER, t.LUMBER_TILE, t.STONE_TILE, t.OIL_TILE]
)
def test_a_spawn_off_the_grass_is_refused(kind):
    tiles, spawns = plain_board()
    tiles[1, 1] = kind
    message = (
        f"the spawn of seat 1 at row 1, column 1 (from 0) lies on {t.TILE_NAMES[kind]}: put it"
    )
    with pytest.raises(MapError, match=re.escape(message)):
        check_map(tiles, spawns, "odd")


def test_spawns_that_no_way_connects_are_refused():
    tiles, spawns = plain_board()
    tiles[4] = t.WATER
    message = "map odd: no way leads from the spawn of seat 1 to that of seat 2 at row 6, column 7"
    with pytest.raises(MapError, match=re.escape(message)):
        check_map(tiles, spawns, "odd")
    tiles[4, 0] = t.LAVA
    check_map(tiles, spawns, "odd")


def test_a_way_between_two_corners_is_none():
    tiles, spawns = plain_board()
    tiles[3, :5] = tiles[4, 5:] = t.WALL
    check_map(tiles, spawns[:1], "odd")
    with pytest.raises(MapError, match="no way leads from the spawn of seat 1 to that of seat 2"):
        check_map(tiles, spawns, "odd")


def test_a_map_without_a_resource_in_reach_is_refused():
    tiles, spawns = plain_board()
    tiles[0, 8] = t.GRASS
    tiles[7, 0] = t.GRASS
    tiles[4, 4] = t.GOLD_TILE
    check_map(tiles, spawns, "odd")
    tiles[3:6, 3:6] = t.WALL
    tiles[4, 4] = t.GOLD_TILE
    with pytest.raises(MapError, match="map odd: no resource can be reached from the spawn of"):
        check_map(tiles, spawns, "odd")
