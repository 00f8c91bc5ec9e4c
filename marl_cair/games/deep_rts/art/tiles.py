"""The ground of Deep RTS: pixel art made of letters, light from the top left."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.drawing import read_sprites

# g h i grass, its dark and its light, d e f sand, l k y lava, crust and glow, r R q Q rock, w v x
# water, t T u leaves, b trunk, G Y n gold, s S z stone, o O oil, # outline
LETTERS = ".ghidefklyrRqQwvxtTubGYnsSzoO#"
NUM_VARIANTS = 4

_GRASS = ("g" * 16,) * 16
_SAND = ("d" * 16,) * 16
# Details of the calm grounds: (row, column, letters), one tuple for each variant.
_GRASS_DETAILS: tuple[tuple[tuple[int, int, str], ...], ...] = (
    (),
    ((3, 4, "i"), (4, 3, "h"), (4, 5, "h"), (11, 10, "i"), (12, 9, "h"), (12, 11, "h")),
    ((6, 11, "i"), (7, 10, "h"), (7, 12, "h"), (13, 3, "hh")),
    ((2, 9, "hh"), (9, 3, "i"), (10, 2, "h"), (10, 4, "h"), (12, 12, "i"), (13, 13, "h")),
)
_SAND_DETAILS: tuple[tuple[tuple[int, int, str], ...], ...] = (
    ((4, 2, "ffff"), (5, 3, "eeee"), (11, 8, "fff"), (12, 9, "eee")),
    ((8, 9, "fff"), (9, 10, "eee")),
    ((3, 8, "fff"), (4, 9, "eee"), (12, 3, "e")),
    ((13, 4, "ffff"), (14, 5, "eeee"), (6, 12, "e")),
)
_LAVA = (
    "klllllllkkllllll",
    "kkllylllkklllylk",
    "lkklllllkllllllk",
    "llkkkllkklllllkk",
    "lllllkkkkkllllkl",
    "llylllkklkkklkkl",
    "lllllkklllkkkkll",
    "kkllkklllllkklll",
    "lkkkklllyllkllll",
    "llkkllllllkklyll",
    "llkllllllkklllll",
    "lkklylllkkllllkk",
    "kklllllkkkklllkl",
    "klllllkklllkkkkl",
    "lllllkklllllkkll",
    "kllylklllyllkkll",
)
_WALL = (
    "################",
    "#RRRRRRRRRRRRRr#",
    "#RRrrrrrrrrrrrq#",
    "#RrrrrrrrrrrrrQ#",
    "#RrrrRRrrrrrrrq#",
    "#RrrrrrrrrrrrrQ#",
    "#RrrrrrrrrRRrrq#",
    "#RrrrrrrrrrrrrQ#",
    "#RrrrrrrrrrrrrQ#",
    "#rqqqqqqqqqqqqQ#",
    "################",
    "#qqqqqQ#qqqqqqQ#",
    "#qQQQQQ#qQQQQQQ#",
    "################",
    "#QQQ#qQQQQQQ#QQ#",
    "################",
)
_WATER = (
    ("w" * 16,) * 16,
    (
        *("w" * 16,) * 3,
        "wwwxxxwwwwwwwwww",
        "wwvvwwxxwwwwwwww",
        *("w" * 16,) * 5,
        "wwwwwwwwwwxxxwww",
        "wwwwwwwwwvvwwxxw",
        *("w" * 16,) * 4,
    ),
    (
        *("w" * 16,) * 6,
        "wwwwwwwwxxxwwwww",
        "wwwwwwwvvwwxxwww",
        *("w" * 16,) * 8,
    ),
    (
        *("w" * 16,) * 12,
        "wwxxxwwwwwwwwwww",
        "wvvwwxxwwwwwwwww",
        *("w" * 16,) * 2,
    ),
)
_TREES = (
    (
        "ggggg#####gggggg",
        "ggg##TTTtt##gggg",
        "gg#TTTTTttttt#gg",
        "g#TTTtTTtttttu#g",
        "g#TTtTTtttttuu#g",
        "#TTTTTtttttttuu#",
        "#TTtTttttutttuu#",
        "#TtTTttttttutuu#",
        "#tTtttutttttuuu#",
        "g#tttttttuuuuu#g",
        "g#uttuttuuuuuu#h",
        "gg##uuuuuuuu##hh",
        "gggg####b###hhhh",
        "ggggg#bbb#hhhhhg",
        "ggggg#bbn#hhhhgg",
        "gggggg###hhggggg",
    ),
    (
        "ggggggg##ggggggg",
        "gggggg#Tt#gggggg",
        "ggggg#TTtt#ggggg",
        "gggg#TTtttt#gggg",
        "gggg#TTttuu#gggg",
        "ggg#TTtttutu#ggg",
        "ggg##TTttuu##ggg",
        "ggg#TTTtttuu#ggg",
        "gg#TTTttttuuu#gg",
        "gg##TtTttutu##gg",
        "gg#TTTtttttuu#gg",
        "g#TTtTttttuuuu#g",
        "g##uuttuutuuu##h",
        "ggg####bb####hhh",
        "gggggg#bn#hhhhhg",
        "gggggg####hhhggg",
    ),
)
_GOLD = (
    "gggggggggggggggg",
    "ggggg#####gggggg",
    "gggg#RRrYG#ggggg",
    "ggg#RRrrGGq##ggg",
    "gg#RrYGrrrqGY#gg",
    "gg#rYYGGrrrGGq#g",
    "g#RrGGGnrYrrrq#g",
    "g#RrrGnrYYGrrqq#",
    "#RRrrrrrYGGnrqq#",
    "#RYGrrYrrGnrrrq#",
    "#rGGnrGnrrrYGrq#",
    "#rrnrrrrrrYGGnq#",
    "#qrrrYGrrrrGnqq#",
    "g#qqrGnqqrrqqq#h",
    "gg############hh",
    "ggghhhhhhhhhhhhg",
)
_STONE = (
    "gggggggggggggggg",
    "gggggg####gggggg",
    "gggg##SSss##gggg",
    "ggg#SSSSsssz#ggg",
    "ggg#SSssssszz#gg",
    "gg#SSsssssszz#gg",
    "gg#Sssss#sszz#gg",
    "g###sss####z##gg",
    "#SS##s#SSss#zz#g",
    "#SSs##SSssss#z#g",
    "#Ssss#Ssssszz##g",
    "#sssz#sssszzz#hg",
    "#szzz#szzzzzz#hh",
    "g####zzzzzzz#hhh",
    "gggh########hhhg",
    "gggghhhhhhhhhggg",
)
_OIL = (
    "gggggggggggggggg",
    "gggggg#####ggggg",
    "gggg##ooooo##ggg",
    "ggg#ooooooooo#gg",
    "gg#ooOOOoooooo#g",
    "g#ooOOoooooooo#g",
    "g#oooooooooOoo#g",
    "#ooooooooooOOoo#",
    "#oooooooooooOoo#",
    "#ooOOoooooooooo#",
    "#oooOOOoooooooo#",
    "g#ooooooooooOo#g",
    "g#oooooooooOo#gg",
    "gg##oooooooo##gg",
    "gggg########gggg",
    "gggggggggggggggg",
)


def _with_details(
    ground: tuple[str, ...], details: tuple[tuple[int, int, str], ...]
) -> tuple[str, ...]:
    rows = list(ground)
    for row, column, letters in details:
        rows[row] = rows[row][:column] + letters + rows[row][column + len(letters) :]
    return tuple(rows)


def _variants() -> list[tuple[tuple[str, ...], ...]]:
    """NUM_VARIANTS pictures of each tile kind, in the order of TILE_NAMES."""
    return [
        tuple(_with_details(_GRASS, details) for details in _GRASS_DETAILS),
        tuple(_with_details(_SAND, details) for details in _SAND_DETAILS),
        (_LAVA,) * NUM_VARIANTS,
        (_WALL,) * NUM_VARIANTS,
        _WATER,
        (_TREES[0], _TREES[1], _TREES[0], _TREES[0]),
        (_GOLD,) * NUM_VARIANTS,
        (_STONE,) * NUM_VARIANTS,
        (_OIL,) * NUM_VARIANTS,
    ]


# [tile kind, variant, 16, 16]
TILE_SPRITES: NDArray[np.uint8] = np.stack(
    [read_sprites(variants, LETTERS) for variants in _variants()]
)

_COLOURS = {
    ".": (0, 0, 0),
    "g": (112, 150, 86),
    "h": (94, 130, 74),
    "i": (134, 170, 102),
    "d": (208, 184, 132),
    "e": (190, 164, 112),
    "f": (222, 200, 152),
    "l": (190, 74, 36),
    "k": (138, 50, 34),
    "y": (232, 140, 52),
    "r": (130, 124, 122),
    "R": (166, 160, 154),
    "q": (98, 92, 94),
    "Q": (80, 75, 80),
    "w": (74, 124, 172),
    "v": (62, 108, 156),
    "x": (128, 172, 208),
    "t": (52, 106, 62),
    "T": (82, 142, 78),
    "u": (34, 76, 52),
    "b": (112, 78, 48),
    "G": (240, 196, 60),
    "Y": (255, 238, 150),
    "n": (176, 124, 40),
    "s": (172, 178, 188),
    "S": (210, 214, 222),
    "z": (122, 128, 142),
    "o": (40, 36, 48),
    "O": (104, 92, 132),
    "#": (36, 34, 42),
}
_ODD = {"g": (107, 145, 82), "d": (204, 179, 127)}  # every other cell, so that cells can be counted
# [parity of row + column, letter, RGB]
TILE_PALETTES: NDArray[np.uint8] = np.array(
    [[{**_COLOURS, **odd}[letter] for letter in LETTERS] for odd in ({}, _ODD)], np.uint8
)
