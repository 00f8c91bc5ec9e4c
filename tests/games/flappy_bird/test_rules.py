"""The rules: flight, pipes, crashes, pay, races, wind and time."""

from __future__ import annotations

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.flappy_bird.scenarios import REWARDS
from marl_cair.games.flappy_bird.state import FLAPPED, GLIDING
from marl_cair.games.game import NO_WINNER
from tests.games.flappy_bird.flight import FLAP, NOOP, Flight, Reference

pytestmark = pytest.mark.plain_python


def heights(flight: Flight, actions: list[int]) -> list[float]:
    path = []
    for action in actions:
        flight.play(action)
        path.append(flight.y())
    return path


def test_a_bird_starts_with_a_flap_that_lasts_two_ticks():
    path = heights(Flight(), [NOOP] * 12)
    assert path == [248, 240, 233, 227, 222, 218, 215, 213, 212, 212, 213, 215]


def test_a_bird_falls_at_most_ten_pixels_a_tick_and_a_flap_forgets_the_fall():
    flight = Flight()
    flight.wait(24)
    assert flight.velocity() == 10.0
    flight.play()
    assert flight.velocity() == 10.0
    before = flight.y()
    assert heights(flight, [FLAP, NOOP, NOOP]) == [before - 8, before - 16, before - 23]


def test_a_flap_in_the_tick_after_a_flap_only_brakes():
    flight = Flight()
    flight.wait(12)
    before = flight.y()
    assert heights(flight, [FLAP, FLAP]) == [before - 8, before - 8]
    assert (flight.velocity(), int(flight.world.motion[0])) == (0.0, GLIDING)
    assert heights(flight, [NOOP, NOOP]) == [before - 7, before - 5]


def test_flapping_in_every_second_tick_climbs_eight_pixels_a_tick():
    flight = Flight()
    flight.wait(12)
    before = flight.y()
    assert heights(flight, [FLAP, NOOP] * 3) == [before - 8 * tick for tick in range(1, 7)]


@pytest.mark.parametrize("seed", range(12))
def test_the_classic_game_goes_as_ple_goes(seed):
    """Against the rules written in floats, with flaps that keep near the gap for a while."""
    flight = Flight(seed=seed)
    reference = Reference(gaps=[int(gap) for gap in flight.world.gap_top])
    luck = np.random.default_rng(seed)
    for _ in range(400):
        wants = flight.y() > flight.next_gap() + (60 if seed % 2 else 75)
        flap = wants if luck.random() > 0.03 else bool(luck.random() < 0.5)
        (reward,) = flight.play(int(flap))
        expected = reference.step(flap, flight.world.gap_top.tolist())
        assert (flight.y(), flight.velocity()) == (reference.y, reference.speed)
        np.testing.assert_allclose(flight.pipes(), reference.pipes, atol=1e-6)
        assert (reward, flight.is_over()) == (expected, reference.over)
        if flight.is_over():
            break


def test_pipes_start_144_apart_and_come_back_at_the_right():
    flight = Flight()
    assert flight.pipes() == [340, 484, 628]
    for _ in range(98):
        flight.hover()
        flight.play()
    assert flight.pipes() == [-52, 92, 236]
    for _ in range(2):
        flight.hover()
        flight.play()
    assert flight.pipes() == [393.6, 84, 228]


def test_gaps_are_drawn_evenly_from_25_to_192():
    engine = make_engine("flappy_bird", num_worlds=4_000)
    engine.reset(np.arange(4_000, dtype=np.uint64))
    gaps = engine._worlds.gap_top
    assert (gaps.min(), gaps.max()) == (25, 192)
    counts = np.bincount(gaps.ravel())[25:]
    assert len(counts) == 168
    assert counts.min() > 30
    assert counts.max() < 120


