"""The pixel art of Deep Line Wars, made of letters: one picture per unit and tower kind."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.drawing import read_sprites

# . nothing, # outline, o player's colour, O its light shade, m metal, M bright metal, s skin,
# b wood, y brass
LETTERS = ".#oOmMsby"

_MILITIA = (
    "............",
    "....###.....",
    "...#sss#..#.",
    "...#sss#.#M#",
    "....###.#M#.",
    "...#oo##M#..",
    "..#oOoo##...",
    "..#oooo#....",
    "...#oo#.....",
    "...#bb#.....",
    "..#b##b#....",
    "..##..##....",
)
_FOOTMAN = (
    "...####.....",
    "..#mMMm#....",
    "..#msss#.#..",
    "..##sss##M#.",
    ".#o####.#M#.",
    "#oOo#oo##M#.",
    "#oyo#oOo#M#.",
    "#oOo#ooo#b#.",
    ".#o##ooo##..",
    "..#.#bb#....",
    "...#b##b#...",
    "...##..##...",
)
_GRUNT = (
    "..##....##..",
    ".#MM####MM#.",
    "..#ssssss#..",
    "..#s#ss#s#..",
    "..#ssssss###",
    ".#o#s##s#omM",
    "#oOo####oOmM",
    "#ooooooooomM",
    ".##oOOOo##b#",
    "..#oooooo#b#",
    "..#bb##bb#..",
    "..###..###..",
)
_ARMOURED = (
    "...######...",
    "..#mMMMMm#..",
    ".#mM####Mm#.",
    ".#m#yyyy#m##",
    "##mMMMMMMmmM",
    "#oomMMMMmomM",
    "#oOomMMmoOmM",
    "#oooommoooM#",
    ".#mMooooMmb#",
    ".#mMm##mMmb#",
    ".#mm#..#mm#.",
    ".####..####.",
)
_BASIC = (
    "............",
    "..##.##.##..",
    "..#m#mm#m#..",
    "..#mMMMMm#..",
    "..##mmmm##..",
    "...#m##m#...",
    "...#m##m#...",
    "...#mMMm#...",
    "..#oooooo#..",
    "..#oOOOOo#..",
    ".#mmmmmmmm#.",
    ".##########.",
)
_FAST = (
    ".....##.....",
    "....#oo#....",
    "...#oOOo#...",
    "..#oOOOOo#..",
    ".##########.",
    "..#mMMMMm#..",
    "..#m#MM#m#..",
    "..#mMMMMm#..",
    "..#m#MM#m#..",
    "..#mMMMMm#..",
    ".#mmmmmmmm#.",
    ".##########.",
)
_FASTER = (
    "............",
    "########....",
    "#MMMMMMM###.",
    "#mmmmmmmmmm#",
    "########mm#.",
    "..#yy#.###..",
    ".#oyyo######",
    ".#oOOOOOOoo#",
    "#mooooooooom",
    "#m#bb##bb#m#",
    "#mm#b##b#mm#",
    "############",
)
UNIT_SPRITES: NDArray[np.uint8] = read_sprites((_MILITIA, _FOOTMAN, _GRUNT, _ARMOURED), LETTERS)
TOWER_SPRITES: NDArray[np.uint8] = read_sprites((_BASIC, _FAST, _FASTER), LETTERS)

_SHARED = {
    "#": (24, 22, 30),
    "m": (128, 134, 146),
    "M": (198, 204, 214),
    "s": (236, 188, 148),
    "b": (110, 74, 44),
    "y": (238, 196, 72),
}
_LEFT = {"o": (42, 104, 214), "O": (122, 172, 255)}
_RIGHT = {"o": (206, 52, 48), "O": (255, 134, 116)}


def _make_palette(own: dict[str, tuple[int, int, int]]) -> list[tuple[int, int, int]]:
    colours = {".": (0, 0, 0), **_SHARED, **own}
    return [colours[letter] for letter in LETTERS]


# [side, letter, RGB]: blue plays from the left, red from the right.
PALETTES: NDArray[np.uint8] = np.array([_make_palette(_LEFT), _make_palette(_RIGHT)], np.uint8)
SIDE_COLOURS: NDArray[np.uint8] = np.array([_LEFT["o"], _RIGHT["o"]], np.uint8)
