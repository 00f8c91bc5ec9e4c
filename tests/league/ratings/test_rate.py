"""Ratings recover known strengths, and say how sure they are."""

import dataclasses
import itertools
import math

import choix
import numpy as np
import pytest

from marl_cair.league.ratings import rate as ratings_module
from marl_cair.league.ratings.bootstrap import make_pseudo_blocks
from marl_cair.league.ratings.likelihood import Likelihood, Rankings, split_ranking
from marl_cair.league.ratings.rate import ELO_PER_LOGIT, is_stronger, rate
from tests.league.paper_games import (
    count_results,
    from_rows,
    make_games,
    share,
    simulate,
    simulate_orders,
    sweep,
)

NAMES = ["a", "b", "c", "d"]


def by_name(names, rows, **options):
    return {rating.name: rating for rating in rate(names, from_rows(rows), **options).ratings}


class TestLikelihood:
    def test_a_draw_of_two_is_half_a_win_of_each(self):
        assert split_ranking((1.5, 1.5)) == ([0.5, 0.5], [((0, 1), 1.0)])
        assert split_ranking((2.0, 1.0)) == ([0.0, 1.0], [((1, 0), 1.0)])

    @pytest.mark.parametrize("ranks", [(1, 2, 3), (1.5, 1.5, 3), (1, 2.5, 2.5), (2, 2, 2)])
    def test_ties_are_the_mean_of_all_orders(self, ranks):
        strength = np.array([0.3, -0.4, 1.1])

        def find_value(chosen, sets):
            sums = [weight * np.log(np.exp(strength[list(some)]).sum()) for some, weight in sets]
            return np.dot(chosen, strength) - sum(sums)

        orders = [
            find_value(*split_ranking(np.argsort(order) + 1.0))
            for order in itertools.permutations(range(3))
            if all(ranks[a] <= ranks[b] for a, b in itertools.pairwise(order))
        ]
        assert find_value(*split_ranking(ranks)) == pytest.approx(np.mean(orders))
        chances = np.exp(strength) / np.exp(strength).sum()  # of the first of 1.1, 0.3, -0.4
        first, second = chances[2], chances[0] / (chances[0] + chances[1])
        assert find_value(*split_ranking((2, 3, 1))) == pytest.approx(np.log(first * second))

    def test_a_team_that_is_left_out_leaves_the_order_of_the_rest(self):
        assert split_ranking((2.0, 0.0, 1.0)) == ([0.0, 0.0, 1.0], [((2, 0), 1.0)])

    @pytest.mark.slow
    def test_the_maximum_is_that_of_choix(self):
        """But for the prior, and the seat advantages, which choix does not have."""
        pairs = simulate([0.0, 1.5, 3.0, 4.5], 40, 2)
        orders = simulate_orders([0.0, 0.5, 1.0, 1.5, 2.0], 60, 4, 3)
        for games, size, find in ((pairs, 4, choix.opt_pairwise), (orders, 5, choix.opt_rankings)):
            listed = np.take_along_axis(games.agents, np.argsort(games.ranks), 1).tolist()
            model = Likelihood(size, [Rankings(games.agents, games.ranks, games.blocks)])
            fitted = ELO_PER_LOGIT * model.fit(np.ones(model.num_blocks))[:size]
            assert fitted == pytest.approx(ELO_PER_LOGIT * find(size, listed), abs=6.0)

    def test_the_quick_fit_finds_what_the_careful_one_finds(self):
        games = simulate([0.0, 1.0, 2.0], 20, 0)
        model = Likelihood(3, [Rankings(games.agents, games.ranks, games.blocks)])
        point = model.fit(np.ones(60))
        weights = np.bincount(np.random.default_rng(0).integers(60, size=60), minlength=60)
        both = np.stack((weights, np.ones(60)))
        quick = model.refit(point, both, model.factorise(point))
        assert quick[0] == pytest.approx(model.fit(weights.astype(float)), abs=2e-3)
        assert quick[1] == pytest.approx(point, abs=2e-3)

    def test_a_resample_that_lies_far_off_is_fitted_with_care(self):
        games = from_rows([*sweep(0, 1), *sweep(1, 2, 6), *[(1, 0, 99, 1.0), (2, 1, 99, 1.0)] * 2])
        model = Likelihood(3, [Rankings(games.agents, games.ranks, games.blocks)])
        num = model.num_blocks
        point = model.fit(np.ones(num))
        weights = np.vstack((np.eye(num)[[0, num - 1]] * num, np.ones((1, num))))
        quick = model.refit(point, weights, model.factorise(point))
        assert quick == pytest.approx(np.stack([model.fit(row) for row in weights]), abs=2e-3)


