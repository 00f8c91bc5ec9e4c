"""Groups of agents on one scale: which there are, bounds between them, the zero of the scale."""

import numpy as np
import pytest

from marl_cair.league.ratings.groups import ELO_PER_LOGIT, find_gap, find_groups, split_core
from marl_cair.league.ratings.rate import rate
from tests.league.paper_games import from_rows, share, simulate, sweep


def rate_rows(names, *parts, **options):
    """Ratings by name, and the ladder."""
    ladder = rate(names, from_rows([row for part in parts for row in part]), **options)
    return {rating.name: rating for rating in ladder.ratings}, ladder


def read_bounds(ratings):
    return {name: rating.bound for name, rating in ratings.items()}


@pytest.mark.parametrize(
    ("points", "groups"),
    [
        ([[0, 4, 0], [0, 0, 4], [4, 0, 0]], [[0, 1, 2]]),  # a cycle
        ([[0, 4, 4], [0, 0, 4], [0, 0, 0]], [[2], [1], [0]]),  # sweeps
        ([[0, 3.5], [0.5, 0]], [[0, 1]]),  # a draw
    ],
)
def test_agents_that_took_points_off_each_other_are_a_group(points, groups):
    assert find_groups(np.array(points)) == groups


def test_agents_above_and_below_the_core():
    points = np.array([[0, 1, 1, 1], [0, 0, 1, 1], [0, 1, 0, 1], [0, 0, 0, 0]])
    core, is_above = split_core(points)
    assert core.tolist() == [False, True, True, False]
    assert is_above[[0, 3]].tolist() == [True, False]


def test_the_gap_is_where_a_sweep_has_a_chance_of_one_in_forty():
    gaps = {n: find_gap(np.zeros(1), np.zeros(1), np.array([[n]])) for n in (1, 8, 40)}
    for games, gap in gaps.items():
        assert (1.0 + np.exp(-gap / ELO_PER_LOGIT)) ** -games == pytest.approx(0.025)
    assert gaps[40] == pytest.approx(405, abs=1)


def test_a_named_agent_is_the_zero_of_ratings_and_intervals():
    ladder = rate(["random", "b", "c"], simulate([0.0, 1.0, 2.0], 40, 0), zero="random")
    assert ladder.zero == "random"
    best, _, zero = ladder.ratings
    assert (best.name, zero.name) == ("c", "random")
    assert zero.elo == zero.low == zero.high == 0.0
    gap = ladder.differences[0][2]
    assert (best.elo, best.low, best.high) == pytest.approx((gap.elo, gap.low, gap.high))
    assert best.probability_first > 0.95
    assert sum(rating.probability_first for rating in ladder.ratings) == pytest.approx(1.0)


def test_the_largest_group_has_the_zero_and_intervals():
    # Neither turtle nor economist lost to rusher or random, but each lost to the other.
    names, below = ["turtle", "economist", "rusher", "random"], ("rusher", "random")
    sweeps = [row for above in (0, 1) for lower in (2, 3) for row in sweep(above, lower)]
    ratings, _ = rate_rows(names, share(0, 1, 25), sweeps, share(2, 3, 30))
    assert read_bounds(ratings) == {"turtle": "", "economist": "", **dict.fromkeys(below, "upper")}
    assert ratings["turtle"].elo == pytest.approx(-ratings["economist"].elo)
    assert ratings["turtle"].low < ratings["turtle"].high
    for name in below:
        assert ratings[name].low == ratings[name].high == ratings[name].elo < -100
        assert ratings[name].probability_first == 0.0
    assert [ratings[name].group for name in names] == [0, 0, 1, 1]


def test_an_agent_above_the_largest_group_has_a_lower_bound():
    ratings, _ = rate_rows(["best", "b", "c"], sweep(0, 1), sweep(0, 2), share(1, 2, 20))
    assert read_bounds(ratings) == {"best": "lower", "b": "", "c": ""}
    assert ratings["best"].elo > 300


@pytest.mark.parametrize("games", [40, 160])
def test_more_games_without_a_point_for_random_move_no_other_agent(games):
    """`random` was 0 in any case: after 40 games the others were at 405, after 160 at 640."""
    sweeps = [*sweep(0, 2, games), *sweep(1, 2, games)]
    ratings, _ = rate_rows(["a", "b", "random"], share(0, 1, games * 5 // 8, games), sweeps)
    assert ratings["a"].elo == pytest.approx(42.65, abs=0.02)
    assert ratings["random"].bound == "upper"
    assert ratings["random"].elo < -400


def test_a_zero_outside_the_largest_group_is_not_taken():
    rows = share(0, 1, 25), sweep(0, 2), sweep(1, 2)
    ratings, ladder = rate_rows(["a", "b", "random"], *rows, zero="random")
    assert ladder.zero == ""
    assert ratings["a"].elo == pytest.approx(-ratings["b"].elo)


def test_bounds_do_not_come_from_a_prior():
    """All games against random won: 40 of them show 405 Elo, whichever agents take part."""
    for games, elo in ((40, -405), (400, -ELO_PER_LOGIT * 4.68)):
        ratings, _ = rate_rows(["a", "random"], sweep(0, 1, games))
        assert ratings["random"].elo == pytest.approx(elo, abs=2)


def test_a_chain_of_sweeps_is_ordered():
    _, ladder = rate_rows(["a", "random", "c"], sweep(0, 1), sweep(0, 2), sweep(1, 2))
    assert [(r.name, r.bound, r.group) for r in ladder.ratings] == [
        ("a", "", 0),
        ("random", "upper", 1),
        ("c", "upper", 2),
    ]
    assert ladder.differences[0][1] is None
