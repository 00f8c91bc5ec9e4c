"""Orders: what purchases and buildings cost and give, and when they are refused."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import chisquare

from marl_cair.games import make_engine
from marl_cair.games.deep_line_wars.state import NO_TOWER, unit_slot
from marl_cair.games.deep_line_wars.tables import PRESETS, TOWER_NAMES, UNIT_NAMES, Preset
from tests.games.deep_line_wars.board import Board


@pytest.fixture
def lumber_preset(monkeypatch) -> Preset:
    """The numbers of 2018, but towers cost lumber and intervals pay some."""
    preset = dataclasses.replace(
        PRESETS["2018"], tower_cost_lumber=(1, 2, 3), start_lumber=3, lumber_per_interval=2
    )
    monkeypatch.setitem(PRESETS, "lumber", preset)
    return preset


@pytest.mark.plain_python
@pytest.mark.parametrize(
    ("name", "cost", "income"),
    [("militia", 10, 2), ("footman", 20, 4), ("grunt", 40, 8), ("armoured_grunt", 100, 20)],
)
def test_a_unit_costs_its_price_and_raises_the_income_by_a_fifth_of_it(name, cost, income):
    """It starts in its own column and walks in the tick of the purchase."""
    board = Board()
    board.play(f"buy_{name}")
    expected = [[100 - cost, 100], [20 + income, 20], [1, 0]]
    assert board.read("gold", "income", "num_units") == expected
    slot, kind = board.world.first_unit[0], UNIT_NAMES.index(name)
    assert board.world.unit_kind[0, slot] == kind
    assert board.world.unit_health[0, slot] == board.rules.unit_health[kind]
    assert board.world.unit_column[0, slot] == 0
    assert board.world.unit_progress[0, slot] == board.rules.unit_speed[kind]


@pytest.mark.parametrize(("name", "cost"), [("basic", 10), ("fast", 20), ("faster", 30)])
def test_a_tower_costs_its_price_and_stands_in_its_cell(name, cost):
    board = Board()
    board.play("noop", f"build_{name}_r3_c5")
    assert board.read("gold", "income") == [[100, 100 - cost], [20, 20]]
    assert board.world.tower_at[1, 3, 4] == TOWER_NAMES.index(name)
    assert (board.world.tower_at != NO_TOWER).sum() == 1


@pytest.mark.parametrize("action", ["buy_militia", "build_basic_r0_c1"])
def test_gold_that_is_just_enough_buys_and_one_less_does_not(action):
    board = Board()
    board.world.gold[:] = (10, 9)
    assert board.is_legal(0, action)
    assert not board.is_legal(1, action)
    board.play(action, action)
    assert board.world.gold.tolist() == [0, 9]
    assert board.engine.illegal_actions.tolist() == [[0, 1]]
    assert board.world.num_units[1] == board.world.num_towers[1] == 0


def test_spawn_rows_are_uniform_and_independent():
    engine = make_engine("deep_line_wars", num_worlds=4_000, ticks_per_step=1)
    engine.reset(np.arange(4_000, dtype=np.uint64))
    engine.step(np.ones((4_000, 2), np.int32))
    rows = engine._worlds.unit_row[:, :, 0].astype(int)
    for drawn, size in ((rows[:, 0], 10), (rows[:, 1], 10), (rows[:, 0] * 10 + rows[:, 1], 100)):
        assert chisquare(np.bincount(drawn, minlength=size)).pvalue > 0.001


@pytest.mark.slow
def test_spawn_rows_of_one_player_are_uniform_along_a_game():
    board = Board(seed=11)
    rows = []
    for _ in range(1_500):
        board.world.gold[:] = 100
        board.world.health[:] = 50
        slot = unit_slot(board.world, 0, int(board.world.num_units[0]))
        board.play("buy_militia")
        rows.append(board.world.unit_row[0, slot])
    assert chisquare(np.bincount(rows, minlength=10)).pvalue > 0.001


def test_towers_are_built_in_the_own_half_off_the_spawn_column():
    board = Board(actions="classic")
    legal = []
    for column in range(1, 14):
        board.world.cursor[0] = (4, column)
        legal.append(board.is_legal(0, "build_basic"))
    assert legal == [True] * 6 + [False] * 7


def test_spatial_actions_cover_each_cell_of_the_own_half_once_per_kind():
    board = Board()
    masks = board.engine.action_mask()[0]
    assert masks[:, 5:].sum(axis=1).tolist() == [180, 180]
    cells = board.engine.spec.action_cells[5:65]
    assert sorted(cells.tolist()) == [
        row * 15 + column for row in range(10) for column in range(1, 7)
    ]


@pytest.mark.parametrize("second", TOWER_NAMES)
def test_a_cell_holds_one_tower(second):
    board = Board()
    board.play("build_fast_r2_c2")
    assert not board.is_legal(0, f"build_{second}_r2_c2")
    assert board.is_legal(1, f"build_{second}_r2_c2")
    before = board.world.gold[0]
    board.play(f"build_{second}_r2_c2")
    assert board.world.gold[0] == before
    assert board.world.num_towers[0] == 1
    assert board.world.tower_at[0, 2, 1] == TOWER_NAMES.index("fast")
    assert board.engine.illegal_actions[0, 0] == 1


@pytest.mark.plain_python
def test_the_half_can_be_filled_with_towers():
    board = Board(ticks_per_step=1)
    for row in range(10):
        for column in range(1, 7):
            board.world.gold[:] = 30
            board.play(f"build_faster_r{row}_c{column}", f"build_faster_r{row}_c{column}")
    board.world.gold[:] = 1_000
    assert board.world.num_towers.tolist() == [60, 60]
    assert not board.engine.action_mask()[0, :, 5:].any()
    assert not board.engine.illegal_actions.any()


def test_a_tower_takes_lumber_and_is_refused_without(lumber_preset):
    board = Board(preset="lumber")
    board.play("buy_militia")
    assert board.world.lumber.tolist() == [3, 3]
    board.play("build_fast_r0_c1", "build_basic_r0_c1")
    assert board.world.lumber.tolist() == [1, 2]
    actions = [f"build_{name}_r1_c1" for name in TOWER_NAMES]
    assert [board.is_legal(0, action) for action in actions] == [True, False, False]
    assert [board.is_legal(1, action) for action in actions] == [True, True, False]
    board.play("build_fast_r1_c1")
    assert board.world.lumber.tolist() == [1, 2]
    assert board.engine.illegal_actions.tolist() == [[1, 0]]


@pytest.mark.parametrize(
    ("name", "moved"),
    [("up", (-1, 0)), ("down", (1, 0)), ("right", (0, 1)), ("left", (0, -1))],
)
def test_the_cursor_moves_one_cell_and_stops_at_the_edges(name, moved):
    board = Board(actions="classic")
    assert board.world.cursor.tolist() == [[5, 1], [5, 1]]
    board.world.cursor[0] = (5, 5)
    board.play(f"cursor_{name}")
    assert (board.world.cursor[0] - (5, 5)).tolist() == list(moved)
    for _ in range(20):
        board.play(f"cursor_{name}")
    assert tuple(board.world.cursor[0].tolist()) in {(0, 5), (9, 5), (5, 13), (5, 1)}
    assert not board.is_legal(0, f"cursor_{name}")
    assert board.world.cursor[1].tolist() == [5, 1]


def test_the_cursor_builds_where_it_stands():
    board = Board(actions="classic")
    for action in ("cursor_up", "cursor_right", "build_faster"):
        board.play(action)
    assert board.world.tower_at[0, 4, 1] == TOWER_NAMES.index("faster")
    assert board.world.num_towers.tolist() == [1, 0]


def test_the_fourth_tower_of_the_classic_actions_does_not_exist():
    board = Board(actions="classic")
    assert not board.is_legal(0, "build_none")
    board.play("build_none")
    assert board.engine.illegal_actions.tolist() == [[1, 0]]
    assert board.world.gold.tolist() == [100, 100]


def test_orders_are_carried_out_once_a_decision():
    board = Board(ticks_per_step=10)
    board.play("buy_militia")
    assert board.world.gold.tolist() == [90, 100]
    assert board.world.tick[0] == 10
    assert board.world.unit_column[0, 0] == 1
