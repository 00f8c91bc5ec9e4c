"""Diagnostics: cycles, test of fit and Nash averaging, and their wording."""

import dataclasses

import pytest

from marl_cair.league.ratings.diagnostics import NASH, diagnose
from marl_cair.league.ratings.fit import check_fit
from marl_cair.league.ratings.payoffs import find_payoffs
from marl_cair.league.report.wording import describe_cycles, describe_fit
from tests.league.paper_games import from_rows, share, simulate

NAMES = ["paper", "rock", "scissors"]


def find(games):
    size = int(games.agents.max()) + 1
    return diagnose(games, find_payoffs(size, games))


@pytest.fixture(scope="module")
def circle():
    surplus = [[0.0, 9.0, -2.0], [-9.0, 0.0, 9.0], [2.0, -9.0, 0.0]]
    return find(simulate([0.0] * 3, 20, seed=0, surplus=surplus))


def test_a_cycle_is_found_and_described(circle):
    assert [(cycle.agents, cycle.share) for cycle in circle.cycles] == [((0, 1, 2), 0.825)]
    assert circle.fit.p_value == pytest.approx(1 / 300)
    assert "p < 0.004" in describe_fit(circle.fit)
    text = describe_cycles(circle.cycles, NAMES, 2)
    assert "paper beats rock, rock beats scissors, and scissors beats paper" in text
    assert "82%" in text
    assert "paper comes in above rock" in describe_cycles(circle.cycles, NAMES, 4)


def test_averages_are_shares(circle):
    found = circle.averages[NASH]
    assert all(((column >= 0) & (column <= 1)).all() for column in vars(found).values())


def test_few_games_do_not_decide():
    few = check_fit(4, simulate([0.0, 0.2, 0.5, 1.0], 2, seed=0))
    assert "too few games" in describe_fit(few)
    many = describe_fit(dataclasses.replace(few, p_value=0.4, power=0.95))
    assert "p = 0.400" in many
    assert "95%" in many


def test_two_agents_have_no_cycle():
    found = find(from_rows(share(0, 1, 30)))
    assert found.fit is None
    assert found.cycles == ()