def test_two_agents_differ_by_the_log_odds_of_their_score():
    rows = [(0, 1, block, score) for block in range(200) for score in (1.0, block % 2)]
    swapped = [(1, 0, block + 200, 1 - score) for _, _, block, score in rows]
    best, worst = rate(["a", "b"], from_rows(rows + swapped)).ratings
    assert (best.name, best.score) == ("a", 0.75)
    assert best.elo - worst.elo == pytest.approx(ELO_PER_LOGIT * math.log(3), abs=0.2)


def measure_two(elo, games, num_leagues=300):
    """Shares of leagues of two, one `elo` above the other, that call one of them stronger, and
    whose interval, or bound, of the difference holds it.
    """
    strengths, known, keys = np.array([elo, 0.0]) / ELO_PER_LOGIT, {}, []
    for seed in range(num_leagues):
        league = simulate(strengths, games // 2, 1_000 * games + seed)
        keys.append(count_results(league))  # of few games many leagues are the same
        if keys[-1] not in known:
            ladder = rate(["a", "b"], league)
            (first, second), gap = ladder.ratings, ladder.differences[0][1]
            truth = elo if first.name == "a" else -elo
            low, high = (first.elo - second.elo, math.inf) if gap is None else (gap.low, gap.high)
            known[keys[-1]] = is_stronger(first, second, gap), low <= truth <= high
    return np.mean([known[key] for key in keys], axis=0)


def use_resamples(monkeypatch, number):
    monkeypatch.setattr(ratings_module, "LEAST_RESAMPLES", number)
    monkeypatch.setattr(ratings_module, "MOST_RESAMPLES", number)


@pytest.mark.slow
def test_another_seed_of_the_resampling_moves_ends_by_less_than_two_elo():
    """With 500 resamples ends of a league like this moved by up to 9 Elo."""
    games = simulate(np.linspace(-1.0, 1.0, 6), 20, 0)
    ladders = [rate([*NAMES, "e", "f"], games, seed) for seed in range(4)]
    ends = np.array([[(r.low, r.high) for r in ladder.ratings] for ladder in ladders])
    assert ladders[0].num_resamples > 5_000
    assert 1.0 < ladders[0].move < 2.1
    moves = np.abs(ends[:, None] - ends)
    assert np.quantile(moves, 0.95) < ladders[0].move
    assert moves.max() < 3.0


def test_what_leagues_shared_their_map_seeds_is_resampled_by_seed():
    """A map seed that favours an agent does so in all its games there, against whomever."""
    rng = np.random.default_rng(3)
    rows, seeds = [], []
    for seed, favoured in enumerate(rng.integers(4, size=24).tolist()):
        for first, second in itertools.combinations(range(4), 2):
            chance = 0.95 if first == favoured else 0.05 if second == favoured else 0.5
            won = rng.random(2) < chance
            rows += [(first, second, seed, float(won[0])), (second, first, seed, float(~won[1]))]
            seeds += [seed, seed]
    apart = from_rows(rows)
    together = dataclasses.replace(apart, blocks=np.array(seeds))
    narrow, wide = (rate(NAMES, games) for games in (apart, together))
    assert [r.elo for r in narrow.ratings] == pytest.approx([r.elo for r in wide.ratings])
    widths = [np.mean([r.high - r.low for r in one.ratings]) for one in (narrow, wide)]
    assert widths[1] > 1.25 * widths[0]


@pytest.mark.slow
@pytest.mark.parametrize(("elo", "games"), [(0, 4), (0, 8), (0, 40), (200, 8), (200, 40)])
def test_the_difference_of_two_lies_in_19_of_20_intervals_after_few_games(monkeypatch, elo, games):
    """The bootstrap alone held 200 Elo in 67 and 91 of 100, and called equals unequal in 51, 15 and
    10 of 100 leagues.
    """
    use_resamples(monkeypatch, 200)
    sure, holds = measure_two(elo, games)
    assert holds >= 0.93
    assert sure <= 0.07 if elo == 0 else holds <= 0.99  # 300 leagues at the nominal 0.05


def test_pseudo_blocks_change_no_rating_and_are_as_many_as_ratings():
    games = simulate([0.0, 0.5, 1.0, 1.5], 10, 0)
    rankings = [Rankings(games.agents, games.ranks, games.blocks)]
    model = Likelihood(4, rankings)
    point = model.fit(np.ones(model.num_blocks))
    pseudo = make_pseudo_blocks(4, games, rankings, point)
    assert pseudo.shapes.sum() == pytest.approx(3.0, abs=0.1)  # ratings, but for their mean
    assert pseudo.games == 1.0  # a block is two games, as a pseudo-block is
    elo = {rating.name: rating.elo for rating in rate(NAMES, games).ratings}
    gaps = ELO_PER_LOGIT * (point[:4] - point[:4].mean())
    assert [elo[name] for name in NAMES] == pytest.approx(gaps, abs=1e-6)


def test_blocks_that_are_all_alike_leave_an_interval():
    rows = [row for b in range(8) for row in ((0, 1, b, 1.0), (1, 0, b, 1.0))]
    gap = rate(["a", "b"], from_rows(rows)).differences[0][1]
    assert gap.low < -20.0 < 20.0 < gap.high


@pytest.mark.parametrize(("games", "sure"), [(2, False), (4, False), (6, True), (40, True)])
def test_a_clean_sweep_of_a_few_games_shows_nothing(games, sure):
    ladder = rate(["a", "b"], from_rows(sweep(0, 1, games)))
    first, second = ladder.ratings
    assert is_stronger(first, second, ladder.differences[0][1]) is sure
    assert (first.probability_first >= 0.975) is sure
    assert first.probability_first == pytest.approx(1.0 - 0.5**games, abs=0.05)


def test_the_advantage_of_a_seat_is_found_and_does_not_spoil_the_ratings():
    with_it = rate(["a", "b"], simulate([0.0, 1.0], 600, 1, seat=0.5))
    first, second = with_it.seats
    # Half of the advantage over the other seat is above the mean of both.
    assert first.low <= ELO_PER_LOGIT * 0.25 <= first.high
    assert first.elo == pytest.approx(-second.elo)
    gap = with_it.differences[0][1]
    assert gap.low <= ELO_PER_LOGIT * 1.0 <= gap.high
    without = rate(["a", "b"], simulate([0.0, 1.0], 600, 1)).seats[0]
    assert without.low <= 0.0 <= without.high


def test_games_that_are_repeated_do_not_shrink_an_interval():
    games = simulate([0.0, 0.5], 10, 0)
    many = games.select(np.tile(np.arange(20), 20))
    blocks, is_repeat = many.blocks + np.arange(400) // 20 * 10, np.arange(400) >= 20
    repeated = dataclasses.replace(many, blocks=blocks, is_repeat=is_repeat)
    assert rate(["a", "b"], repeated) == rate(["a", "b"], games)


def test_the_order_of_the_games_changes_nothing():
    games = simulate([0.0, 1.0, 2.0], 30, 1)
    turned = games.select(np.random.default_rng(0).permutation(len(games.blocks)))
    shuffled = dataclasses.replace(turned, blocks=999 - turned.blocks)
    assert rate(NAMES[:3], games, 5) == rate(NAMES[:3], shuffled, 5)


def test_draws_count_half():
    first, second = rate(["a", "b"], from_rows([(0, 1, block, 0.5) for block in range(20)])).ratings
    assert first.elo == pytest.approx(second.elo, abs=1e-6)
    assert first.probability_first == pytest.approx(0.5, abs=0.1)


def test_an_agent_saved_by_one_game_has_an_open_upper_end():
    ratings = by_name(["a", "b", "random"], [*share(0, 1, 39), *sweep(0, 2), *share(1, 2, 20)])
    assert ratings["a"].bound == ""
    assert ratings["a"].open_high
    assert not ratings["a"].open_low
    assert all(math.isfinite(r.low) and math.isfinite(r.high) for r in ratings.values())


def test_in_a_free_for_all_who_always_comes_last_is_below_all_limits():
    games = simulate_orders([0.0, 0.2, 0.4, -60.0], 40, 4, 0)
    ladder = rate(NAMES, games)
    assert ladder.ratings[-1].name == "d"
    assert [rating.bound for rating in ladder.ratings] == ["", "", "", "upper"]


def test_an_agent_may_play_two_seats_of_a_game():
    games = make_games([(0, 1, 1), (1, 0, 1), (1, 1, 0)] * 20, [(1, 2, 3)] * 60, np.arange(60) // 3)
    ratings = {rating.name: rating for rating in rate(["a", "b"], games).ratings}
    assert ratings["a"].games == ratings["b"].games == 60
    assert ratings["a"].elo == pytest.approx(0.0, abs=30)


def test_agents_that_never_met_are_named():
    games = from_rows([(0, 1, 0, 1.0), (2, 3, 0, 1.0)])
    with pytest.raises(ValueError, match="no games compare a, b with c: let them play"):
        rate(["a", "b", "c", "d"], games)
    with pytest.raises(ValueError, match="there are no games to rate"):
        rate(["a", "b"], make_games(np.zeros((0, 2), int), np.zeros((0, 2)), np.zeros(0, int)))
