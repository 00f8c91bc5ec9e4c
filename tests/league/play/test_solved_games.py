"""PettingZoo's tic-tac-toe: a perfect player never loses, is rated first, and gets what is due."""

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

from tests.league.tictactoe import GAME, GIVEAWAY, PERFECT, VALUES, WAIT, Player, register

MATCH_SEED = 5


def play(first, second, num_games, scenario="whole"):
    chosen = GAME.scenario(scenario)
    agents = GAME.bot(first, chosen), GAME.bot(second, chosen)
    return play_match(*agents, GAME, chosen, num_games, MATCH_SEED)


def run(folder, monkeypatch, *agents, games):
    """Ratings best first, and the rows of winrates.csv by both names."""
    register(monkeypatch)
    settings = {"games_per_pair": games, "out": str(folder), "replays": False}
    result = run_league(LeagueConfig(agents, GAME.name, "whole", **settings), show_progress=False)
    with (folder / "winrates.csv").open() as file:
        rows = {(row["agent"], row["opponent"]): row for row in csv.DictReader(file)}
    return result.ratings, rows


# --- the game -----------------------------------------------------------------------------------


def play_all_lines(choose, seat):
    """Winners of the games of the first best move against every order of moves of the other."""
    lines = list(itertools.product(*map(range, (8, 6, 4, 2) if seat == 0 else (9, 7, 5, 3))))
    player = Player("first", lambda cells, moves: choose(cells, moves)[:1])
    engine = BatchedEngine(GAME, GAME.scenario(), len(lines))
    engine.reset(np.arange(len(lines), dtype=np.uint64))
    actions = np.zeros((len(lines), 2), np.int32)
    for tick in range(9):
        masks, seen = engine.action_mask(), engine.observe("vector")
        runs = ~engine.terminated
        actions[:] = WAIT
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


def test_it_is_drawn_from_any_first_move():
    assert len(VALUES) == 4_520  # all 5,478 boards but the 958 at which it is over
    assert set(VALUES[bytes(18)].values()) == {0}


@pytest.mark.slow
@pytest.mark.parametrize("seat", [0, 1])
def test_perfect_play_loses_to_nothing_that_can_be_tried(seat):
    winners = play_all_lines(PERFECT, seat)
    assert set(winners.tolist()) == {seat, NO_WINNER}
    assert 1 - seat in play_all_lines(GIVEAWAY, seat)


# --- matches ------------------------------------------------------------------------------------


def test_perfect_play_draws_with_itself():
    match = play("perfect", "twin", 100)
    assert match.draws == match.games == 100
    assert match.distinct_games > 50


@pytest.mark.parametrize("rival", ["random", "sleepy"])
def test_perfect_play_never_loses_a_match(rival):
    match = play("perfect", rival, 200)
    assert match.losses == 0
    assert match.wins > 0
    assert match.draws > 0
    broken = play("giveaway", rival, 200)
    assert broken.losses > broken.wins


def find_surpluses(first, second, num_games=80):
    """The first agent's result in each game less the value of its opening; and these values."""
    results = play(first, second, num_games, "opened").results
    engine = BatchedEngine(GAME, GAME.scenario("opened"), num_games // 2)
    engine.reset(map_seeds(MATCH_SEED, np.arange(num_games // 2)))
    boards = engine.observe("vector")[:, 0] > 0
    assert (boards.sum(1) == 4).all()
    of_first_seat = [max(VALUES[board.tobytes()].values()) for board in boards]
    worth = np.array([of_first_seat[r.block] * (1 if r.first_seat == 0 else -1) for r in results])
    got = np.array([round(2 * result.score - 1) for result in results])
    return got - worth, worth


def test_a_perfect_player_gets_exactly_the_value_of_each_opening_against_itself():
    surpluses, worth = find_surpluses("perfect", "twin")
    assert set(worth.tolist()) == {-1, 0, 1}
    assert not surpluses.any()


@pytest.mark.parametrize("rival", ["random", "sleepy"])
def test_a_perfect_player_never_gets_less_than_the_value_of_an_opening(rival):
    surpluses, _ = find_surpluses("perfect", rival)
    assert surpluses.min() == 0
    assert surpluses.max() > 0
    assert find_surpluses("giveaway", rival)[0].min() < 0


@pytest.mark.parametrize("rival", ["random", "sleepy", "giveaway"])
def test_a_perfect_player_loses_no_pair_of_games_of_an_opening(rival):
    """An advantage of a seat is the opponent's in the other game of the pair."""
    for first, loses in (("perfect", False), ("giveaway", True)):
        results = play(first, rival, 40, "opened").results
        pairs = np.bincount([one.block for one in results], [one.score for one in results])
        assert (pairs.min() < 1.0) == loses


# --- ratings ------------------------------------------------------------------------------------


def test_perfect_play_is_rated_first_and_draws_are_halves(tmp_path, monkeypatch):
    names = ("perfect", "sleepy", "random", "giveaway")
    ratings, rows = run(tmp_path / "a", monkeypatch, *names, games=60)
    assert [rating.name for rating in ratings] == list(names)
    assert ratings[0].probability_first > 0.95
    against = [rows["perfect", rival] for rival in names[1:]]
    assert {int(row["losses"]) for row in against} == {0}
    wins, draws = (sum(int(row[result]) for row in against) for result in ("wins", "draws"))
    assert draws > 0
    assert ratings[0].games == wins + draws
    assert ratings[0].score == pytest.approx((wins + draws / 2) / (wins + draws))


@pytest.mark.slow
def test_drawn_games_alone_rate_both_alike(tmp_path, monkeypatch):
    ratings, rows = run(tmp_path / "a", monkeypatch, "perfect", "twin", games=40)
    assert int(rows["perfect", "twin"]["draws"]) == ratings[0].games > 0
    assert [rating.score for rating in ratings] == [0.5, 0.5]
    assert [rating.elo for rating in ratings] == pytest.approx([0.0, 0.0], abs=1e-6)
