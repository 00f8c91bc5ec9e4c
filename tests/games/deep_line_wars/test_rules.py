"""Income, the end of a game, rewards, and the order of the phases of a tick."""

import dataclasses

import numpy as np
import pytest

from marl_cair.games.deep_line_wars.tables import FASTER, MILITIA, PRESETS
from marl_cair.games.game import NO_WINNER
from tests.games.deep_line_wars.board import Board


def read_outcome(board: Board) -> tuple[bool, bool, int, list[float]]:
    """Terminated, truncated, winner, rewards."""
    engine = board.engine
    flags = bool(engine.terminated[0]), bool(engine.truncated[0])
    return *flags, int(engine.winner[0]), engine.rewards[0].tolist()


def put_arriving(board: Board, player: int) -> None:
    """A unit that reaches the far column in the next tick."""
    board.put_unit(player, MILITIA, row=4, column=board.rules.columns - 2, progress=90)


@pytest.mark.plain_python
def test_income_is_paid_at_the_end_of_every_hundredth_tick():
    board = Board(max_ticks=1_000)
    for tick in range(1, 301):
        board.wait(1)
        assert board.world.gold.tolist() == [100 + tick // 100 * 20] * 2


def test_a_purchase_in_the_last_tick_of_an_interval_already_pays():
    """Orders come before earning."""
    board = Board()
    board.wait(99)
    board.play("buy_militia", "noop")
    assert board.world.gold.tolist() == [100 - 10 + 22, 120]


def test_income_grows_with_every_purchase_and_never_falls():
    board = Board(ticks_per_step=10)
    for bought in range(1, 6):
        board.play("buy_militia", "build_basic_r0_c1")
        assert board.world.income.tolist() == [20 + 2 * bought, 20]
    board.wait(5)
    assert board.world.gold[0] == 100 - 50 + 30


def test_lumber_is_paid_with_the_income(monkeypatch):
    preset = dataclasses.replace(PRESETS["2018"], start_lumber=4, lumber_per_interval=3)
    monkeypatch.setitem(PRESETS, "lumber", preset)
    board = Board(preset="lumber")
    board.wait(99)
    assert board.world.lumber.tolist() == [4, 4]
    board.wait(1)
    assert board.world.lumber.tolist() == [7, 7]


@pytest.mark.plain_python
@pytest.mark.parametrize(("loser", "rewards"), [(0, [-1.0, 1.0]), (1, [1.0, -1.0])])
def test_a_player_without_health_has_lost(loser, rewards):
    board = Board()
    board.world.health[loser] = 1
    put_arriving(board, 1 - loser)
    board.wait(1)
    assert read_outcome(board) == (True, False, 1 - loser, rewards)


@pytest.mark.parametrize(("health", "arriving"), [((1, 1), (1, 1)), ((1, 2), (5, 1))])
def test_losing_in_the_same_tick_is_a_draw_also_where_one_is_further_below_zero(health, arriving):
    board = Board()
    board.world.health[:] = health
    for player in range(2):
        for _ in range(arriving[player]):
            put_arriving(board, player)
    board.wait(1)
    assert board.world.health.tolist() == [health[0] - arriving[1], health[1] - arriving[0]]
    assert read_outcome(board) == (True, False, NO_WINNER, [0.0, 0.0])


def test_the_time_limit_truncates_and_names_no_winner():
    board = Board(max_ticks=200, ticks_per_step=10)
    board.world.health[:] = (50, 3)
    board.wait(19)
    assert not board.engine.truncated[0]
    board.wait(1)
    assert read_outcome(board) == (False, True, NO_WINNER, [0.0, 0.0])


def test_a_time_limit_within_a_step_ends_it_there():
    board = Board(max_ticks=25, ticks_per_step=10)
    board.wait(3)
    assert board.world.tick[0] == 25
    assert board.engine.truncated[0]


@pytest.mark.parametrize(("num_steps", "progress", "end"), [(1, 0, 20), (0, 60, 4)])
def test_a_loss_counts_in_the_last_tick_and_ends_the_game_within_a_step(num_steps, progress, end):
    board = Board(max_ticks=20, ticks_per_step=10)
    board.wait(num_steps)
    board.world.health[1] = 1
    board.put_unit(0, MILITIA, row=4, column=13, progress=progress)
    board.wait(1)
    assert board.world.tick[0] == end
    assert read_outcome(board)[:3] == (True, False, 0)


def test_a_finished_world_ignores_steps_and_pays_nothing():
    board = Board()
    board.world.health[1] = 1
    put_arriving(board, 0)
    board.wait(1)
    before = board.engine.state_dict()
    board.play("buy_militia", "build_basic_r0_c1")
    after = board.engine.state_dict()
    assert after.pop("outcome.rewards").tolist() == [[0.0, 0.0]]
    for name, value in after.items():
        np.testing.assert_array_equal(value, before[name])


def test_the_last_tick_still_pays_income():
    """Earning comes before judging."""
    board = Board(max_ticks=100)
    board.wait(100)
    assert board.engine.truncated[0]
    assert board.world.gold.tolist() == [120, 120]


def test_a_tick_walks_then_lands_then_fires_then_earns_then_judges(monkeypatch):
    """One tick in which each phase decides what the next one sees."""
    preset = dataclasses.replace(PRESETS["2018"], projectile_tiles_per_tick=2)
    monkeypatch.setitem(PRESETS, "flying", preset)
    board = Board(preset="flying", max_ticks=100)
    board.wait(98)
    board.put_tower(0, FASTER, row=6, column=1)
    board.put_unit(1, MILITIA, row=4, column=13, progress=0, health=1)  # will be shot
    board.put_unit(1, MILITIA, row=4, column=13, progress=80)  # will arrive in tick 100
    board.put_unit(1, MILITIA, row=5, column=13, progress=0)  # next target
    board.wait(1)
    assert board.world.num_shots[0] == 1
    board.world.tower_ready[0, 0] = 100
    board.play("noop", "buy_militia")
    assert board.world.health.tolist() == [49, 50]  # walk
    assert board.world.gold[0] == 100 + 1 + 20  # land: bounty; earn: income
    assert board.world.shot_target[0, 0] == 2  # fire: not at the dead, nor at the one that left
    assert board.world.gold[1] == 100 - 10 + 22  # orders before earn
    assert board.engine.truncated[0]  # judge


def test_sparse_games_pay_only_at_the_end():
    board = Board()
    put_arriving(board, 0)
    board.play("buy_militia")
    assert board.world.health.tolist() == [50, 49]
    assert board.engine.rewards.tolist() == [[0.0, 0.0]]


def test_a_shaped_step_pays_the_discounted_gain_of_potential():
    board = Board(reward="shaped", shaping_discount=0.9)
    put_arriving(board, 0)
    board.play("buy_militia")
    potential = 0.5 * (50 - 49) / 50 + 0.3 * (22 - 20) / (22 + 20)
    assert board.engine.rewards[0, 0] == np.float32(0.9 * potential - 0.0)
    assert board.engine.rewards[0, 1] == -board.engine.rewards[0, 0]
    board.wait(1)
    assert board.engine.rewards[0, 0] == np.float32(0.9 * potential - potential)


def test_the_potential_ends_with_the_game():
    board = Board(reward="shaped", shaping_discount=0.9)
    board.world.health[:] = (50, 1)
    before = 0.5 * 49 / 50
    put_arriving(board, 0)
    board.wait(1)
    assert board.engine.rewards[0, 0] == np.float32(1.0 - before)
