"""Matches of more than two seats and of teams, and agents that play alone, on the test game."""

import sqlite3
from contextlib import closing

import numpy as np
import pytest

from marl_cair.cli import main
from marl_cair.games.game import NO_WINNER
from marl_cair.league.league import LeagueConfig, run_league
from marl_cair.league.play import match as matches
from marl_cair.league.play.match import GameResult, MatchResult, play_chunks, play_match
from marl_cair.league.play.playing import map_seeds
from marl_cair.league.play.solo import compare, play_alone
from marl_cair.league.ratings.intervals import mean_interval
from marl_cair.league.report.report import number_agents, report_stored
from marl_cair.league.store.store import LeagueStore, LeagueStoreError
from tests.games import last_standing
from tests.games.last_standing import FINISH, GAME, NOOP

MANY = ["duel", "ffa-3", "ffa-4", "ffa-8", "teams", "uneven"]


def bot(name):
    return GAME.bots[name](None, None)


def play(first, second, scenario, num_games, seed=3, identities=None):
    chosen = GAME.scenario(scenario)
    return play_match(bot(first), bot(second), GAME, chosen, num_games, seed, identities)


# --- seats -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scenario", "first_seats"),
    [
        ("duel", [0, 1]),
        ("ffa-3", [0, 1, 2]),
        ("ffa-4", [0, 1, 2, 3]),
        ("ffa-8", list(range(8))),
        ("teams", [0, 1]),
        ("uneven", [0, 1, 4]),
    ],
)
def test_each_map_seed_is_played_once_with_the_first_agent_in_each_team(scenario, first_seats):
    match = play("random", "random", scenario, 3 * len(first_seats))
    expected = [(block, seat) for block in range(3) for seat in first_seats]
    assert [(r.block, r.first_seat) for r in match.results] == expected
    assert match.num_teams == len(first_seats)


@pytest.mark.parametrize("scenario", MANY)
def test_the_first_agent_plays_its_whole_team_and_the_second_all_others(scenario):
    """The finisher wins for its team at once, in any seat; its opponents wait."""
    num_teams = GAME.make_spec(GAME.scenario(scenario)).num_teams
    match = play("finisher", "idle", scenario, 4 * num_teams)
    assert (match.wins, match.draws, match.losses) == (4 * num_teams, 0, 0)
    other_way = play("idle", "finisher", scenario, 4 * num_teams)
    drawn = num_teams > 2  # two teams of finishers draw, one wins
    assert (other_way.draws, other_way.losses) == (
        (4 * num_teams, 0) if drawn else (0, 4 * num_teams)
    )


def test_seats_of_the_first_agent_are_those_of_its_team():
    first, second = bot("finisher"), bot("idle")
    play_chunks(first, second, GAME, GAME.scenario("uneven"), 0, (0,))
    shown = sorted(seat - 1 for seat, *_ in first.rows[:6])
    assert shown == sorted([0, 3, 1, 2, 5, 4])  # once in each team, over the games of a block
    assert len(second.rows) == 2 * len(first.rows)


def test_an_agent_is_not_asked_for_seats_that_are_out():
    first, second = bot("quitter"), bot("idle")
    play_chunks(first, second, GAME, GAME.scenario("ffa-3"), 0, (0,))
    assert {tick for *_, tick in first.rows} == {0}
    assert {tick for *_, tick in second.rows} == set(range(12))


@pytest.mark.parametrize("scenario", MANY)
def test_a_longer_match_begins_with_a_shorter_one(scenario):
    num_teams = GAME.make_spec(GAME.scenario(scenario)).num_teams
    longer = play("random", "scorer", scenario, 14 * num_teams)
    shorter = play("random", "scorer", scenario, 5 * num_teams)
    assert shorter.results == longer.results[: 5 * num_teams]
    assert longer.distinct_games > 5 * num_teams


@pytest.mark.parametrize("scenario", MANY)
def test_chunks_may_be_played_in_any_company(scenario):
    agents, chosen = (bot("random"), bot("random")), GAME.scenario(scenario)
    whole = play_chunks(*agents, GAME, chosen, 3, (0, 1, 2)).results
    turned = play_chunks(*agents, GAME, chosen, 3, (2, 0)).results
    size = len(whole) // 3
    assert turned[size:] == whole[:size]
    assert turned[:size] == whole[2 * size :]


