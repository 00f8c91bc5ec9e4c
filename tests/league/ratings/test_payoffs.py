"""The payoff matrix: counts, and intervals that hold what is true and never end in nothing."""

import numpy as np

from marl_cair.league.ratings.payoffs import find_payoffs
from tests.league.paper_games import (
    from_rows,
    make_games,
    share,
    simulate,
    simulate_orders,
    sweep,
)


def test_points_and_games_are_counted_for_both_sides():
    found = find_payoffs(3, from_rows([*share(0, 1, 30), *share(2, 0, 10)]))
    assert found.points.tolist() == [[0, 30, 30], [10, 0, 0], [10, 0, 0]]
    assert found.counts.tolist() == [[0, 40, 40], [40, 0, 0], [40, 0, 0]]
    assert found.shares[0, 1] == 0.75
    assert found.shares[1, 2] == 0.5  # they never met


def test_a_pair_that_never_met_may_have_any_score():
    found = find_payoffs(3, from_rows([*share(0, 1, 30), *share(2, 0, 10)]))
    assert found.low[1, 2] < 0.01
    assert found.high[1, 2] > 0.99


def test_a_clean_sweep_is_no_certainty():
    few, many = (find_payoffs(2, from_rows(sweep(0, 1, games))) for games in (8, 80))
    assert few.high[0, 1] == many.high[0, 1] == 1.0
    assert 0.4 < few.low[0, 1] < 0.7
    assert 0.9 < many.low[0, 1] < 0.96


def test_what_one_gains_the_other_loses():
    found = find_payoffs(4, simulate([0.0, 1.0, 2.0, 0.5], 6, seed=0))
    assert np.allclose(found.samples + found.samples.swapaxes(1, 2), 1.0)
    assert np.allclose(found.low + found.high.T, 1.0)
    assert np.isfinite(found.samples).all()
    assert (found.low <= found.shares).all()
    assert (found.shares <= found.high).all()


def test_in_a_free_for_all_the_row_came_in_above_the_column():
    games = make_games([[0, 1, 2], [2, 0, 1]], [[1, 2.5, 2.5], [1, 3, 2]], [0, 0])
    found = find_payoffs(3, games)
    assert found.points.tolist() == [[0, 1, 1], [1, 0, 0.5], [1, 1.5, 0]]
    assert found.draws.tolist() == [[0, 0, 0], [0, 0, 1], [0, 1, 0]]
    many = find_payoffs(5, simulate_orders([0.0, 0.5, 1.0, 1.5, 2.0], 40, 4, seed=0))
    assert (many.low[4, :4] > 0.5).all()


def test_repeats_are_reported_and_not_counted():
    games = make_games([[0, 1]] * 3, [[1, 2]] * 3, [0, 1, 2], [False, True, True])
    found = find_payoffs(2, games)
    assert found.counts[0, 1] == 1
    assert found.repeats[0, 1] == found.repeats[1, 0] == 2


def test_the_order_of_the_games_changes_nothing():
    games = simulate([0.0, 1.0, 2.0], 5, seed=1)
    turned = make_games(games.agents[::-1], games.ranks[::-1], 100 - games.blocks[::-1])
    assert (find_payoffs(3, games).samples == find_payoffs(3, turned).samples).all()


def test_agents_can_be_put_in_another_order():
    found = find_payoffs(3, simulate([0.0, 1.0, 2.0], 5, seed=1))
    turned = found.reorder(np.array([2, 0, 1]))
    assert turned.points[0, 1] == found.points[2, 0]
    assert (turned.samples[:, 0, 2] == found.samples[:, 2, 1]).all()
