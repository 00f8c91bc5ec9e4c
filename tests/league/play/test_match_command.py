"""`marl-cair match` and `evaluate` with any number of seats: output and refusals."""

import re

import pytest

from marl_cair.cli import evaluate, main, match
from marl_cair.league.play.match import GameResult, MatchResult
from tests.games import last_standing
from tests.games.last_standing import NAME


@pytest.fixture(autouse=True)
def _known(monkeypatch):
    last_standing.register(monkeypatch)


def run(capsys, *words, code=0):
    assert main([*words, f"--game={NAME}"]) == code
    written = capsys.readouterr()
    return written.err if code else written.out


def test_a_match_of_many_stands_beside_the_fair_share(capsys):
    text = run(
        capsys, "match", "finisher", "idle", "--scenario=ffa-3", "--games=10", "--set=gain=0"
    )
    assert text.splitlines() == [
        "A = finisher, B = idle on last_standing ffa-3",
        "ffa-3  A in one seat, B in the other 2: 4 map seeds, once in each",
        "       A won 3, drew 0, lost 0: 100.0% [14.7%, 100.0%] of the points, 33.3% is fair",
        (
            "       The difference is not significant. "
            "9 of 12 games repeat the others, move by move: not counted."
        ),
    ]


def test_equal_games_count_where_any_differs_or_is_forfeited():
    def play(*fingerprints, forfeit=""):
        results = (
            GameResult(number, seat, 0, False, 9, f, seat == 0, forfeit)
            for number, block in enumerate(fingerprints)
            for seat, f in enumerate(block)
        )
        return MatchResult(tuple(results))

    same = play("ab", "ab", "ab").without_repeats()
    assert [result.block for result in same.results] == [0, 0]
    assert "4 of 6 games repeat" in match.describe_doubts(6, same)
    varied = play("ab", "ab", "ac").without_repeats()
    assert varied.games == 6
    assert match.describe_doubts(6, varied) == " (only 3 of 6 games differ from one another)"
    assert play("ab", "ab", forfeit="a crashed").without_repeats().games == 4


@pytest.mark.parametrize(
    ("words", "verdict"),
    [
        (["finisher", "idle"], "A is stronger than B."),
        (["idle", "finisher"], "A is weaker than B."),
        (["idle", "idle"], "The difference is not significant."),
    ],
)
def test_the_verdict_between_teams_is_in_plain_words(capsys, words, verdict):
    text = run(capsys, "match", *words, "--scenario=teams", "--games=40")
    assert "A in one team, B in the other: 20 map seeds, once in each" in text
    assert verdict in text


@pytest.mark.parametrize(
    ("words", "verdict"),
    [
        (["scorer", "idle"], "A scores more than B."),
        (["idle", "scorer"], "A scores less than B."),
        (["scorer", "scorer"], "The difference is not significant."),
    ],
)
def test_solo_agents_are_compared_by_scores(capsys, words, verdict):
    text = run(capsys, "match", *words, "--scenario=alone", "--games=24")
    assert "each alone on the same 24 map seeds; a score is the sum of a game's rewards" in text
    number = r"-?[\d.]+ \[-?[\d.]+, -?[\d.]+\]"
    assert re.search(f"mean score of A {number}, of B {number}; A less B {number}\n", text)
    assert verdict in text


def test_variants_stand_below_each_other(capsys):
    words = [
        "--scenario=alone",
        "--games=8",
        "--set=gain=5",
        "--set=heldout.gain=0",
        "--set=max_ticks=6",
    ]
    text = run(capsys, "match", "scorer", "idle", *words)
    lines = [line for line in text.splitlines() if "each alone" in line]
    assert [line.split()[0] for line in lines] == ["alone", "heldout"]
    assert text.count("mean score of A 0 [0, 0]") == 1
    assert text.index("A scores more") < text.index("not significant")


def test_options_may_stand_anywhere(capsys):
    orders = (
        ["match", "scorer", "idle", "--scenario=alone", "--set=gain=5", "--games=8", "--seed=2"],
        ["match", "--games", "8", "scorer", "idle", "--set=gain=5", "--seed=2", "--scenario=alone"],
    )
    assert len({run(capsys, *words) for words in orders}) == 1


