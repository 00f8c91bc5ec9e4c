"""Walking: exact ticks, corners, shortest ways, meeting others."""

from __future__ import annotations

from collections import deque
from itertools import pairwise

import numpy as np
import pytest

from marl_cair.games.deep_rts import state as s
from marl_cair.games.deep_rts import tables as t
from tests.games.deep_rts.skirmish import MEADOW, Skirmish, ticks_until

STEPS = [(0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, 1), (-1, -1)]
ROOM = 12  # side of the walled maps below


def meadow_with(tiles: dict[tuple[int, int], str]) -> str:
    rows = [list(row) for row in MEADOW.split()]
    for (row, column), character in tiles.items():
        rows[row][column] = character
    return "\n".join("".join(row) for row in rows)


def trail(skirmish: Skirmish, unit: int, limit: int = 600) -> list[tuple[int, int]]:
    """The places at which the unit stands until its order is done."""
    places = [skirmish.place(unit)]
    for _ in range(limit):
        skirmish.wait()
        if skirmish.place(unit) != places[-1]:
            places.append(skirmish.place(unit))
        if skirmish.get(unit, s.UNIT_ORDER) == s.NO_ORDER:
            return places
    raise AssertionError(f"still on its way after {limit} ticks: {places}")


# --- time --------------------------------------------------------------------------------------


@pytest.mark.plain_python
@pytest.mark.parametrize(
    ("kind", "ticks"), [(t.PEASANT, 11), (t.FOOTMAN, 11), (t.ARCHER, 11), (t.CAVALRY, 7)]
)
@pytest.mark.parametrize("step", STEPS)
def test_a_tile_of_grass_takes_the_same_ticks_in_all_eight_directions(kind, ticks, step):
    """One tick to set out, then the tile's."""
    skirmish = Skirmish()
    unit = skirmish.put(0, kind, 8, 8)
    place = (8 + step[0], 8 + step[1])
    skirmish.order(unit, s.MOVE, *place)
    for _ in range(ticks):
        skirmish.wait()
        assert skirmish.place(unit) == (8, 8)
        assert skirmish.get(unit, s.UNIT_STATE) == s.WALKING
    skirmish.wait()
    assert skirmish.place(unit) == place
    assert skirmish.get(unit, s.UNIT_STATE) == s.IDLE
    assert skirmish.get(unit, s.UNIT_ORDER) == s.NO_ORDER


@pytest.mark.parametrize(
    ("character", "peasant", "cavalry"), [(".", 11, 7), (",", 5, 3), ("^", 5, 3)]
)
def test_desert_and_lava_take_half_the_ticks_rounded_down(character, peasant, cavalry):
    """What counts is the tile that the unit walks onto."""
    for kind, ticks in ((t.PEASANT, peasant), (t.CAVALRY, cavalry)):
        skirmish = Skirmish(meadow_with({(8, 9): character}))
        unit = skirmish.put(0, kind, 8, 8)
        skirmish.order(unit, s.MOVE, 8, 9)
        assert ticks_until(skirmish, unit, (8, 9)) == 1 + ticks


def test_a_walk_takes_the_sum_of_its_tiles():
    skirmish = Skirmish(meadow_with({(8, 9): ",", (8, 10): ","}))
    unit = skirmish.put(0, t.FOOTMAN, 8, 8)
    skirmish.order(unit, s.MOVE, 8, 12)
    assert ticks_until(skirmish, unit, (8, 12)) == 1 + 5 + 5 + 11 + 11


def test_a_new_order_waits_for_the_end_of_the_step():
    skirmish = Skirmish()
    unit = skirmish.put(0, t.FOOTMAN, 8, 8)
    skirmish.order(unit, s.MOVE, 8, 12)
    skirmish.wait(5)
    skirmish.order(unit, s.MOVE, 8, 5)
    assert trail(skirmish, unit) == [(8, 8), (8, 9), (8, 8), (8, 7), (8, 6), (8, 5)]
    assert skirmish.tick == 1 + 5 * 11


def test_a_unit_that_is_stopped_ends_its_step_and_stays():
    skirmish = Skirmish()
    unit = skirmish.put(0, t.FOOTMAN, 8, 8)
    skirmish.order(unit, s.MOVE, 8, 12)
    skirmish.wait(15)
    skirmish.select(unit)
    skirmish.play("stop")
    skirmish.wait(40)
    assert skirmish.place(unit) == (8, 10)
    assert skirmish.illegal() == [0, 0]


# --- corners -----------------------------------------------------------------------------------


@pytest.mark.parametrize("corner", [(8, 9), (9, 8)])
@pytest.mark.parametrize("character", "#~TGSO")
def test_nobody_cuts_the_corner_of_what_is_solid(character, corner):
    skirmish = Skirmish(meadow_with({corner: character}))
    unit = skirmish.put(0, t.FOOTMAN, 8, 8)
    skirmish.order(unit, s.MOVE, 9, 9)
    free = (8, 9) if corner == (9, 8) else (9, 8)
    assert trail(skirmish, unit) == [(8, 8), free, (9, 9)]


@pytest.mark.parametrize("owner", [0, 1])
def test_nobody_cuts_the_corner_of_a_building(owner):
    skirmish = Skirmish(preset="thesis")  # where nobody fights by itself
    skirmish.put(1, t.PEASANT, 1, 1)  # who keeps player 1 in the game
    skirmish.put(owner, t.FARM, 8, 9)
    unit = skirmish.put(0, t.FOOTMAN, 8, 8)
    skirmish.order(unit, s.MOVE, 9, 9)
    assert trail(skirmish, unit) == [(8, 8), (9, 8), (9, 9)]


