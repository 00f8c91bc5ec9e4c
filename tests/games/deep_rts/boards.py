"""Boards of text for the tests of maps."""

import numpy as np

from marl_cair.games.deep_rts.maps.formats import LEGEND
from marl_cair.games.deep_rts.tables import GRASS

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
    tiles = [[max(LEGEND.find(character), GRASS) for character in row] for row in rows]
    spawns = {
        int(character): (row, column)
        for row, line in enumerate(rows)
        for column, character in enumerate(line)
        if character.isdecimal()
    }
    return np.array(tiles, dtype=np.uint8), [spawns[seat] for seat in sorted(spawns)]


def plain_board():
    return board_of(PLAIN[len("; a plain map\n") :])
