"""The sequential test: its error rate, and its use of pairs instead of games."""

import math

import numpy as np
import pytest

from marl_cair.cli import main
from marl_cair.league.play import sequential
from marl_cair.league.play.sequential import SequentialTest, find_elo, find_score
from tests.games import last_standing
from tests.games.last_standing import GAME

TEST = SequentialTest(0.0, 60.0)


def ratio_of(test, scores, num_teams=2):
    counts = sequential.start_count(num_teams)
    counts.update(round(float(score), 9) for score in scores)
    return test.ratio(counts, num_teams)


def run(test, elo, seed, draws=0.3, alike=0.0, max_pairs=4_000):
    """+1, -1 or 0 (undecided), and the number of pairs; `alike` pairs have one result."""
    rng = np.random.default_rng(seed)
    mean = find_score(elo)
    chances = [1 - draws / 2 - mean, draws, mean - draws / 2]
    games = rng.choice([0.0, 0.5, 1.0], (max_pairs, 2), p=chances)
    same = rng.random(max_pairs) < alike
    games[same, 1] = games[same, 0]
    scores = games.mean(1).tolist()
    for number in range(8, max_pairs, 8):
        ratio = ratio_of(test, scores[:number])
        if abs(ratio) >= test.limit:
            return int(math.copysign(1, ratio)), number
    return 0, max_pairs


@pytest.mark.parametrize("alike", [0.0, 0.6])
def test_one_decision_in_twenty_is_wrong(alike):
    """Also if the map decides both games of a pair, where single games would be wrong."""
    for elo, right in ((0.0, -1), (60.0, 1)):
        verdicts = [run(TEST, elo, seed, alike=alike)[0] for seed in range(60)]
        assert 0 not in verdicts
        assert verdicts.count(-right) <= 8


def test_a_clear_difference_is_decided_soon():
    clear = [run(TEST, 250.0, seed) for seed in range(10)]
    assert {verdict for verdict, _ in clear} == {1}
    close = np.mean([run(TEST, 60.0, seed)[1] for seed in range(10)])
    assert np.mean([pairs for _, pairs in clear]) < 0.5 * close


def test_the_ratio_is_the_normal_one_for_many_pairs():
    """LLR = N (s1 - s0) (2 mean - s0 - s1) / (2 variance), as fishtest's old formula has it."""
    rng = np.random.default_rng(0)
    scores = rng.choice([0.0, 0.25, 0.5, 0.75, 1.0], 4_000, p=[0.1, 0.2, 0.35, 0.22, 0.13])
    test = SequentialTest(0.0, 10.0)
    low, high = find_score(0.0), find_score(10.0)
    expected = 4_000 * (high - low) * (2 * scores.mean() - low - high) / (2 * scores.var())
    assert ratio_of(test, scores) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("score", [0.0, 0.5, 1.0])
def test_scores_that_never_vary_have_a_finite_ratio(score):
    ratios = [ratio_of(TEST, [score] * number) for number in (1, 10, 1_000)]
    assert all(map(math.isfinite, ratios))
    assert ratios == sorted(ratios, key=abs)
    assert all(ratio > 0 for ratio in ratios) == (score == 1.0)


@pytest.mark.parametrize("num_teams", [2, 3, 8])
def test_elo_and_score_are_inverse(num_teams):
    assert find_elo(find_score(137.0, num_teams), num_teams) == pytest.approx(137.0)
    assert find_score(0.0, num_teams) == pytest.approx(1 / num_teams)
    assert find_elo(1.0, num_teams) is find_elo(0.0, num_teams) is None


@pytest.mark.parametrize(
    ("ends", "message"),
    [
        ((20, 0), "smaller first"),
        ((0, math.inf), "finite"),
        ((0, 200_000), r"between 0 and 200000 Elo: give numbers in -4000\.\.4000"),
    ],
)
def test_invalid_tests_are_refused(ends, message):
    with pytest.raises(ValueError, match=message):
        SequentialTest(*ends)


def test_the_widest_test_has_a_ratio():
    assert math.isfinite(ratio_of(SequentialTest(-4_000, 4_000), [0.0, 0.5, 1.0]))


def test_blocks_are_counted_once(monkeypatch):
    """Counting all blocks again each time would take quadratic time."""
    counters, totals, ratio = [], [], SequentialTest.ratio

    def listen(test, outcomes, num_teams):
        counters.append(outcomes)
        totals.append(outcomes.total())
        return ratio(test, outcomes, num_teams)

    monkeypatch.setattr(SequentialTest, "ratio", listen)
    result = play("finisher", "idle", "duel")
    assert result.verdict == "higher"
    assert totals == list(range(1, len(totals) + 1))
    assert all(counter is counters[0] for counter in counters)
    assert result.ratio == ratio(TEST, counters[0])


def play(first, second, scenario, test=TEST, max_games=2_000, **options):
    agents = GAME.bots[first](None, None), GAME.bots[second](None, None)
    return sequential.play_sequentially(
        agents, GAME, GAME.scenario(scenario, **options), test, max_games, 3, ("a", "b")
    )


@pytest.mark.parametrize("scenario", ["duel", "ffa-4"])
def test_a_match_stops_when_it_is_decided(scenario):
    won = play("finisher", "idle", scenario)
    assert (won.verdict, won.match.score) == ("higher", 1.0)
    assert won.match.games < 200
    assert play("quitter", "idle", scenario).verdict == "lower"


def test_agents_that_only_repeat_games_end_the_test():
    result = play("idle", "idle", "duel", gain=0)
    assert (result.verdict, result.match.games) == ("repeats", 2)
    few = play("idle", "idle", "duel", max_games=20, gain=0)
    assert (few.verdict, few.match.games) == ("repeats", 2)


def test_a_match_may_stay_undecided():
    result = play("random", "random", "duel", SequentialTest(-300, 300), max_games=4)
    assert (result.verdict, result.match.games) == ("undecided", 4)
    with pytest.raises(ValueError, match="max_games is 1, a block has 2 games"):
        play("random", "random", "duel", max_games=1)


def test_the_command_shows_verdict_and_estimate(monkeypatch, capsys):
    last_standing.register(monkeypatch)
    words = ["match", f"--game={last_standing.NAME}", "--scenario=duel", "--sprt=0,60"]
    assert main([*words, "finisher", "idle"]) == 0
    text = capsys.readouterr().out
    assert "A is stronger than B: 60 Elo is likelier than 0" in text
    assert main([*words[:-1], "--sprt=0;60", "finisher", "idle"]) == 2
    assert "--sprt is '0;60', it must be two numbers" in capsys.readouterr().err
    assert main([*words[:2], "--scenario=alone", "--sprt=0,60", "finisher", "idle"]) == 2
    assert "--sprt needs a game with opponents" in capsys.readouterr().err
