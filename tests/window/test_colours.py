"""People who are colour-blind can separate the players' colours."""

from itertools import combinations

import numpy as np
import pytest

from marl_cair.games.deep_line_wars.rendering import SIDE_COLOURS
from marl_cair.games.deep_maze.rendering import PLAYER_COLOURS as MAZE_COLOURS
from marl_cair.games.deep_rts.art.sprites import PLAYER_COLOURS as RTS_COLOURS
from marl_cair.games.flappy_bird.art import BIRD_COLOURS

# Machado, Oliveira and Fernandes (2009), severity 1.0, on linear RGB.
MACHADO = {
    "normal": np.eye(3),
    "deuteranopia": np.array(
        [
            [0.367322, 0.860646, -0.227968],
            [0.280085, 0.672501, 0.047413],
            [-0.011820, 0.042940, 0.968881],
        ]
    ),
    "protanopia": np.array(
        [
            [0.152286, 1.052583, -0.204868],
            [0.114503, 0.786281, 0.099216],
            [-0.003882, -0.048116, 1.051998],
        ]
    ),
}
# sRGB (D65) to XYZ, and the white point.
TO_XYZ = np.array(
    [
        [0.4124564, 0.3575761, 0.1804375],
        [0.2126729, 0.7151522, 0.072175],
        [0.0193339, 0.119192, 0.9503041],
    ]
)
WHITE = TO_XYZ.sum(1)


def to_lab(colours, matrix):
    """CIE L*a*b* [n, 3] of sRGB colours uint8 [n, 3] as a person with that sight sees them."""
    share = colours / 255.0
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    seen = np.clip(linear @ matrix.T, 0.0, 1.0) @ TO_XYZ.T / WHITE
    f = np.where(seen > 0.008856, np.cbrt(seen), 7.787 * seen + 16.0 / 116.0)
    x, y, z = f.T
    return np.stack([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)], 1)


def least_distance(colours, sight):
    lab = to_lab(colours, MACHADO[sight])
    return min(np.linalg.norm(a - b) for a, b in combinations(lab, 2))


# 2.3 is just noticeable, two colours 10 apart are separated at a glance.
LEAST_DISTANCE = 10.0


@pytest.mark.parametrize("sight", MACHADO)
@pytest.mark.parametrize(
    "colours",
    [RTS_COLOURS, SIDE_COLOURS, MAZE_COLOURS, BIRD_COLOURS],
    ids=["deep_rts", "deep_line_wars", "deep_maze", "flappy_bird"],
)
def test_players_have_colours_that_everyone_can_separate(colours, sight):
    assert least_distance(colours, sight) > LEAST_DISTANCE


def test_red_and_green_of_one_lightness_fail_for_the_colour_blind():
    red_and_green = np.array([(200, 110, 40), (130, 146, 40)], np.uint8)
    assert least_distance(red_and_green, "normal") > 40
    assert least_distance(red_and_green, "deuteranopia") < LEAST_DISTANCE
