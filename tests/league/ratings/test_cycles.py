"""Circles of three are named where they are sure, and seldom where there are none."""

import itertools

import numpy as np
import pytest
from scipy.stats import binomtest

from marl_cair.league.ratings.cycles import find_chance, find_cycles, find_uneven_pairs
from tests.league.paper_games import from_rows, make_games, share, simulate, sweep


def test_the_chance_of_signs_is_that_of_all_signs():
    sums = np.array([2, 2, -1, 0, 1, -2])
    far = [
        abs(np.dot(signs, sums)) >= abs(sums.sum())
        for signs in itertools.product((-1, 1), repeat=6)
    ]
    assert find_chance(sums) == pytest.approx(np.mean(far))


@pytest.mark.parametrize("wins", [0, 7, 10, 16])
def test_of_equal_blocks_it_is_the_sign_test(wins):
    sums = np.array([2] * wins + [-2] * (20 - wins))
    assert find_chance(sums) == pytest.approx(binomtest(wins, 20).pvalue)
    assert find_chance(np.zeros(5, np.int64)) == 1.0


def test_rock_paper_scissors_is_named_once():
    (cycle,) = find_cycles(3, from_rows([*sweep(0, 2), *share(2, 1, 32), *sweep(1, 0)]))
    assert cycle.agents == (0, 2, 1)
    assert cycle.share == 0.8


def test_an_unsure_pair_closes_no_circle():
    assert find_cycles(3, from_rows([*sweep(0, 1), *sweep(1, 2), *share(2, 0, 24)])) == ()


def test_the_clearest_of_many_circles_is_the_first():
    beats = {(0, 1): 40, (1, 2): 40, (2, 0): 40, (0, 3): 34, (3, 1): 20, (3, 2): 34}
    rows = [row for pair, won in beats.items() for row in share(*pair, won)]
    found = find_cycles(4, from_rows(rows))
    assert [cycle.agents for cycle in found] == [(0, 1, 2), (0, 3, 2)]


def test_equal_agents_are_called_uneven_in_5_percent_of_the_leagues():
    leagues = [simulate([0.0] * 6, 10, seed) for seed in range(100)]
    uneven = sum(find_uneven_pairs(6, games)[0].any() for games in leagues)
    assert uneven <= 12  # 5 of 100, and three standard deviations
    assert not any(find_cycles(6, games) for games in leagues)


def test_games_of_one_block_count_as_one():
    """Forty games on one map are no evidence."""
    games = make_games([[0, 1]] * 40, [[1, 2]] * 40, [0] * 40)
    assert not find_uneven_pairs(2, games)[0].any()


def test_no_games_have_no_circles():
    games = make_games(np.zeros((0, 2), int), np.zeros((0, 2)), [])
    assert find_cycles(3, games) == ()
