"""Generated maps: the same from the same seed, connected, and fair to every seat."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.maps import generator, maps
from marl_cair.games.deep_rts.maps.formats import LEGEND, MapError
from marl_cair.games.deep_rts.maps.generator import MAP_SETS, generate_map
from tests.games.deep_rts.boards import own_spawns, resource_distances, symmetries, views

SMALLEST = {1: 8, 2: 10, 3: 10, 4: 10, 5: 15, 6: 15, 7: 20, 8: 20}  # side of a square, by players
CROWDED = {  # percent of all tiles, size of a clump, how straight it is
    t.DESERT: (8, 14, 0),
    t.WATER: (15, 12, 0),
    t.LUMBER_TILE: (25, 12, 1),
    t.WALL: (20, 6, 3),
    t.LAVA: (10, 5, 1),
}
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
    sides = st.integers(SMALLEST[num_players], SMALLEST[num_players] + 24)
    with pytest.MonkeyPatch.context() as patch:
        if draw(st.booleans()):
            patch.setattr(generator, "TERRAIN", CROWDED)
            patch.setattr(generator, "GOLD_PATCHES", 5)
        return generate_map(draw(sides), draw(sides), num_players, draw(st.integers(0, 2**63 - 1)))


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(game_map=generated())
def test_every_map_can_be_played_and_is_fair(game_map):
    """Connected without lava; bases on open ground in the own top left, as far from resources."""
    maps.make_map(game_map.name, game_map.tiles, game_map.spawns)
    safe = np.where(game_map.tiles == t.LAVA, t.WALL, game_map.tiles).astype(np.uint8)
    reached = maps.walking_distances(safe, *game_map.spawns[0])
    assert all(reached[spawn] >= 0 for spawn in game_map.spawns)
    (walks,) = {resource_distances(game_map.tiles, *spawn) for spawn in game_map.spawns}
    assert min(walks) >= 1
    for row, column in game_map.spawns:
        assert np.isin(safe[row - 1 : row + 2, column - 1 : column + 2], t.WALKABLE_TILES).all()
    rows, columns = game_map.tiles.shape
    for row, column in own_spawns(game_map):
        assert 2 * row <= rows - 1
        assert 2 * column <= columns - 1


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(game_map=generated(counts=(2, 4)))
def test_two_and_four_seats_see_one_board(game_map):
    assert len(views(game_map)) == len(set(own_spawns(game_map))) == 1
    assert len(symmetries(game_map)) >= len(game_map.spawns)
    walks = [maps.walking_distances(game_map.tiles, *spawn) for spawn in game_map.spawns]
    assert len({int(distances[distances >= 0].sum()) for distances in walks}) == 1


@settings(max_examples=20, deadline=None)
@given(game_map=generated(counts=(6, 8)))
def test_six_and_eight_seats_have_a_symmetric_map(game_map):
    assert len(symmetries(game_map)) >= 2


def test_the_seed_decides_the_map():
    first, again = (generate_map(31, 31, 4, 7) for _ in range(2))
    assert np.array_equal(first.tiles, again.tiles)
    assert (first.spawns, first.frames, first.name) == (again.spawns, again.frames, again.name)
    assert first.name == "generated-31x31-4p-7"
    texts = {as_text(generate_map(15, 15, 2, seed)) for seed in range(100)}
    assert len(texts) == 100


def test_a_seed_makes_the_same_map_in_every_version():
    assert as_text(generate_map(10, 10, 2, 1)) == GOLDEN


@pytest.mark.parametrize("size", [31, 64])
def test_maps_hold_all_kinds_of_terrain_and_contested_resources(size):
    game_map = generate_map(size, size, 2, 11)
    assert np.isin(np.arange(t.NUM_TILE_KINDS), game_map.tiles).all()
    gold = np.argwhere(game_map.tiles == t.GOLD_TILE)
    away = np.abs(gold[:, None] - np.array(game_map.spawns)).max(axis=2).min(axis=1)
    assert away.min() <= 5
    assert away.max() >= 8


@pytest.mark.parametrize("num_players", [2, 4, 6, 8])
def test_seeds_choose_turns_and_mirrors(num_players):
    maps_of_seeds = [generate_map(40, 40, num_players, seed) for seed in range(8)]
    found = [{frame for frame, _ in symmetries(game_map)} for game_map in maps_of_seeds]
    assert all(len(frames) >= 2 for frames in found)
    assert any(frames & {3, 5, 6} and not frames & {1, 2} for frames in found)
    assert any(frames & {1, 2} for frames in found)


def test_an_odd_number_of_players_leaves_one_base_of_a_symmetric_board_free():
    game_map = generate_map(40, 40, 3, 1)
    shown = [maps.transform_tiles(game_map.tiles, frame) for frame in range(8)]
    assert sum(np.array_equal(tiles, game_map.tiles) for tiles in shown) >= 4
    assert len(set(own_spawns(game_map))) == 1


# --- sets --------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MAP_SETS)
def test_a_set_holds_the_maps_of_its_seeds(name):
    (game_map,) = generator.map_set(name, 1)
    split, size = name.split("-", 1)
    first = {"train": 0, "test": 1_000_000}[split]
    assert game_map.name == f"generated-{size}-{first}"
    assert "x".join(map(str, game_map.tiles.shape)) + f"-{len(game_map.spawns)}p" == size
    assert {f"train-{size}", f"test-{size}"} <= MAP_SETS.keys()
    assert not set(generator.TRAIN_SEEDS) & set(generator.TEST_SEEDS)


def test_the_first_maps_of_a_set_stay_the_same_when_more_are_asked():
    few, more = (generator.map_set("train-15x15-2p", count) for count in (2, 4))
    assert [as_text(game_map) for game_map in few] == [as_text(game_map) for game_map in more[:2]]
    assert more[3].name.endswith("-3")


# --- bad input ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("rows", 7, "8..128"),
        ("columns", 129, "8..128"),
        ("num_players", 0, "1..8"),
        ("num_players", 9, "1..8"),
        ("seed", -1, "0..9223372036854775807"),
    ],
)
def test_numbers_out_of_range_are_refused(name, value, allowed):
    arguments = {"rows": 15, "columns": 15, "num_players": 2, "seed": 0} | {name: value}
    with pytest.raises(ValueError, match=re.escape(f"{name} is {value}, it must be in {allowed}")):
        generate_map(**arguments)


@pytest.mark.parametrize("num_players", range(1, 9))
def test_a_board_too_small_for_its_players_is_refused_with_one_that_does(num_players):
    side = SMALLEST[num_players]
    generate_map(side, side, num_players, 0)
    if side > 8:
        message = f"-{side - 1}x{side - 1}-{num_players}p-0: too small .* take {side}x{side} or"
        with pytest.raises(MapError, match=message):
            generate_map(side - 1, side - 1, num_players, 0)


def test_a_board_that_no_way_crosses_is_refused(monkeypatch):
    monkeypatch.setattr(generator, "NUM_ATTEMPTS", 0)
    with pytest.raises(MapError, match="map generated-15x15-2p-4: no way .* in 0 attempts"):
        generate_map(15, 15, 2, 4)
