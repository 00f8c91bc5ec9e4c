"""The zero of the scale, and bounds of agents that games do not connect to it."""

import pytest

from marl_cair.league.ratings.rate import ELO_PER_LOGIT, rate
from tests.league.paper_games import (
    from_rows,
    share,
    simulate,
    sweep,
)
from tests.league.ratings.test_rate import by_name


def test_an_agent_that_is_named_is_the_zero_of_ratings_and_intervals():
    games = simulate([0.0, 1.0, 2.0], 40, 0)
    ladder = rate(["random", "b", "c"], games, zero="random")
    assert ladder.zero == "random"
    ratings = {rating.name: rating for rating in ladder.ratings}
    assert ratings["random"].elo == ratings["random"].low == ratings["random"].high == 0.0
    gap = ladder.differences[0][2]
    shown = ratings["c"].elo, ratings["c"].low, ratings["c"].high
    assert shown == pytest.approx((gap.elo, gap.low, gap.high))
    assert [rating.name for rating in ladder.ratings] == ["c", "b", "random"]
    assert ladder.ratings[0].probability_first > 0.95
    assert sum(rating.probability_first for rating in ladder.ratings) == pytest.approx(1.0)


def test_the_zero_and_all_intervals_are_of_the_group_that_is_connected():
    # Neither turtle nor economist lost to rusher or random, but each lost to the other.
    names = ["turtle", "economist", "rusher", "random"]
    rows = [*share(0, 1, 25), *sweep(0, 2), *sweep(0, 3), *sweep(1, 2), *sweep(1, 3)]
    rows += share(2, 3, 30)
    ratings = by_name(names, rows)
    assert {name: rating.bound for name, rating in ratings.items()} == {
        "turtle": "",
        "economist": "",
        "rusher": "upper",
        "random": "upper",
    }
    assert ratings["turtle"].elo == pytest.approx(-ratings["economist"].elo)
    assert ratings["turtle"].low < ratings["turtle"].high
    for name in ("rusher", "random"):
        assert ratings[name].low == ratings[name].high == ratings[name].elo < -100
    assert ratings["turtle"].group == ratings["economist"].group == 0
    assert ratings["rusher"].probability_first == ratings["random"].probability_first == 0.0


def test_an_agent_above_the_connected_group_has_only_a_lower_bound():
    ratings = by_name(["best", "b", "c"], [*sweep(0, 1), *sweep(0, 2), *share(1, 2, 20)])
    assert {name: rating.bound for name, rating in ratings.items()} == {
        "best": "lower",
        "b": "",
        "c": "",
    }
    assert ratings["best"].elo > 300


@pytest.mark.parametrize("games", [40, 80, 160])
def test_more_games_without_a_point_for_random_move_nobody_else(games):
    """`random` was 0 whatever it did: after 40 games the others stood at 405, after 160 at 640."""
    rows = [*share(0, 1, games * 5 // 8, games)]
    rows += [*sweep(0, 2, games), *sweep(1, 2, games)]
    ratings = by_name(["a", "b", "random"], rows)
    assert ratings["a"].elo == pytest.approx(42.65, abs=0.02)
    assert ratings["random"].bound == "upper"


def test_a_zero_that_games_do_not_limit_is_not_taken():
    ladder = rate(
        ["a", "b", "random"],
        from_rows([*share(0, 1, 25), *sweep(0, 2), *sweep(1, 2)]),
        zero="random",
    )
    assert ladder.zero == ""
    assert sum(r.elo for r in ladder.ratings if not r.is_bound) == pytest.approx(0.0, abs=1e-9)


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
    assert alone["random"].elo == pytest.approx(-405, abs=1)
    longer = by_name(["a", "random"], sweep(0, 1, 400))
    assert longer["random"].elo == pytest.approx(-ELO_PER_LOGIT * 4.68, abs=2)


def test_a_chain_of_sweeps_is_ordered():
    rows = [*sweep(0, 1), *sweep(0, 2), *sweep(1, 2)]
    ladder = rate(["a", "random", "c"], from_rows(rows))
    assert [(r.name, r.bound, r.group) for r in ladder.ratings] == [
        ("a", "", 0),
        ("random", "upper", 1),
        ("c", "upper", 2),
    ]
    assert ladder.differences[0][1] is None


def test_the_mean_of_the_largest_group_is_the_zero():
    ratings = by_name(["a", "b", "c"], [*share(0, 1, 30), *sweep(0, 2), *sweep(1, 2)])
    assert [ratings[name].bound for name in "abc"] == ["", "", "upper"]
    assert ratings["a"].elo == pytest.approx(-ratings["b"].elo)
