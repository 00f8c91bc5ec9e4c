"""A scripted person plays whole games with keys and mouse, and wins."""

import numpy as np
import pygame
import pytest

from marl_cair.games.compiled import compiled_compact
from marl_cair.games.deep_maze import state as maze
from marl_cair.games.deep_maze.tables import COLUMN_STEP, ROW_STEP
from marl_cair.games.deep_rts import state as rts
from marl_cair.games.deep_rts import tables as t
from marl_cair.games.deep_rts.art.scene import piece_of, scene_of
from marl_cair.window.session import View
from tests.games import last_standing
from tests.window.persons import Person, make_window, win_line_wars, win_skirmish

MAZE_KEYS = (pygame.K_DOWN, pygame.K_UP, pygame.K_LEFT, pygame.K_RIGHT)


def test_line_wars_is_won_by_mouse_and_keys():
    window = make_window("deep_line_wars", None, (None, "random"), ticks_per_step=20)
    person = Person(window)
    person.wait(20)
    assert window.moment.step == 0  # the game begins with the person's first order
    win_line_wars(person)
    assert window.moment.world.num_towers[0, 0] == 4
    assert window.moment.winner == 0
    assert window.message == "you have won. N: next game, Esc: quit"


@pytest.mark.parametrize("actions", ["spatial", "classic"])
def test_line_wars_is_played_by_keyboard_alone(actions):
    window = make_window("deep_line_wars", None, (None, "random"), actions=actions)
    person = Person(window)
    person.press(pygame.K_6, pygame.K_UP)  # the frame appears in the middle
    for _ in range(4):
        person.press(pygame.K_LEFT)
    person.press(pygame.K_RETURN)
    person.wait(12)  # `classic` moves its cursor there first
    world = window.moment.world
    row, column = window.controls[0].frame
    assert (world.tower_row[0, 0, 0], world.tower_column[0, 0, 0]) == (row, column)
    assert world.tower_kind[0, 0, 0] == 1


def test_line_wars_says_why_an_order_is_not_possible():
    window = make_window("deep_line_wars", None, (None, "random"))
    person = Person(window)
    person.click_cell(2, 3)
    assert window.message == "choose a tower first: 5, 6 or 7"
    person.press(pygame.K_5)
    person.click_cell(2, 10)
    assert window.message == "towers stand in your own half, not in its first column"
    person.click_cell(2, 3)
    person.wait()
    person.click_cell(2, 3)
    assert window.message == "a tower stands there"
    person.press(pygame.K_4)
    person.wait()
    person.press(pygame.K_4)
    assert window.message == "not enough gold: it costs 100, you have 85"
    assert window.session.engine.illegal_actions.sum() == 0


def test_a_maze_waits_for_the_person_who_solves_it():
    window = make_window("deep_maze")
    person = Person(window)
    person.wait(50)
    assert window.moment.step == 0
    while not window.moment.is_over:
        world = window.moment.world
        row, column = divmod(int(world.cell[0, 0]), window.session.scenario.columns)
        distances = world.distance[0].reshape(window.session.scenario.rows, -1)
        padded = np.pad(distances, 1, constant_values=maze.NO_WAY)
        beside = [
            padded[row + 1 + down, column + 1 + right]
            for down, right in zip(ROW_STEP, COLUMN_STEP, strict=True)
        ]
        move = beside.index(distances[row, column] - 1)
        person.press(MAZE_KEYS[move])
        person.wait()
    assert window.moment.winner == 0
    optimal = window.moment.world.optimal[0, 0]
    assert window.moment.world.clock[0, maze.TICK] == optimal


def test_several_persons_fly_at_once_with_keys_of_their_own():
    window = make_window("flappy_bird", "race-4", (None, "random", None, "random"))
    person = Person(window)
    assert window.view == View(None)
    person.press(pygame.K_SPACE)  # the game begins: in its first step no bird may flap
    person.wait(5)
    person.press(pygame.K_UP)  # the second person's key
    person.wait()
    flap = window.session.spec.action_names.index("flap")
    assert window.session.history.actions[5][[0, 2]].tolist() == [0, flap]


