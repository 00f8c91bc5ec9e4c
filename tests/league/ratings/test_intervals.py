"""95 % intervals hold the truth, also with draws, few blocks, and maps that favour one side."""

import numpy as np
import pytest
from scipy import stats

from marl_cair.league.ratings.bootstrap import block_interval
from marl_cair.league.ratings.intervals import mean_interval, median_interval, share_interval


@pytest.mark.parametrize(("wins", "games"), [(0, 10), (3, 7), (40, 40), (497, 500)])
def test_plain_shares_have_the_wilson_interval_of_scipy(wins, games):
    expected = stats.binomtest(wins, games).proportion_ci(0.95, method="wilson")
    assert share_interval(wins, games) == pytest.approx((expected.low, expected.high))


def of_blocks(scores):
    """The interval of two games in each block."""
    return block_interval(np.ravel(scores), np.repeat(np.arange(len(scores)), 2))


def find_width(scores):
    low, high = of_blocks(scores)
    assert low <= np.mean(scores) <= high
    return high - low


def test_seeds_that_decide_both_games_widen_the_interval():
    paired, split = find_width([(0, 0), (1, 1)] * 10), find_width([(0, 1)] * 20)
    drawn = find_width([(0.5, 0.5)] * 20)
    assert 0.05 < split < 0.5 * paired  # 20 blocks do not show that all are split
    assert split == drawn


@pytest.mark.parametrize("blocks", [1, 4, 20])
def test_a_clean_sweep_has_the_interval_of_jeffreys(blocks):
    low, high = of_blocks([(1, 1)] * blocks)
    assert high == 1.0
    assert low == pytest.approx(stats.beta.ppf(0.025, blocks + 0.5, 0.5), abs=0.02)


@pytest.mark.parametrize("blocks", [4, 20])
@pytest.mark.parametrize(
    ("chances", "pairing"),
    [
        ((0.5, 0.0, 0.5), 0.0),
        ((0.5, 0.0, 0.5), 0.5),
        ((0.05, 0.3, 0.65), 0.0),
        ((0.0, 0.8, 0.2), 0.0),
        ((0.2, 0.0, 0.8), 0.5),
        ((0.2, 0.0, 0.8), 1.0),
    ],
)
def test_the_interval_covers_the_true_score(blocks, chances, pairing):
    """chances: of loss, draw and win. pairing: how often the map decides both games."""
    rng, covered = np.random.default_rng(0), 0
    for _ in range(200):
        games = rng.choice([0.0, 0.5, 1.0], size=(blocks, 2), p=chances)
        same = rng.random(blocks) < pairing
        games[same, 1] = games[same, 0]
        low, high = of_blocks(games)
        covered += low <= np.dot(chances, [0.0, 0.5, 1.0]) <= high
    assert covered >= 0.91 * 200


def test_the_interval_of_a_mean_is_students():
    values = np.array([1.0, 2.0, 4.0, 7.0])
    expected = stats.t.interval(0.95, 3, loc=3.5, scale=stats.sem(values))
    assert mean_interval(values) == pytest.approx(expected)
    assert mean_interval(np.array([2.0])) == (-np.inf, np.inf)
    assert mean_interval(np.full(5, 0.25)) == (0.25, 0.25)


def test_the_interval_of_a_median_covers_the_truth_of_skewed_values():
    samples = np.random.default_rng(0).exponential(size=(2_000, 101))
    inside = [low <= np.log(2.0) <= high for low, high in map(median_interval, samples)]
    assert 0.94 < np.mean(inside) < 0.98
    assert median_interval(np.arange(5.0)) == (-np.inf, np.inf)
    assert median_interval(np.arange(6.0)) == (0.0, 5.0)


@pytest.mark.parametrize("find", [mean_interval, median_interval])
def test_no_values_have_no_interval(find):
    with pytest.raises(ValueError, match="no values"):
        find(np.array([]))
