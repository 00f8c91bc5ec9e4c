"""Opponent samplers: probabilities for any record, the weights of their papers, mixtures."""

import numpy as np
import pytest

from marl_cair.league.ratings.equilibrium import exploitability, maximum_entropy_nash
from marl_cair.lookup import UnknownNameError
from marl_cair.self_play.samplers import SAMPLERS, SamplerOptions, Standings, draw_evenly, mix

OPTIONS = SamplerOptions()


def standings(win_rates, payoff=None, num_bots=2):
    """The learner, bots, then a pool with those win rates."""
    size = 1 + num_bots + len(win_rates)
    whole = np.full((size, size), 0.5)
    if payoff is not None:
        whole[1 + num_bots :, 1 + num_bots :] = payoff
    return Standings(
        np.arange(size),
        (
            "latest",
            *(f"bot{i}" for i in range(num_bots)),
            *(f"s{i}" for i in range(len(win_rates))),
        ),
        ("learner", *["bot"] * num_bots, *["snapshot"] * len(win_rates)),
        np.array([0.5] * (1 + num_bots) + list(win_rates), np.float64),
        whole,
    )


def of_pool(name, win_rates, options=OPTIONS, payoff=None):
    probabilities = SAMPLERS[name](standings(win_rates, payoff), options)
    assert probabilities[:3].sum() == 0.0
    return probabilities[3:]


@pytest.mark.parametrize("name", SAMPLERS)
@pytest.mark.parametrize("num_bots", [0, 2])
@pytest.mark.parametrize(
    "win_rates",
    [[], [1.0], [0.0], [1.0] * 5, [0.0] * 5, [0.5] * 5, [0.0, 1.0, 0.0, 1.0], [1e-300, 1.0]],
    ids=str,
)
def test_every_sampler_gives_probabilities_for_any_record(name, num_bots, win_rates):
    """Also with all games won or lost, where the weights of `pfsp` are all 0."""
    found = SAMPLERS[name](standings(win_rates, num_bots=num_bots), OPTIONS)
    assert found.shape == (1 + num_bots + len(win_rates),)
    assert np.isfinite(found).all()
    assert (found >= 0).all()
    assert found.sum() == pytest.approx(1.0)


@pytest.mark.parametrize("name", sorted(set(SAMPLERS) - {"bots", "pfsp_bots", "curriculum"}))
def test_without_a_pool_the_learner_plays_itself(name):
    assert SAMPLERS[name](standings([]), OPTIONS).tolist() == [1.0, 0.0, 0.0]


def test_latest_and_bots_take_no_other_opponent():
    assert SAMPLERS["latest"](standings([0.2, 0.9]), OPTIONS).tolist() == [1, 0, 0, 0, 0]
    assert SAMPLERS["bots"](standings([0.2, 0.9]), OPTIONS).tolist() == [0, 0.5, 0.5, 0, 0]


def test_a_curriculum_takes_each_bot_at_the_lowest_strength_that_is_not_beaten():
    names = ("latest", "a@0.5", "a", "a@0.1", "b@0.1", "b@0.5", "b", "random", "s0")
    rates = [0.5, 0.6, 0.1, 0.9, 0.9, 0.8, 0.75, 0.5, 0.0]
    kinds = ("learner", *["bot"] * 7, "snapshot")
    met = Standings(np.arange(9), names, kinds, np.array(rates), np.full((9, 9), 0.5))
    third = 1 / 3
    expected = [0, third, 0, 0, 0, 0, third, third, 0]
    assert SAMPLERS["curriculum"](met, OPTIONS) == pytest.approx(expected)
    # The others take bots at full strength.
    assert np.flatnonzero(SAMPLERS["bots"](met, OPTIONS)).tolist() == [2, 6, 7]


def test_bots_that_are_not_beaten_yet_are_played_more_often():
    met = standings([0.2])
    met.win_rate[1:3] = 0.5, 0.75
    expected = [0, 0.25 / 0.3125, 0.0625 / 0.3125, 0]
    assert SAMPLERS["pfsp_bots"](met, OPTIONS) == pytest.approx(expected)


def test_prioritised_samplers_weigh_as_their_papers_say():
    rates = [0.0, 0.5, 0.75, 1.0]
    for name, weights in (
        ("pfsp", [1.0, 0.25, 0.0625, 0.0]),
        ("pfsp_variance", [0.0, 0.25, 0.1875, 0.0]),
        ("pfsp_easy", [0.0, 0.25, 0.5625, 1.0]),
    ):
        assert of_pool(name, rates) == pytest.approx(np.array(weights) / sum(weights))
    linear = SamplerOptions(power=1.0)
    assert of_pool("pfsp", rates, linear) == pytest.approx(np.array([1, 0.5, 0.25, 0]) / 1.75)


def test_samplers_by_age_prefer_the_newest():
    rates = [0.5] * 4
    assert of_pool("uniform", rates).tolist() == [0.25] * 4
    assert of_pool("delta_uniform", rates).tolist() == [0, 0, 0.5, 0.5]
    assert of_pool("delta_uniform", rates, SamplerOptions(delta=0.99)).tolist() == [0, 0, 0, 1]
    found = of_pool("recent", rates, SamplerOptions(recency=3.0))
    assert found[1:] / found[:-1] == pytest.approx(np.e)  # ages 1, 2/3, 1/3, 0


ROCK_PAPER_SCISSORS = np.array([[0.5, 0.0, 1.0], [1.0, 0.5, 0.0], [0.0, 1.0, 0.5]])


