"""Scenarios and number tables that cannot work are refused by field, value and what is allowed."""

import dataclasses

import pytest

from marl_cair.games import make_engine
from marl_cair.games.deep_rts.maps.formats import MapError
from marl_cair.games.deep_rts.scenarios import SCENARIOS, Scenario
from marl_cair.games.deep_rts.tables import NUM_KINDS, PRESETS, UNIT_NAMES
from marl_cair.lookup import UnknownNameError
from tests.games.deep_rts.skirmish import MEADOW, read_engine

BALANCED = PRESETS["balanced"]


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_named_scenario_can_be_played(name):
    engine = make_engine("deep_rts", name)
    engine.reset(0)
    assert engine.action_mask().any(axis=-1).all()
    assert (engine._worlds.players[0, :, 0] == 1).all()


@pytest.mark.parametrize(
    ("field", "value", "allowed"),
    [
        ("num_players", 0, "1..8"),
        ("num_players", 9, "1..8"),
        ("num_players", True, "1..8"),
        ("num_players", 2.0, "1..8"),
        ("ticks_per_step", 0, "1..100"),
        ("ticks_per_step", 101, "1..100"),
        ("max_ticks", 9, "10..1000000"),
        ("max_ticks", 1_000_001, "10..1000000"),
        ("tile_pixels", 0, "1..32"),
        ("tile_pixels", 33, "1..32"),
        ("unit_capacity", -1, "0..200"),
        ("unit_capacity", 201, "0..200"),
        ("goal_amount", -1, "0..1000000"),
    ],
)
def test_a_number_out_of_range_is_refused(field, value, allowed):
    message = f"deep_rts: {field} is {value!r}, it must be a whole number in {allowed}"
    with pytest.raises(ValueError, match=message):
        Scenario(**{field: value})


@pytest.mark.parametrize(
    ("field", "value", "nearest"),
    [
        ("preset", "balance", "balanced"),
        ("actions", "clasic", "classic"),
        ("reward", "shape", "shaped"),
        ("goal", "golds", "gold"),
    ],
)
def test_an_unknown_name_is_answered_with_the_nearest(field, value, nearest):
    with pytest.raises(UnknownNameError, match=nearest):
        Scenario(**{field: value})


def test_an_unknown_map_is_answered_with_the_nearest():
    with pytest.raises(UnknownNameError, match="15x15-2p-crossing"):
        make_engine("deep_rts", map="15x15-2p-crosing")


@pytest.mark.parametrize("discount", [0.0, -0.5, 1.01])
def test_a_discount_outside_0_to_1_is_refused(discount):
    with pytest.raises(ValueError, match=f"shaping_discount is {discount}.* above 0 and at most 1"):
        Scenario(shaping_discount=discount)


@pytest.mark.parametrize("goal", ["gold", "lumber", "army"])
def test_a_race_needs_an_amount(goal):
    with pytest.raises(ValueError, match=f"the goal {goal} needs a goal_amount of at least 1"):
        Scenario(goal=goal)


def test_conquest_needs_somebody_to_conquer():
    with pytest.raises(ValueError, match="conquest needs at least 2 players"):
        Scenario(num_players=1)
    with pytest.raises(ValueError, match="all seats are of team 3, conquest needs at least two"):
        Scenario(teams=(3, 3))
    Scenario(teams=(3, 3), goal="score")


def test_each_seat_has_one_team():
    with pytest.raises(ValueError, match="teams names 3 seats, num_players is 2"):
        Scenario(teams=(0, 1, 0))


@pytest.mark.parametrize("army", [(1, 2), (0, 0, 0, 0), (1, -1, 0, 0), (1, 1, 1, 1, 1)])
def test_an_army_counts_the_four_kinds_that_walk(army):
    with pytest.raises(ValueError, match=r"army is .* peasants, footmen, archers and cavalry"):
        Scenario(army=army)


def test_a_map_needs_a_spawn_for_each_player():
    with pytest.raises(ValueError, match="has 2 spawns, num_players is 3"):
        make_engine("deep_rts", num_players=3)


def test_a_map_that_cannot_be_played_is_refused():
    with pytest.raises(MapError, match="no resource can be reached"):
        read_engine(MEADOW.replace("G", "."))


def test_a_file_that_is_not_there_is_refused(tmp_path):
    with pytest.raises((OSError, MapError), match="nowhere"):
        make_engine("deep_rts", map=str(tmp_path / "nowhere.txt"))


def test_an_army_that_does_not_fit_its_capacity_is_refused():
    with pytest.raises(ValueError, match="unit_capacity"):
        make_engine("deep_rts", army=(5, 5, 0, 0), unit_capacity=4)


# --- tables --------------------------------------------------------------------------------------


def changed(name: str, kind: int, value: int) -> dict[str, tuple[int, ...]]:
    values = list(getattr(BALANCED, name))
    values[kind] = value
    return {name: tuple(values)}


@pytest.mark.parametrize(
    ("name", "kind", "value", "message"),
    [
        ("health", 0, 0, "health of peasant is 0, allowed are 1..30000"),
        ("health", 4, 30_001, "health of town_hall is 30001, allowed are 1..30000"),
        ("cost_gold", 3, 2_000_000, "cost_gold of cavalry is 2000000, allowed are 0..1000000"),
        ("range_tiles", 2, 16, "range_tiles of archer is 16, allowed are 0..15"),
        ("sight_tiles", 2, 16, "sight_tiles of archer is 16, allowed are 0..15"),
        ("damage_min", 1, 13, "damage_max of footman is 12, below its damage_min 13"),
        ("walk_ticks", 1, 0, r"footman moves, so its walk_ticks \(0\)"),
        ("attack_ticks", 1, 0, r"footman moves, .* attack_ticks \(0\)"),
        ("size_tiles", 1, 3, r"footman moves, .* size_tiles \(3\) 1"),
        ("size_tiles", 5, 2, "size_tiles of barracks is 2, allowed are 1, 3 and 5"),
        ("size_tiles", 5, 7, "size_tiles of barracks is 7, allowed are 1, 3 and 5"),
        ("food_consumed", 1, 101, "footman eats 101, more than the food limit of 100"),
        ("armour", 1, -1, "armour holds -1, it must not be negative"),
        ("tile_amount", 6, -1, "tile_amount holds -1, it must not be negative"),
    ],
)
def test_a_table_that_cannot_work_is_refused(name, kind, value, message):
    with pytest.raises(ValueError, match=f"deep_rts: {message}"):
        dataclasses.replace(BALANCED, **changed(name, kind, value))


@pytest.mark.parametrize(
    ("name", "expected"), [("health", NUM_KINDS), ("tile_yield", 9), ("upgrade_gold", 2)]
)
def test_a_table_of_the_wrong_length_is_refused(name, expected):
    message = f"{name} has 3 values, it needs {expected}, one for each kind"
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(BALANCED, **{name: (1, 1, 1)})


def test_negative_numbers_are_refused():
    with pytest.raises(ValueError, match="harvest_ticks is -1, it must not be negative"):
        dataclasses.replace(BALANCED, harvest_ticks=-1)


@pytest.mark.parametrize("preset", PRESETS)
def test_every_enabled_kind_can_be_paid_and_fed(preset):
    numbers = PRESETS[preset]
    for kind, name in enumerate(UNIT_NAMES):
        if numbers.is_enabled[kind]:
            assert numbers.cost_gold[kind] > 0, name
            assert numbers.build_ticks[kind] > 0, name
            assert numbers.food_consumed[kind] <= numbers.food_limit, name
