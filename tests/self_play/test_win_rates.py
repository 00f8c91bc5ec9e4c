"""Win records and the betting test: a prior, weights by age, counts, and resuming."""

import numpy as np
import pytest

from marl_cair.league.ratings.intervals import share_interval
from marl_cair.self_play.win_rates import BettingTest, Evidence, WinRecords


def test_estimates_start_from_even_games():
    records = WinRecords(half_life_frames=100, prior_games=2)
    assert records.estimate(7, 0) == 0.5
    assert (records.evidence(7, 0), records.count(7)) == (Evidence(0.0, 0.0), 0)
    for score in (1.0, 1.0, 0.5):
        records.book(7, score, 0)
    assert records.estimate(7, 0) == pytest.approx((2.5 + 1) / (3 + 2))
    assert records.estimate(8, 0) == 0.5


def test_a_game_weighs_half_after_the_half_life_and_is_counted_for_good():
    records = WinRecords(half_life_frames=100)
    records.book(1, 1.0, 0)
    assert records.evidence(1, 100) == pytest.approx(Evidence(0.5, 0.5))
    records.book(1, 0.0, 100)
    assert records.evidence(1, 100) == pytest.approx(Evidence(0.5, 1.5))
    assert records.estimate(1, 10_000) == pytest.approx(0.5, abs=1e-6)
    assert records.count(1) == 2


def test_estimates_of_any_record_lie_inside():
    for score in (0.0, 1.0):
        records = WinRecords(half_life_frames=10)
        for frames in range(1_000):
            records.book(1, score, frames)
        assert 0.0 < records.estimate(1, 1_000) < 1.0
        assert abs(records.estimate(1, 1_000) - score) < 0.1


def test_records_survive_a_resume():
    whole = WinRecords(half_life_frames=30)
    for frames in range(50):
        whole.book(frames % 3, frames % 2, frames)
    resumed = WinRecords(half_life_frames=30)
    resumed.load_state_dict(whole.state_dict())
    for records in (whole, resumed):
        records.book(1, 1.0, 60)
    assert resumed.state_dict() == whole.state_dict()
    assert [resumed.estimate(n, 70) for n in range(4)] == [whole.estimate(n, 70) for n in range(4)]


def test_invalid_arguments_are_refused():
    with pytest.raises(ValueError, match="half_life_frames is 0, it must be above 0"):
        WinRecords(half_life_frames=0)
    with pytest.raises(ValueError, match="prior_games is -1, it must be above 0"):
        WinRecords(half_life_frames=1, prior_games=-1)
    with pytest.raises(ValueError, match=r"score against opponent 3 is 1.5, not in 0..1"):
        WinRecords(half_life_frames=1).book(3, 1.5, 0)


def play_at(score, num_learners, num_games):
    """Shares of learners that are ever found to be above 0.6, checked after each game: by the test,
    and by Wilson's interval every ten games.
    """
    rng = np.random.default_rng(0)
    found = np.zeros((2, num_learners), bool)
    for learner in range(num_learners):
        test = BettingTest(0.6, 0.025)
        won = rng.random(num_games) < score
        for game, points in enumerate(won.cumsum().tolist(), start=1):
            test.book(game, 1, float(won[game - 1]))
            test.settle(game + 1)
            found[0, learner] |= test.is_above(1)
            if game % 10 == 0:
                found[1, learner] |= share_interval(points, game)[0] > 0.6
    return found.mean(1)


@pytest.mark.slow
def test_checking_after_each_game_is_wrong_for_one_in_40_at_most():
    by_test, by_interval = play_at(0.6, 400, 500)
    assert by_test <= 0.035  # 0.025, and the standard error of 400 learners
    assert by_interval > 0.07
    assert play_at(0.8, 50, 300)[0] == 1.0


def test_a_betting_test_resumes_and_is_cleared():
    test, resumed = BettingTest(0.6, 0.025), BettingTest(0.6, 0.025)
    for game in range(30):
        test.book(game, 1, 1.0)
    test.settle(30)
    assert test.is_above(1)
    assert not test.is_above(2)
    resumed.load_state_dict(test.state_dict())
    assert resumed.is_above(1)
    test.clear()
    assert not test.is_above(1)
    assert resumed.is_above(1)


def find_steps(chance, seed, num_steps=1_500):
    """Steps of 64 worlds until a learner is found above 0.6; wins take 60 steps, losses 250."""
    rng, test, worlds = np.random.default_rng(seed), BettingTest(0.6, 0.025), np.arange(64)
    number, won = worlds.copy(), rng.random(64) < chance
    ends = np.where(won, 60, 250)
    for step in range(num_steps):
        for world in np.flatnonzero(ends == step).tolist():
            test.book(int(number[world]), 1, float(won[world]))
            number[world], won[world] = step * 64 + world, rng.random() < chance
            ends[world] += 60 if won[world] else 250
        test.settle(int(number.min()))
        if test.is_above(1):
            return step
    return None


@pytest.mark.slow
def test_short_games_that_are_won_deceive_nobody():
    """Half of the games are won, and most of the early results are."""
    assert sum(find_steps(0.5, seed) is not None for seed in range(40)) <= 2


def test_a_strong_learner_is_found_soon_after_its_longest_games():
    assert max(find_steps(0.9, seed, 600) or 600 for seed in range(5)) < 600


@pytest.mark.parametrize(("bar", "error"), [(0.0, 0.1), (1.0, 0.1), (0.5, 0.0), (0.5, 1.0)])
def test_bars_and_errors_outside_0_to_1_are_refused(bar, error):
    with pytest.raises(ValueError, match="must be above 0 and below 1"):
        BettingTest(bar, error)