@pytest.mark.parametrize("owner", [0, 1])
def test_units_do_not_block_corners(owner):
    skirmish = Skirmish(preset="thesis")
    skirmish.put(owner, t.FOOTMAN, 8, 9)
    skirmish.put(owner, t.FOOTMAN, 9, 8)
    unit = skirmish.put(0, t.FOOTMAN, 8, 8)
    skirmish.order(unit, s.MOVE, 9, 9)
    assert trail(skirmish, unit) == [(8, 8), (9, 9)]


def test_a_building_that_rises_beside_a_diagonal_step_stops_it():
    skirmish = Skirmish()
    unit = skirmish.put(0, t.FOOTMAN, 8, 8)
    skirmish.order(unit, s.MOVE, 9, 9)
    skirmish.wait(5)
    skirmish.put(1, t.FARM, 8, 9)
    assert trail(skirmish, unit)[:3] == [(8, 8), (9, 8), (9, 9)]


# --- shortest ways -----------------------------------------------------------------------------


def draw_room(luck: np.random.Generator, walls: float) -> np.ndarray:
    """Tiles [ROOM, ROOM] of grass, desert and walls; room for two spawns."""
    tiles = np.where(luck.random((ROOM, ROOM)) < walls, t.WALL, t.GRASS)
    tiles[(luck.random(tiles.shape) < 0.1) & (tiles == t.GRASS)] = t.DESERT
    tiles[:3, :3] = tiles[-3:, -3:] = t.GRASS
    return tiles


def distances_from(tiles: np.ndarray, start: tuple[int, int]) -> dict[tuple[int, int], int]:
    """Steps from `start` by a plain search; diagonals need both corners free."""

    def is_open(row: int, column: int) -> bool:
        return 0 <= row < ROOM and 0 <= column < ROOM and tiles[row, column] in (t.GRASS, t.DESERT)

    distances, front = {start: 0}, deque([start])
    while front:
        row, column = front.popleft()
        for down in (-1, 0, 1):
            for right in (-1, 0, 1):
                there = (row + down, column + right)
                if (
                    there not in distances
                    and is_open(*there)
                    and is_open(row, there[1])
                    and is_open(there[0], column)
                ):
                    distances[there] = distances[row, column] + 1
                    front.append(there)
    return distances


def load_room(skirmish: Skirmish, tiles: np.ndarray) -> None:
    layer = skirmish.world.board[0].reshape(ROOM + 2, ROOM + 2)
    layer[1:-1, 1:-1] = tiles


def empty_room() -> Skirmish:
    rows = ["." * ROOM for _ in range(ROOM)]
    rows[0] = rows[0][:-1] + "G"
    rows[1] = ".1" + rows[1][2:]
    rows[-2] = rows[-2][:-2] + "2."
    return Skirmish("\n".join(rows))


@pytest.mark.parametrize("walls", [0.15, 0.3, 0.4])
def test_a_lone_unit_walks_a_shortest_way_or_as_near_as_it_can(walls):
    luck = np.random.default_rng(int(100 * walls))
    skirmish = empty_room()
    unit = skirmish.put(0, t.CAVALRY, 1, 1)
    num_reached = num_near = 0
    for _ in range(70):
        skirmish.order(unit, s.NO_ORDER)
        skirmish.wait(8)
        tiles = draw_room(luck, walls)
        start = skirmish.place(unit)
        tiles[start] = t.GRASS
        load_room(skirmish, tiles)
        distances = distances_from(tiles, start)
        grounds = [tuple(place) for place in np.argwhere(tiles != t.WALL).tolist()]
        goal = grounds[luck.integers(len(grounds))]
        if goal == start:
            continue
        skirmish.order(unit, s.MOVE, *goal)
        places = trail(skirmish, unit)
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


def test_a_way_of_more_than_21_steps_is_walked_to_its_end():
    maze = {(row, column): "#" for row in (3, 7, 11) for column in range(16)}
    for row, gap in ((3, 15), (7, 0), (11, 15)):
        del maze[row, gap]
    skirmish = Skirmish(meadow_with(maze))
    unit = skirmish.put(0, t.CAVALRY, 2, 0)
    skirmish.order(unit, s.MOVE, 12, 0)
    places = trail(skirmish, unit)
    assert places[-1] == (12, 0)
    assert len(places) - 1 > 2 * 21


def test_a_way_leads_around_lava_but_onto_it_where_that_is_asked():
    lava = {(row, 9): "^" for row in range(5, 12)}
    skirmish = Skirmish(meadow_with(lava))
    unit = skirmish.put(0, t.CAVALRY, 8, 8)
    skirmish.order(unit, s.MOVE, 8, 10)
    assert all(skirmish.tile(*place) != t.LAVA for place in trail(skirmish, unit))
    assert skirmish.get(unit, s.UNIT_HEALTH) == 90
    skirmish.order(unit, s.MOVE, 8, 9)
    assert trail(skirmish, unit)[-1] == (8, 9)


def test_a_unit_that_is_shut_in_gives_up():
    skirmish = Skirmish(
        meadow_with({(r, c): "#" for r in (7, 8, 9) for c in (7, 8, 9)} | {(8, 8): "."})
    )
    unit = skirmish.put(0, t.FOOTMAN, 8, 8)
    skirmish.order(unit, s.MOVE, 2, 2)
    assert trail(skirmish, unit) == [(8, 8)]
    assert skirmish.get(unit, s.UNIT_STATE) == s.IDLE
