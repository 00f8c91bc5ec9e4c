"""The numbers of the game as its sources give them, and scenarios that refuse what cannot be."""

import dataclasses
import re

import numpy as np
import pytest

from marl_cair.games import make_engine
from marl_cair.games.deep_line_wars.scenarios import SCENARIOS, Scenario
from marl_cair.games.deep_line_wars.tables import (
    PRESETS,
    PROGRESS_PER_TILE,
    TOWER_NAMES,
    UNIT_NAMES,
)
from marl_cair.lookup import UnknownNameError
from tests.games.deep_line_wars.board import Board

# From the published code of the game.
PUBLISHED = {
    "unit_armour": (2, 4, 4, 6),
    "unit_speed": (10, 10, 10, 12),  # progress a tick
    "unit_cost_gold": (10, 20, 40, 100),
    "unit_income_gold": (2, 4, 8, 20),
    "unit_bounty_gold": (1, 2, 4, 10),
    "tower_damage_min": (2, 2, 4),
    "tower_damage_max": (4, 4, 6),
    "tower_penetration": (2, 2, 3),
    "tower_attack_speed": (3, 4, 5),  # shots a second
    "tower_range_tiles": (3, 3, 3),
    "tower_cost_gold": (10, 20, 30),
    "tower_cost_lumber": (0, 0, 0),
}
UNIT_HEALTH = {"2017": (20, 40, 60, 100), "2018": (40, 80, 140, 190)}


@pytest.mark.parametrize("preset", UNIT_HEALTH)
def test_units_and_towers_have_the_published_numbers(preset):
    numbers = dataclasses.asdict(PRESETS[preset])
    assert {name: numbers[name] for name in PUBLISHED} == PUBLISHED
    assert numbers["unit_health"] == UNIT_HEALTH[preset]
    assert UNIT_NAMES == ("militia", "footman", "grunt", "armoured_grunt")
    assert TOWER_NAMES == ("basic", "fast", "faster")


@pytest.mark.parametrize("preset", ["2017", "2018"])
def test_players_start_with_the_published_numbers(preset):
    board = Board(preset=preset)
    expected = [[50, 50], [100, 100], [0, 0], [20, 20]]
    assert board.read("health", "gold", "lumber", "income") == expected
    assert board.rules.income_interval_ticks == 100
    assert not board.rules.flight_ticks.any()


@pytest.mark.parametrize("preset", PRESETS)
def test_every_preset_can_be_played(preset):
    table = PRESETS[preset]
    assert all(0 < speed < PROGRESS_PER_TILE for speed in table.unit_speed)
    pairs = zip(table.tower_damage_min, table.tower_damage_max, strict=True)
    assert all(1 <= low <= high for low, high in pairs)
    assert all(speed > 0 for speed in table.tower_attack_speed)
    board = Board(preset=preset, ticks_per_step=10)
    assert board.is_legal(0, "buy_militia")
    assert board.is_legal(0, "build_basic_r0_c1")


@pytest.mark.parametrize(
    ("columns", "build_columns"), [(6, 1), (7, 2), (11, 4), (15, 6), (17, 7), (30, 13), (20, 8)]
)
def test_both_halves_take_towers_and_the_centre_does_not(columns, build_columns):
    scenario = Scenario(columns=columns)
    assert scenario.build_columns == build_columns
    neutral = columns - 2 * build_columns - 2
    assert neutral == (1 if columns % 2 else 2)


@pytest.mark.parametrize("name", SCENARIOS)
def test_names_have_the_board(name):
    scenario = SCENARIOS[name]
    rows, columns = scenario.rows, scenario.columns
    assert name in (f"{rows}x{columns}", f"{columns}x{rows}")


def test_the_default_scenario_has_185_actions_and_the_classic_one_13():
    assert make_engine("deep_line_wars").num_actions == 185
    spec = make_engine("deep_line_wars", actions="classic").spec
    assert spec.action_names == (
        *("cursor_up", "cursor_down", "cursor_right", "cursor_left"),
        *("buy_militia", "buy_footman", "buy_grunt", "buy_armoured_grunt"),
        *("build_basic", "build_fast", "build_faster", "build_none", "noop"),
    )


@pytest.mark.parametrize(("kind", "row", "column"), [(0, 0, 1), (1, 3, 4), (2, 9, 6)])
def test_a_spatial_action_names_its_tower_and_cell(kind, row, column):
    spec = make_engine("deep_line_wars").spec
    action = 5 + kind * 60 + row * 6 + (column - 1)
    assert spec.action_names[action] == f"build_{TOWER_NAMES[kind]}_r{row}_c{column}"
    assert spec.action_cells[action] == row * 15 + column
    group = spec.action_group_names[spec.action_groups[action]]
    assert group == f"build_{TOWER_NAMES[kind]}"


@pytest.mark.parametrize("name", SCENARIOS)
@pytest.mark.parametrize("ticks_per_step", [1, 10])
def test_unit_slots_never_run_out(name, ticks_per_step):
    """Both players buy the slowest unit at every decision of a whole game."""
    board = Board(name, ticks_per_step=ticks_per_step)
    slowest = UNIT_NAMES[int(np.argmin(board.rules.unit_speed))]
    most, capacity = 0, board.world.unit_kind.shape[1]
    board.world.health[:] = 30_000
    while not board.engine.truncated[0]:
        board.world.gold[:] = 1_000
        assert board.is_legal(0, f"buy_{slowest}")
        board.play(f"buy_{slowest}", f"buy_{slowest}")
        most = max(most, int(board.world.num_units[0]))
    assert capacity // 4 < most <= capacity
    assert board.engine.illegal_actions.tolist() == [[0, 0]]


@pytest.mark.parametrize(
    ("field", "value", "allowed"),
    [
        ("rows", 5, "a whole number in 6..120"),
        ("columns", 121, "a whole number in 6..120"),
        ("rows", 10.0, "a whole number in 6..120"),
        ("columns", True, "a whole number in 6..120"),
        ("ticks_per_step", 0, "a whole number in 1..100"),
        ("ticks_per_step", 101, "a whole number in 1..100"),
        ("max_ticks", 9, "a whole number in 10..1000000"),
        ("max_ticks", "2000", "a whole number in 10..1000000"),
        ("shaping_discount", 0.0, "above 0 and at most 1"),
        ("shaping_discount", -0.5, "above 0 and at most 1"),
        ("shaping_discount", 1.01, "above 0 and at most 1"),
    ],
)
def test_numbers_out_of_range_are_refused(field, value, allowed):
    message = f"deep_line_wars: {field} is {value!r}, it must be {allowed}"
    with pytest.raises(ValueError, match=re.escape(message)):
        make_engine("deep_line_wars", **{field: value})


@pytest.mark.parametrize(
    ("option", "value", "nearest"),
    [("preset", "2019", "2018"), ("actions", "clasic", "classic"), ("reward", "dense", "sparse")],
)
def test_unknown_names_are_answered_with_the_known(option, value, nearest):
    with pytest.raises(UnknownNameError, match=f"'{value}'.*'{nearest}'"):
        make_engine("deep_line_wars", **{option: value})


def test_scenarios_cannot_be_changed_by_accident():
    with pytest.raises(dataclasses.FrozenInstanceError):
        SCENARIOS["10x15"].rows = 12