def test_a_match_between_two_teams_is_the_same_from_both_sides():
    one = play("random", "random", "teams", 16, identities=("a", "b"))
    two = play("random", "random", "teams", 16, identities=("b", "a"))
    games = {(r.block, r.first_seat): r.fingerprint for r in one.results}
    assert games == {(r.block, 1 - r.first_seat): r.fingerprint for r in two.results}
    assert one.score == 1.0 - two.score


def test_a_recorded_game_of_many_is_the_first_of_the_match():
    replay = matches.record_game(bot("finisher"), bot("idle"), GAME, GAME.scenario("teams"), 3)
    assert replay.actions.tolist() == [[FINISH, NOOP, NOOP, FINISH]]
    assert replay.players == ("finisher", "idle", "idle", "finisher")


# --- points and their interval -----------------------------------------------------------------


def test_an_agent_that_has_left_a_game_has_lost_it_even_if_it_is_drawn():
    match = play("quitter", "idle", "ffa-4", 8)
    assert {r.winner for r in match.results} == {NO_WINNER}
    assert (match.wins, match.draws, match.losses, match.score) == (0, 0, 8, 0.0)
    waiting = play("idle", "quitter", "ffa-4", 8)
    assert (waiting.wins, waiting.score) == (8, 1.0)


@pytest.mark.parametrize("scenario", MANY)
def test_equal_agents_have_the_fair_share(scenario):
    num_teams = GAME.make_spec(GAME.scenario(scenario)).num_teams
    drawn = play("idle", "idle", scenario, 4 * num_teams)
    assert drawn.score == pytest.approx(drawn.fair_share) == pytest.approx(1 / num_teams)
    assert drawn.draws == drawn.games
    noise = play("random", "random", scenario, 60 * num_teams, identities=("a", "b"))
    low, high = noise.interval()
    assert low < noise.fair_share < high


def make_match(wins, num_teams=4):
    """Blocks of `num_teams` games, of which the first agent has won `wins`."""
    games = [
        GameResult(block, seat, (seat + (seat >= number)) % num_teams, False, 1, "", seat < number)
        for block, number in enumerate(wins)
        for seat in range(num_teams)
    ]
    return MatchResult(tuple(games), num_teams)


def test_the_interval_is_of_blocks_and_not_of_games():
    """The same share of wins has a narrower interval if it is spread over the map seeds."""
    even, lumped = make_match([1] * 40), make_match([4, 0, 0, 0] * 10)
    assert even.score == lumped.score == 0.25
    widths = [high - low for low, high in (even.interval(), lumped.interval())]
    assert widths[0] < 0.5 * widths[1]


def test_wins_have_an_interval_of_their_own():
    match = play("idle", "idle", "ffa-3", 36)
    low, high = match.interval(wins_only=True)
    assert low == 0.0
    assert high < match.score


@pytest.mark.parametrize(
    ("scenario", "message"),
    [
        ("ffa-3", "num_games is 4, it must be a multiple of 3: every map seed is"),
        ("uneven", "a multiple of 3: every map seed is played once in each team"),
        ("alone", "this scenario has one team"),
    ],
)
def test_numbers_of_games_that_favour_a_seat_are_refused(scenario, message):
    with pytest.raises(ValueError, match=message):
        play("idle", "idle", scenario, 4)


# --- alone -------------------------------------------------------------------------------------


def play_solo(name, num_games, seed=3, scenario="alone", **options):
    return play_alone(bot(name), GAME, GAME.scenario(scenario, **options), num_games, seed)


@pytest.mark.parametrize(("scenario", "num_seats"), [("alone", 1), ("together", 2)])
def test_the_score_of_a_solo_game_is_the_sum_of_its_rewards_and_the_mean_over_seats(
    scenario, num_seats
):
    result = play_solo("scorer", 5, scenario=scenario)
    seeds = map_seeds(3, np.arange(5)).tolist()
    gains = [np.random.default_rng(seed).integers(0, 10, num_seats).mean() for seed in seeds]
    assert result.scores * 100 / 12 == pytest.approx(gains)
    assert [game.block for game in result.results] == list(range(5))


def test_agents_are_compared_on_the_same_map_seeds():
    """Scores vary between map seeds much more than between these agents."""
    own, other = play_solo("scorer", 40), play_solo("random", 40)
    gain = compare(own, other)
    assert gain.mean == pytest.approx(own.scores.mean() - other.scores.mean())
    assert (gain.low, gain.high) == pytest.approx(mean_interval(own.scores - other.scores))
    assert 0.0 < gain.low < gain.mean < gain.high
    assert compare(own, play_solo("scorer", 40)) == (0.0, 0.0, 0.0)


