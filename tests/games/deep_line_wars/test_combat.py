"""Walking and shooting, with exact ticks, distances and damages."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import chisquare

from marl_cair.games.deep_line_wars import tables as t
from marl_cair.games.deep_line_wars.state import NO_TARGET
from marl_cair.games.deep_line_wars.tables import BASIC, FASTER, GRUNT, MILITIA, PRESETS
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


def make_range(tower: int, place=(5, 3), target=(5, 3), **options) -> tuple[Board, int]:
    """A board with a tower of player 0 and a target that lasts; the target's slot."""
    board = Board(**options)
    board.put_tower(0, tower, *place)
    return board, put_target(board, *target)


def find_hits(board: Board, unit: int, num_ticks: int) -> list[int]:
    """The ticks in which a unit that stands still is hit, from 1."""
    hits = []
    for tick in range(1, num_ticks + 1):
        before = int(board.world.unit_health[1, unit])
        board.wait(1)
        board.world.unit_progress[:] = 0
        if board.world.unit_health[1, unit] < before:
            hits.append(tick)
    return hits


@pytest.mark.plain_python
@pytest.mark.parametrize(
    ("kind", "progress", "arrival"),
    [(MILITIA, 10, 140), (t.FOOTMAN, 10, 140), (GRUNT, 10, 140), (t.ARMOURED_GRUNT, 12, 117)],
)
def test_a_unit_of_speed_1_walks_a_tile_in_ten_ticks(kind, progress, arrival):
    board = Board()
    slot = board.put_unit(0, kind, row=4, column=0)
    for tick in range(1, arrival):
        board.wait(1)
        place = board.world.unit_column[0, slot], board.world.unit_progress[0, slot]
        assert place == divmod(tick * progress, 100)
        assert board.world.health.tolist() == [50, 50]
    assert arrival * progress >= 1_400 > (arrival - 1) * progress
    board.wait(1)
    assert board.read("health", "num_units") == [[50, 49], [0, 0]]


@pytest.mark.parametrize("kind", range(t.NUM_UNIT_KINDS))
def test_an_arrival_costs_the_enemy_one_health_whatever_arrives(kind):
    """Units walk before towers fire: a unit that arrives is not shot in that tick."""
    board = Board()
    board.put_tower(0, FASTER, row=4, column=1)
    board.put_unit(1, kind, row=4, column=13, progress=90, health=1)
    board.wait(1)
    assert board.read("health", "gold") == [[49, 50], [100, 100]]


def test_units_pass_each_other_and_towers():
    board = Board()
    for owner, kind in ((0, MILITIA), (0, GRUNT), (1, MILITIA)):
        board.put_unit(owner, kind, row=4, column=7, progress=90)
    board.put_tower(1, BASIC, row=4, column=6)
    board.wait(1)
    assert board.world.unit_column[[0, 0, 1], [0, 1, 0]].tolist() == [8, 8, 8]


@pytest.mark.parametrize("across", range(-4, 5))
@pytest.mark.parametrize("along", range(-4, 5))
def test_a_tower_reaches_as_far_as_its_range_and_no_further(across, along):
    board, unit = make_range(BASIC, (5, 6), (5 + along, 6 + across), columns=21)
    assert bool(find_hits(board, unit, 1)) == (across**2 + along**2 <= 3**2)


def test_a_tower_does_not_shoot_the_units_of_its_owner():
    board = Board()
    board.put_tower(0, BASIC, row=5, column=3)
    slot = board.put_unit(0, MILITIA, row=5, column=3)
    board.wait(5)
    assert board.world.unit_health[0, slot] == 40


def test_a_tower_fires_at_the_unit_in_range_that_was_bought_first():
    board = Board()
    board.put_tower(0, BASIC, row=5, column=3)
    far, older, younger = (put_target(board, 5, column) for column in (9, 6, 3))
    board.wait(1)
    is_hit = board.world.unit_health[1] < LASTING
    assert is_hit[[far, older, younger]].tolist() == [False, True, False]


@pytest.mark.parametrize(("towers", "ticks"), [([(FASTER, 3)], 3), ([(BASIC, 3), (BASIC, 4)], 1)])
def test_the_next_shot_is_not_wasted_on_a_unit_that_has_died(towers, ticks):
    board = Board()
    for kind, column in towers:
        board.put_tower(0, kind, 5, column)
    put_target(board, 5, 4, health=1)
    younger = put_target(board, 5, 3)
    board.wait(1)
    assert board.world.num_units[1] == 1
    board.wait(ticks - 1)
    assert board.world.unit_health[1, younger] < LASTING


@pytest.mark.plain_python
@pytest.mark.parametrize(
    ("kind", "pattern"), [(BASIC, [4, 3, 3]), (t.FAST, [3, 2, 3, 2]), (FASTER, [2, 2, 2, 2, 2])]
)
def test_attack_speed_gives_exactly_so_many_shots_in_ten_ticks(kind, pattern):
    """Shots a second are ten ticks' shots; the pattern of the gaps repeats without drift."""
    board, unit = make_range(kind)
    assert np.diff(find_hits(board, unit, 101)).tolist() == pattern * 10
    assert (sum(pattern), len(pattern)) == (10, board.rules.tower_attack_speed[kind])


