"""What the report says beyond the ladder, in words."""

import dataclasses

import pytest

from marl_cair.league.ratings.diagnostics import (
    describe_beyond,
    list_averages,
    list_cycles,
    list_fit,
    look_beyond,
    tell_fit,
)
from marl_cair.league.ratings.fit import check_fit
from marl_cair.league.ratings.payoffs import find_payoffs
from tests.league.paper_games import from_rows, share, simulate

NAMES = ["paper", "rock", "scissors"]


def look(games):
    size = int(games.agents.max()) + 1
    return look_beyond(games, find_payoffs(size, games))


@pytest.fixture(scope="module")
def circle():
    surplus = [[0.0, 9.0, -2.0], [-9.0, 0.0, 9.0], [2.0, -9.0, 0.0]]
    return look(simulate([0.0] * 3, 20, seed=0, surplus=surplus))


def test_a_circle_is_told_in_plain_words(circle):
    text = describe_beyond(circle, NAMES, 2).replace("\n", " ")
    assert "Is one number per agent enough? No (p < 0.004" in text
    assert "read the matrix, not the ladder alone" in text
    told = "paper beats rock, rock beats scissors, and scissors beats paper (with 82% of the points"
    assert f"1 circle of three: {told}" in text
    assert "Nash averaging" in text
    assert text.isascii()


def test_a_circle_of_a_free_for_all_is_told_as_such(circle):
    assert "paper comes in above rock, rock comes" in describe_beyond(circle, NAMES, 4).replace(
        "\n", " "
    )


def test_tables_have_a_row_for_each(circle):
    assert list_cycles(circle, NAMES) == [("paper", "rock", "scissors", "0.8250")]
    rows = list_averages(circle, NAMES)
    assert [row[:2] for row in rows] == [("Nash averaging", name) for name in NAMES]
    assert all(0.0 <= float(cell) <= 1.0 for row in rows for cell in row[2:])
    assert dict(list_fit(circle))["p_value"] == "0.00333333"


def test_too_few_games_are_no_proof_of_anything():
    few = check_fit(4, simulate([0.0, 0.2, 0.5, 1.0], 2, seed=0))
    assert "too few games to tell" in tell_fit(few)
    many = dataclasses.replace(few, p_value=0.4, power=0.95)
    assert tell_fit(many).startswith("Nothing speaks against it (p = 0.400")
    assert "with a chance of about 95%" in tell_fit(many)


def test_two_agents_have_no_circle():
    found = look(from_rows(share(0, 1, 30)))
    text = describe_beyond(found, ["a", "b"], 2)
    assert "Too few pairs have met for a circle to show" in text
    assert "No three agents surely beat each other in a circle" in text
    assert dict(list_fit(found))["p_value"] == ""
