"""Maps: the eight views of a board, the built-in ones, mixtures, and boards that are refused."""

import re

import numpy as np
import pytest

from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.maps import maps
from marl_cair.games.deep_rts.maps.formats import MapError
from marl_cair.games.deep_rts.scenarios import Scenario
from tests.games.deep_rts import boards

SMALL, LARGE = "15x15-2p-crossing", "21x21-2p-fords"
TURNED = [(2, 3), (3, 9), (9, 8), (8, 2)]  # each a quarter turn from the one before


# --- views -------------------------------------------------------------------------------------


@pytest.mark.parametrize("frame", range(8))
def test_a_view_shows_each_cell_where_to_own_says(frame):
    tiles = np.arange(15, dtype=np.uint8).reshape(3, 5)
    own = maps.transform_tiles(tiles, frame)
    assert own.shape == ((5, 3) if frame & maps.SWAP else (3, 5))
    for cell in np.ndindex(3, 5):
        there = maps.to_own(frame, *cell, 3, 5)
        assert own[there] == tiles[cell]


def test_composed_frames_show_what_one_after_the_other_shows():
    tiles = np.arange(16, dtype=np.uint8).reshape(4, 4)
    assert len({maps.transform_tiles(tiles, frame).tobytes() for frame in range(8)}) == 8
    for first, second in np.ndindex(8, 8):
        expected = maps.transform_tiles(maps.transform_tiles(tiles, first), second)
        both = maps.compose_frames(first, second)
        assert np.array_equal(maps.transform_tiles(tiles, both), expected)


def test_seats_of_an_unsymmetric_map_mirror_their_base_to_the_top_left():
    tiles = np.zeros((9, 12), dtype=np.uint8)
    for spawn, frame in (((2, 2), 0), ((2, 9), 1), ((6, 2), 2), ((6, 9), 3), ((4, 2), 0)):
        assert maps.seat_frames(tiles, [spawn]) == (frame,)
    tiles, _ = boards.plain_board()
    tiles[0, 0] = t.WALL
    assert maps.seat_frames(tiles, [(1, 1), (6, 7), (1, 7)]) == (0, 3, 1)


@pytest.mark.parametrize("first", range(4))
@pytest.mark.parametrize("num_seats", [3, 4])
def test_seats_of_a_turned_map_take_turned_frames_even_where_a_base_is_free(first, num_seats):
    spawns = tuple((TURNED[first:] + TURNED[:first])[:num_seats])
    tiles = np.zeros((12, 12), dtype=np.uint8)
    tiles[0, 1] = tiles[1, 11] = tiles[11, 10] = tiles[10, 0] = t.GOLD_TILE
    game_map = maps.make_map("turned", tiles, spawns)
    assert len(set(boards.own_spawns(game_map))) == len(boards.views(game_map)) == 1
    assert len(set(game_map.frames)) == num_seats


# --- the built-in maps -------------------------------------------------------------------------


def test_there_is_a_map_of_each_size_and_number_of_players():
    sizes = {name.rsplit("-", 1)[0] for name in maps.BUILT_IN_MAPS}
    assert sizes >= {"10x10-2p", "15x15-1p", "15x15-2p", "21x21-1p", "21x21-2p", "30x30-4p"}
    assert sizes >= {"31x31-2p", "31x31-4p", "31x31-6p", "lava-maze"}


@pytest.mark.parametrize("name", maps.BUILT_IN_MAPS)
def test_built_in_maps_are_fair_and_have_their_size_in_their_name(name):
    """Two and four seats share one view of the map; six at least walk as far for all they need."""
    game_map = maps.load_map(name)
    players, (rows, columns) = len(game_map.spawns), game_map.tiles.shape
    is_maze = name == f"lava-maze-{rows}"
    assert is_maze or name.startswith(f"{rows}x{columns}-{players}p-")
    assert game_map.name == name
    assert not game_map.tiles.flags.writeable
    (walks,) = {boards.resource_distances(game_map.tiles, *spawn) for spawn in game_map.spawns}
    if players in (2, 4):
        assert len(boards.views(game_map)) == 1
    if players == 6:
        assert [frame for frame, _ in boards.symmetries(game_map)] == [0, 1, 2, 3]
    if is_maze:
        safe = np.where(game_map.tiles == t.LAVA, t.WALL, game_map.tiles).astype(np.uint8)
        assert boards.resource_distances(safe, *game_map.spawns[0])[0] > 2 * walks[0] > 0
        return
    assert all(0 < steps <= (8 if players > 1 else 15) for steps in walks)
    room = 3 if min(rows, columns) > 10 else 1
    for row, column in game_map.spawns:
        block = game_map.tiles[row - room : row + room + 1, column - room : column + room + 1]
        assert block.shape == (2 * room + 1, 2 * room + 1)
        assert np.isin(block, t.WALKABLE_TILES).all()


