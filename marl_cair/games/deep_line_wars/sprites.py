"""Sprites and colours of Deep Line Wars, read from `sprites.png`.

The atlas is a row of cells of 12 x 12 pixels: the four units, then the three towers.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.deep_line_wars.tables import NUM_UNIT_KINDS
from marl_cair.games.drawing import cut_cells, read_atlas

_INDICES, _PALETTE = read_atlas(Path(__file__).with_name("sprites.png"))
_CELLS = cut_cells(_INDICES, 12)[0]
UNIT_SPRITES, TOWER_SPRITES = _CELLS[:NUM_UNIT_KINDS], _CELLS[NUM_UNIT_KINDS:]

# Rows 2 and 3 of the palette are the player's colour and its light shade.
_PLAYER_ROWS = [2, 3]
_PLAYER_COLOURS = (
    ((42, 104, 214), (122, 172, 255)),  # blue plays from the left
    ((206, 52, 48), (255, 134, 116)),  # red plays from the right
)
# [side, palette row, RGB]
PALETTES: NDArray[np.uint8] = np.stack([_PALETTE, _PALETTE])
PALETTES[:, _PLAYER_ROWS] = _PLAYER_COLOURS
SIDE_COLOURS: NDArray[np.uint8] = PALETTES[:, 2].copy()
