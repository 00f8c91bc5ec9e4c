"""All pictures of Deep RTS and the players' colours, in the order of the tables."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.deep_rts.art.buildings import (
    GREAT_BUILDINGS,
    GREAT_SCAFFOLD,
    GREAT_SITE,
    SMALL_BUILDINGS,
    SMALL_SCAFFOLD,
    SMALL_SITE,
)
from marl_cair.games.deep_rts.art.tiles import NUM_VARIANTS, TILE_PALETTES, TILE_SPRITES
from marl_cair.games.deep_rts.art.units import (
    BACK,
    FOOD_ICON,
    FRONT,
    ICONS,
    LETTERS,
    SCORE_ICON,
    SIDEWAYS,
    TIME_ICON,
    UNIT_SPRITES,
    UNITS_ICON,
)
from marl_cair.games.deep_rts.tables import BARRACKS, FARM, NUM_KINDS, OIL_WELL, SMITHY, TOWN_HALL

__all__ = [
    "BACK",
    "FOOD_ICON",
    "FRONT",
    "GREAT_BUILDINGS",
    "GREAT_SCAFFOLD",
    "GREAT_SITE",
    "GREAT_SPRITE",
    "ICONS",
    "MAX_COLOURS",
    "NUM_VARIANTS",
    "PALETTES",
    "PLAYER_COLOURS",
    "SCORE_ICON",
    "SIDEWAYS",
    "SMALL_BUILDINGS",
    "SMALL_SCAFFOLD",
    "SMALL_SITE",
    "SMALL_SPRITE",
    "TILE_PALETTES",
    "TILE_SPRITES",
    "TIME_ICON",
    "UNITS_ICON",
    "UNIT_SPRITES",
]

NO_SPRITE = -1


def _index_of(kinds: tuple[int, ...]) -> NDArray[np.int8]:
    table = np.full(NUM_KINDS, NO_SPRITE, np.int8)
    table[list(kinds)] = range(len(kinds))
    return table


# [kind] -> row of GREAT_BUILDINGS or SMALL_BUILDINGS, NO_SPRITE for what is not in it.
GREAT_SPRITE: NDArray[np.int8] = _index_of((TOWN_HALL, BARRACKS, SMITHY))
SMALL_SPRITE: NDArray[np.int8] = _index_of((FARM, OIL_WELL))

_SHARED = {
    ".": (0, 0, 0),
    "#": (30, 27, 36),
    "m": (146, 150, 160),
    "M": (206, 210, 218),
    "n": (98, 100, 114),
    "s": (238, 196, 156),
    "k": (200, 148, 112),
    "b": (112, 76, 48),
    "B": (164, 118, 72),
    "y": (222, 178, 76),
    "Y": (248, 222, 138),
    "h": (78, 52, 40),
    "e": (150, 112, 80),
    "d": (102, 74, 58),
    "w": (240, 240, 236),
    "a": (66, 66, 78),
    "r": (190, 66, 34),
    "R": (242, 142, 48),
}
# Colours that the colour-blind tell apart, after Okabe and Ito (2008): plain, light, dark.
_PLAYERS = (
    ((24, 108, 196), (104, 176, 246), (16, 72, 138)),  # blue
    ((206, 78, 26), (248, 142, 88), (146, 48, 16)),  # vermilion
    ((236, 214, 62), (255, 244, 158), (178, 152, 30)),  # yellow
    ((186, 96, 158), (232, 164, 210), (128, 58, 108)),  # purple
    ((222, 224, 230), (255, 255, 255), (160, 164, 176)),  # white
    ((72, 72, 84), (124, 126, 142), (44, 44, 54)),  # black
    ((84, 190, 226), (164, 228, 250), (46, 132, 168)),  # sky
    ((0, 150, 116), (86, 206, 172), (0, 100, 78)),  # green
)
MAX_COLOURS = len(_PLAYERS)


def _make_palette(shades: tuple[tuple[int, int, int], ...]) -> list[tuple[int, int, int]]:
    colours = {**_SHARED, **dict(zip("oOp", shades, strict=True))}
    return [colours[letter] for letter in LETTERS]


# [colour, letter, RGB]; colour 0 is the onlooker's own in its view.
PALETTES: NDArray[np.uint8] = np.array([_make_palette(shades) for shades in _PLAYERS], np.uint8)
PLAYER_COLOURS: NDArray[np.uint8] = np.array([shades[0] for shades in _PLAYERS], np.uint8)
