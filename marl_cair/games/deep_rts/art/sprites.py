"""Sprites and colours of Deep RTS, read from `pieces.png` and `tiles.png`, in the tables' order."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.deep_rts.tables import BARRACKS, FARM, NUM_KINDS, OIL_WELL, SMITHY, TOWN_HALL
from marl_cair.games.drawing import cut_cells, read_atlas

_FOLDER = Path(__file__).parent
_PIECES, _PIECES_PALETTE = read_atlas(_FOLDER / "pieces.png")
_TILES, _TILES_PALETTE = read_atlas(_FOLDER / "tiles.png")

# pieces.png: large buildings above; below them units, and right of these small buildings and icons.
_GREAT = cut_cells(_PIECES[:48], 48)[0]
GREAT_BUILDINGS, GREAT_SITE, GREAT_SCAFFOLD = _GREAT[:3], _GREAT[3], _GREAT[4]
_SMALL = cut_cells(_PIECES[48:64, 48:112], 16)[0]
SMALL_BUILDINGS, SMALL_SITE, SMALL_SCAFFOLD = _SMALL[:2], _SMALL[2], _SMALL[3]
UNIT_SPRITES: NDArray[np.uint8] = cut_cells(_PIECES[48:, :48], 16)  # [kind, pose, 16, 16]
SIDEWAYS, FRONT, BACK = range(3)  # poses; sideways looks to the right
ICONS: NDArray[np.uint8] = cut_cells(_PIECES[64:72, 48:112], 8)[0]  # 4 resources, then these
FOOD_ICON, UNITS_ICON, SCORE_ICON, TIME_ICON = range(4, 8)

# [kind] -> row of GREAT_BUILDINGS or SMALL_BUILDINGS, -1 for kinds that are not in it.
GREAT_SPRITE, SMALL_SPRITE = (
    np.array([kinds.index(kind) if kind in kinds else -1 for kind in range(NUM_KINDS)], np.int8)
    for kinds in ((TOWN_HALL, BARRACKS, SMITHY), (FARM, OIL_WELL))
)

# Rows 2 to 4 of the palette of pieces.png are the player's colour: plain, light and dark. People
# who are colour-blind can tell these apart, after Okabe and Ito (2008).
_PLAYER_SHADES = (
    ((24, 108, 196), (104, 176, 246), (16, 72, 138)),  # blue
    ((206, 78, 26), (248, 142, 88), (146, 48, 16)),  # vermilion
    ((236, 214, 62), (255, 244, 158), (178, 152, 30)),  # yellow
    ((186, 96, 158), (232, 164, 210), (128, 58, 108)),  # purple
    ((222, 224, 230), (255, 255, 255), (160, 164, 176)),  # white
    ((72, 72, 84), (124, 126, 142), (44, 44, 54)),  # black
    ((84, 190, 226), (164, 228, 250), (46, 132, 168)),  # sky
    ((0, 150, 116), (86, 206, 172), (0, 100, 78)),  # green
)
MAX_COLOURS = len(_PLAYER_SHADES)
LIGHT_SHADE = 3  # row of the palette
# [colour, palette row, RGB]; a seat sees itself in colour 0.
PALETTES: NDArray[np.uint8] = np.stack([_PIECES_PALETTE] * MAX_COLOURS)
PALETTES[:, 2:5] = _PLAYER_SHADES
PLAYER_COLOURS: NDArray[np.uint8] = PALETTES[:, 2].copy()

# tiles.png: a column for each tile kind, a row for each variant.
TILE_SPRITES: NDArray[np.uint8] = cut_cells(_TILES, 16).swapaxes(0, 1).copy()
NUM_VARIANTS = TILE_SPRITES.shape[1]
# [parity of row + column, palette row, RGB]: every other cell of grass and of sand is darker, so
# that cells can be counted.
TILE_PALETTES: NDArray[np.uint8] = np.stack([_TILES_PALETTE] * 2)
TILE_PALETTES[1, [1, 4]] = (107, 145, 82), (204, 179, 127)
