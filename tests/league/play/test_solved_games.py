"""Tic-tac-toe and Connect Four of PettingZoo: who plays perfectly never loses, and rates first."""

import csv
import itertools

import numpy as np
import pytest

from marl_cair.games.engine import BatchedEngine
from marl_cair.games.game import NO_WINNER
from marl_cair.league.league import LeagueConfig, run_league
from marl_cair.league.play.match import play_match
from marl_cair.league.play.playing import map_seeds

pytest.importorskip("pygame", reason="PettingZoo's board games need the extra `dev`")

from pettingzoo.classic.connect_four import connect_four  # needs pygame
from pettingzoo.classic.tictactoe import tictactoe  # needs pygame

from tests.league import board_players as players
from tests.league.pettingzoo_games import Scenario, make_game, register

VALUES = players.solve_all(tictactoe.raw_env)
PERFECT = players.choose_by(VALUES, max)
GIVEAWAY = players.choose_by(VALUES, min)
MATCH_SEED = 5
OPENING = 26  # stones of Connect Four's 42 that lie when play begins: the rest is solved at once


def choose_sleepily(cells, moves):
    """Perfect until it has two marks."""
    return PERFECT(cells, moves) if cells[:9].sum() < 2 else moves


TICTACTOE = make_game(
    "tictactoe",
    tictactoe.raw_env,
    {"whole": Scenario()},
    players.make_bots(
        {
            "perfect": PERFECT,
            "twin": PERFECT,
            "sleepy": choose_sleepily,
            "giveaway": GIVEAWAY,
            "random": players.choose_any,
        }
    ),
)
CONNECT_FOUR = make_game(
    "connect_four",
    connect_four.raw_env,
    {"endgame": Scenario(opening=OPENING), "whole": Scenario()},
    players.make_bots(
        {
            "solver": players.choose_best,
            "twin": players.choose_best,
            "near": players.choose_near,
            "giveaway": players.choose_worst,
            "random": players.choose_any,
        }
    ),
)

# Columns 1 to 7, and the sign of the score, of Pascal Pons's published tests (blog.gamesolver.org).
PUBLISHED = {
    "2252576253462244111563365343671351441": -1,
    "7422341735647741166133573473242566": 1,
    "23163416124767223154467471272416755633": 0,
    "65214673556155731566316327373221417": -1,
    "52677675164321472411331752454": 0,
    "233377345754465174223731671122611552": 1,
    "6763525635134453444361412671365712": -1,
    "211376455663355325112113664364524722": 0,
    "3146762114467714356347741621375222": -1,
    "67152117737262713366376314254": 1,
    "2762751722231276466633475674533": 1,
    "427566236745127177115664464254": 1,
    "3575316255751336464276636772271112": -1,
}


def play(game, first, second, num_games):
    scenario = game.scenario()
    agents = game.bot(first, scenario), game.bot(second, scenario)
    return play_match(*agents, game, scenario, num_games, MATCH_SEED)


def run(folder, monkeypatch, game, *agents, games):
    """Ratings best first, and the rows of winrates.csv by both names."""
    register(monkeypatch, game)
    config = LeagueConfig(
        agents,
        game.name,
        game.default_scenario,
        games_per_pair=games,
        out=str(folder),
        replays=False,
    )
    result = run_league(config, show_progress=False)
    with (folder / "winrates.csv").open() as file:
        rows = {(row["agent"], row["opponent"]): row for row in csv.DictReader(file)}
    return result.ratings, rows


