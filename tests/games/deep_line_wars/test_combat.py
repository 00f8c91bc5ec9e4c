"""Walking and shooting, with exact ticks, distances and damages."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import chisquare

from marl_cair.games.deep_line_wars.state import NO_TARGET
from marl_cair.games.deep_line_wars.tables import (
    ARMOURED_GRUNT,
    BASIC,
    FAST,
    FASTER,
    FOOTMAN,
    GRUNT,
    MILITIA,
    PRESETS,
)
from tests.games.deep_line_wars.board import Board

LASTING = 30_000  # hit points of a unit that is to stand under fire


@pytest.fixture
def flying(monkeypatch) -> str:
    """A preset with the numbers of 2018 whose projectiles fly two tiles a tick."""
    preset = dataclasses.replace(PRESETS["2018"], projectile_tiles_per_tick=2)
    monkeypatch.setitem(PRESETS, "flying", preset)
    return "flying"


def put_target(board: Board, row: int, column: int, kind: int = MILITIA, health: int = LASTING):
    """A unit of player 1 in a cell of player 0's view; it does not leave it within a tick."""
    return board.put_unit(1, kind, row, board.mirrored(column), health=health)


def hold_still(board: Board) -> None:
    board.world.unit_progress[:] = 0


# --- walking ---------------------------------------------------------------------------------


@pytest.mark.plain_python
@pytest.mark.parametrize(
    ("kind", "progress", "arrival"), [(MILITIA, 10, 140), (FOOTMAN, 10, 140), (GRUNT, 10, 140)]
)
def test_a_unit_of_speed_1_walks_a_tile_in_ten_ticks(kind, progress, arrival):
    assert_walk(kind, progress, arrival)


def test_a_unit_of_speed_1_2_walks_six_tiles_in_fifty_ticks():
    assert_walk(ARMOURED_GRUNT, progress=12, arrival=117)


def assert_walk(kind: int, progress: int, arrival: int) -> None:
    board = Board()
    slot = board.put_unit(0, kind, row=4, column=0)
    for tick in range(1, arrival):
        board.wait(1)
        way = tick * progress
        assert board.world.unit_column[0, slot] == way // 100
        assert board.world.unit_progress[0, slot] == way % 100
        assert board.world.health.tolist() == [50, 50]
    assert arrival * progress >= 1_400 > (arrival - 1) * progress
    board.wait(1)
    assert board.world.health.tolist() == [50, 49]
    assert board.world.num_units.tolist() == [0, 0]


@pytest.mark.parametrize("kind", [MILITIA, FOOTMAN, GRUNT, ARMOURED_GRUNT])
def test_an_arrival_costs_the_enemy_one_health_whatever_arrives(kind):
    board = Board()
    board.put_unit(1, kind, row=4, column=13, progress=90)
    board.wait(1)
    assert board.world.health.tolist() == [49, 50]
    assert board.world.gold.tolist() == [100, 100]


def test_units_pass_each_other_and_towers():
    board = Board()
    board.put_unit(0, MILITIA, row=4, column=7, progress=90)
    board.put_unit(0, GRUNT, row=4, column=7, progress=90)
    board.put_unit(1, MILITIA, row=4, column=7, progress=90)
    board.put_tower(1, BASIC, row=4, column=6)
    board.wait(1)
    assert board.world.unit_column[0, :2].tolist() == [8, 8]
    assert board.world.unit_column[1, 0] == 8


def test_a_unit_that_arrives_is_not_shot_in_that_tick():
    """Units walk before towers fire."""
    board = Board()
    board.put_tower(0, FASTER, row=4, column=1)
    board.put_unit(1, MILITIA, row=4, column=13, progress=90, health=1)
    board.wait(1)
    assert board.world.health.tolist() == [49, 50]
    assert board.world.gold.tolist() == [100, 100]


# --- range and target ------------------------------------------------------------------------


@pytest.mark.parametrize("across", range(-4, 5))
@pytest.mark.parametrize("along", range(-4, 5))
def test_a_tower_reaches_as_far_as_its_range_and_no_further(across, along):
    board = Board(columns=21)
    board.put_tower(0, BASIC, row=5, column=6)
    unit = put_target(board, 5 + along, 6 + across)
    board.wait(1)
    was_hit = board.world.unit_health[1, unit] < LASTING
    assert was_hit == (across**2 + along**2 <= 3**2)


def test_a_tower_does_not_shoot_the_units_of_its_owner():
    board = Board()
    board.put_tower(0, BASIC, row=5, column=3)
    slot = board.put_unit(0, MILITIA, row=5, column=3)
    board.wait(5)
    assert board.world.unit_health[0, slot] == 40


def test_a_tower_fires_at_the_unit_that_was_bought_first():
    board = Board()
    board.put_tower(0, BASIC, row=5, column=3)
    far = put_target(board, 5, 9)
    older = put_target(board, 5, 6)
    younger = put_target(board, 5, 3)
    board.wait(1)
    health = board.world.unit_health[1]
    assert health[far] == LASTING
    assert health[older] < LASTING
    assert health[younger] == LASTING