def test_a_longer_solo_series_begins_with_a_shorter_one():
    longer = play_solo("random", 150).results
    assert play_solo("random", 11).results == longer[:11]
    assert longer != play_solo("random", 150, seed=4).results


def test_games_that_look_the_same_from_first_to_last_are_one_game():
    assert play_solo("idle", 20, gain=0).distinct_games == 1
    assert play_solo("idle", 20).distinct_games > 5  # each map shows its own gain


def test_scores_of_different_seeds_are_not_compared():
    with pytest.raises(ValueError, match="5 games cannot be paired with 6: play the same map see"):
        compare(play_solo("idle", 5), play_solo("idle", 6))


@pytest.mark.parametrize(
    ("scenario", "num_games", "message"),
    [("duel", 2, "this scenario has 2 teams"), ("alone", 0, "num_games is 0")],
)
def test_a_scenario_with_opponents_and_no_games_are_refused(scenario, num_games, message):
    with pytest.raises(ValueError, match=message):
        play_solo("idle", num_games, scenario=scenario)


# --- the league --------------------------------------------------------------------------------


def play_league(folder, *agents, scenario="ffa-4", **changes):
    config = LeagueConfig(
        agents, last_standing.NAME, scenario, out=str(folder), replays=False, **changes
    )
    return run_league(config, show_progress=False)


def read_games(folder):
    with closing(LeagueStore(folder / "league.sqlite")) as store:
        return store.read_games()


