"""The test of fit calls one number per agent enough where it is, and finds circles where not."""

import itertools

import numpy as np
import pytest
from scipy.stats import binomtest

from marl_cair.league.ratings import fit as fit_module
from marl_cair.league.ratings.fit import check_fit
from tests.league.paper_games import from_rows, make_games, share, simulate, simulate_orders, sweep

STRENGTHS = [-1.5, -0.5, 0.0, 0.4, 1.0]
CIRCLE = [[0.0, 1.0, -1.0], [-1.0, 0.0, 1.0], [1.0, -1.0, 0.0]]  # rock, paper, scissors


def find_rate(monkeypatch, simulations, make=simulate, blocks=8, **options):
    """How many of these simulated leagues are called cyclic, at p <= 0.05 exactly."""
    monkeypatch.setattr(fit_module, "NUM_SIMULATIONS", 99)
    games = (make(STRENGTHS, blocks, seed=seed, **options) for seed in range(simulations))
    return sum(check_fit(5, one, seed).p_value <= 0.05 for seed, one in enumerate(games))


TRANSITIVE = {
    "seats": {"seat": 0.7},
    "maps": {"map_spread": 1.5},
    "draws": {"draws": 0.5},
    "teams": {"make": simulate_orders, "blocks": 24, "num_teams": 4},
}


@pytest.mark.parametrize("case", TRANSITIVE)
def test_transitive_leagues_are_seldom_called_cyclic(monkeypatch, case):
    """In 5 % of the leagues: a rate that 100 leagues do not contradict."""
    cyclic = find_rate(monkeypatch, 100, **TRANSITIVE[case])
    assert binomtest(cyclic, 100, 0.05).pvalue > 0.01


@pytest.mark.slow
@pytest.mark.parametrize("case", [*TRANSITIVE, "plain"])
def test_transitive_leagues_are_called_cyclic_at_the_stated_rate(monkeypatch, case):
    assert 0.025 <= find_rate(monkeypatch, 1_000, **TRANSITIVE.get(case, {})) / 1_000 <= 0.065


@pytest.mark.parametrize("power", [1.0, 9.0])
def test_rock_paper_scissors_is_found(power):
    surplus = power * np.array(CIRCLE)
    found = check_fit(3, simulate([0.0] * 3, 20, seed=0, surplus=surplus))
    assert found.p_value <= 0.01
    assert found.misfit > 2 * found.misfit_by_chance


def test_a_circle_among_others_is_found():
    surplus = np.zeros((6, 6))
    surplus[:3, :3] = 1.5 * np.array(CIRCLE)
    found = check_fit(6, simulate([0.0, 0.0, 0.0, 2.0, -2.0, 1.0], 20, seed=0, surplus=surplus))
    assert found.p_value <= 0.01


def test_a_circle_of_a_free_for_all_is_found():
    """Three play, and who is beaten by the one before comes in below it, in four games of five."""
    rng = np.random.default_rng(0)
    agents = [[0, 1, 2, 3], [1, 2, 0, 3], [2, 0, 1, 3]] * 60
    usual = np.array([1, 2, 4, 3])
    ranks = [usual if rng.random() < 0.8 else rng.permutation(usual) for _ in agents]
    found = check_fit(4, make_games(agents, ranks, np.repeat(np.arange(60), 3)))
    assert found.p_value <= 0.01
    assert found.misfit > 2 * found.misfit_by_chance


def test_few_games_have_little_power_and_many_have_much():
    few, many = (check_fit(5, simulate(STRENGTHS, blocks, seed=0)) for blocks in (2, 100))
    assert few.power < 0.4
    assert many.power > 0.9


def test_without_three_that_all_met_there_is_nothing_to_test():
    assert check_fit(2, from_rows(share(0, 1, 30))) is None
    assert check_fit(4, from_rows([*share(0, 1, 30), *share(0, 2, 30), *share(0, 3, 9)])) is None


def test_agents_that_sweep_all_others_are_no_circle():
    games = from_rows([*sweep(0, 1), *sweep(0, 2), *sweep(1, 2)])
    found = check_fit(3, games)
    assert found.p_value > 0.05
    assert np.isfinite(list(vars(found).values())).all()


def test_two_games_per_pair_that_went_as_expected_are_no_misfit():
    """Most simulations repeat these games: p was 0.005 as rounding put them below the data."""
    pairs = itertools.combinations(range(5), 2)
    found = check_fit(5, from_rows([row for one, two in pairs for row in sweep(one, two, 2)]))
    assert found.p_value > 0.5


def test_the_order_of_the_games_changes_nothing():
    games = simulate(STRENGTHS, 4, seed=1)
    turned = make_games(games.agents[::-1], games.ranks[::-1], 1_000 - games.blocks[::-1])
    assert check_fit(5, games) == check_fit(5, turned)
