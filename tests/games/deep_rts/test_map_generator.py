"""Generated maps: the same from the same seed, connected, and fair to every seat."""

import dataclasses
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.maps import generator as map_generator
from marl_cair.games.deep_rts.maps.formats import LEGEND
from marl_cair.games.deep_rts.maps.generator import (
    MAP_SETS,
    TEST_SEEDS,
    TRAIN_SEEDS,
    MapStyle,
    generate_map,
    map_set,
)
from marl_cair.games.deep_rts.maps.maps import (
    MapError,
    check_map,
    read_map,
    resource_distances,
    symmetries,
    to_own,
    transform_tiles,
    walking_distances,
    write_text_map,
)
from marl_cair.lookup import UnknownNameError

SMALLEST = {1: 8, 2: 10, 3: 10, 4: 10, 5: 15, 6: 15, 7: 20, 8: 20}  # side of a square, by players
RICH = MapStyle(
    lumber_percent=25, wall_percent=20, water_percent=15, lava_percent=10, gold_patches=5
)
GOLDEN = """\
OSTT.....G
.....~...G
G.1..~TT.O
G....~TT.,
......T,,,
,,,T......
,.TT~....G
O.TT~..2.G
G...~.....
G.....TTSO"""


def as_text(game_map):
    rows = [[LEGEND[kind] for kind in row] for row in game_map.tiles]
    for seat, (row, column) in enumerate(game_map.spawns):
        rows[row][column] = str(seat + 1)
    return "\n".join("".join(row) for row in rows)


@st.composite
def generated(draw, counts=range(1, 9)):
    num_players = draw(st.sampled_from(counts))
    low = SMALLEST[num_players]
    sides = st.integers(low, low + 24)
    style = draw(st.sampled_from([MapStyle(), RICH]))
    seed = draw(st.integers(0, 2**63 - 1))
    return generate_map(draw(sides), draw(sides), num_players, seed, style)


@settings(max_examples=60, deadline=None)
@given(game_map=generated())
def test_every_map_can_be_played_and_its_spawns_are_connected_without_lava(game_map):
    check_map(game_map.tiles, game_map.spawns, game_map.name)
    safe = np.where(game_map.tiles == t.LAVA, t.WALL, game_map.tiles).astype(np.uint8)
    reached = walking_distances(safe, *game_map.spawns[0])
    assert all(reached[spawn] >= 0 for spawn in game_map.spawns)


@settings(max_examples=60, deadline=None)
@given(game_map=generated())
def test_every_seat_walks_equally_far_to_its_nearest_resources(game_map):
    walks = {resource_distances(game_map.tiles, *spawn) for spawn in game_map.spawns}
    assert len(walks) == 1
    assert min(walks.pop()) >= 1


@settings(max_examples=40, deadline=None)
@given(game_map=generated(counts=(2, 4)))
def test_two_and_four_seats_see_one_board(game_map):
    shape = game_map.tiles.shape
    seats = [*zip(game_map.frames, game_map.spawns, strict=True)]
    assert len({transform_tiles(game_map.tiles, frame).tobytes() for frame, _ in seats}) == 1
    assert len({to_own(frame, *spawn, *shape) for frame, spawn in seats}) == 1
    assert len(symmetries(game_map)) >= game_map.num_players
    totals = set()
    for spawn in game_map.spawns:
        distances = walking_distances(game_map.tiles, *spawn)
        totals.add(int(distances[distances >= 0].sum()))
    assert len(totals) == 1


@settings(max_examples=20, deadline=None)
@given(game_map=generated(counts=(6, 8)))
def test_six_and_eight_seats_have_a_symmetric_map(game_map):
    assert len(symmetries(game_map)) >= 2


@settings(max_examples=30, deadline=None)
@given(game_map=generated())
def test_bases_are_open_ground(game_map):
    for row, column in game_map.spawns:
        block = game_map.tiles[row - 1 : row + 2, column - 1 : column + 2]
        assert np.isin(block, t.WALKABLE_TILES).all()
        assert not (block == t.LAVA).any()