class TestLeague:
    @pytest.fixture(autouse=True)
    def _known(self, monkeypatch):
        last_standing.register(monkeypatch)

    def test_a_solo_scenario_has_no_league(self, tmp_path):
        with pytest.raises(ValueError, match="this scenario has one team"):
            play_league(tmp_path / "a", "idle", "quitter", scenario="alone")
        assert not (tmp_path / "a").exists()

    @pytest.mark.slow
    def test_teams_are_rated(self, tmp_path):
        names = ("idle", "quitter", "scorer")
        result = play_league(tmp_path, *names, scenario="teams", games_per_pair=4)
        assert result.ratings[-1].name == "quitter"

    @pytest.mark.slow
    def test_a_free_for_all_is_rated_by_the_order_in_which_agents_went_out(self, tmp_path):
        names = ("idle", "quitter", "scorer", "finisher", "random")
        result = play_league(tmp_path, *names, games_per_pair=6)
        order = [rating.name for rating in result.ratings]
        assert order[0] == "finisher"
        assert order.index("idle") < order.index("quitter")

    @pytest.mark.slow
    @pytest.mark.parametrize("agents", [("random", "idle"), ("random", "idle", "scorer")])
    def test_fewer_agents_than_seats_play_more_than_one(self, tmp_path, agents):
        result = play_league(tmp_path, *agents, scenario="ffa-4", games_per_pair=12)
        assert {rating.name for rating in result.ratings} == set(agents)
        assert all(rating.games >= 12 for rating in result.ratings)

    @pytest.mark.slow
    @pytest.mark.parametrize("scenario", ["ffa-3", "ffa-4", "ffa-8", "uneven"])
    def test_a_league_of_many_that_grows_is_a_fresh_one_of_its_size(self, tmp_path, scenario):
        names = ("random", "scorer", "finisher", "idle")
        for games in (3, 10):
            grown = play_league(tmp_path / "a", *names, scenario=scenario, games_per_pair=games)
        fresh = play_league(tmp_path / "b", *names[::-1], scenario=scenario, games_per_pair=games)
        assert grown.text == fresh.text

    @pytest.mark.slow
    def test_each_map_seed_is_played_by_all_agents_in_every_seat(self, tmp_path):
        for seating, games in (("ring", 4), ("all", 24)):
            folder = tmp_path / seating
            names = ("idle", "random", "scorer", "finisher")
            play_league(folder, *names, games_per_pair=4, seating=seating)
            stored = read_games(folder)
            for block in np.unique(stored.blocks):
                seated = stored.agents[stored.blocks == block]
                assert len(seated) == games
                for seat in range(4):
                    assert set(np.bincount(seated[:, seat])[1:]) == {games // 4}

    @pytest.mark.slow
    def test_each_line_up_has_map_seeds_of_its_own(self, tmp_path):
        play_league(tmp_path, "idle", "random", "scorer", scenario="duel", games_per_pair=8)
        stored = read_games(tmp_path)
        blocks, seeds = (len(np.unique(one)) for one in (stored.blocks, stored.map_seeds))
        assert blocks == seeds == 3 * 4
        games = number_agents(stored, sorted(set(stored.agents.ravel().tolist())))
        assert len(np.unique(games.blocks)) == blocks

    @pytest.mark.slow
    def test_games_of_leagues_that_shared_map_seeds_are_one_block(self, tmp_path):
        """New games have map seeds of their own; stored games keep theirs."""
        names = ("idle", "random", "scorer")
        play_league(tmp_path, *names, scenario="duel", games_per_pair=8)
        shared = map_seeds(0, np.arange(4))
        with closing(sqlite3.connect(tmp_path / "league.sqlite")) as database, database:
            for number, seed in enumerate(shared.tolist()):
                database.execute(
                    "UPDATE block SET map_seed = ? WHERE number = ?", (str(seed), number)
                )
        result = play_league(tmp_path, *names, scenario="duel", games_per_pair=16)
        # One game may repeat another move by move, and counts once.
        assert all(30 <= rating.games <= 32 for rating in result.ratings)
        stored = read_games(tmp_path)
        assert set(stored.map_seeds[stored.numbers < 4].tolist()) == set(shared.tolist())
        games = number_agents(stored, sorted(set(stored.agents.ravel().tolist())))
        sizes = np.bincount(games.blocks)
        assert sorted(sizes.tolist()) == [2] * 12 + [6] * 4

    @pytest.mark.slow
    def test_a_league_of_another_seating_is_refused(self, tmp_path):
        play_league(tmp_path, "idle", "random", games_per_pair=4)
        message = "a league with seating = .ring.*cannot be mixed"
        with pytest.raises(LeagueStoreError, match=message):
            play_league(tmp_path, "idle", "random", games_per_pair=4, seating="all")

    @pytest.mark.slow
    def test_new_agents_play_a_ladder_that_does_not_play_again(self, tmp_path):
        ladder, duel = ("random", "idle", "scorer"), {"scenario": "duel"}
        play_league(tmp_path, *ladder, games_per_pair=8, **duel)
        result = play_league(tmp_path, "finisher", ladder=ladder, games_per_pair=16, **duel)
        games = {rating.name: rating.games for rating in result.ratings}
        assert games["finisher"] <= 48
        assert games["random"] <= 8 + 8 + 16
        assert report_stored(tmp_path).ratings == result.ratings

    @pytest.mark.slow
    def test_repeats_are_counted_once(self, tmp_path):
        changes = {"scenario": "duel", "scenario_options": {"gain": 0}}
        short = play_league(tmp_path / "a", "idle", "scorer", games_per_pair=8, **changes)
        long = play_league(tmp_path / "b", "idle", "scorer", games_per_pair=80, **changes)
        assert short.ratings == long.ratings
        assert {rating.games for rating in long.ratings} == {2}
        assert "78 of 80" in long.text

    @pytest.mark.slow
    def test_commands_show_rate_and_export_stored_games(self, tmp_path, capsys):
        folder = str(tmp_path / "a")
        words = ["league", "random", "scorer", "idle", "--game", last_standing.NAME]
        assert main([*words, "--scenario", "ffa-3", "--games", "6", "--out", folder]) == 0
        ladder = capsys.readouterr().out.splitlines()[:5]
        assert main(["league", "status", folder]) == 0
        text = capsys.readouterr().out
        assert "3 agents, 6 games in 1 blocks" in text
        assert "idle: 6 games; bot, scripted" in text
        assert main(["league", "report", folder]) == 0
        assert capsys.readouterr().out.splitlines()[:5] == ladder
        assert main(["league", "export", folder, "--format", "json"]) == 0
        assert len(list((tmp_path / "a" / "export").glob("*.json"))) == 4
        assert main(["league", "status", str(tmp_path / "b")]) == 2
        assert "is not there: give the folder of a league" in capsys.readouterr().err

    @pytest.mark.slow
    def test_the_adaptive_command_stops(self, tmp_path, capsys):
        words = ["league", "random", "scorer", "--game", last_standing.NAME, "--scenario", "duel"]
        assert main([*words, "--ci", "150", "--games", "64", "--out", str(tmp_path / "a")]) == 0
        assert "Advantage of each" in capsys.readouterr().out