@pytest.mark.parametrize(
    ("x", "gap", "y", "crashes"),
    [
        # A pipe is touched from half a bird deep until it is left behind.
        *((x, 192, 192, crashes) for x, crashes in ((31, 0), (32, 1), (99.99, 1), (100, 0))),
        # A bird must be wholly within the gap.
        *((60, 100, y, crashes) for y, crashes in ((100, 1), (100.01, 0), (176, 0), (176.01, 1))),
        # The ground and the upper edge kill.
        *((500, 100, y, crashes) for y, crashes in ((0, 1), (0.01, 0), (380, 0), (381, 1))),
    ],
)
def test_a_bird_crashes_at_edges_of_pipes_and_of_the_screen(x, gap, y, crashes):
    flight = Flight()
    flight.wait(1)
    flight.world.pipe_x[:] = [round(x * 100), 60_000, 70_000]
    flight.world.gap_top[0] = gap
    flight.world.bird_y[0] = round(y * 100)
    flight.play()
    assert flight.is_over() == crashes
    assert flight.world.tick[0] == 2


# Two pipes passed and then a crash on the ground, decision by decision.
PAY = {  # for a pipe, a crash and a tick
    "classic": (1.0, -5.0, 0.0),
    "unit": (1.0, -1.0, 0.0),
    "thesis": (np.float32(0.1), 0.0, 0.0),
    "alive": (1.0, -1.0, np.float32(0.1)),
    "sparse": (0.0, -1.0, 0.0),
}


def test_every_reward_is_tested_and_the_classic_one_rates_play():
    assert list(PAY) == list(REWARDS)


@pytest.mark.parametrize("reward", REWARDS)
def test_pay_by_the_tick(reward):
    """The first pipe is at the bird after 65 ticks of 4 pixels, which the 66th sees."""
    flight = Flight(reward=reward)
    pipe_pay, crash_pay, tick_pay = PAY[reward]
    for tick in range(1, 121):
        flight.hover()
        (paid,) = flight.play()
        expected = np.float32(tick_pay)
        if tick in (66, 102):
            expected += np.float32(pipe_pay)
        assert np.float32(paid) == expected, tick
    assert flight.world.pipes_passed[0] == 2
    flight.world.bird_y[0] = 38_500
    (paid,) = flight.play()
    assert np.float32(paid) == np.float32(tick_pay) + np.float32(crash_pay)
    assert flight.play() == [0.0]


def test_a_pipe_is_paid_even_in_the_tick_of_a_crash():
    flight = Flight()
    flight.wait(1)
    flight.world.pipe_x[:] = [8_300, 60_000, 70_000]
    flight.world.bird_y[0] = 39_000
    assert flight.play() == [-4.0]


@pytest.mark.parametrize("speed", [1.0, 2.7, 4.0, 7.3])
def test_each_pipe_is_passed_once_at_any_speed(speed):
    flight = Flight(pipe_gap=200, pipe_speed=speed, max_ticks=2_000)
    for _ in range(int(1_000 / speed)):
        flight.hover()
        flight.play()
    # The first is passed after 257 pixels, then one for every 144 and more.
    assert flight.world.pipes_passed[0] in (5, 6)
    assert flight.engine.info()["pipes_passed"].tolist() == [[flight.world.pipes_passed[0]]]


def test_a_step_of_several_ticks_flaps_once_and_sums_the_pay():
    one, three = Flight(reward="alive"), Flight(reward="alive", ticks_per_step=3)
    for _ in range(10):
        paid = np.float32(0)
        for tick in range(3):
            paid += np.float32(one.play(FLAP if tick == 0 and one.world.tick[0] else NOOP)[0])
        first = three.world.tick[0] == 0
        assert np.float32(three.play(NOOP if first else FLAP)[0]) == paid
        assert one.y() == three.y()


def test_a_flap_is_legal_where_it_changes_something():
    """Everywhere but in the first tick, when the bird flaps by itself, and after the end."""
    flight = Flight()
    assert not flight.can_flap()
    flight.play(FLAP)
    assert flight.engine.illegal_actions.tolist() == [[1]]
    assert flight.y() == 248
    luck = np.random.default_rng(0)
    while not flight.is_over():
        assert flight.can_flap()
        saved = flight.engine.snapshot()
        outcomes = []
        for action in (NOOP, FLAP):
            flight.engine.restore(saved)
            flight.play(action)
            outcomes.append((flight.y(), flight.velocity(), int(flight.world.motion[0])))
        assert outcomes[0] != outcomes[1]
        flight.engine.restore(saved)
        flight.play(int(luck.random() < 0.1))
    assert not flight.can_flap()
    flight.play(FLAP)
    assert flight.engine.illegal_actions.tolist() == [[1]]


