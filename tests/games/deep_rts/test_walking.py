"""Walking: exact ticks, corners, shortest paths."""

from __future__ import annotations

from collections import deque
from itertools import pairwise

import numpy as np
import pytest

from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from tests.games.deep_rts.skirmish import CALM, Skirmish, ticks_until

STEPS = [(0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)]
ROOM = 12  # side of the walled maps below


def walker(kind: int, start=(8, 8), tiles=None, **options) -> tuple[Skirmish, int]:
    """A unit on the meadow, with other tiles at some places."""
    game = Skirmish(**options)
    for place, tile in (tiles or {}).items():
        game.set_tile(*place, tile)
    return game, game.put(0, kind, *start)


def trail(game: Skirmish, unit: int, *goal: int, limit: int = 600) -> list[tuple[int, int]]:
    """Send the unit to a goal; returns the places at which it stands until its order is done."""
    if goal:
        game.order(unit, s.MOVE, *goal)
    places = [game.place(unit)]
    for _ in range(limit):
        game.wait()
        if game.place(unit) != places[-1]:
            places.append(game.place(unit))
        if game.get(unit, s.UNIT_ORDER) == s.NO_ORDER:
            return places
    raise AssertionError(f"still walking after {limit} ticks: {places}")


# --- time --------------------------------------------------------------------------------------


@pytest.mark.plain_python
@pytest.mark.parametrize(
    ("kind", "ticks"), [(t.PEASANT, 11), (t.FOOTMAN, 11), (t.ARCHER, 11), (t.CAVALRY, 7)]
)
@pytest.mark.parametrize("step", STEPS)
def test_tile_of_grass_takes_the_same_ticks_in_all_eight_directions(kind, ticks, step):
    """One tick to set out, then the tile's."""
    game, unit = walker(kind)
    place = (8 + step[0], 8 + step[1])
    game.order(unit, s.MOVE, *place)
    for _ in range(ticks):
        game.wait()
        assert game.place(unit) == (8, 8)
        assert game.get(unit, s.UNIT_STATE) == s.WALKING
    game.wait()
    assert game.place(unit) == place
    assert game.get(unit, s.UNIT_STATE, s.UNIT_ORDER) == (s.IDLE, s.NO_ORDER)


@pytest.mark.parametrize("tile", [t.DESERT, t.LAVA])
@pytest.mark.parametrize(("kind", "ticks"), [(t.PEASANT, 5), (t.CAVALRY, 3)])
def test_desert_and_lava_take_half_the_ticks_rounded_down(kind, ticks, tile):
    """The tile that the unit walks onto counts."""
    game, unit = walker(kind, tiles={(8, 9): tile})
    game.order(unit, s.MOVE, 8, 9)
    assert ticks_until(game, unit, (8, 9)) == 1 + ticks


def test_walk_takes_the_sum_of_its_tiles():
    game, unit = walker(t.FOOTMAN, tiles={(8, 9): t.DESERT, (8, 10): t.DESERT})
    game.order(unit, s.MOVE, 8, 12)
    assert ticks_until(game, unit, (8, 12)) == 1 + 5 + 5 + 11 + 11


def test_new_order_waits_for_the_end_of_the_step():
    game, unit = walker(t.FOOTMAN)
    game.order(unit, s.MOVE, 8, 12)
    game.wait(5)
    assert trail(game, unit, 8, 5) == [(8, 8), (8, 9), (8, 8), (8, 7), (8, 6), (8, 5)]
    assert game.tick == 1 + 5 * 11


def test_stopped_unit_ends_its_step_and_stays():
    game, unit = walker(t.FOOTMAN)
    game.order(unit, s.MOVE, 8, 12)
    game.wait(15)
    game.select(unit)
    game.play("stop")
    game.wait(40)
    assert game.place(unit) == (8, 10)
    assert game.illegal() == [0, 0]


# --- corners -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("corner", "free"), [((8, 9), (9, 8)), ((9, 8), (8, 9))])
@pytest.mark.parametrize(
    "tile", [t.WALL, t.WATER, t.LUMBER_TILE, t.GOLD_TILE, t.STONE_TILE, t.OIL_TILE]
)
def test_no_unit_cuts_the_corner_of_a_solid_tile(tile, corner, free):
    game, unit = walker(t.FOOTMAN, tiles={corner: tile})
    assert trail(game, unit, 9, 9) == [(8, 8), free, (9, 9)]


@pytest.mark.parametrize("owner", [0, 1])
@pytest.mark.parametrize("is_building", [True, False])
def test_buildings_block_corners_and_other_units_do_not(owner, is_building):
    game, unit = walker(t.FOOTMAN, **CALM)
    game.put(1, t.PEASANT, 1, 1)  # keeps player 1 in the game
    if is_building:
        game.put(owner, t.FARM, 8, 9)
    else:
        game.put(owner, t.FOOTMAN, 8, 9)
        game.put(owner, t.FOOTMAN, 9, 8)
    way_round = [(9, 8)] if is_building else []
    assert trail(game, unit, 9, 9) == [(8, 8), *way_round, (9, 9)]


