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

# From the published code of the game: armour, progress a tick, cost, income, bounty.
UNITS = {
    "militia": (2, 10, 10, 2, 1),
    "footman": (4, 10, 20, 4, 2),
    "grunt": (4, 10, 40, 8, 4),
    "armoured_grunt": (6, 12, 100, 20, 10),
}
UNIT_HEALTH = {"2017": (20, 40, 60, 100), "2018": (40, 80, 140, 190)}
# Lowest and highest damage, penetration, shots a second, range in tiles, cost.
TOWERS = {"basic": (2, 4, 2, 3, 3, 10), "fast": (2, 4, 2, 4, 3, 20), "faster": (4, 6, 3, 5, 3, 30)}


@pytest.mark.parametrize("preset", ["2017", "2018"])
def test_units_have_the_published_numbers(preset):
    table = PRESETS[preset]
    rows = zip(
        table.unit_armour,
        table.unit_speed,
        table.unit_cost_gold,
        table.unit_income_gold,
        table.unit_bounty_gold,
        strict=True,
    )
    assert dict(zip(UNIT_NAMES, rows, strict=True)) == UNITS
    assert table.unit_health == UNIT_HEALTH[preset]


@pytest.mark.parametrize("preset", ["2017", "2018"])
def test_towers_have_the_published_numbers(preset):
    table = PRESETS[preset]
    rows = zip(
        table.tower_damage_min,
        table.tower_damage_max,
        table.tower_penetration,
        table.tower_attack_speed,
        table.tower_range_tiles,
        table.tower_cost_gold,
        strict=True,
    )
    assert dict(zip(TOWER_NAMES, rows, strict=True)) == TOWERS
    assert table.tower_cost_lumber == (0, 0, 0)


@pytest.mark.parametrize("preset", ["2017", "2018"])
def test_players_start_with_the_published_numbers(preset):
    board = Board(preset=preset)
    world = board.world
    assert world.health.tolist() == [50, 50]
    assert world.gold.tolist() == [100, 100]
    assert world.lumber.tolist() == [0, 0]
    assert world.income.tolist() == [20, 20]
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
def test_names_tell_the_board(name):
    scenario = SCENARIOS[name]
    assert name in (
        f"{scenario.rows}x{scenario.columns}",
        f"{scenario.columns}x{scenario.rows}",
    )


def test_the_default_scenario_has_185_actions_and_the_classic_one_13():
    assert make_engine("deep_line_wars").num_actions == 185
    spec = make_engine("deep_line_wars", actions="classic").spec
    assert spec.action_names == (
        "cursor_up",
        "cursor_down",
        "cursor_right",
        "cursor_left",
        "buy_militia",
        "buy_footman",
        "buy_grunt",
        "buy_armoured_grunt",
        "build_basic",
        "build_fast",
        "build_faster",
        "build_none",
        "noop",
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


# --- bad input -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("field", "value", "allowed"),
    [
        ("rows", 5, "6..120"),
        ("columns", 121, "6..120"),
        ("rows", 10.0, "6..120"),
        ("columns", True, "6..120"),
        ("ticks_per_step", 0, "1..100"),
        ("ticks_per_step", 101, "1..100"),
        ("max_ticks", 9, "10..1000000"),
        ("max_ticks", "2000", "10..1000000"),
    ],
)
def test_numbers_out_of_range_are_refused(field, value, allowed):
    message = f"deep_line_wars: {field} is {value!r}, it must be a whole number in {allowed}"
    with pytest.raises(ValueError, match=re.escape(message)):
        make_engine("deep_line_wars", **{field: value})


@pytest.mark.parametrize(
    ("option", "value", "message"),
    [
        ("preset", "2019", "unknown deep_line_wars preset '2019': nearest are"),
        (
            "actions",
            "clasic",
            "unknown deep_line_wars action space 'clasic': nearest are 'classic'",
        ),
        ("reward", "dense", "unknown deep_line_wars reward 'dense': known are 'sparse', 'shaped'"),
    ],
)
def test_unknown_names_are_answered_with_the_known(option, value, message):
    with pytest.raises(UnknownNameError, match=re.escape(message)):
        make_engine("deep_line_wars", **{option: value})


@pytest.mark.parametrize("discount", [0.0, -0.5, 1.01])
def test_a_shaping_discount_that_is_none_is_refused(discount):
    message = f"deep_line_wars: shaping_discount is {discount}, it must be above 0 and at most 1"
    with pytest.raises(ValueError, match=re.escape(message)):
        make_engine("deep_line_wars", shaping_discount=discount)


def test_scenarios_cannot_be_changed_by_accident():
    with pytest.raises(dataclasses.FrozenInstanceError):
        SCENARIOS["10x15"].rows = 12
