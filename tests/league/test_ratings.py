"""Ratings recover known strengths, and say how sure they are."""

import math

import choix
import numpy as np
import pytest

from marl_cair.league.ratings import ELO_PER_LOGIT, rate, score_matrix


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


def sweep(winner, loser, num_games=40):
    return [(winner, loser, game // 2, 1.0) for game in range(num_games)]


def share(first, second, wins, num_games=40):
    """`wins` of the games go to the first, in mixed blocks."""
    return [(first, second, game // 2, float(game < wins)) for game in range(num_games)]


def by_name(names, rows, **options):
    return {rating.name: rating for rating in rate(names, np.array(rows, float), **options)}


def test_two_agents_differ_by_the_log_odds_of_their_score():
    games = np.array([(0, 1, block, score) for block in range(200) for score in (1.0, block % 2)])
    best, worst = rate(["a", "b"], games)
    assert (best.name, best.score) == ("a", 0.75)
    assert best.elo - worst.elo == pytest.approx(ELO_PER_LOGIT * math.log(3), abs=1e-3)


def test_ratings_are_those_of_the_largest_likelihood_without_a_prior():
    games = simulate([0.0, 1.5, 3.0, 4.5], 40, 2)
    names = ["a", "b", "c", "d"]
    points, _ = score_matrix(4, games)
    wins = [(int(i), int(j)) for i, j in np.argwhere(points) for _ in range(int(points[i, j]))]
    expected = ELO_PER_LOGIT * choix.opt_pairwise(4, wins)
    ratings = by_name(names, games)
    assert [ratings[name].elo for name in names] == pytest.approx(expected, abs=0.1)


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
    assert zero.elo == 0.0
    assert zero.low < 0.0 < zero.high
    assert [rating.name for rating in ratings] == ["c", "b", "random"]


def test_an_agent_that_never_lost_to_the_rest_has_only_a_lower_bound():
    # Neither turtle nor economist lost to rusher or random, but each lost to the other.
    names = ["turtle", "economist", "rusher", "random"]
    rows = [*share(0, 1, 25), *sweep(0, 2), *sweep(0, 3), *sweep(1, 2), *sweep(1, 3)]
    rows += share(2, 3, 30)
    ratings = by_name(names, rows)
    assert {name: rating.bound for name, rating in ratings.items()} == {
        "turtle": "lower",
        "economist": "lower",
        "rusher": "",
        "random": "",
    }
    assert ratings["turtle"].score < 1.0
    assert ratings["turtle"].is_bound
    assert ratings["turtle"].group == ratings["economist"].group == 0
    difference = ratings["turtle"].elo - ratings["economist"].elo
    assert difference == pytest.approx(ELO_PER_LOGIT * math.log(25 / 15), abs=0.01)


def test_an_agent_that_never_won_off_the_rest_has_only_an_upper_bound():
    names = ["random", "b", "worst"]
    ratings = by_name(names, [*share(0, 1, 20), *sweep(0, 2), *sweep(1, 2)])
    assert {name: rating.bound for name, rating in ratings.items()} == {
        "random": "",
        "b": "",
        "worst": "upper",
    }
    assert ratings["worst"].elo < -400


def test_bounds_do_not_come_from_a_prior():
    """All games against random won: 40 of them show 405 Elo, whoever else takes part."""
    alone = by_name(["a", "random"], sweep(0, 1))
    assert alone["a"].elo == pytest.approx(405, abs=1)
    longer = by_name(["a", "random"], sweep(0, 1, 400))
    assert longer["a"].elo == pytest.approx(ELO_PER_LOGIT * 4.68, abs=2)


def test_a_chain_of_sweeps_is_ordered():
    names = ["a", "random", "c"]
    ratings = rate(names, np.array([*sweep(0, 1), *sweep(0, 2), *sweep(1, 2)]))
    assert [(r.name, r.bound, r.group) for r in ratings] == [
        ("a", "lower", 0),
        ("random", "", 1),
        ("c", "upper", 2),
    ]


def test_without_random_the_largest_group_is_the_zero():
    ratings = by_name(["a", "b", "c"], [*share(0, 1, 30), *sweep(0, 2), *sweep(1, 2)])
    assert [ratings[name].bound for name in "abc"] == ["", "", "upper"]
    assert ratings["a"].elo == pytest.approx(-ratings["b"].elo)


def test_an_agent_saved_by_one_game_has_no_upper_end():
    ratings = by_name(["a", "b", "random"], [*share(0, 1, 39), *sweep(0, 2), *share(1, 2, 20)])
    assert ratings["a"].bound == ""
    assert ratings["a"].high == math.inf
    assert math.isfinite(ratings["a"].low)


def test_agents_that_never_met_are_named():
    games = np.array([(0, 1, 0, 1.0), (2, 3, 0, 1.0)])
    with pytest.raises(ValueError, match="no games compare a, b with c: let them play"):
        rate(["a", "b", "c", "d"], games)


def test_the_same_games_give_the_same_ratings():
    games = simulate([0.0, 1.0], 30, 1)
    assert rate(["a", "b"], games, 5) == rate(["a", "b"], games[::-1], 5)


def test_points_are_counted_for_both_sides():
    points, counts = score_matrix(2, np.array([(0, 1, 0, 1.0), (0, 1, 0, 0.5)]))
    assert points.tolist() == [[0.0, 1.5], [0.5, 0.0]]
    assert counts.tolist() == [[0, 2], [2, 0]]