def test_nash_plays_rock_paper_scissors_evenly_and_a_copy_changes_nothing():
    assert of_pool("nash", [0.5] * 3, payoff=ROCK_PAPER_SCISSORS) == pytest.approx([1 / 3] * 3)
    twice = [0, 0, 1, 2]  # two rocks share what one had
    copied = ROCK_PAPER_SCISSORS[np.ix_(twice, twice)]
    found = of_pool("nash", [0.5] * 4, payoff=copied)
    assert found == pytest.approx([1 / 6, 1 / 6, 1 / 3, 1 / 3], abs=1e-6)


def test_nash_is_the_best_where_one_beats_all():
    ladder = np.array([[0.5, 0.4, 0.2], [0.6, 0.5, 0.4], [0.8, 0.6, 0.5]])
    assert of_pool("nash", [0.5] * 3, payoff=ladder) == pytest.approx([0, 0, 1], abs=1e-6)


@pytest.mark.parametrize("size", [2, 9, 40])
def test_nash_of_random_games_is_not_beaten(size):
    rng = np.random.default_rng(size)
    payoff = rng.normal(size=(size, size))
    payoff -= payoff.T
    mixture = maximum_entropy_nash(payoff)
    assert mixture.sum() == pytest.approx(1.0)
    assert exploitability(payoff, mixture) <= 1e-6 * np.abs(payoff).max()


def test_nash_refuses_payoffs_of_no_zero_sum_game():
    with pytest.raises(ValueError, match="payoffs are not antisymmetric"):
        maximum_entropy_nash(np.ones((2, 2)))
    with pytest.raises(ValueError, match=r"shape \[2, 3\], they must be \[K, K\]"):
        maximum_entropy_nash(np.zeros((2, 3)))
    with pytest.raises(ValueError, match="must be finite"):
        maximum_entropy_nash(np.full((2, 2), np.nan))


def test_a_mixture_is_the_weighted_sum_of_its_samplers():
    about = standings([0.0, 1.0])
    found = mix({"latest": 5, "pfsp": 3, "uniform": 1, "bot1": 1}, about, OPTIONS)
    assert found == pytest.approx([0.5, 0.0, 0.1, 0.35, 0.05])


def test_invalid_mixtures_are_refused():
    with pytest.raises(UnknownNameError, match="unknown opponent 'pfps': nearest are 'pfsp'"):
        mix({"pfps": 1.0}, standings([]), OPTIONS)
    for wrong in ({"latest": 0.0}, {"latest": -1.0, "bots": 2.0}, {"latest": np.nan}, {}):
        with pytest.raises(ValueError, match="weights must be 0 or more, and one of them above 0"):
            mix(wrong, standings([]), OPTIONS)


def test_even_draws_are_within_one_of_their_share():
    rng = np.random.default_rng(0)
    probabilities = np.array([0.0, 0.07, 0.5, 0.43, 0.0])
    counts = np.zeros(5)
    for _ in range(2_000):
        drawn = draw_evenly(rng, range(5), probabilities, 4)
        got = np.bincount(drawn, minlength=5)
        assert (np.abs(got - 4 * probabilities) < 1.0).all()
        counts += got
    assert counts / 8_000 == pytest.approx(probabilities, abs=0.01)
    assert draw_evenly(rng, range(5), probabilities, 0) == []


# --- leagues ---------------------------------------------------------------------------------


def in_a_league(win_rates, live=(0.5,)):
    """The learner, current main agents, and the past by name: owners are before the dash."""
    others = [f"main_{n + 1}" for n in range(len(live))]
    owners = ["", *others, *(name.partition("-")[0] for name in win_rates)]
    size = len(owners)
    return Standings(
        np.arange(size),
        ("latest", *others, *win_rates),
        ("learner", *["live"] * len(live), *["snapshot"] * len(win_rates)),
        np.array([0.5, *live, *win_rates.values()]),
        np.full((size, size), 0.5),
        tuple(owners),
        tuple(owner.rpartition("_")[0] for owner in owners),
    )


def shares(name, found):
    named = zip(found.names, SAMPLERS[name](found, OPTIONS).tolist(), strict=True)
    return {who: pytest.approx(share) for who, share in named if share}


def test_an_exploiter_plays_the_main_agents_or_the_past_of_those_that_it_cannot_beat():
    past = {"main_1-a": 0.5, "main_1-b": 0.9, "main_2-a": 0.5, "league_exploiter_0-a": 0.5}
    found = shares("main_agents", in_a_league(past, live=(0.1, 0.11)))
    even, easy = 0.5 * 0.25 / 0.34, 0.5 * 0.09 / 0.34
    assert found == {"main_2": 0.5, "main_1-a": even, "main_1-b": easy}
    assert shares("main_agents", in_a_league({}, live=(0.0,))) == {"main_1": 1.0}
    assert shares("main_agents", in_a_league({}, live=())) == {"latest": 1.0}


def test_a_main_agent_plays_itself_and_the_others_that_it_can_win_against():
    past = {"main_1-a": 0.5}
    assert shares("main_self_play", in_a_league(past, (0.31,))) == {"latest": 0.5, "main_1": 0.5}
    assert shares("main_self_play", in_a_league(past, (0.3,))) == {"latest": 0.5, "main_1-a": 0.5}
    assert shares("main_self_play", in_a_league(past, ())) == {"latest": 1.0}


def test_opponents_that_win_again_come_back_exploiters_first():
    past = {
        "main_1-a": 0.6,
        "main_1-b": 0.8,
        "main_exploiter_0-a": 0.2,
        "league_exploiter_0-a": 0.3,
    }
    assert shares("forgotten", in_a_league(past)) == {"main_exploiter_0-a": 1.0}
    past["main_exploiter_0-a"] = 0.4
    assert shares("forgotten", in_a_league(past)) == {"main_1-a": 1.0}
    past["main_1-a"] = 0.7
    assert shares("forgotten", in_a_league(past)) == {"latest": 1.0}
