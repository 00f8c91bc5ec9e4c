"""Each hotkey does what its line of the menu says."""

import math
from types import SimpleNamespace

import numpy as np
import pygame
import pytest

from marl_cair.games.replays import read_replay
from marl_cair.window.colours import list_seat_colours
from marl_cair.window.controls import line_wars, registry, rts
from marl_cair.window.controls.controls import ARROWS
from marl_cair.window.hotkeys import HOTKEYS, SPEEDS, find_hotkey
from marl_cair.window.panels import draw_panels
from marl_cair.window.scene import PANEL_WIDTH, SCROLLBAR
from marl_cair.window.session import View
from tests.window.persons import Person, make_window

BOTS = ("counter", "rusher")


@pytest.fixture(name="window")
def make_bots_window(tmp_path):
    return make_window("deep_line_wars", None, BOTS, folder=tmp_path / "saved")


def press(window, label):
    """Press a hotkey by its label of the menu, and let a step's time pass."""
    (hotkey,) = [hotkey for hotkey in HOTKEYS if hotkey.label == label]
    Person(window).press(hotkey.keys[0])
    Person(window).wait()
    window.draw()


def pixels(window):
    return pygame.surfarray.array3d(window.surface)


def test_g_shows_the_menu_with_a_line_for_each_hotkey(window, monkeypatch):
    from marl_cair.window import scene

    written, write = [], scene.write
    monkeypatch.setattr(
        scene, "write", lambda text, *rest: written.append(text) or write(text, *rest)
    )
    before = pixels(window)
    press(window, "G")
    assert {text for key in HOTKEYS for text in (key.label, key.text)} <= set(written)
    assert (pixels(window)[200:700] != before[200:700]).any()
    written.clear()
    press(window, "G")
    assert HOTKEYS[0].text not in written


def test_p_pauses_and_continues(window):
    press(window, "P")
    paused = window.moment.step
    Person(window).wait(5)
    assert window.moment.step == paused
    press(window, "P")
    assert window.moment.step == paused + 1
    press(window, "P")
    window.due = 9.0  # steps that the computer is behind
    Person(window).wait(2)
    assert window.moment.step == paused + 1


def test_the_period_plays_one_step_and_pauses(window):
    press(window, "P")
    first = window.moment.step
    press(window, ".")
    Person(window).wait(5)
    assert window.moment.step == first + 1
    assert window.shown["pause"]


def test_plus_and_minus_change_the_speed(window):
    press(window, "+")
    assert window.speed == 2.0
    first = window.moment.step
    window.update(1.0)
    assert window.moment.step == first + 20  # ten ticks in a second, twice
    press(window, "-")
    press(window, "-")
    assert window.speed == 0.5
    for _ in SPEEDS:
        press(window, "-")
    assert window.speed == SPEEDS[0]


def test_t_waits_for_the_persons_action():
    window = make_window("deep_line_wars", None, (None, "random"))
    Person(window).press(pygame.K_1)
    Person(window).wait()
    press(window, "T")
    waiting = window.moment.step
    Person(window).wait(5)
    assert window.moment.step == waiting
    Person(window).press(pygame.K_1)
    Person(window).wait()
    assert window.moment.step == waiting + 1


def test_n_begins_the_next_game_on_another_map(window):
    Person(window).wait(5)
    first = window.session.map_seed
    press(window, "N")
    assert window.session.map_seed != first
    assert window.moment.step == 1


def test_tab_is_for_several_persons(window):
    press(window, "Tab")
    assert window.message == "no other person takes turns at the keyboard"


def test_f_shows_the_view_of_each_player_with_its_fog():
    window = make_window("deep_rts", "1v1-15x15-fog", ("random", "random"))
    seen = []
    for expected in (0, 1, None):
        press(window, "F")
        Person(window).wait()
        assert window.moment.view == View(expected)
        seen.append((window.moment.picture.sum(2) == 0).mean())
    assert min(seen[:2]) > 0.2 > seen[2]  # what a player has not seen is black


def test_f_shows_a_person_no_other_view_before_the_end():
    window = make_window("deep_maze")
    press(window, "F")
    assert window.view == View(0)
    assert window.message == "other views open when the game is over"