# --- walking -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("text", "steps"),
    [  # not across the corners of blocked tiles; over lava, not over water
        (".#.. ..#. .... ....", [[0, -1, 7, 6], [1, 2, -1, 5], [2, 2, 3, 4], [3, 3, 3, 4]]),
        ("..^. ~~^~ ....", [[0, 1, 2, 3], [-1, -1, 3, -1], [6, 5, 4, 5]]),
    ],
)
def test_walking_distances(text, steps):
    tiles, _ = boards.board_of(text)
    assert maps.walking_distances(tiles, 0, 0).tolist() == steps


# --- checks ------------------------------------------------------------------------------------


def test_a_plain_board_is_a_map_of_its_own():
    tiles, spawns = boards.plain_board()
    game_map = maps.make_map("plain", tiles, spawns)
    assert (game_map.spawns, game_map.frames) == (((1, 1), (6, 7)), (0, 3))
    tiles[0, 0] = t.WALL
    assert game_map.tiles[0, 0] == t.GRASS


def refused(message, tiles=None, spawns=None, **changes):
    plain_tiles, plain_spawns = boards.plain_board()
    tiles = plain_tiles if tiles is None else tiles
    with pytest.raises(MapError, match=re.escape(message)):
        maps.make_map("odd", tiles, plain_spawns if spawns is None else spawns, **changes)


@pytest.mark.parametrize("shape", [(7, 9), (9, 129)])
def test_boards_of_a_size_that_is_not_allowed_are_refused(shape):
    message = f"map odd: it has {shape[0]} rows and {shape[1]} columns, allowed are 8..128"
    refused(message, np.zeros(shape, np.uint8), [(1, 1)])


@pytest.mark.parametrize(
    ("spawns", "message"),
    [
        ([], "it has 0 spawns, allowed are 1..8"),
        ([(1, 1)] * 9, "it has 9 spawns, allowed are 1..8"),
        ([(0, 1)], "seat 1 at 0, 1 (from 0) is at the edge"),
        ([(7, 1)], "seat 1 at 7, 1 (from 0) is at the edge"),
        ([(1, 1), (6, 9)], "seat 2 at 6, 9 (from 0) is at the edge or outside"),
        ([(1, 1), (4, 3)], "4, 3 (from 0) is 3 tiles from the one of seat 1: move them at least 4"),
        ([(1, 7)], "seat 1 at 1, 7 (from 0) has no room for a town hall"),
    ],
)
def test_spawns_in_bad_places_are_refused(spawns, message):
    refused(message, spawns=spawns)


@pytest.mark.parametrize("kind", set(range(t.NUM_TILE_KINDS)) - {t.GRASS})
def test_a_spawn_off_the_grass_is_refused(kind):
    tiles, _ = boards.plain_board()
    tiles[1, 1] = kind
    refused(f"seat 1 at 1, 1 (from 0) lies on {t.TILE_NAMES[kind]}", tiles)


def test_spawns_that_no_way_connects_are_refused():
    tiles, spawns = boards.plain_board()
    tiles[4] = t.WATER
    refused("map odd: the spawn of seat 2 at 6, 7 (from 0) cannot be reached", tiles)
    tiles[4, 0] = t.LAVA
    maps.make_map("odd", tiles, spawns)
    tiles, _ = boards.plain_board()
    tiles[3, :5] = tiles[4, 5:] = t.WALL  # open across two corners only
    maps.make_map("odd", tiles, spawns[:1])
    refused("seat 2 at 6, 7 (from 0) cannot be reached", tiles)


def test_a_map_without_a_resource_in_reach_is_refused():
    tiles, spawns = boards.plain_board()
    tiles[0, 8] = tiles[7, 0] = t.GRASS
    tiles[4, 4] = t.GOLD_TILE
    maps.make_map("odd", tiles, spawns)
    tiles[3:6, 3:6] = t.WALL
    tiles[4, 4] = t.GOLD_TILE
    refused("map odd: no resource can be reached from the spawn of seat 1", tiles)


# --- mixtures ----------------------------------------------------------------------------------


def test_a_smaller_map_stands_in_the_middle_of_walls():
    small, large = maps.load_map(SMALL), maps.load_map(LARGE)
    padded, kept = maps.pad_maps([small, large])
    assert np.array_equal(kept.tiles, large.tiles)
    around = np.pad(small.tiles, 3, constant_values=t.WALL)
    np.testing.assert_array_equal(padded.tiles, around)
    assert padded.spawns == tuple((row + 3, column + 3) for row, column in small.spawns)
    assert padded.frames == small.frames


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (f"{SMALL}+generated-30x30-2p-1", "15x15-2p-crossing has 15x15 .* middle of 30x30"),
        (f"{LARGE}+15x15-1p-embers", "15x15-1p-embers has 1 spawns"),
    ],
)
def test_mixtures_that_cannot_be_played_are_refused(names, message):
    with pytest.raises(ValueError, match=message):
        Scenario(map=names).maps  # noqa: B018  # reading it loads them