def test_a_tower_turns_to_the_next_unit_when_the_oldest_has_died():
    board = Board()
    board.put_tower(0, FASTER, row=5, column=3)
    put_target(board, 5, 4, health=1)
    younger = put_target(board, 5, 3)
    board.wait(1)
    assert board.world.num_units[1] == 1
    board.wait(2)
    assert board.world.unit_health[1, younger] < LASTING


def test_the_second_tower_does_not_waste_its_shot_on_a_unit_that_died_in_this_tick():
    board = Board()
    board.put_tower(0, BASIC, row=5, column=3)
    board.put_tower(0, BASIC, row=5, column=4)
    put_target(board, 5, 4, health=1)
    younger = put_target(board, 5, 3)
    board.wait(1)
    assert board.world.unit_health[1, younger] < LASTING


# --- reloading -------------------------------------------------------------------------------


@pytest.mark.plain_python
@pytest.mark.parametrize(
    ("kind", "pattern"), [(BASIC, [4, 3, 3]), (FAST, [3, 2, 3, 2]), (FASTER, [2, 2, 2, 2, 2])]
)
def test_attack_speed_gives_exactly_so_many_shots_in_ten_ticks(kind, pattern):
    """Shots a second are ten ticks' shots; the pattern of the gaps repeats without drift."""
    assert sum(pattern) == 10
    board = Board()
    board.put_tower(0, kind, row=5, column=3)
    unit = put_target(board, 5, 3)
    fired, before = [], LASTING
    for tick in range(1, 102):
        board.wait(1)
        hold_still(board)
        if board.world.unit_health[1, unit] < before:
            fired.append(tick)
        before = board.world.unit_health[1, unit]
    assert np.diff(fired).tolist() == pattern * 10
    assert len(pattern) == board.rules.tower_attack_speed[kind]


def test_a_new_tower_fires_in_its_first_tick():
    board = Board()
    unit = put_target(board, 5, 3)
    board.play("build_basic_r5_c4")
    assert board.world.unit_health[1, unit] < LASTING


def test_a_tower_that_waited_has_only_one_shot_in_store():
    board = Board()
    board.put_tower(0, BASIC, row=5, column=3)
    board.wait(50)
    unit = put_target(board, 5, 3)
    board.wait(1)
    after_first = board.world.unit_health[1, unit]
    board.wait(3)
    assert board.world.unit_health[1, unit] == after_first
    board.wait(1)
    assert board.world.unit_health[1, unit] < after_first


# --- damage ----------------------------------------------------------------------------------


def losses_of(kind: int, tower: int, num_shots: int = 300) -> list[int]:
    """Hit points that a unit of the kind loses by each of so many shots."""
    board = Board(seed=1)
    board.put_tower(0, tower, row=5, column=3)
    unit = put_target(board, 5, 3, kind=kind)
    losses = []
    while len(losses) < num_shots:
        board.world.unit_health[1, unit] = LASTING
        board.world.tick[0] = 1
        board.world.tower_ready[0] = 0
        board.wait(1)
        hold_still(board)
        losses.append(LASTING - int(board.world.unit_health[1, unit]))
    return losses


@pytest.mark.parametrize(
    ("kind", "tower", "possible"),
    [
        (MILITIA, BASIC, {2, 3, 4}),  # armour 2 - penetration 2: whole roll
        (MILITIA, FAST, {2, 3, 4}),
        (MILITIA, FASTER, {4, 5, 6}),  # penetration beyond the armour adds nothing
        (FOOTMAN, BASIC, {1, 2}),  # rolls 2, 3, 4 less 2, but never below 1
        (FOOTMAN, FASTER, {3, 4, 5}),
        (GRUNT, FASTER, {3, 4, 5}),
        (ARMOURED_GRUNT, BASIC, {1}),
        (ARMOURED_GRUNT, FASTER, {1, 2, 3}),
    ],
)
def test_armour_beyond_the_penetration_blunts_a_hit_down_to_one(kind, tower, possible):
    assert set(losses_of(kind, tower)) == possible


def test_damage_rolls_are_uniform():
    losses = losses_of(MILITIA, BASIC, num_shots=3_000)
    assert chisquare(np.bincount(losses)[2:]).pvalue > 0.001


@pytest.mark.parametrize(
    ("kind", "bounty"), [(MILITIA, 1), (FOOTMAN, 2), (GRUNT, 4), (ARMOURED_GRUNT, 10)]
)
def test_a_kill_pays_the_owner_of_the_tower_a_tenth_of_the_price(kind, bounty):
    board = Board()
    board.put_tower(0, BASIC, row=5, column=3)
    put_target(board, 5, 3, kind=kind, health=1)
    board.wait(1)
    assert board.world.gold.tolist() == [100 + bounty, 100]
    assert board.world.num_units.tolist() == [0, 0]
    assert board.world.health.tolist() == [50, 50]