def test_rts_gold_is_gathered_by_a_box_and_a_right_click():
    window = make_window("deep_rts", "GoldCollect-15x15")
    person = Person(window)
    units = window.controls[0].list_units(window.moment)
    peasants = [unit for unit in units if unit.is_mobile]
    low = np.min([(u.row, u.column) for u in peasants], 0)
    high = np.max([(u.row, u.column) for u in peasants], 0)
    person.click(person.find_pixel(*low), until=person.find_pixel(*high))
    assert window.message == f"{len(peasants)} selected"
    person.click_cell(*find_tile(window, t.GOLD_TILE), button=3)
    person.wait(7)
    orders = window.moment.world.units[0, :, rts.UNIT_ORDER]
    assert (orders == rts.HARVEST).sum() == len(peasants)
    while not window.moment.is_over:
        person.wait()
    assert window.moment.winner == 0
    assert window.moment.numbers.scoreboard["gathered"][0] >= 200
    assert window.session.engine.illegal_actions.sum() == 0


def find_tile(window, kind):
    """Row and column, in the person's view, of the nearest free tile of a kind to its base."""
    control, world = window.controls[0], window.moment.world
    frame = control.rules.seats[world.clock[0, rts.MAP_INDEX], control.seat, 1]
    is_free = world.board[0, rts.OCCUPANT] == rts.NO_UNIT
    cells = np.flatnonzero((world.board[0, rts.TILE] == kind) & is_free)
    places = control.rules.own_place[frame, cells]
    base = control.find_start(window.moment)
    return places[np.abs(places - base).sum(1).argmin()].tolist()


@compiled_compact
def read_corners(worlds, rules, viewer, tile, top, left, out):
    """Top and left, in the picture, of every unit on the board, int64 [U, 2]."""
    scene = scene_of(worlds, rules, 0, viewer, tile, top, left)
    for unit in range(len(out)):
        if scene.units[unit, rts.UNIT_KIND] != t.NO_KIND:
            piece = piece_of(scene, unit)
            out[unit, 0], out[unit, 1] = piece.top, piece.left


