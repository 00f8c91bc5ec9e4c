"""What birds see as numbers is what is there: PLE's eight, the features, the planes."""

from __future__ import annotations

import numpy as np
import pytest

import marl_cair
from marl_cair.games.flappy_bird.observation import (
    FEATURE_NAMES,
    FIRST_UNIFORM,
    HAS_FLAPPED,
    OTHERS_FLYING,
    PLANE_NAMES,
    VECTOR_NAMES,
    WIND,
)
from marl_cair.games.parallel_env import GameParallelEnv
from tests.games.flappy_bird.flight import FLAP, Flight

pytestmark = pytest.mark.plain_python


def test_the_vector_holds_ples_eight_numbers_in_pixels():
    flight = Flight()
    flight.wait(5)
    flight.world.gap_top[:] = [40, 100, 150]
    # Distances are to the right edges of the pipes, from the bird's left: x + 26 - 57.
    expected = [222, -5, 320 - 31, 40, 140, 464 - 31, 100, 200]
    assert flight.seen("vector").tolist() == expected
    assert len(VECTOR_NAMES) == 8


def test_the_next_pipe_is_the_one_not_yet_left_behind():
    flight = Flight()
    flight.wait(1)
    flight.world.pipe_x[:] = [3_200, 17_600, 32_000]
    flight.world.gap_top[:] = [40, 100, 150]
    assert flight.seen("vector")[2:].tolist() == [1, 40, 140, 145, 100, 200]
    flight.world.pipe_x[:] = [3_100, 17_600, 32_000]
    assert flight.seen("vector")[2:].tolist() == [145, 100, 200, 289, 150, 250]
    flight.world.pipe_x[:] = [39_360, 8_400, 22_800]
    np.testing.assert_allclose(flight.seen("vector")[[2, 5]], [53, 197])


def test_features_are_the_vector_scaled_and_more():
    flight = Flight("race-4-windy")
    for _ in range(20):
        flight.hover()
        flight.play(FLAP, 0, 0, 0) if flight.world.tick[0] else flight.play()
    vector, features = flight.seen("vector"), flight.seen("features")
    scales = [512, 10, 288, 512, 512, 288, 512, 512]
    np.testing.assert_allclose(features[[0, 1, 4, 5, 6, 7, 8, 9]] * scales, vector, rtol=1e-6)
    assert features[HAS_FLAPPED] == 1.0
    assert flight.seen("features", 1)[HAS_FLAPPED] == 0.0
    assert features[WIND] * 300 == pytest.approx(int(flight.world.wind[0]), abs=1e-3)
    assert features[OTHERS_FLYING] == pytest.approx(3 / 7)
    assert features[-1] == pytest.approx(1 - 20 / 6_000)
    assert len(FEATURE_NAMES) == len(features)


def test_two_states_of_one_vector_are_different_features():
    """PLE's numbers do not show whether the bird rises without gravity in the next tick."""
    first, second = Flight(), Flight()
    first.wait(1)
    second.wait(2)
    second.world.bird_y[:] = first.world.bird_y
    second.world.pipe_x[:] = first.world.pipe_x
    assert np.array_equal(first.seen("vector"), second.seen("vector"))
    assert first.seen("features")[HAS_FLAPPED] != second.seen("features")[HAS_FLAPPED]
    for representation in ("image", "gray", "planes"):
        assert not np.array_equal(first.seen(representation), second.seen(representation))


@pytest.mark.parametrize("hovers", [False, True])
def test_numbers_stay_within_their_bounds_in_a_storm(hovers):
    luck, flight = np.random.default_rng(0), Flight("storm")
    while not flight.is_over() and flight.world.tick[0] < 150:
        if hovers:
            flight.hover()
        flight.play(int(luck.random() < 0.2))
        for name in ("vector", "features"):
            low, high = flight.engine.representation(name).bounds()
            seen = flight.engine.observe(name)
            assert ((low <= seen) & (seen <= high)).all()


def covered(plane: np.ndarray) -> float:
    """Pixels; each cell holds 255ths of 256, rounded down."""
    return float(plane.sum(dtype=np.int64)) * 256 / 255


@pytest.mark.parametrize("y", [100, 107, 111, 112])
def test_planes_show_the_height_of_a_bird_to_the_pixel(y):
    flight = Flight()
    flight.wait(1)
    flight.world.bird_y[0] = y * 100
    plane = flight.seen("planes")[0].astype(int)
    rows, columns = np.nonzero(plane)
    assert (rows.min(), rows.max()) == (y // 16, (y + 23) // 16)
    assert (columns.min(), columns.max()) == (3, 5)
    first = min(16, (y // 16 + 1) * 16 - y)
    assert plane[y // 16, 4] == 255 * first * 16 // 256
    assert covered(plane) == pytest.approx(34 * 24, abs=9)


def test_planes_show_where_pipes_are():
    flight = Flight()
    flight.world.pipe_x[:] = [10_000, 24_400, 38_800]
    flight.world.gap_top[:] = [64, 96, 150]
    plane = flight.seen("planes")[2]
    assert (plane[:4, 5:7] == 255).all()
    assert plane[0, 4] == 255 * 6 // 16
    assert plane[0, 7] == 255 * 14 // 16
    assert (plane[4:10, 4:8] == 0).all()
    assert plane[10, 5] == 255 * 12 // 16
    assert (plane[26:] == 0).all()


def test_planes_show_other_birds_apart_until_they_crash():
    flight = Flight("race-2")
    flight.wait(1)
    flight.world.bird_y[:] = [6_400, 16_000]
    own, other = flight.seen("planes", 0)[:2], flight.seen("planes", 1)[:2]
    assert np.array_equal(own[0], other[1])
    assert np.array_equal(own[1], other[0])
    flight.world.crash_tick[1] = 1
    assert not flight.seen("planes", 0)[1].any()


def test_uniform_planes_hold_their_numbers():
    flight = Flight("windy", max_ticks=100)
    for _ in range(20):
        flight.hover()
        flight.play(FLAP if flight.world.tick[0] else 0)
    seen = flight.seen("planes")[FIRST_UNIFORM:]
    assert len(PLANE_NAMES) == FIRST_UNIFORM + len(seen)
    values = [int(plane[0, 0]) for plane in seen]
    wind = 128 + 127 * int(flight.world.wind[0]) // 300
    assert values == [0, 255, wind, 0, 255 * 80 // 100]
    assert all((plane == value).all() for plane, value in zip(seen, values, strict=True))


def test_environments_know_that_numbers_go_below_zero():
    space = GameParallelEnv("flappy_bird", representation="vector").observation_space("player_0")
    assert space.low.tolist() == [-64, -12, 0, 0, 0, 0, 0, 0]
    assert space.high.tolist() == [512, 12, 400, 512, 512, 600, 512, 512]
    spec = marl_cair.make_torchrl_env("flappy_bird", representation="features").observation_spec
    assert (spec["player", "observation"].space.low[..., 3] == -1).all()
    assert (spec["player", "observation"].space.low[..., 4:] == 0).all()
