"""Intervals of scores cover the truth, with draws and with seeds that favour one side."""

import numpy as np
import pytest
from scipy import stats
from scipy.stats import binomtest

from marl_cair.league.ratings.intervals import (
    block_interval,
    mean_interval,
    median_interval,
    win_rate_interval,
)


def test_wilson_interval_of_497_wins_in_500_games():
    low, high = win_rate_interval(497, 0, 500)
    assert (round(low, 4), round(high, 4)) == (0.9825, 0.998)


@pytest.mark.parametrize(("wins", "games"), [(0, 10), (3, 7), (40, 40), (1, 1), (250, 500)])
def test_without_draws_it_is_wilsons_of_scipy(wins, games):
    expected = binomtest(wins, games).proportion_ci(0.95, method="wilson")
    assert win_rate_interval(wins, 0, games) == pytest.approx((expected.low, expected.high))


def test_half_points_are_not_rounded():
    # 1 win and 3 draws of 4 games are 2.5 points, not 2.
    low, high = win_rate_interval(1, 3, 4)
    assert low < 0.625 < high
    assert win_rate_interval(0, 3, 4) == pytest.approx((1.0 - high, 1.0 - low))


def test_draws_narrow_the_interval():
    drawn, decided = win_rate_interval(0, 40, 40), win_rate_interval(20, 0, 40)
    assert drawn[1] - drawn[0] < 0.5 * (decided[1] - decided[0])
    assert drawn[0] < 0.48  # though not to a point: 40 games do not show that all are drawn


def test_impossible_counts_are_refused():
    with pytest.raises(ValueError, match="3 wins and 0 draws of 2 games cannot be"):
        win_rate_interval(3, 0, 2)
    with pytest.raises(ValueError, match="must be one or more numbers in 0..1"):
        block_interval(np.array([]))


def test_seeds_that_decide_both_games_widen_the_interval():
    paired = block_interval(np.array([0.0, 1.0] * 10))
    split = block_interval(np.full(20, 0.5))
    single = win_rate_interval(20, 0, 40)
    assert split[1] - split[0] < single[1] - single[0] < paired[1] - paired[0]


def test_a_clean_sweep_counts_its_games():
    assert block_interval(np.ones(20)) == pytest.approx(win_rate_interval(40, 0, 40))


@pytest.mark.parametrize("draws", [0.0, 0.3, 0.8])
@pytest.mark.parametrize("edge", [0.0, 0.9])
@pytest.mark.parametrize("pairing", [0.0, 0.5])
def test_the_interval_covers_the_true_score(draws, edge, pairing):
    chances = np.array([(1 - draws) * (1 - edge) / 2, draws, (1 - draws) * (1 + edge) / 2])
    true_score = float(chances @ [0.0, 0.5, 1.0])
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(400):
        games = rng.choice([0.0, 0.5, 1.0], size=(20, 2), p=chances)
        same = rng.random(20) < pairing  # the map decides both games
        games[same, 1] = games[same, 0]
        low, high = block_interval(games.mean(1))
        covered += low <= true_score <= high
    assert covered >= 0.92 * 400


def test_the_interval_of_a_mean_is_students():
    values = np.array([1.0, 2.0, 4.0, 7.0])
    expected = stats.t.interval(0.95, 3, loc=3.5, scale=stats.sem(values))
    assert mean_interval(values) == pytest.approx(expected)
    assert mean_interval(np.array([2.0])) == (-np.inf, np.inf)
    assert mean_interval(np.full(5, 0.25)) == (0.25, 0.25)
    with pytest.raises(ValueError, match="there are no values"):
        mean_interval(np.array([]))


def test_the_interval_of_a_median_covers_the_truth_of_skewed_values():
    rng = np.random.default_rng(0)
    samples = rng.exponential(size=(2_000, 101))
    inside = [low <= np.log(2.0) <= high for low, high in map(median_interval, samples)]
    assert 0.94 < np.mean(inside) < 0.98


def test_the_median_of_few_values_is_not_known():
    assert median_interval(np.arange(5.0)) == (-np.inf, np.inf)
    assert median_interval(np.arange(6.0)) == (0.0, 5.0)
    with pytest.raises(ValueError, match="no values"):
        median_interval(np.array([]))