def crash(flight: Flight, *players: int) -> list[float]:
    flight.hover()
    for player in players:
        flight.world.bird_y[player] = 39_000
    return flight.play()


def test_the_last_one_flying_wins_a_race():
    flight = Flight("race-4")
    flight.wait(1)
    assert crash(flight, 2) == [0, 0, -5, 0]
    assert flight.engine.eliminated[0].tolist() == [False, False, True, False]
    assert not flight.is_over()
    assert crash(flight, 0) == [-5, 0, 0, 0]
    assert crash(flight, 1) == [0, -5, 0, 0]
    assert flight.engine.terminated[0]
    assert flight.engine.winner[0] == 3


def test_a_bird_that_is_out_cannot_act_and_is_paid_nothing():
    flight = Flight("race-4", reward="alive")
    flight.wait(1)
    crash(flight, 1)
    height = flight.y(1)
    assert [flight.can_flap(player) for player in range(4)] == [True, False, True, True]
    flight.hover(0, 2, 3)
    assert flight.play(NOOP, FLAP, NOOP, NOOP)[1] == 0.0
    assert flight.y(1) == height
    assert flight.engine.illegal_actions.tolist() == [[0, 1, 0, 0]]


@pytest.mark.parametrize(
    ("crashed", "paid", "winner"), [((0, 1), [-1, -1], NO_WINNER), ((0,), [-1, 1], 1)]
)
def test_the_sparse_reward_pays_the_winner_and_birds_that_crash_together_draw(
    crashed, paid, winner
):
    flight = Flight("race-2", reward="sparse")
    flight.wait(1)
    assert crash(flight, *crashed) == paid
    assert (flight.engine.terminated[0], flight.engine.winner[0]) == (True, winner)


def test_time_truncates_without_a_winner():
    flight = Flight("race-2", max_ticks=30)
    for _ in range(30):
        assert not flight.is_over()
        flight.hover()
        flight.play()
    assert (flight.engine.truncated[0], flight.engine.terminated[0]) == (True, False)
    assert flight.engine.winner[0] == NO_WINNER


def test_seats_are_alike():
    """The same flaps in other seats give the same game with the seats exchanged."""
    luck = np.random.default_rng(4)
    straight, turned = Flight("race-4-windy", seed=5), Flight("race-4-windy", seed=5)
    order = [2, 0, 3, 1]
    while not straight.is_over():
        flaps = (luck.random(4) < (0.08, 0.12, 0.05, 0.2)).astype(int)
        paid = straight.play(*flaps.tolist())
        assert turned.play(*flaps[order].tolist()) == [paid[seat] for seat in order]
        assert turned.engine.eliminated[0].tolist() == [
            bool(straight.engine.eliminated[0, seat]) for seat in order
        ]
    assert turned.is_over()


def test_wind_moves_all_birds_alike_and_leaves_the_course_as_it_is():
    calm, windy = Flight(pipe_gap=110), Flight("windy")
    windy.play()  # the first flap is as strong in the wind
    assert (windy.world.motion[0], windy.velocity()) == (FLAPPED, -8.0)
    calm.play()
    winds = [int(windy.world.wind[0])]
    for _ in range(399):
        calm.hover()
        windy.hover()
        calm.play()
        before = windy.y()
        windy.play()
        winds.append(int(windy.world.wind[0]))
        assert windy.y() == round(before + 1 + winds[-1] / 100, 2)
        assert windy.world.gap_top.tolist() == calm.world.gap_top.tolist()
    assert -150 <= min(winds) <= max(winds) <= 150
    lasted = np.diff(np.flatnonzero(np.diff(winds)))
    # Two gusts of one strength may follow each other.
    assert 15 <= lasted.min() <= lasted.max() <= 90
