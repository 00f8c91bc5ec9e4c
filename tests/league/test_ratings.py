"""Ratings recover known strengths, and say how sure they are."""

import math

import numpy as np
import pytest

from marl_cair.league.ratings import ELO_PER_LOGIT, rate, score_matrix, win_rate_interval


def simulate(strengths, blocks_per_pair, seed):
    """Games of agents whose chance to win follows Bradley-Terry; two games a block."""
    rng = np.random.default_rng(seed)
    rows = []
    for first in range(len(strengths)):
        for second in range(first + 1, len(strengths)):
            chance = 1 / (1 + math.exp(strengths[second] - strengths[first]))
            for block in range(blocks_per_pair):
                rows += [(first, second, block, float(rng.random() < chance)) for _ in range(2)]
    return np.array(rows)


def test_two_agents_differ_by_the_log_odds_of_their_score():
    games = np.array([(0, 1, block, score) for block in range(200) for score in (1.0, block % 2)])
    best, worst = rate(["a", "b"], games)
    assert (best.name, best.score) == ("a", 0.75)
    assert best.elo - worst.elo == pytest.approx(ELO_PER_LOGIT * math.log(3), rel=0.02)


def test_known_strengths_lie_in_most_of_the_intervals():
    strengths = np.array([0.0, 0.4, 0.8, 1.2])
    truth = ELO_PER_LOGIT * (strengths - strengths.mean())
    covered = 0
    for seed in range(10):
        names = ["a", "b", "c", "d"]
        for rating in rate(names, simulate(strengths, 60, seed), seed):
            true = truth[names.index(rating.name)]
            covered += rating.low <= true <= rating.high
    assert covered >= 34  # of 40; 38 are expected


def test_draws_count_half():
    games = np.array([(0, 1, block, 0.5) for block in range(20)])
    first, second = rate(["a", "b"], games)
    assert first.elo == pytest.approx(second.elo, abs=1e-6)


def test_random_is_the_zero_of_the_scale():
    ratings = rate(["random", "b", "c"], simulate([0.0, 1.0, 2.0], 40, 0))
    zero = next(rating for rating in ratings if rating.name == "random")
    assert (zero.elo, zero.low, zero.high) == (0.0, 0.0, 0.0)
    assert [rating.name for rating in ratings] == ["c", "b", "random"]


def test_an_undefeated_agent_is_marked_as_a_bound():
    games = np.array([(0, 1, block, 1.0) for block in range(20)])
    ratings = {rating.name: rating for rating in rate(["a", "b"], games)}
    assert ratings["a"].is_bound
    assert ratings["b"].is_bound
    assert math.isfinite(ratings["a"].elo)


def test_agents_that_never_met_are_named():
    games = np.array([(0, 1, 0, 1.0), (2, 3, 0, 1.0)])
    with pytest.raises(ValueError, match="no games connect c, d with a: let them play"):
        rate(["a", "b", "c", "d"], games)


def test_the_same_games_give_the_same_ratings():
    games = simulate([0.0, 1.0], 30, 1)
    assert rate(["a", "b"], games, 5) == rate(["a", "b"], games[::-1], 5)


def test_points_are_counted_for_both_sides():
    points, counts = score_matrix(2, np.array([(0, 1, 0, 1.0), (0, 1, 0, 0.5)]))
    assert points.tolist() == [[0.0, 1.5], [0.5, 0.0]]
    assert counts.tolist() == [[0, 2], [2, 0]]


def test_wilson_interval_of_497_wins_in_500_games():
    low, high = win_rate_interval(497, 0, 500)
    assert (round(low, 4), round(high, 4)) == (0.9825, 0.998)


def test_impossible_counts_are_refused():
    with pytest.raises(ValueError, match="3 wins and 0 draws of 2 games cannot be"):
        win_rate_interval(3, 0, 2)
