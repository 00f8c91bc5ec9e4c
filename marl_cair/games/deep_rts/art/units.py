"""The walking units of Deep RTS and the marks around them: pixel art made of letters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.drawing import read_sprites

# . nothing, # outline, o O p the player's colour, its light and its dark shade, m M n metal, s k
# skin, b B wood, y Y brass, h hair, e d horse, w white, a stone, r R ember
LETTERS = ".#oOpmMnskbByYhedwarR"
SIDEWAYS, FRONT, BACK = range(3)  # poses; sideways looks to the right

_PEASANT_SIDE = (
    "................",
    "................",
    "......####......",
    ".....#YYyy#..##.",
    "...##YYyyyy##MM#",
    "..#BBBbbbbbb#Mm#",
    "...###sssk##.#b#",
    "....#hss#s#..#b#",
    "....#hssss#..#b#",
    "....##sss###.#b#",
    "...#OOooop#sssb#",
    "...#OoooopsssbB#",
    "...#ss#oop##.#b#",
    "...#ss#ooop#.##.",
    "....##bb#bb#....",
    ".....########...",
)
_PEASANT_FRONT = (
    "................",
    "................",
    ".....######.....",
    "....#YYyyyy#.##.",
    "..##YYyyyyyb#MM#",
    ".#BBBbbbbbbbb#m#",
    "..###ssssss##b#.",
    "....#s#ss#k##b#.",
    "....#ssssss##b#.",
    "...##kssssk##b#.",
    "..#OOosssoop#b#.",
    "..#OOooooopssb#.",
    "..#ss#Oooop##b#.",
    "..#ss#ooooo#.#..",
    "...##bb##bb#....",
    "....########....",
)
_PEASANT_BACK = (
    "................",
    "................",
    ".....######.....",
    "....#YYyyyy#.##.",
    "..##YYyyyyyb#MM#",
    ".#BBBbbbbbbbb#m#",
    "..###hhhhhh##b#.",
    "....#hhhhhh##b#.",
    "....#khhhhk##b#.",
    "...##kkkkkk##b#.",
    "..#OOooooopp#b#.",
    "..#OOooooopssb#.",
    "..#ss#Oooop##b#.",
    "..#ss#ooooo#.#..",
    "...##bb##bb#....",
    "....########....",
)
_FOOTMAN_SIDE = (
    "....####........",
    "...#OOoo#....#..",
    "...#O#####..#M#.",
    "....#MMmmm#.#M#.",
    "...#MMmmmmn##M#.",
    "...#Mmm####.#M#.",
    "...#mmn#s#s##m#.",
    "...#mmnssss##m#.",
    "...#####s###yyy#",
    "..#OOOo#oop##b#.",
    ".#OOoooo#opss##.",
    ".#OoYYoo#oss#...",
    ".#OoYyop#np#....",
    ".#ooooop#mn#....",
    "..#oopp#mm#n#...",
    "...#########....",
)
_FOOTMAN_FRONT = (
    ".....######.....",
    "....#OOoooo#.#..",
    ".....######.#M#.",
    "....#MMmmmn##M#.",
    "...#MMmmmmmn#M#.",
    "...#M######n#M#.",
    "...#m#s##s#n#m#.",
    "...#mmssssnn#m#.",
    "...###mmnn##yyy#",
    ".#####oooop##b#.",
    "#OOoo#oooopsss#.",
    "#OYYoo#ooop###..",
    "#OYyop#mmnn#....",
    "#oooop#mmnn#....",
    ".#opp#mn##mn#...",
    "..##########....",
)
_FOOTMAN_BACK = (
    ".....######.....",
    "....#OOoooo#.#..",
    ".....######.#M#.",
    "....#MMmmmn##M#.",
    "...#MMmmmmmn#M#.",
    "...#Mmmmmmnn#M#.",
    "...#mmmmmmnn#m#.",
    "...#mmmmmnnn#m#.",
    "...###mmnn##yyy#",
    "..#OOoooooop#b#.",
    ".#mOOooooopsss#.",
    ".#mOOoooooop##..",
    ".#nooooooopp#...",
    "..##mmmmnn##....",
    "...#mmn#mmn#....",
    "...#########....",
)
_ARCHER_SIDE = (
    "................",
    ".....####..##...",
    "....#OOoo##bb#..",
    "...#OOoooo#wbb#.",
    "...#Ooo###.w#b#.",
    "...#oo#sss#w#bb#",
    "...#op#s#s#w##b#",
    "...#oppsss#w##b#",
    ".##########w##b#",
    "#wB#OOoossbbbbMM",
    "#Bb#OooopsswwbM#",
    "#bb#oooop##w##b#",
    ".##bBBbbb#.w#bb#",
    "...#oo#op##wbb#.",
    "...#bb#bb##bb#..",
    "...########.#...",
)
_ARCHER_FRONT = (
    "................",
    ".....#####......",
    "....#OOooo#..##.",
    "...#OOooooo##bB#",
    "...#Oo###op#bB#.",
    "...#o#sss#p#b#w.",
    "...#o#s#s#pb#.w.",
    "...#opsssppb#.w.",
    "..##########..w.",
    ".#OOoooooopsb#w.",
    ".#OOoooooopssbw.",
    ".#ss#ooop##b#.w.",
    "..##bBBbbb#b#.w.",
    "...#oo##op##b#w.",
    "...#bb##bb##bB#.",
    "...########.##..",
)
_ARCHER_BACK = (
    "................",
    ".....#####......",
    "....#OOooo#..##.",
    "...#OOooooo##bB#",
    "...#Ooooopp#bB#.",
    "...#ooooopp#b#w.",
    "...#ooooopp#b#w.",
    "...#opooppp#b#w.",
    "..###w#w#w##b#w.",
    ".#OO#B#B#B#sb#w.",
    ".#OO#bBBb#pssbw.",
    ".#ss#bBbb##b#.w.",
    "..###bBbb#.b#.w.",
    "...#o####p##b#w.",
    "...#bb##bb##bB#.",
    "...########.##..",
)
_CAVALRY_SIDE = (
    "....####......#M",
    "...#MMmm#....#M#",
    "..#MMmmmn#..#B#.",
    "..#Mm#s#s#.#B#..",
    "..#mmnsss##B#...",
    "...######sB##.#.",
    "..#OOooosss##e#.",
    "..#OooopB##eeee#",
    ".##oooop##eee#e#",
    "#d#######deeeee#",
    "#deeOOooodee###.",
    "#d#eOooopeed#...",
    ".##eOooopeed#...",
    "..#deooopddd#...",
    "..#dd#####dd#...",
    "..####....###...",
)
_CAVALRY_FRONT = (
    ".....####....#..",
    "....#MMmm#..#M#.",
    "...#MMmmmn#.#M#.",
    "...#M#s#s##.#B#.",
    "...#mmsssn#.#B#.",
    "..##########.B#.",
    ".#OOoooooop##B#.",
    ".#OoooooooosssB.",
    "..###e##e####B#.",
    "..#O#eeee#p##B#.",
    ".#OoO#ee#opp#B#.",
    ".#Oo#deed#op#B#.",
    ".#oo#eeee#op##..",
    "..##e#dd#d##....",
    "...#dd##dd#.....",
    "...########.....",
)
_CAVALRY_BACK = (
    ".....####....#..",
    "....#MMmm#..#M#.",
    "...#MMmmmn#.#M#.",
    "...#Mmmmmn#.#B#.",
    "...#mmmmnn#.#B#.",
    "..##########.B#.",
    ".#OOoooooop##B#.",
    ".#OOooooooosssB.",
    "..#OOooooop##B#.",
    ".#OOo#hh#oop#B#.",
    ".#Ooo#hh#oop#B#.",
    ".#ooe#hh#eop#B#.",
    "..##e#hh#e###...",
    "...#ed##de#.....",
    "...#dd##dd#.....",
    "...########.....",
)
_POSES = (
    (_PEASANT_SIDE, _PEASANT_FRONT, _PEASANT_BACK),
    (_FOOTMAN_SIDE, _FOOTMAN_FRONT, _FOOTMAN_BACK),
    (_ARCHER_SIDE, _ARCHER_FRONT, _ARCHER_BACK),
    (_CAVALRY_SIDE, _CAVALRY_FRONT, _CAVALRY_BACK),
)
# One picture of each kind and pose: uint8 [kind, pose, side, side].
UNIT_SPRITES: NDArray[np.uint8] = np.stack([read_sprites(poses, LETTERS) for poses in _POSES])

# What a peasant carries and what the panel counts: gold, lumber, stone, oil.
_GOLD = (
    "........",
    "..####..",
    ".#YYyy#.",
    "#YYyyyy#",
    "#Yyyyyb#",
    "#yyyybb#",
    ".#ybbb#.",
    "..####..",
)
_LUMBER = (
    "........",
    ".######.",
    "#BYB###.",
    "#YBYBBb#",
    "#BYBbbb#",
    "#######.",
    "#YBYBbb#",
    "########",
)
_STONE = (
    "........",
    "..####..",
    ".#Mwmm#.",
    "#MMmmmn#",
    "#Mmm#mn#",
    "#mmmmnn#",
    "#mnnnnn#",
    ".######.",
)
_OIL = (
    "...##...",
    "...#n#..",
    "..#nn#..",
    ".#nwnn#.",
    "#nwnnnn#",
    "#nwnnnn#",
    ".#nnnn#.",
    "..####..",
)
_FOOD = (
    "......#.",
    "...##Y#.",
    "..#Y##Y#",
    "..#yY#y#",
    ".#Y#yy#.",
    ".#yyb##.",
    "#Bb##...",
    "##......",
)
_HELMET = (
    "..####..",
    ".#MMmm#.",
    "#MMmmmn#",
    "#M####n#",
    "#m####n#",
    "#mn##nn#",
    ".#m##n#.",
    "..#..#..",
)
_STAR = (
    "...##...",
    "...##...",
    "########",
    "#YYyyyb#",
    ".#Yyyb#.",
    ".#Yyyb#.",
    "#yb##yb#",
    "##....##",
)
_HOURGLASS = (
    "########",
    "#bbbbbb#",
    ".#wYYw#.",
    "..#Yw#..",
    "..#wY#..",
    ".#wYYw#.",
    "#bbbbbb#",
    "########",
)
# [4 resources, then food, units, score, time, 8, 8]
ICONS: NDArray[np.uint8] = read_sprites(
    (_GOLD, _LUMBER, _STONE, _OIL, _FOOD, _HELMET, _STAR, _HOURGLASS), LETTERS
)
FOOD_ICON, UNITS_ICON, SCORE_ICON, TIME_ICON = range(4, 8)