def test_the_next_game_of_a_person_begins_in_its_own_view():
    window = make_window("deep_rts", "1v1-15x15-fog", (None, "random"))
    window.set_view(View(1))
    window.start_next()
    assert window.moment.view == window.view == View(0)


def test_v_shows_what_agents_see(window):
    names = []
    for _ in range(7):
        press(window, "V")
        names.append(window.moment.view.representation)
    kinds = window.session.spec.representations
    assert set(names) == {"", *(name for name, one in kinds.items() if len(one.shape) == 3)}
    assert {"planes", "image", "heatmap", "heatmap_gray", "gray", ""} <= set(names)


def test_representations_are_shown_as_they_are(window):
    for name in ("image", "gray", "heatmap"):
        seen = window.session.engine.observe(name)[0, 0]
        picture = window.session.look(View(0, name)).picture
        assert (picture[..., 0] == seen[0]).all(), name
    planes = window.session.engine.observe("planes")[0, 0]
    picture = window.session.look(View(0, "planes")).picture
    rows, columns = planes.shape[1:]
    low, high = planes[0].min(), planes[0].max()
    first = picture[1 : 1 + rows, 1 : 1 + columns, 0]
    assert (np.argsort(first[:, 0]) == np.argsort(planes[0][:, 0])).all()
    assert low == high or first[planes[0] == high].min() > first[planes[0] == low].max()


def test_o_shows_the_presence_of_capsules_in_the_agents_view(window):
    press(window, "O")
    assert window.message == "no player that you may look at has capsules"
    presence = np.linspace(0, 1, 15, dtype=np.float32).reshape(1, 1, 3, 5)
    agent = window.session.agents[1]
    agent.find_presences = lambda seen: presence[: len(seen)]
    without = pixels(window)
    press(window, "P")
    press(window, "O")
    assert window.view == View(1)
    window.draw()
    assert (window.moment.presence == presence[0]).all()
    assert (pixels(window)[200:800, 200:600] != without[200:800, 200:600]).mean() > 0.2


def test_h_draws_grid_lines(window):
    press(window, "P")
    before = pixels(window)
    press(window, "H")
    x, y = Person(window).find_pixel(3, 4)
    board = window.find_board()
    edge = y - round(board.tile * window.camera.scale / 2)
    changed = (pixels(window) != before).any(2)
    assert changed[x, edge - 1 : edge + 2].any()
    assert not changed[x, y]


def test_b_hides_the_panels_and_gives_their_room_to_the_game(window):
    wide = window.camera.area[2]
    press(window, "B")
    assert window.camera.area[2] == window.surface.get_width() > wide


def test_end_and_the_wheel_scroll_panels_that_do_not_fit():
    window = make_window("deep_rts", "FFA-6-31x31", ["random"] * 6, (960, 300))
    window._counted = 0, 0, math.inf  # rates do not change
    Person(window).wait()
    press(window, "P")
    whole, scale = draw_all_panels(window), window.camera.scale
    tops = [find_top(window, whole)]
    for _ in range(2):
        press(window, "End")
        tops.append(find_top(window, whole))
    assert tops == [0, 300 - 2 * 17, len(whole) - 300]  # no line of 17 pixels is cut
    press(window, "End")
    assert find_top(window, whole) == 0
    Person(window).move((900, 200))
    window.handle(SimpleNamespace(type=pygame.MOUSEWHEEL, y=-1))
    window.draw()
    assert find_top(window, whole) == 3 * 17
    window.handle(SimpleNamespace(type=pygame.MOUSEWHEEL, y=2))
    window.draw()
    assert find_top(window, whole) == 0
    assert window.camera.scale == scale
    press(window, "B")
    window.handle(SimpleNamespace(type=pygame.MOUSEWHEEL, y=1))
    assert window.camera.scale == scale + 1  # the board lies there now


def draw_all_panels(window):
    """The panels as a column of lines, without the edge where the scroll bar is."""
    surface = pygame.Surface((PANEL_WIDTH, 2_000))
    state = window.describe_panels(list_seat_colours(window.session, window.moment.view.seat))
    height = draw_panels(surface, state)
    return pygame.surfarray.array3d(surface).swapaxes(0, 1)[:height, :-SCROLLBAR]


def shown_panels(window):
    left = window.surface.get_width() - PANEL_WIDTH
    return pixels(window).swapaxes(0, 1)[:, left:-SCROLLBAR]


