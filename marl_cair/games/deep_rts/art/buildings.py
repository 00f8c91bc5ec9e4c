"""The buildings of Deep RTS: small ones of letters, great ones put together from walls and roofs.

A canvas is an array of letters' numbers. Light comes from the top left: the left slope of a roof
and the top edge of a wall are light, the right and the bottom dark.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.deep_rts.art.units import LETTERS
from marl_cair.games.drawing import read_sprites

SMALL_SIDE, GREAT_SIDE = 16, 48
_Canvas = NDArray[np.uint8]


def _blank(side: int = GREAT_SIDE) -> _Canvas:
    return np.zeros((side, side), np.uint8)


def _fill(canvas: _Canvas, top: int, left: int, height: int, width: int, letter: str) -> None:
    canvas[top : top + height, left : left + width] = LETTERS.index(letter)


def _put(canvas: _Canvas, top: int, left: int, rows: tuple[str, ...]) -> None:
    """Lay letters over the canvas; dots leave it as it is."""
    for y, row in enumerate(rows):
        for x, letter in enumerate(row):
            if letter != ".":
                canvas[top + y, left + x] = LETTERS.index(letter)


def _wall(
    canvas: _Canvas, top: int, left: int, height: int, width: int, shades: str = "Mmn"
) -> None:
    """A masonry wall with an outline: light above and on the left, dark on the right."""
    light, plain, dark = tuple(shades)
    _fill(canvas, top, left, height, width, "#")
    _fill(canvas, top + 1, left + 1, height - 2, width - 2, plain)
    for y in range(top + 4, top + height - 1, 4):
        _fill(canvas, y, left + 1, 1, width - 2, dark)
        shift = 3 if (y - top) % 8 == 0 else 0
        for x in range(left + 3 + shift, left + width - 1, 6):
            _fill(canvas, y - 3, x, 3, 1, dark)
    _fill(canvas, top + 1, left + 1, 1, width - 2, light)
    _fill(canvas, top + 1, left + 1, height - 2, 1, light)
    _fill(canvas, top + 2, left + width - 2, height - 3, 1, dark)


def _roof(
    canvas: _Canvas, top: int, left: int, height: int, width: int, inset: int, shades: str = "Oop"
) -> None:
    """A roof whose ridge is `inset` shorter on both sides than its eaves; courses of tiles."""
    light, plain, dark = tuple(shades)
    for row in range(height):
        shift = inset - inset * row // max(1, height - 1)
        first, last = left + shift, left + width - shift
        _fill(canvas, top + row, first, 1, last - first, plain)
        if row % 4 == 3:
            _fill(canvas, top + row, first, 1, last - first, dark)
        span = max(2, (last - first) // 5)
        _fill(canvas, top + row, last - span, 1, span, dark)
        if row % 4 != 3:
            _fill(canvas, top + row, first, 1, span, light)
        _fill(canvas, top + row, first, 1, 1, "#")
        _fill(canvas, top + row, last - 1, 1, 1, "#")
    _fill(canvas, top, left + inset, 1, width - 2 * inset, "#")
    _fill(canvas, top + 1, left + inset + 1, 1, max(0, width - 2 * inset - 2), light)
    _fill(canvas, top + height - 1, left, 1, width, "#")


def _gate(canvas: _Canvas, top: int, left: int, height: int, width: int) -> None:
    """An arched wooden gate."""
    _fill(canvas, top, left + 1, 1, width - 2, "#")
    _fill(canvas, top + 1, left, height - 1, width, "#")
    _fill(canvas, top + 1, left + 1, height - 1, width - 2, "b")
    for x in range(left + 2, left + width - 2, 3):
        _fill(canvas, top + 2, x, height - 2, 1, "B")
    _fill(canvas, top + 1, left + width // 2, height - 1, 1, "#")


_FLAG = (
    "y.......",
    "b##.....",
    "bOo####.",
    "bOoooo#.",
    "bOooop#.",
    "boop###.",
    "b###....",
    "b.......",
    "b.......",
)
_WINDOW = ("####", "#yY#", "#Yy#", "#yy#", "####")
_BANNER = ("bbbbbb", "#OOoo#", "#Oyop#", "#yYyp#", "#Oyop#", "#Ooop#", "#oopp#", ".#op#.", "..##..")


def _town_hall() -> _Canvas:
    canvas = _blank()
    _wall(canvas, 22, 7, 24, 34)
    _roof(canvas, 9, 4, 16, 40, 9)
    for left in (1, 37):
        _wall(canvas, 18, left, 28, 10)
        _roof(canvas, 6, left - 1, 14, 12, 5)
        _put(canvas, 25, left + 3, _WINDOW)
    _wall(canvas, 20, 15, 26, 18)
    _roof(canvas, 8, 13, 15, 22, 10)
    _put(canvas, 0, 23, _FLAG)
    _put(canvas, 25, 22, _WINDOW)
    _gate(canvas, 33, 19, 13, 10)
    _fill(canvas, 45, 1, 1, 46, "#")
    _fill(canvas, 46, 17, 2, 14, "n")
    _fill(canvas, 46, 18, 1, 12, "M")
    return canvas


def _battlements(canvas: _Canvas, top: int, left: int, width: int) -> None:
    """Merlons along the top of a wall."""
    for x in range(left, left + width - 3, 6):
        _fill(canvas, top, x, 5, 4, "#")
        _fill(canvas, top + 1, x + 1, 4, 2, "m")
        _fill(canvas, top + 1, x + 1, 1, 2, "M")
        _fill(canvas, top + 1, x + 1, 4, 1, "M")


_SHIELD = (
    "M#......#M",
    "mM######Mm",
    ".#OOooop#.",
    ".#OyMMop#.",
    ".#yYMMyp#.",
    ".#OyMMop#.",
    ".#OoMMop#.",
    "..#oooo#..",
    ".MM#op#MM.",
    "MM..##..MM",
)


def _barracks() -> _Canvas:
    canvas = _blank()
    _wall(canvas, 9, 4, 20, 40)
    _battlements(canvas, 5, 4, 40)
    _fill(canvas, 12, 8, 14, 32, "#")
    _roof(canvas, 11, 8, 17, 32, 4)
    _wall(canvas, 28, 4, 18, 40)
    _battlements(canvas, 24, 4, 40)
    for left in (0, 38):
        _wall(canvas, 14, left, 32, 10)
        _battlements(canvas, 10, left, 10)
        _put(canvas, 20, left + 2, _BANNER)
        _put(canvas, 34, left + 3, _WINDOW)
    _gate(canvas, 36, 19, 10, 10)
    _put(canvas, 25, 19, _SHIELD)
    _fill(canvas, 45, 0, 1, 48, "#")
    return canvas


_ANVIL = (
    "..........",
    "###########",
    "#MMMMMMMMm#",
    ".##mmmmm##.",
    "...#mn#....",
    "..#mmmn#...",
    ".#bbbbbb#..",
    ".#BbbbbB#..",
    ".########..",
)
_FORGE = (
    "..########..",
    ".#rrRRRRrr#.",
    "#rrRYYYYRrr#",
    "#rRYYwwYYRr#",
    "#rRYwwwwYRr#",
    "#rRYYwwYYRr#",
    "#rrRYYYYRrr#",
    "#rrrRRRRrrr#",
    "############",
)
_SMOKE = ("..www...", ".wwmww..", "..wmwww.", "....ww..")


def _smithy() -> _Canvas:
    canvas = _blank()
    _wall(canvas, 6, 33, 30, 10, "mna")
    _fill(canvas, 5, 32, 4, 12, "#")
    _fill(canvas, 6, 33, 2, 10, "m")
    _fill(canvas, 6, 33, 1, 10, "M")
    _put(canvas, 1, 34, _SMOKE)
    _wall(canvas, 26, 5, 20, 38, "Mmn")
    _roof(canvas, 12, 2, 17, 33, 8)
    _put(canvas, 35, 27, _FORGE)
    _fill(canvas, 44, 26, 2, 14, "#")
    _gate(canvas, 33, 9, 13, 8)
    _put(canvas, 37, 16, _ANVIL)
    _put(canvas, 30, 20, _WINDOW)
    _fill(canvas, 45, 5, 1, 38, "#")
    return canvas


_FARM = (
    "......####......",
    "....##OOoo##....",
    "..##OOOooopp##..",
    ".#OOOoooooooop#.",
    "#OOOooooooooopp#",
    "#pppppppppppppp#",
    "################",
    "#BBBBBBbbbbbbbb#",
    "#B####BbbbYyYyb#",
    "#B#bb#BbyYyYyYy#",
    "#B#bb#BbYyYyYyy#",
    "#B#bb#BbbyyYyyb#",
    "################",
    ".YyYyYyYyYyYyYy.",
    "yByByByByByByByB",
    ".B.B.B.B.B.B.B.B",
)
_OIL_WELL = (
    "......bOo##.....",
    "......bOoop#....",
    "......bop##.....",
    ".....####.......",
    ".....#Mm#.......",
    "....#M##n#......",
    "....#MMmn#......",
    "....#M##n#.####.",
    "...#M#nm#n#yym#.",
    "...#MMMmmn#####.",
    "...#M#..#n##mn#.",
    "..#M#.nm.#n#mn#.",
    "..#MMMMmmmn#mn#.",
    ".############n#.",
    "#aaaaaaaaaaaaaa#",
    ".##############.",
)


def _site(side: int) -> _Canvas:
    """Bare ground where a building will stand, with corner posts."""
    canvas = _blank(side)
    _fill(canvas, 1, 1, side - 2, side - 2, "B")
    _fill(canvas, 2, 2, side - 4, side - 4, "e")
    for y in range(4, side - 3, 6):
        for x in range(4 + y % 4, side - 4, 9):
            _fill(canvas, y, x, 1, 3, "B")
    return canvas


def _scaffold(side: int) -> _Canvas:
    """Poles and planks before a rising building."""
    canvas = _blank(side)
    poles = (0, side - 3) if side == SMALL_SIDE else (1, side // 3, 2 * side // 3 - 3, side - 4)
    is_great = side == GREAT_SIDE
    for y in range(side // 6, side - 2, 14 if is_great else 6):
        _fill(canvas, y, 0, 3 if is_great else 2, side, "#")
        _fill(canvas, y + 1 if is_great else y, 1, 1, side - 2, "B")
    for x in poles:
        _fill(canvas, 1, x, side - 1, 3, "#")
        _fill(canvas, 2, x + 1, side - 3, 1, "b")
    return canvas


GREAT_BUILDINGS: NDArray[np.uint8] = np.stack([_town_hall(), _barracks(), _smithy()])
SMALL_BUILDINGS: NDArray[np.uint8] = read_sprites((_FARM, _OIL_WELL), LETTERS)
GREAT_SITE, GREAT_SCAFFOLD = _site(GREAT_SIDE), _scaffold(GREAT_SIDE)
SMALL_SITE, SMALL_SCAFFOLD = _site(SMALL_SIDE), _scaffold(SMALL_SIDE)
