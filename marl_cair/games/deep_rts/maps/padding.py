"""Maps of several sizes in one batch: the smaller ones stand in the middle of a board of walls."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.maps.maps import GameMap, MapError, make_map


def pad_maps(maps: Sequence[GameMap]) -> tuple[GameMap, ...]:
    """The maps on boards of one size, the largest rows and columns among them.

    Each keeps its symmetries, so its ground must lie in the very middle.

    Raises:
        MapError: a map that is an odd number of rows or columns smaller than the largest.
    """
    rows = max(game_map.tiles.shape[0] for game_map in maps)
    columns = max(game_map.tiles.shape[1] for game_map in maps)
    return tuple(_pad_map(game_map, rows, columns) for game_map in maps)


def _pad_map(game_map: GameMap, rows: int, columns: int) -> GameMap:
    own_rows, own_columns = game_map.tiles.shape
    if (own_rows, own_columns) == (rows, columns):
        return game_map
    if (rows - own_rows) % 2 or (columns - own_columns) % 2:
        raise MapError(
            f"deep_rts: the map {game_map.name} has {own_rows}x{own_columns} cells, it cannot "
            f"stand in the middle of {rows}x{columns}; mix sizes that are all odd or all even"
        )
    above, left = (rows - own_rows) // 2, (columns - own_columns) // 2
    tiles = np.full((rows, columns), t.WALL, np.uint8)
    tiles[above : above + own_rows, left : left + own_columns] = game_map.tiles
    spawns = [(row + above, column + left) for row, column in game_map.spawns]
    return make_map(game_map.name, tiles, spawns)