def find_top(window, whole):
    """The first line of the panels that is shown."""
    shown = shown_panels(window)
    (top,) = [
        top
        for top in range(len(whole) - len(shown) + 1)
        if (whole[top : top + len(shown)] == shown).all()
    ]
    return top


def test_page_up_and_down_zoom_by_whole_pixels(window):
    assert window.camera.scale == 1
    press(window, "Page up")
    assert window.camera.scale == 2
    press(window, "Page down")
    assert window.camera.scale == 1


def test_f5_saves_the_replay_so_far(window):
    Person(window).wait(30)
    press(window, "P")
    press(window, "F5")
    path = window.folder / "deep_line_wars.replay"
    assert window.message == f"saved {path}"
    assert len(read_replay(path).actions) == window.moment.step
    press(window, "F5")
    assert (window.folder / "deep_line_wars-2.replay").is_file()


def test_f12_saves_a_screenshot(window):
    press(window, "P")
    press(window, "F12")
    saved = pygame.image.load(window.folder / "screenshot.png")
    assert saved.get_size() == window.surface.get_size()


def test_a_folder_that_cannot_be_written_is_a_message(tmp_path):
    (tmp_path / "file").write_text("no folder")
    window = make_window("deep_maze", None, ("random",), folder=tmp_path / "file" / "saved")
    press(window, "F12")
    assert "not saved" in window.message
    press(window, "F5")
    assert "not saved" in window.message
    assert window.is_open


def test_escape_quits(window):
    press(window, "Esc")
    assert not window.is_open


def test_the_window_has_a_test_for_each_hotkey():
    tested = (
        *("G", "P", ".", "+", "-", "T", "N", "Tab", "F", "V", "O", "H", "B", "F5", "F12", "Esc"),
        *("Page up", "Page down", "End"),
    )
    assert sorted(tested) == sorted(hotkey.label for hotkey in HOTKEYS)


def test_no_key_means_two_things():
    keys = [key for hotkey in HOTKEYS for key in hotkey.keys]
    assert len(keys) == len(set(keys))
    of_games = {
        *(*line_wars.UNIT_KEYS, *line_wars.TOWER_KEYS, *rts.PRODUCT_KEYS, *rts.CLASSIC_KEYS),
        *(*registry.FLAP_KEYS, *registry.DIGITS, *ARROWS),
        *(key for person in registry.MAZE_KEYS for key in person),
        *(pygame.K_a, pygame.K_s, pygame.K_c, pygame.K_u, pygame.K_RETURN, pygame.K_SPACE),
    }
    assert of_games.isdisjoint(keys)
    for group in (registry.FLAP_KEYS, [key for one in registry.MAZE_KEYS for key in one]):
        assert len(group) == len(set(group))
    assert find_hotkey(pygame.K_1) is None


def test_large_boards_scroll_by_keys_mouse_and_minimap():
    window = make_window("deep_rts", "FFA-6-31x31", (None, *["random"] * 5))
    person, camera = Person(window), window.camera
    assert not camera.is_whole
    lowest = camera.size[1] - camera.area[3]
    person.press(pygame.K_DOWN, mod=pygame.KMOD_CTRL)
    assert camera.top == min(64, lowest)
    person.move((300, 300), buttons=(0, 1, 0), rel=(0, 24))
    assert camera.top == min(64, lowest) - 24
    window.draw()
    left, top, width, height = window.scene._minimap
    person.click((left + width // 2, top + height - 2))
    assert camera.top == lowest  # the lower edge is in sight
    person.press(*[pygame.K_UP] * 30)  # the frame takes the camera with it
    assert camera.top < lowest


def test_the_wheel_zooms_and_keeps_the_pixel_under_the_pointer(window):
    person = Person(window)
    place = person.find_pixel(4, 7)
    person.move(place)
    before = window.find_cell(place)
    window.handle(SimpleNamespace(type=pygame.MOUSEWHEEL, y=2))
    assert window.camera.scale == 3
    assert window.find_cell(place) == before


def test_a_click_on_a_button_presses_its_key():
    window = make_window("deep_line_wars", None, (None, "random"))
    box, button = window.scene._buttons[4]
    assert button.label == "basic tower"
    Person(window).click((box[0] + 5, box[1] + 5))
    assert window.controls[0].tower == 0
