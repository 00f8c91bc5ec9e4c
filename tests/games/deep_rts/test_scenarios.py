"""Scenarios and presets that cannot work are refused with field, value and allowed values."""

import dataclasses
import re

import pytest

from marl_cair.games import make_engine
from marl_cair.games.deep_rts.maps.formats import MapError
from marl_cair.games.deep_rts.scenarios import SCENARIOS, Scenario
from marl_cair.games.deep_rts.state import IS_ALIVE
from marl_cair.games.deep_rts.tables import NUM_KINDS, PRESETS, UNIT_NAMES
from marl_cair.lookup import UnknownNameError
from tests.games.deep_rts.skirmish import MEADOW, read_engine

BALANCED = PRESETS["balanced"]


def refuses(*parts, kind=ValueError):
    """Raises an error whose message holds the parts in this order."""
    return pytest.raises(kind, match=".*".join(re.escape(str(part)) for part in parts))


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_named_scenario_can_be_played(name):
    engine = make_engine("deep_rts", name)
    engine.reset(0)
    assert engine.action_mask().any(axis=-1).all()
    assert (engine._worlds.players[0, :, IS_ALIVE] == 1).all()


@pytest.mark.parametrize(
    ("field", "values", "allowed"),
    [
        ("num_players", (0, 9, True, 2.0), "1..8"),
        ("ticks_per_step", (0, 101), "1..100"),
        ("max_ticks", (9, 1_000_001), "10..1000000"),
        ("tile_pixels", (0, 33), "1..32"),
        ("unit_capacity", (-1, 201), "0..200"),
        ("goal_amount", (-1,), "0..1000000"),
        ("shaping_discount", (0.0, -0.5, 1.01), "above 0 and at most 1"),
        ("army", ((1, 2), (0, 0, 0, 0), (1, -1, 0, 0), (1,) * 5), "peasants, footmen, archers"),
    ],
)
def test_value_out_of_range_is_refused(field, values, allowed):
    for value in values:
        with refuses("deep_rts:", field, value, allowed):
            Scenario(**{field: value})


@pytest.mark.parametrize(
    ("field", "value", "nearest"),
    [
        ("preset", "balance", "balanced"),
        ("actions", "clasic", "classic"),
        ("reward", "shape", "shaped"),
        ("goal", "golds", "gold"),
        ("map", "15x15-2p-crosing", "15x15-2p-crossing"),
    ],
)
def test_unknown_name_is_answered_with_the_nearest(field, value, nearest):
    with refuses(nearest, kind=UnknownNameError):
        make_engine("deep_rts", **{field: value})


@pytest.mark.parametrize(
    ("options", "parts"),
    [
        *(({"goal": goal}, (goal, "goal_amount", 1)) for goal in ("gold", "lumber", "army")),
        ({"num_players": 1}, ("conquest", 2, "num_players is 1")),
        ({"teams": (3, 3)}, ("teams is (3, 3)", "conquest")),
        ({"teams": (0, 1, 0)}, ("3 seats", "num_players is 2")),
        ({"num_players": 3}, ("2 spawns", "num_players is 3")),
        ({"army": (5, 5, 0, 0), "unit_capacity": 4}, ("(5, 5, 0, 0)", "unit_capacity", 4)),
    ],
)
def test_options_that_contradict_each_other_are_refused(options, parts):
    with refuses(*parts):
        make_engine("deep_rts", **options)


def test_one_team_may_play_for_the_score():
    Scenario(teams=(3, 3), goal="score")


def test_map_without_a_reachable_resource_is_refused():
    with refuses("no resource can be reached", kind=MapError):
        read_engine(MEADOW.replace("G", "."))


def test_missing_map_file_is_refused(tmp_path):
    with refuses("nowhere", kind=MapError):
        make_engine("deep_rts", map=str(tmp_path / "nowhere.txt"))


# --- presets -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "kind", "value", "parts"),
    [
        ("health", 0, 0, ("peasant", "1..30000")),
        ("health", 4, 30_001, ("town_hall", "1..30000")),
        ("cost_gold", 3, 2_000_000, ("cavalry", "0..1000000")),
        ("range_tiles", 2, 16, ("archer", "0..15")),
        ("sight_tiles", 2, 16, ("archer", "0..15")),
        ("damage_min", 1, 13, ("footman", 12)),
        ("walk_ticks", 1, 0, ("footman",)),
        ("attack_ticks", 1, 0, ("footman",)),
        ("size_tiles", 1, 3, ("footman",)),
        ("size_tiles", 5, 2, ("barracks", "1, 3 and 5")),
        ("size_tiles", 5, 7, ("barracks", "1, 3 and 5")),
        ("food_consumed", 1, 101, ("footman", 100)),
        ("armour", 1, -1, ("negative",)),
        ("tile_amount", 6, -1, ("negative",)),
    ],
)
def test_preset_that_cannot_work_is_refused(name, kind, value, parts):
    values = list(getattr(BALANCED, name))
    values[kind] = value
    with pytest.raises(ValueError, match="^deep_rts: ") as error:
        dataclasses.replace(BALANCED, **{name: tuple(values)})
    assert all(str(part) in str(error.value) for part in (name.split("_")[0], value, *parts))


@pytest.mark.parametrize(
    ("name", "expected"), [("health", NUM_KINDS), ("tile_yield", 9), ("upgrade_gold", 2)]
)
def test_table_of_the_wrong_length_is_refused(name, expected):
    with refuses(name, 3, expected):
        dataclasses.replace(BALANCED, **{name: (1, 1, 1)})


def test_negative_number_is_refused():
    with refuses("harvest_ticks", -1, "negative"):
        dataclasses.replace(BALANCED, harvest_ticks=-1)


@pytest.mark.parametrize("preset", PRESETS)
def test_every_enabled_kind_has_a_price_and_can_be_fed(preset):
    numbers = PRESETS[preset]
    for kind, name in enumerate(UNIT_NAMES):
        if numbers.is_enabled[kind]:
            assert numbers.cost_gold[kind] > 0, name
            assert numbers.build_ticks[kind] > 0, name
            assert numbers.food_consumed[kind] <= numbers.food_limit, name
