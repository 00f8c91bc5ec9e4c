"""The live rating: rises with wins, is marked as dependent on order, survives a resume."""

import pytest

from marl_cair.self_play.live_rating import LiveRating
from marl_cair.self_play.samplers import LATEST_ID


def rate(games):
    rating = LiveRating()
    for opponent, score in games:
        rating.note(opponent, score)
    return rating


def test_wins_raise_it_losses_lower_it_draws_of_equals_leave_it():
    start = LiveRating().read(LATEST_ID)[0]
    assert rate([(1, 1.0)]).read(LATEST_ID)[0] > start > rate([(1, 0.0)]).read(LATEST_ID)[0]
    assert rate([(1, 0.5)]).read(LATEST_ID)[0] == pytest.approx(start)
    rating = rate([(1, 1.0)])
    assert rating.read(1)[0] < start
    assert rating.read(LATEST_ID)[1] < LiveRating().read(LATEST_ID)[1]


def test_its_name_in_the_log_says_that_it_depends_on_the_order_of_games_which_it_does():
    games = [(1, 1.0), (2, 1.0), (1, 0.0), (2, 0.0), (1, 1.0)]
    forward, backward = rate(games).report(), rate(games[::-1]).report()
    assert set(forward) == {"order_dependent_rating", "order_dependent_rating/deviation"}
    assert forward["order_dependent_rating"] != backward["order_dependent_rating"]
    assert LiveRating().report() == {}


def test_a_snapshot_begins_with_the_learners_rating_and_a_saved_one_goes_on():
    rating = rate([(1, 1.0)] * 5)
    rating.freeze(1_000)
    assert rating.read(1_000) == rating.read(LATEST_ID)
    again = LiveRating()
    again.load_state_dict(rating.state_dict())
    for one in (rating, again):
        one.note(1_000, 0.0)
    assert again.report() == rating.report()