def test_a_new_tower_fires_in_its_first_tick():
    board = Board()
    unit = put_target(board, 5, 3)
    board.play("build_basic_r5_c4")
    assert board.world.unit_health[1, unit] < LASTING


def test_a_tower_that_waited_has_only_one_shot_in_store():
    board = Board()
    board.put_tower(0, BASIC, row=5, column=3)
    board.wait(50)
    assert find_hits(board, put_target(board, 5, 3), 5) == [1, 5]


def losses_of(kind: int, tower: int, num_shots: int = 300) -> list[int]:
    """Hit points that a unit of the kind loses by each of so many shots."""
    board = Board(seed=1)
    board.put_tower(0, tower, row=5, column=3)
    unit = put_target(board, 5, 3, kind=kind)
    losses = []
    while len(losses) < num_shots:
        board.world.unit_health[1, unit] = LASTING
        board.world.tick[0], board.world.tower_ready[0] = 1, 0
        find_hits(board, unit, 1)
        losses.append(LASTING - int(board.world.unit_health[1, unit]))
    return losses


@pytest.mark.parametrize(
    ("kind", "tower", "possible"),
    [
        (MILITIA, BASIC, {2, 3, 4}),  # armour 2 - penetration 2: whole roll
        (MILITIA, t.FAST, {2, 3, 4}),
        (MILITIA, FASTER, {4, 5, 6}),  # penetration beyond the armour adds nothing
        (t.FOOTMAN, BASIC, {1, 2}),  # rolls 2, 3, 4 less 2, but never below 1
        (t.FOOTMAN, FASTER, {3, 4, 5}),
        (GRUNT, FASTER, {3, 4, 5}),
        (t.ARMOURED_GRUNT, BASIC, {1}),
        (t.ARMOURED_GRUNT, FASTER, {1, 2, 3}),
    ],
)
def test_armour_beyond_the_penetration_blunts_a_hit_down_to_one(kind, tower, possible):
    assert set(losses_of(kind, tower)) == possible


def test_damage_rolls_are_uniform():
    losses = losses_of(MILITIA, BASIC, num_shots=3_000)
    assert chisquare(np.bincount(losses)[2:]).pvalue > 0.001


@pytest.mark.parametrize(("kind", "bounty"), [(0, 1), (1, 2), (2, 4), (3, 10)])
def test_a_kill_pays_the_owner_of_the_tower_a_tenth_of_the_price(kind, bounty):
    board = Board()
    board.put_tower(0, BASIC, row=5, column=3)
    put_target(board, 5, 3, kind=kind, health=1)
    board.wait(1)
    expected = [[100 + bounty, 100], [0, 0], [50, 50]]
    assert board.read("gold", "num_units", "health") == expected


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


@pytest.mark.plain_python
@pytest.mark.parametrize(
    ("along", "across", "flight"),
    [(0, 1, 1), (1, 1, 1), (2, 0, 1), (0, 2, 1), (2, 1, 2), (2, 2, 2), (3, 0, 2), (0, 3, 2)],
)
def test_a_projectile_flies_two_tiles_a_tick(flying, along, across, flight):
    board, unit = make_range(BASIC, (4, 4), (4 + along, 4 + across), preset=flying)
    board.wait(1)
    assert board.world.num_shots.tolist() == [1, 0]
    assert board.world.shot_ticks[0, 0] == board.world.shot_flight_ticks[0, 0] == flight
    assert board.world.unit_health[1, unit] == LASTING
    assert find_hits(board, unit, flight) == [flight]
    assert board.world.num_shots.tolist() == [0, 0]


def test_without_flight_time_a_shot_hits_in_the_tick_it_is_fired():
    board, unit = make_range(BASIC, (4, 4), (4, 7))
    assert find_hits(board, unit, 1) == [1]
    assert board.world.num_shots.tolist() == [0, 0]


def test_a_tower_fires_again_in_the_tick_in_which_its_projectile_lands(flying):
    """Shots land before towers fire, so a flight of two ticks does not slow five shots a second."""
    board, unit = make_range(FASTER, (4, 4), (7, 4), preset=flying)
    assert len(find_hits(board, unit, 41)) == 20


def test_a_tower_waits_for_its_projectile_to_land(monkeypatch):
    """Three ticks of flight slow a tower that would reload in two."""
    preset = dataclasses.replace(PRESETS["2018"], projectile_tiles_per_tick=1)
    monkeypatch.setitem(PRESETS, "slow", preset)
    board, unit = make_range(FASTER, (4, 4), (7, 4), preset="slow")
    assert find_hits(board, unit, 31) == list(range(4, 32, 3))
    assert board.world.num_shots[0] == 1


def test_a_shot_at_a_unit_that_died_is_lost(flying):
    board = Board(preset=flying)
    for column in (4, 5):
        board.put_tower(0, BASIC, row=4, column=column)
    put_target(board, 4, 6, health=1)
    younger = put_target(board, 4, 7)
    board.wait(1)
    assert board.world.num_shots[0] == 2
    board.wait(1)
    assert (board.world.num_shots[0], board.world.gold[0]) == (0, 101)
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
    assert (board.world.num_shots[0], board.world.gold[0]) == (0, 100)
    assert board.world.shot_target[0, 0] == NO_TARGET
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