@settings(max_examples=10, deadline=None)
@given(game_map=generated())
def test_frames_show_a_base_in_the_top_left(game_map):
    rows, columns = game_map.tiles.shape
    for frame, spawn in zip(game_map.frames, game_map.spawns, strict=True):
        row, column = to_own(frame, *spawn, rows, columns)
        assert 2 * row <= rows - 1
        assert 2 * column <= columns - 1


def test_the_seed_decides_the_map():
    first, again = (generate_map(31, 31, 4, 7) for _ in range(2))
    assert np.array_equal(first.tiles, again.tiles)
    assert (first.spawns, first.frames, first.name) == (again.spawns, again.frames, again.name)
    assert first.name == "generated-31x31-4p-7"
    texts = {as_text(generate_map(15, 15, 2, seed)) for seed in range(100)}
    assert len(texts) == 100


def test_a_seed_makes_the_same_map_in_every_version():
    assert as_text(generate_map(10, 10, 2, 1)) == GOLDEN


def test_a_generated_map_reads_back_from_its_file(tmp_path):
    game_map = generate_map(20, 33, 5, 3)
    path = tmp_path / "map.txt"
    write_text_map(game_map, path)
    again = read_map(path)
    assert np.array_equal(again.tiles, game_map.tiles)
    assert (again.spawns, again.frames) == (game_map.spawns, game_map.frames)


@pytest.mark.parametrize("size", [31, 64])
def test_maps_hold_all_kinds_of_terrain_and_contested_resources(size):
    game_map = generate_map(size, size, 2, 11)
    for kind in (t.LUMBER_TILE, t.WALL, t.WATER, t.LAVA, t.GOLD_TILE, t.STONE_TILE, t.OIL_TILE):
        assert (game_map.tiles == kind).any()
    spawns = np.array(game_map.spawns)
    gold = np.argwhere(game_map.tiles == t.GOLD_TILE)
    away = np.abs(gold[:, None] - spawns).max(axis=2).min(axis=1)
    assert away.min() <= 5
    assert away.max() >= 8


def test_a_style_decides_how_much_there_is():
    bare = MapStyle(
        lumber_percent=0, wall_percent=0, water_percent=0, desert_percent=0, lava_percent=0
    )
    tiles = generate_map(48, 48, 2, 5, bare).tiles
    forest = generate_map(48, 48, 2, 5, MapStyle(lumber_percent=40)).tiles
    assert not np.isin(tiles, (t.WALL, t.WATER, t.LAVA)).any()
    assert (tiles == t.LUMBER_TILE).mean() < 0.02
    assert (forest == t.LUMBER_TILE).mean() > 0.25


@pytest.mark.parametrize("num_players", [2, 4, 6, 8])
@pytest.mark.parametrize(("symmetry", "frames"), [("rotate", {0, 3, 5, 6}), ("mirror", {0, 1, 2})])
def test_a_style_decides_the_symmetry(symmetry, frames, num_players):
    style = MapStyle(symmetry=symmetry)
    for seed in range(5):
        found = {frame for frame, _ in symmetries(generate_map(40, 40, num_players, seed, style))}
        assert len(found) >= 2
        assert found & frames - {0}


def test_an_odd_number_of_players_leaves_one_base_of_a_symmetric_board_free():
    game_map = generate_map(40, 40, 3, 1)
    same = [
        frame
        for frame in range(8)
        if np.array_equal(transform_tiles(game_map.tiles, frame), game_map.tiles)
    ]
    assert len(same) >= 4
    own = {
        to_own(frame, *spawn, 40, 40)
        for frame, spawn in zip(game_map.frames, game_map.spawns, strict=True)
    }
    assert len(own) == 1


# --- sets --------------------------------------------------------------------------------------


def test_train_and_test_sets_never_share_a_seed():
    assert not set(TRAIN_SEEDS) & set(TEST_SEEDS)
    for name, maps in MAP_SETS.items():
        assert name.endswith(f"-{maps.rows}x{maps.columns}-{maps.num_players}p")
        assert maps.seeds == (TRAIN_SEEDS if name.startswith("train-") else TEST_SEEDS)
    pairs = {name.split("-", 1)[1] for name in MAP_SETS}
    assert {f"{split}-{size}" for size in pairs for split in ("train", "test")} == set(MAP_SETS)