# --- both ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("game", [TICTACTOE, CONNECT_FOUR], ids=lambda game: game.name)
class TestGame:
    def test_one_seat_moves_and_the_other_waits(self, game):
        engine = BatchedEngine(game, game.scenario("whole"))
        engine.reset(0)
        wait = engine.spec.noop_action
        for tick, seat in enumerate((0, 1, 0)):
            mask = engine.action_mask()[0]
            legal = np.flatnonzero(mask[seat])
            assert len(legal) == (9 - tick if game is TICTACTOE else 7)
            assert wait not in legal
            assert np.flatnonzero(mask[1 - seat]).tolist() == [wait]
            actions = np.full((1, 2), wait)
            actions[0, seat] = legal[0]
            engine.step(actions)
        assert engine.illegal_actions.sum() == 0

    def test_an_illegal_move_changes_nothing_and_is_counted(self, game):
        engine = BatchedEngine(game, game.scenario("whole"))
        engine.reset(0)
        board, wait = engine.observe("vector"), engine.spec.noop_action
        engine.step(np.array([[wait, 0]]))  # the first waits, the second moves out of turn
        assert np.array_equal(engine.observe("vector"), board)
        assert engine.illegal_actions.tolist() == [[1, 1]]

    def test_a_snapshot_is_of_the_board(self, game):
        engine = BatchedEngine(game, game.scenario("whole"))
        engine.reset(0)
        wait = engine.spec.noop_action
        engine.step(np.array([[0, wait]]))
        kept, board = engine.snapshot(), engine.observe("vector")
        engine.step(np.array([[wait, 1]]))
        assert not np.array_equal(engine.observe("vector"), board)
        engine.restore(kept)
        assert np.array_equal(engine.observe("vector"), board)


# --- tic-tac-toe --------------------------------------------------------------------------------


def play_all_lines(choose, seat):
    """Winners of the games of the first best move against every order of moves of the other."""
    lines = list(itertools.product(*map(range, (8, 6, 4, 2) if seat == 0 else (9, 7, 5, 3))))
    player = players.Player("first", lambda cells, moves: choose(cells, moves)[:1])
    engine = BatchedEngine(TICTACTOE, TICTACTOE.scenario(), len(lines))
    engine.reset(np.arange(len(lines), dtype=np.uint64))
    actions = np.zeros((len(lines), 2), np.int32)
    for tick in range(9):
        masks, seen = engine.action_mask(), engine.observe("vector")
        runs = ~engine.terminated
        actions[:] = engine.spec.noop_action
        actions[runs, seat] = player.act(seen[runs, seat], masks[runs, seat])
        if tick % 2 != seat:
            turn = tick // 2
            for world in np.flatnonzero(runs).tolist():
                legal = np.flatnonzero(masks[world, 1 - seat])
                # In the last cell there is no choice.
                which = lines[world][turn] if turn < len(lines[world]) else 0
                actions[world, 1 - seat] = legal[which]
        engine.step(actions)
    assert engine.terminated.all()
    assert engine.illegal_actions.sum() == 0
    return engine.winner


def test_tictactoe_is_drawn_from_any_first_move():
    assert len(VALUES) == 4_520  # all 5,478 boards but the 958 at which it is over
    assert set(VALUES[bytes(18)].values()) == {0}


@pytest.mark.parametrize("seat", [0, 1])
def test_perfect_play_loses_to_nothing_that_can_be_tried(seat):
    winners = play_all_lines(PERFECT, seat)
    assert set(winners.tolist()) == {seat, NO_WINNER}
    assert 1 - seat in play_all_lines(GIVEAWAY, seat)


def test_perfect_play_draws_with_itself():
    match = play(TICTACTOE, "perfect", "twin", 100)
    assert match.draws == match.games == 100
    assert match.distinct_games > 50


@pytest.mark.parametrize("rival", ["random", "sleepy"])
def test_perfect_play_never_loses_a_match(rival):
    match = play(TICTACTOE, "perfect", rival, 200)
    assert match.losses == 0
    assert match.wins > 0
    assert match.draws > 0
    broken = play(TICTACTOE, "giveaway", rival, 200)
    assert broken.losses > broken.wins


def test_perfect_play_is_rated_first_and_draws_are_halves(tmp_path, monkeypatch):
    names = ("perfect", "sleepy", "random", "giveaway")
    ratings, rows = run(tmp_path / "a", monkeypatch, TICTACTOE, *names, games=60)
    assert [rating.name for rating in ratings] == list(names)
    assert ratings[0].probability_first > 0.95
    against = [rows["perfect", rival] for rival in names[1:]]
    assert {int(row["losses"]) for row in against} == {0}
    wins, draws = (sum(int(row[result]) for row in against) for result in ("wins", "draws"))
    assert draws > 0
    assert ratings[0].games == wins + draws
    assert ratings[0].score == pytest.approx((wins + draws / 2) / (wins + draws))