def test_building_that_rises_beside_a_diagonal_step_stops_it():
    game, unit = walker(t.FOOTMAN)
    game.order(unit, s.MOVE, 9, 9)
    game.wait(5)
    game.put(1, t.FARM, 8, 9)
    assert trail(game, unit)[:3] == [(8, 8), (9, 8), (9, 9)]


# --- shortest paths ----------------------------------------------------------------------------


def draw_room(luck: np.random.Generator, walls: float) -> np.ndarray:
    """Tiles [ROOM, ROOM] of grass, desert and walls; room for two spawns."""
    tiles = np.where(luck.random((ROOM, ROOM)) < walls, t.WALL, t.GRASS)
    tiles[(luck.random(tiles.shape) < 0.1) & (tiles == t.GRASS)] = t.DESERT
    tiles[:3, :3] = tiles[-3:, -3:] = t.GRASS
    return tiles


def distances_from(tiles: np.ndarray, start: tuple[int, int]) -> dict[tuple[int, int], int]:
    """Steps from `start` by a plain search; diagonals need both corners free."""
    is_open = np.pad(tiles != t.WALL, 1)
    distances, front = {start: 0}, deque([start])
    while front:
        row, column = front.popleft()
        for down, right in STEPS:
            there = (row + down, column + right)
            passed = (there, (row, there[1]), (there[0], column))
            if there not in distances and all(is_open[r + 1, c + 1] for r, c in passed):
                distances[there] = distances[row, column] + 1
                front.append(there)
    return distances


@pytest.mark.parametrize("walls", [0.15, 0.3, 0.4])
def test_lone_unit_walks_a_shortest_path_or_as_near_as_it_can(walls):
    luck = np.random.default_rng(int(100 * walls))
    rows = ["." * ROOM] * ROOM
    rows[0], rows[1], rows[-2] = rows[0][1:] + "G", ".1" + rows[1][2:], rows[-2][2:] + "2."
    game = Skirmish("\n".join(rows))
    unit = game.put(0, t.CAVALRY, 1, 1)
    num_reached = num_near = 0
    for _ in range(70):
        game.order(unit, s.NO_ORDER)
        game.wait(8)
        tiles, start = draw_room(luck, walls), game.place(unit)
        tiles[start] = t.GRASS
        game.world.board[s.TILE].reshape(ROOM + 2, ROOM + 2)[1:-1, 1:-1] = tiles
        distances = distances_from(tiles, start)
        grounds = [tuple(place) for place in np.argwhere(tiles != t.WALL).tolist()]
        goal = grounds[luck.integers(len(grounds))]
        if goal == start:
            continue
        places = trail(game, unit, *goal)
        for place, following in pairwise(places):
            assert max(abs(place[0] - following[0]), abs(place[1] - following[1])) == 1
            assert distances_from(tiles, place)[following] == 1
        if goal in distances:
            num_reached += 1
            assert places[-1] == goal
            assert len(places) - 1 == distances[goal]
        else:
            num_near += 1
            away = {p: (p[0] - goal[0]) ** 2 + (p[1] - goal[1]) ** 2 for p in distances}
            assert away[places[-1]] == min(away.values())
    assert num_reached > 20
    assert num_near > 0 or walls < 0.3


def test_path_of_more_than_21_steps_is_walked_to_its_end():
    maze = {(row, column): t.WALL for row in (3, 7, 11) for column in range(16)}
    for gap in ((3, 15), (7, 0), (11, 15)):
        del maze[gap]
    game, unit = walker(t.CAVALRY, (2, 0), maze)
    places = trail(game, unit, 12, 0)
    assert places[-1] == (12, 0)
    assert len(places) - 1 > 2 * 21


def test_path_leads_around_lava_but_onto_it_where_that_is_the_goal():
    game, unit = walker(t.CAVALRY, tiles={(row, 9): t.LAVA for row in range(5, 12)})
    assert all(game.tile(*place) != t.LAVA for place in trail(game, unit, 8, 10))
    assert game.get(unit, s.UNIT_HEALTH) == 90
    assert trail(game, unit, 8, 9)[-1] == (8, 9)


def test_unit_that_is_shut_in_gives_up():
    walls = {(8 + down, 8 + right): t.WALL for down, right in STEPS}
    game, unit = walker(t.FOOTMAN, tiles=walls)
    assert trail(game, unit, 2, 2) == [(8, 8)]
    assert game.get(unit, s.UNIT_STATE) == s.IDLE