@pytest.mark.parametrize("name", MAP_SETS)
def test_a_set_holds_the_maps_of_its_seeds(name):
    (game_map,) = map_set(name, 1)
    maps = MAP_SETS[name]
    assert game_map.tiles.shape == (maps.rows, maps.columns)
    assert game_map.num_players == maps.num_players
    assert game_map.name.endswith(f"-{maps.seeds[0]}")


def test_the_first_maps_of_a_set_stay_the_same_when_more_are_asked():
    few, more = map_set("train-15x15-2p", 2), map_set("train-15x15-2p", count=4)
    assert [as_text(game_map) for game_map in few] == [as_text(game_map) for game_map in more[:2]]
    assert as_text(MAP_SETS["train-15x15-2p"].make(3)) == as_text(more[3])


# --- bad input ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("rows", 7, "8..128"),
        ("columns", 129, "8..128"),
        ("rows", 15.0, "8..128"),
        ("num_players", 0, "1..8"),
        ("num_players", 9, "1..8"),
        ("seed", -1, "0..9223372036854775807"),
        ("seed", True, "0..9223372036854775807"),
    ],
)
def test_numbers_out_of_range_are_refused(name, value, allowed):
    arguments = {"rows": 15, "columns": 15, "num_players": 2, "seed": 0} | {name: value}
    message = f"deep_rts map: {name} is {value!r}, it must be a whole number in {allowed}"
    with pytest.raises(ValueError, match=re.escape(message)):
        generate_map(**arguments)


@pytest.mark.parametrize("num_players", range(1, 9))
def test_a_board_too_small_for_its_players_is_refused_with_one_that_does(num_players):
    side = SMALLEST[num_players]
    generate_map(side, side, num_players, 0)
    if side > 8:
        message = f"deep_rts map: {side - 1}x{side - 1} for {num_players} players is too small"
        with pytest.raises(MapError, match=f"{message} for their bases: give {side}x{side} or"):
            generate_map(side - 1, side - 1, num_players, 0)


@pytest.mark.parametrize("num_players", [3, 4, 7, 8])
def test_quarter_turns_need_a_square(num_players):
    message = f"40x50 for {num_players} players cannot be turned by a quarter: make it square or"
    with pytest.raises(MapError, match=message):
        generate_map(40, 50, num_players, 0, MapStyle(symmetry="rotate"))


def test_a_board_that_no_way_crosses_is_refused(monkeypatch):
    monkeypatch.setattr(map_generator, "NUM_ATTEMPTS", 0)
    message = "map generated-15x15-2p-4: no way between the bases was found in 0 attempts: give an"
    with pytest.raises(MapError, match=re.escape(message)):
        generate_map(15, 15, 2, 4)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"lumber_percent": 61}, "lumber_percent is 61, it must be a whole number in 0..60"),
        ({"lava_percent": -1}, "lava_percent is -1, it must be a whole number in 0..60"),
        ({"gold_patches": 17}, "gold_patches is 17, it must be a whole number in 0..16"),
        ({"lumber_percent": 60, "wall_percent": 20}, "sum to 96, leave at least 20 percent of the"),
        ({"symmetry": "miror"}, "unknown deep_rts map symmetry 'miror': nearest are 'mirror'"),
    ],
)
def test_styles_that_cannot_be_are_refused(options, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        MapStyle(**options)


def test_styles_cannot_be_changed_by_accident():
    with pytest.raises(dataclasses.FrozenInstanceError):
        MapStyle().gold_patches = 3


def test_an_unknown_set_is_answered_with_the_nearest():
    with pytest.raises(UnknownNameError, match="unknown deep_rts map set 'train-15x15': nearest"):
        map_set("train-15x15", 1)


def test_a_set_holds_only_its_maps():
    with pytest.raises(ValueError, match=re.escape("count is 1001, it must be a whole number in")):
        map_set("test-15x15-2p", 1001)
    with pytest.raises(IndexError):
        MAP_SETS["test-15x15-2p"].make(1000)
