"""Which ratings exist at all, and how far apart a clean sweep shows two groups to be."""

import numpy as np
import pytest

from marl_cair.league.ratings.groups import ELO_PER_LOGIT, find_gap, find_groups, split_core


def test_a_cycle_is_one_group_and_a_chain_of_sweeps_is_many():
    cycle = np.array([[0, 4, 0], [0, 0, 4], [4, 0, 0]])
    chain = np.array([[0, 4, 4], [0, 0, 4], [0, 0, 0]])
    assert find_groups(cycle) == [[0, 1, 2]]
    assert find_groups(chain) == [[2], [1], [0]]


def test_one_draw_joins_two_groups():
    points = np.array([[0.0, 3.5], [0.5, 0.0]])
    assert find_groups(points) == [[0, 1]]


def test_who_is_above_and_below_the_core():
    points = np.array([[0, 1, 1, 1], [0, 0, 1, 1], [0, 1, 0, 1], [0, 0, 0, 0]])
    core, is_above = split_core(points)
    assert core.tolist() == [False, True, True, False]
    assert is_above[[0, 3]].tolist() == [True, False]


@pytest.mark.parametrize("games", [1, 8, 40])
def test_the_gap_is_where_a_sweep_has_a_chance_of_one_in_forty(games):
    gap = find_gap(np.zeros(1), np.zeros(1), np.array([[games]]))
    chance = 1.0 / (1.0 + np.exp(-gap / ELO_PER_LOGIT))
    assert chance**games == pytest.approx(0.025)


def test_more_games_show_a_larger_gap():
    gaps = [find_gap(np.zeros(1), np.zeros(1), np.array([[n]])) for n in (4, 40, 400)]
    assert gaps == sorted(gaps)
    assert gaps[1] == pytest.approx(405, abs=1)