def test_dead_units_behind_a_living_one_wait_for_their_slots():
    board = Board()
    board.put_tower(0, FASTER, row=5, column=3)
    oldest = put_target(board, 0, 12)
    put_target(board, 5, 3, health=1)
    board.wait(1)
    assert board.world.num_units[1] == 2
    board.world.unit_health[1, oldest] = 0
    board.wait(1)
    assert board.world.num_units[1] == 0


# --- projectiles -----------------------------------------------------------------------------


@pytest.mark.plain_python
@pytest.mark.parametrize(
    ("along", "across", "flight"),
    [(0, 1, 1), (1, 1, 1), (2, 0, 1), (0, 2, 1), (2, 1, 2), (2, 2, 2), (3, 0, 2), (0, 3, 2)],
)
def test_a_projectile_flies_two_tiles_a_tick(flying, along, across, flight):
    board = Board(preset=flying)
    board.put_tower(0, BASIC, row=4, column=4)
    unit = put_target(board, 4 + along, 4 + across)
    board.wait(1)
    assert board.world.num_shots.tolist() == [1, 0]
    assert board.world.shot_ticks[0, 0] == board.world.shot_flight_ticks[0, 0] == flight
    assert board.world.unit_health[1, unit] == LASTING
    for _ in range(flight):
        assert board.world.unit_health[1, unit] == LASTING
        board.wait(1)
    assert board.world.unit_health[1, unit] < LASTING
    assert board.world.num_shots.tolist() == [0, 0]


def test_without_flight_time_a_shot_hits_in_the_tick_it_is_fired():
    board = Board()
    board.put_tower(0, BASIC, row=4, column=4)
    unit = put_target(board, 4, 7)
    board.wait(1)
    assert board.world.unit_health[1, unit] < LASTING
    assert board.world.num_shots.tolist() == [0, 0]


def test_a_tower_fires_again_in_the_tick_in_which_its_projectile_lands(flying):
    """Shots land before towers fire, so a flight of two ticks does not slow five shots a second."""
    board = Board(preset=flying)
    board.put_tower(0, FASTER, row=4, column=4)
    unit = put_target(board, 7, 4)
    hits, before = 0, LASTING
    for _ in range(41):
        board.wait(1)
        hold_still(board)
        hits += int(board.world.unit_health[1, unit]) < before
        before = int(board.world.unit_health[1, unit])
    assert hits == 20


def test_a_tower_waits_for_its_projectile_to_land(monkeypatch):
    """Three ticks of flight slow a tower that would reload in two."""
    preset = dataclasses.replace(PRESETS["2018"], projectile_tiles_per_tick=1)
    monkeypatch.setitem(PRESETS, "slow", preset)
    board = Board(preset="slow")
    board.put_tower(0, FASTER, row=4, column=4)
    unit = put_target(board, 7, 4)
    hits, before = [], LASTING
    for tick in range(1, 32):
        board.wait(1)
        hold_still(board)
        assert board.world.num_shots[0] <= 1
        if board.world.unit_health[1, unit] < before:
            hits.append(tick)
        before = int(board.world.unit_health[1, unit])
    assert hits == list(range(4, 32, 3))


def test_a_shot_at_a_unit_that_died_is_lost(flying):
    board = Board(preset=flying)
    board.put_tower(0, BASIC, row=4, column=4)
    board.put_tower(0, BASIC, row=4, column=5)
    put_target(board, 4, 6, health=1)
    younger = put_target(board, 4, 7)
    board.wait(1)
    assert board.world.num_shots[0] == 2
    board.wait(1)
    assert board.world.num_shots[0] == 0
    assert board.world.gold[0] == 101
    assert board.world.unit_health[1, younger] == LASTING


def test_a_shot_at_a_unit_that_walked_off_is_lost(flying):
    board = Board(preset=flying)
    board.put_tower(0, BASIC, row=7, column=1)
    board.put_unit(1, MILITIA, row=4, column=13, progress=80, health=1)
    board.wait(1)
    assert board.world.num_shots[0] == 1
    board.play("noop", "buy_militia")
    assert board.world.health[0] == 49
    board.wait(1)
    assert board.world.num_shots[0] == 0
    assert board.world.shot_target[0, 0] == NO_TARGET
    assert board.world.gold[0] == 100
    assert board.world.unit_health[1, board.world.first_unit[1]] == 40


def test_a_shot_follows_its_unit_out_of_range(flying):
    board = Board(preset=flying)
    board.put_tower(0, BASIC, row=7, column=4)
    unit = board.put_unit(1, MILITIA, row=4, column=10, progress=80, health=LASTING)
    board.wait(2)
    assert board.world.unit_column[1, unit] == 11
    assert board.world.unit_health[1, unit] == LASTING
    board.wait(1)
    assert board.world.unit_health[1, unit] < LASTING
