"""Boards of text for the tests of maps, and what must hold for fair ones."""

import numpy as np
from scipy.ndimage import binary_dilation

from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.maps.formats import LEGEND
from marl_cair.games.deep_rts.maps.maps import to_own, transform_tiles, walking_distances

PLAIN = """\
; a plain map
........G
.1.......
.........
.........
.........
.........
.......2.
G........
"""


def board_of(text):
    """Tiles and spawns of rows of LEGEND's characters."""
    rows = text.split()
    tiles = [[max(LEGEND.find(character), t.GRASS) for character in row] for row in rows]
    spawns = {
        int(character): (row, column)
        for row, line in enumerate(rows)
        for column, character in enumerate(line)
        if character.isdecimal()
    }
    return np.array(tiles, dtype=np.uint8), [spawns[seat] for seat in sorted(spawns)]


def plain_board():
    return board_of(PLAIN[len("; a plain map\n") :])


def own_spawns(game_map):
    """Where each seat sees its own base."""
    pairs = zip(game_map.frames, game_map.spawns, strict=True)
    return [to_own(frame, *spawn, *game_map.tiles.shape) for frame, spawn in pairs]


def views(game_map):
    """The different boards that the seats see."""
    return {transform_tiles(game_map.tiles, frame).tobytes() for frame in game_map.frames}


def symmetries(game_map):
    """All (frame, seats) that leave the map as it is; seat k moves to the place of `seats[k]`."""
    seat_at = {spawn: seat for seat, spawn in enumerate(game_map.spawns)}
    found = []
    for frame in range(8):
        moved = [to_own(frame, *spawn, *game_map.tiles.shape) for spawn in game_map.spawns]
        same = np.array_equal(transform_tiles(game_map.tiles, frame), game_map.tiles)
        if same and seat_at.keys() == set(moved):
            found.append((frame, tuple(seat_at[spawn] for spawn in moved)))
    return found


def resource_distances(tiles, row, column):
    """Steps from a cell to the nearest cell beside a tile of each resource; -1: no way."""
    distances = walking_distances(tiles, row, column)
    kinds = np.array(t.TILE_RESOURCE)[tiles]
    beside = [binary_dilation(kinds == kind, np.ones((3, 3))) for kind in range(t.NUM_RESOURCES)]
    reached = [distances[near & (distances >= 0)] for near in beside]
    return tuple(int(steps.min()) if steps.size else -1 for steps in reached)
