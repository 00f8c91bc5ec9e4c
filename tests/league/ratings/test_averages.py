"""Nash averaging and alpha-Rank give what is published, with intervals that say how sure it is."""

import sys

import numpy as np
import pytest

from marl_cair.league.ratings import averages as averages_module
from marl_cair.league.ratings.averages import ALPHA_RANK, AVERAGES, NASH, average, find_alpha_rank
from marl_cair.league.ratings.equilibrium import exploitability, maximum_entropy_nash
from marl_cair.league.ratings.payoffs import find_payoffs
from tests.league.leagues import make_games
from tests.league.paper_games import from_rows, simulate, sweep

RPS = np.array([[0.0, -1.0, 1.0], [1.0, 0.0, -1.0], [-1.0, 1.0, 0.0]])
TRANSITIVE = np.array([[0.0, -1.0, -1.0], [1.0, 0.0, -1.0], [1.0, 1.0, 0.0]])
# OpenSpiel's nash_averaging_test.py: the last row dominates.
DOMINATED = np.array(
    [[0.0, 234, 34, -270], [-234, 0, -38, -464], [-34, 38, 0, -270], [270, 464, 270, 0]]
)


def by_nash(payoffs):
    return average(payoffs, AVERAGES[NASH])


def make_cyclic(one, two, three):
    """Rock, paper, scissors in which paper beats rock by one, scissors paper by two, ..."""
    return np.array([[0.0, -one, three], [one, 0.0, -two], [-three, two, 0.0]])


@pytest.mark.parametrize(
    ("payoff", "expected"),
    [
        (RPS, [1 / 3] * 3),
        (TRANSITIVE, [0, 0, 1]),
        (DOMINATED, [0, 0, 0, 1]),
        (make_cyclic(1.0, 2.0, 3.0), [2 / 6, 3 / 6, 1 / 6]),
        (make_cyclic(0.4, 1.0, 0.2), [1.0 / 1.6, 0.2 / 1.6, 0.4 / 1.6]),
        (np.zeros((4, 4)), [1 / 4] * 4),
    ],
)
def test_known_equilibria(payoff, expected):
    assert maximum_entropy_nash(payoff) == pytest.approx(expected, abs=1e-6)


def test_copies_share_what_one_would_have():
    """Invariance to redundant agents, which is what Balduzzi et al. ask for."""
    places = [0, 0, 0, 1, 2, 2]
    found = maximum_entropy_nash(RPS[np.ix_(places, places)])
    assert found == pytest.approx([1 / 9] * 3 + [1 / 3] + [1 / 6] * 2, abs=1e-6)


def test_two_circles_of_equal_worth_are_mixed_evenly():
    """Equilibria without end: the one of highest entropy is even, as OpenSpiel's is."""
    two = np.zeros((6, 6))
    two[:3, :3], two[3:, 3:] = RPS, 5 * RPS
    assert maximum_entropy_nash(two) == pytest.approx([1 / 6] * 6, abs=1e-6)


@pytest.mark.parametrize("size", [3, 8, 30])
def test_equilibria_without_ties_are_exact(size):
    payoff = np.random.default_rng(size).normal(size=(size, size))
    payoff -= payoff.T
    assert exploitability(payoff, maximum_entropy_nash(payoff)) < 1e-7


@pytest.mark.slow
def test_many_agents_of_whom_only_neighbours_have_met():
    """Most payoffs are drawn from all that there can be: each draw is a game of its own, and some
    have equilibria whose rows lose by no more than a program's tolerance.
    """
    found = by_nash(find_payoffs(20, make_games({(n, n + 1): 25 for n in range(19)})))
    assert found.weights.sum() == pytest.approx(1.0)
    assert (found.low <= found.weights).all()
    assert (found.weights <= found.high).all()