def test_heldout_map_is_short_for_the_heldout_variants_map():
    from marl_cair.games import GAMES

    game = GAMES["deep_rts"]
    scenario = game.scenario("1v1-15x15")
    words = ["heldout_map=test-15x15-2p", "map=train-15x15-2p", "fog=true", "small.teams=[0,1]"]
    variants = match.read_variants(game, scenario, words)
    maps = {name: (variant.map, variant.fog) for name, variant in variants.items()}
    assert maps == {
        "": ("train-15x15-2p", True),
        "heldout": ("test-15x15-2p", True),
        "small": ("train-15x15-2p", True),
    }
    assert variants["small"].teams == (0, 1)


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("--set=gian=3", "unknown last_standing option 'gian': nearest are 'gain'"),
        ("--sprt=0,200000", "between 0 and 200000 Elo: give numbers in -4000"),
        ("--set=gain", "write --set field=value"),
        ("--set=reward=shaped", "reward=shaped: leave it out"),
        ("--set=far.gain=many", "gain is 'many', it must be a whole number"),
    ],
)
def test_a_match_refuses_in_one_line(capsys, word, message):
    text = run(capsys, "match", "idle", "quitter", "--scenario=ffa-3", word, code=2)
    assert message in text
    assert text.count("\n") == 1


def test_help_describes_each_option():
    text = " ".join(match.make_parser().format_help().split())
    assert "heldout_map=" in text
    for action in match.make_parser()._actions:
        assert action.help, action.dest


def test_evaluate_plays_games_of_many_in_whole_blocks(capsys):
    text = run(
        capsys, "evaluate", "finisher", "--against", "idle", "--games", "10", "--scenario", "ffa-3"
    )
    assert "share of games won (fair: 33.3%), draws are not wins" in text
    row = text.splitlines()[2].split()
    assert row[0] == "idle"
    assert row[1] == row[2]
    assert row[5] == "100.0%"


def test_evaluate_counts_games_that_repeat_others_once(capsys):
    words = ["--against", "idle", "--games", "12", "--scenario", "ffa-3", "--set", "gain=0"]
    text = run(capsys, "evaluate", "finisher", *words)
    assert "idle         3      3      0      0  100.0% [14.7%, 100.0%]" in text
    assert "9 of 12 games repeat the others, move by move: not counted." in text


def test_evaluate_and_match_have_the_same_interval():
    """Also if both games of a map seed end alike: single games would be too narrow."""
    games = [
        GameResult(
            block, seat, seat if block % 2 else 1 - seat, False, 9, f"{block} {seat}", block % 2
        )
        for block in range(20)
        for seat in range(2)
    ]
    result = MatchResult(tuple(games))
    low, high = result.interval()
    shares = result.wins / result.games, *result.interval(wins_only=True)
    row = evaluate.format_row("b", (result.games, result.wins, 0, 20), shares, 1)
    assert f"50.0% [{low:.1%}, {high:.1%}]" in row
    assert high - low > 0.4  # of 40 independent games: 0.3


def test_evaluate_needs_a_rival_where_there_are_rivals(capsys):
    text = run(capsys, "evaluate", "finisher", "--scenario", "duel", "--against", code=2)
    assert "--against is empty: name one or more opponents" in text
    assert "ended" in run(capsys, "evaluate", "idle", "--scenario", "alone", "--against")


def test_evaluate_rates_solo_agents_apart(capsys):
    text = run(capsys, "evaluate", "idle", "--scenario", "alone", "--games", "20")
    assert "alone: 20 games, each alone" in text
    assert "idle: 0.0% [0.0%, 16.1%] ended before the time limit" in text
    assert "random: 100.0% [83.9%, 100.0%] ended before the time limit" in text


def test_more_games_than_were_asked_for_are_reported(capsys):
    played = "playing 6: each map seed once in each of 3 seats\n"
    words = ("finisher", "idle", "--scenario=ffa-3")
    assert run_with_notes(capsys, "match", *words, "--games=5") == f"games is 5, {played}"
    assert run_with_notes(capsys, "match", *words, "--games=6") == ""
    words = ("finisher", "--against", "idle", "--scenario", "ffa-3", "--games")
    assert run_with_notes(capsys, "evaluate", *words, "4") == f"games is 4, {played}"
    words = ("finisher", "idle", "--scenario=teams", "--games=3")
    text = "games is 3, playing 4: each map seed once in each of 2 teams\n"
    assert run_with_notes(capsys, "match", *words) == text


def run_with_notes(capsys, *words):
    assert main([*words, f"--game={NAME}"]) == 0
    return capsys.readouterr().err


def test_help_lists_all_kinds_of_agents():
    for command in (match, evaluate):
        text = " ".join(command.make_parser().format_help().split())
        for kind in ("runs/a/latest", "mixture", "module:function", "process:COMMAND"):
            assert kind in text


def test_a_game_that_is_always_the_same_counts_once(capsys):
    maze = ("--game", "deep_maze", "--scenario", "9x9-full_deterministic", "--games", "20")
    assert main(["evaluate", "oracle", *maze, "--against"]) == 0
    text = capsys.readouterr().out
    assert "oracle: 100.0% [20.7%, 100.0%] ended before the time limit (only 1 of 20" in text