def test_drawn_games_alone_rate_both_alike(tmp_path, monkeypatch):
    ratings, rows = run(tmp_path / "a", monkeypatch, TICTACTOE, "perfect", "twin", games=40)
    assert int(rows["perfect", "twin"]["draws"]) == ratings[0].games > 0
    assert [rating.score for rating in ratings] == [0.5, 0.5]
    assert [rating.elo for rating in ratings] == pytest.approx([0.0, 0.0], abs=1e-6)


# --- Connect Four -------------------------------------------------------------------------------


@pytest.mark.parametrize("moves", PUBLISHED)
def test_the_solver_finds_what_is_published(moves):
    own = other = 0
    for column in moves:
        own, other = other, players.drop(own, other, int(column) - 1)
    assert players.solve(own, other) == PUBLISHED[moves]


def test_the_solver_sees_the_fours_that_pettingzoo_sees():
    engine = BatchedEngine(CONNECT_FOUR, CONNECT_FOUR.scenario("whole"), 60)
    engine.reset(np.arange(60, dtype=np.uint64))
    luck = np.random.default_rng(0)
    while not engine.terminated.all():
        masks = engine.action_mask()
        actions = np.argmax(luck.random(masks.shape) * masks, axis=2)
        engine.step(actions)
        for world, cells in enumerate(engine.observe("vector")[:, 0] > 0):
            fours = [players.has_four(stones) for stones in players.pack(cells)]
            winner = engine.winner[world]
            assert fours == [winner == 0, winner == 1]
            assert engine.terminated[world] == (any(fours) or cells.sum() == 42)


def find_surpluses(first, second, num_games=80):
    """What the first got in each game, less what the board was worth to it; and those values."""
    match = play(CONNECT_FOUR, first, second, num_games)
    engine = BatchedEngine(CONNECT_FOUR, CONNECT_FOUR.scenario(), num_games // 2)
    engine.reset(map_seeds(MATCH_SEED, np.arange(num_games // 2)))
    boards = engine.observe("vector")[:, 0] > 0  # of both
    assert (boards.sum(1) == OPENING).all()
    of_first_seat = [players.solve(*players.pack(cells)) for cells in boards]
    worth = np.array(
        [of_first_seat[one.block] * (1 if one.first_seat == 0 else -1) for one in match.results]
    )
    got = np.array([round(2 * one.score - 1) for one in match.results])
    return got - worth, worth


def test_the_solver_gets_exactly_what_the_board_is_worth_against_itself():
    surpluses, worth = find_surpluses("solver", "twin")
    assert set(worth.tolist()) == {-1, 0, 1}
    assert not surpluses.any()


@pytest.mark.parametrize("rival", ["random", "near"])
def test_the_solver_never_gets_less_than_the_board_is_worth(rival):
    surpluses, _ = find_surpluses("solver", rival)
    assert surpluses.min() == 0
    assert surpluses.max() > 0
    assert find_surpluses("giveaway", rival)[0].min() < 0


def test_the_solver_is_rated_first_and_loses_no_pair_of_games(tmp_path, monkeypatch):
    """What a board denies it in one seat it gives it in the other.

    Only that is sure: a rating also counts who takes most off the weak, which no value tells.
    """
    names = ("solver", "near", "random", "giveaway")
    ratings, rows = run(tmp_path / "a", monkeypatch, CONNECT_FOUR, *names, games=40)
    assert [rating.name for rating in ratings] == list(names)
    for rival in names[1:]:
        assert float(rows["solver", rival]["score"]) >= 0.5
        results = play(CONNECT_FOUR, "solver", rival, 40).results
        pairs = np.bincount([one.block for one in results], [one.score for one in results])
        assert pairs.min() >= 1.0
    broken = play(CONNECT_FOUR, "giveaway", "near", 40).results
    assert np.bincount([one.block for one in broken], [one.score for one in broken]).min() < 1.0