def test_the_average_of_one_that_beats_all_is_that_one(monkeypatch):
    monkeypatch.setattr(averages_module, "NUM_SAMPLES", 50)
    games = from_rows([*sweep(0, 1), *sweep(0, 2), *sweep(1, 2)])
    found = by_nash(find_payoffs(3, games))
    assert found.weights == pytest.approx([1, 0, 0], abs=1e-6)
    assert found.skills == pytest.approx([0.5, 0, 0], abs=1e-6)
    assert found.low[0] > 0.9


@pytest.mark.slow
def test_intervals_are_wide_where_games_are_few(monkeypatch):
    """Sect. 2.5 of the notes: the best of a transitive league is often not the estimate's."""
    monkeypatch.setattr(averages_module, "NUM_SAMPLES", 100)
    few, many = (
        by_nash(find_payoffs(4, simulate([0.0, 0.1, 0.2, 0.3], blocks, seed=3)))
        for blocks in (3, 3_000)
    )
    assert (few.high - few.low).max() > 0.8
    assert many.weights[3] > 0.95
    assert many.low[3] > 0.8
    for found in (few, many):
        assert (found.low <= found.weights).all()
        assert (found.skill_low <= found.skills).all()
        assert (found.skills <= found.skill_high).all()
        assert found.weights.sum() == pytest.approx(1.0)


class TestAlphaRank:
    @pytest.fixture(autouse=True)
    def _has_open_spiel(self):
        pytest.importorskip("pyspiel")

    def test_rock_paper_scissors_is_even_and_who_beats_all_has_all(self):
        assert find_alpha_rank(RPS) == pytest.approx([1 / 3] * 3, abs=1e-6)
        assert find_alpha_rank(TRANSITIVE) == pytest.approx([0, 0, 1], abs=1e-6)
        assert find_alpha_rank(np.zeros((1, 1))).tolist() == [1.0]

    def test_no_weight_is_below_0(self, monkeypatch):
        """A table showed -0.0 %: the solver's rounding."""
        solved = None, None, np.array([-1e-9, 0.25, 0.75 + 1e-9]), None, None
        monkeypatch.setattr("open_spiel.python.egt.alpharank.compute", lambda *_, **__: solved)
        weights = find_alpha_rank(np.zeros((3, 3)))
        assert weights.min() == 0.0
        assert not np.signbit(weights).any()
        assert weights.sum() == pytest.approx(1.0)

    def test_the_published_stationary_distribution(self, monkeypatch):
        """Biased rock, paper, scissors: against the closed form of the Markov chain."""
        monkeypatch.setattr(averages_module, "ALPHA", 0.1)
        monkeypatch.setattr(averages_module, "POPULATION", 20)
        payoff = make_cyclic(1.0, 0.1, 0.5)
        stays = (1 - np.exp(-0.1 * 2 * payoff)) / np.where(
            payoff == 0, 1, 1 - np.exp(-0.1 * 20 * 2 * payoff)
        )
        chain = np.where(np.eye(3, dtype=bool), 0.0, stays.T) / 2
        chain += np.diag(1 - chain.sum(1))
        values, vectors = np.linalg.eig(chain.T)
        expected = np.real(vectors[:, np.argmax(np.real(values))])
        assert find_alpha_rank(payoff) == pytest.approx(expected / expected.sum(), abs=1e-6)

    def test_it_has_intervals(self, monkeypatch):
        monkeypatch.setattr(averages_module, "NUM_SAMPLES", 20)
        games = from_rows([*sweep(0, 1), *sweep(1, 2), *sweep(2, 0)])
        found = average(find_payoffs(3, games), AVERAGES[ALPHA_RANK])
        assert found.weights == pytest.approx([1 / 3] * 3)
        assert (found.low <= found.weights).all()
        assert (found.high >= found.weights).all()


def test_without_open_spiel_alpha_rank_says_how_to_get_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "open_spiel.python.egt", None)
    with pytest.raises(ValueError, match=r"pip install 'marl_cair\[openspiel\]'"):
        find_alpha_rank(RPS)