def test_rts_units_are_marked_and_picked_where_they_are_drawn():
    """The picture's own pieces are the reference; blows and blows at trees shift them a little."""
    window = make_window("deep_rts", "1v1-15x15", ("random", None))
    person, control, board = Person(window), window.controls[0], window.find_board()
    rules, side = control.rules, int(board.tile)
    corners, shifts = np.zeros((len(window.moment.world.units[0]), 2), np.int64), []
    for step in range(160):
        if step % 40 == 0:  # to corners, so that all directions are walked
            person.press(pygame.K_u)
            person.click_cell(*[(0, 14), (14, 14), (14, 0), (7, 7)][step // 40], button=3)
        person.wait()
        world = window.moment.world
        read_corners(world, rules, 1, side, int(board.top), int(board.left), corners)
        for unit in control.list_units(window.moment):
            top, left = corners[unit.slot]
            away = np.abs(np.subtract(board.find_box(*unit.corner), (left, top))).max()
            is_walking = world.units[0, unit.slot, rts.UNIT_STATE] == rts.WALKING
            assert away < 1e-6 if is_walking else away <= side // 6
            if max(map(abs, unit.ahead)) > 0.7:
                shifts.append(unit.ahead)
                middle = board.find_point(left + side // 2, top + side // 2)
                assert control.find_unit(middle, window.moment) == unit
    assert len({tuple(np.sign(shift)) for shift in shifts}) > 3


@pytest.mark.parametrize("actions", ["unit", "grid"])
def test_rts_trains_builds_and_sends_units_far_away(actions):
    window = make_window("deep_rts", "1v1-15x15", (None, "random"), actions=actions)
    person, control = Person(window), window.controls[0]
    hall, *_ = (u for u in control.list_units(window.moment) if u.kind == t.TOWN_HALL)
    person.click_cell(hall.row, hall.column)
    assert [button.label for button in control.list_buttons(window.moment)] == ["peasant", "cancel"]
    person.press(pygame.K_1)
    person.wait(3)
    assert window.moment.world.units[0, hall.slot, rts.UNIT_QUEUE_LENGTH] == 1
    person.press(pygame.K_c)
    person.wait(3)
    assert window.moment.world.units[0, hall.slot, rts.UNIT_QUEUE_LENGTH] == 0
    person.press(pygame.K_u)
    assert window.message == ""
    (peasant,) = control.list_selected(window.moment)
    goal = (2, 7)
    person.click_cell(*goal, button=3)
    person.wait(180)
    (there,) = control.list_selected(window.moment)
    assert (there.slot, there.row, there.column) == (peasant.slot, *goal)
    person.click_cell(hall.row, hall.column, button=3)
    person.wait(3)
    assert window.message == f"go r{hall.row} c{hall.column}: not possible now" or actions == "grid"
    person.press(pygame.K_2)  # a farm, where it stands
    person.wait(5)
    assert window.moment.world.players[0, 0, rts.NUM_OWNED + t.FARM] == 1
    assert window.session.engine.illegal_actions[0, 0] == 0


def test_rts_soldiers_advance_after_a():
    window = make_window("deep_rts", "Skirmish-15x15", (None, "random"))
    person, control = Person(window), window.controls[0]
    person.press(pygame.K_a)
    assert window.message == "select soldiers first"
    everything = window.find_board()
    last = (everything.rows - 1, everything.columns - 1)
    person.click(person.find_pixel(0, 0), until=person.find_pixel(*last))
    goal = find_tile(window, t.GRASS)
    num_soldiers = len(control.list_selected(window.moment))
    assert num_soldiers == 8
    person.press(pygame.K_a)
    person.click_cell(*goal)
    person.wait(2 * num_soldiers + 2)
    names = [window.session.spec.action_names[one[0]] for one in window.session.history.actions]
    assert names.count(f"advance_r{goal[0]}_c{goal[1]}") >= num_soldiers - 1  # one may be there


def test_s_stops_a_unit_on_its_way():
    window = make_window("deep_rts", "1v1-15x15", (None, "random"))
    person, control = Person(window), window.controls[0]
    person.press(pygame.K_u)
    person.click_cell(7, 7, button=3)
    person.wait(12)
    (peasant,) = control.list_selected(window.moment)
    assert window.moment.world.units[0, peasant.slot, rts.UNIT_ORDER] == rts.MOVE
    person.press(pygame.K_s)
    person.wait(30)
    (peasant,) = control.list_selected(window.moment)
    assert peasant.is_idle
    assert (peasant.row, peasant.column) != (7, 7)


def test_an_rts_battle_is_won_by_mouse_and_keys():
    window = make_window("deep_rts", "Skirmish-15x15", (None, "random"))
    win_skirmish(Person(window))
    assert window.moment.winner == 0
    assert window.session.kills[0] == 8
    assert window.session.engine.illegal_actions[0, 0] == 0


def test_the_classic_orders_of_rts_have_keys():
    window = make_window("deep_rts", "1v1-15x15", (None, "random"), actions="classic")
    person = Person(window)
    person.press(pygame.K_RIGHTBRACKET)
    person.wait()
    assert window.session.spec.action_names[window.session.history.actions[0][0]] == "next_unit"


def test_persons_pass_the_mouse_on_by_tab():
    window = make_window("deep_line_wars", None, (None, None))
    person = Person(window)
    assert window.view == View(0)
    person.press(pygame.K_TAB)
    assert window.view == View(1)
    person.wait()
    person.press(pygame.K_1)
    person.wait()
    assert [chosen != 0 for chosen in window.session.history.actions[0]] == [False, True]


def test_an_own_game_is_played_by_digits(monkeypatch):
    last_standing.register(monkeypatch)
    window = make_window(last_standing.NAME, "alone")
    assert window.controls[0].lines == (("1", "score"), ("2", "leave"), ("3", "finish"))
