"""Screenshots of each game with its panels, beside approved ones, in windows of every size.

`python -m tests.window.test_screens` writes the approved pictures again: look at them.
"""

from pathlib import Path

import numpy as np
import pygame
import pytest
from PIL import Image

from marl_cair.games.deep_rts import state as rts
from marl_cair.window.controls.registry import FLAP_KEYS
from marl_cair.window.pen import fit, write
from marl_cair.window.scene import PANEL_WIDTH
from marl_cair.window.session import View
from tests.games.flash.browser.flash_files import need_flash
from tests.window.persons import SIZE, Person, make_window

APPROVED = Path(__file__).parent / "approved"
SMALL_SIZE = (960, 620)
# Text is drawn by the FreeType of the machine: edges of letters may differ, colours and places not.
MOST_DIFFERENT, TOLERANCE = 0.01, 48  # share of pixels by more than that in a channel


def line_wars_by_hand():
    window = make_window("deep_line_wars", None, (None, "counter"), SMALL_SIZE)
    person = Person(window)
    person.press(pygame.K_2, pygame.K_5)
    person.click_cell(3, 4)
    person.wait(150)
    person.move(person.find_pixel(5, 5))
    return window


def line_wars_values():
    """An agent's action values and the presence of its capsules, here made up."""
    window = make_window("deep_line_wars", None, ("counter", "rusher"), SIZE)
    agent = window.session.agents[0]
    agent.values = lambda seen, mask, state: np.where(
        mask, np.linspace(-0.4, 0.8, mask.shape[1]), -np.inf
    )
    agent.find_presences = lambda seen: np.linspace(0, 1, 40, dtype=np.float32).reshape(1, 1, 5, 8)
    Person(window).press(pygame.K_o)
    Person(window).wait(610)
    return window


def rts_by_hand():
    window = make_window("deep_rts", "1v1-15x15-fog", (None, "mixed"), SMALL_SIZE)
    person, board = Person(window), window.find_board()
    person.click(
        person.find_pixel(0, 0), until=person.find_pixel(board.rows - 1, board.columns - 1)
    )
    person.press(pygame.K_h)
    person.click_cell(13, 2, button=3)
    person.wait(28)
    walking = window.moment.world.units[0, :, rts.UNIT_STATE] == rts.WALKING
    assert walking.sum() > 2
    return window


def rts_of_six():
    window = make_window("deep_rts", "FFA-6-31x31", ["mixed"] * 6, SIZE)
    Person(window).wait(400)
    return window


def rts_planes():
    window = make_window("deep_rts", "1v1-15x15", ("mixed", "mixed"), SMALL_SIZE)
    Person(window).press(pygame.K_v)
    Person(window).wait(50)
    return window


def maze_menu():
    window = make_window("deep_maze", size=SMALL_SIZE)
    Person(window).press(pygame.K_g)
    return window


def flappy_race():
    """Two persons, who keep to a height each, and two bots."""
    window = make_window("flappy_bird", "race-4", (None, "oracle", "reflex", None), SMALL_SIZE)
    Person(window).press(pygame.K_SPACE)
    for _ in range(40):
        for seat, key, lowest in ((0, FLAP_KEYS[0], 230), (3, FLAP_KEYS[1], 180)):
            if window.moment.world.bird_y[0, seat] > 100 * lowest:
                Person(window).press(key)
        Person(window).wait()
    assert not window.moment.eliminated.any()
    return window


def line_wars_heatmap():
    window = make_window("deep_line_wars", None, ("counter", "rusher"), SMALL_SIZE)
    Person(window).wait(400)
    window.set_view(View(1, "heatmap"))
    Person(window).wait()
    return window


def duel_by_hand():
    need_flash()
    window = make_window("flash", "duel", (None, "duelist"), SMALL_SIZE)
    Person(window).hold(pygame.K_s)
    Person(window).wait(10)
    Person(window).hold(pygame.K_d)
    Person(window).wait(25)
    return window


SCREENS = (
    *(line_wars_by_hand, line_wars_values, line_wars_heatmap, rts_by_hand, rts_of_six, rts_planes),
    *(maze_menu, flappy_race, duel_by_hand),
)


def take(make):
    """The screen uint8 [h, w, 3], with rates as on a quick machine."""
    window = make()
    window.frame_rates, window.tick_rates = [60.0, 59.0, 60.0], [10.0, 10.0, 10.0]
    window.scene._drawn.pop("panels", None)
    window.draw()
    window.shut_down()
    return pygame.surfarray.array3d(window.surface).swapaxes(0, 1)


@pytest.mark.parametrize("make", SCREENS, ids=lambda make: make.__name__)
def test_screens_look_as_approved(make):
    with Image.open(APPROVED / f"{make.__name__}.png") as image:
        approved = np.asarray(image.convert("RGB")).astype(int)
    different = np.abs(take(make).astype(int) - approved).max(2) > TOLERANCE
    assert different.mean() < MOST_DIFFERENT, np.argwhere(different)[:5]


@pytest.mark.parametrize(
    "size", [(1, 1), (3, 200), (200, 3), (160, 120), (640, 90), (2_000, 1_500)]
)
def test_windows_of_every_size_are_drawn(size):
    window = make_window("deep_rts", "1v1-15x15", (None, "random"), size)
    Person(window).press(pygame.K_u, pygame.K_g, pygame.K_DOWN)
    Person(window).wait(3)
    window.draw()
    Person(window).click((size[0] // 2, size[1] // 2))
    Person(window).press(pygame.K_PAGEUP, pygame.K_PAGEDOWN)
    window.draw()


def test_the_picture_is_scaled_sharply():
    window = make_window("flappy_bird", size=(1_400, 1_200))
    assert window.camera.scale == 2
    left, top = window.camera.corner()
    picture = window.moment.picture
    shown = pygame.surfarray.array3d(window.surface).swapaxes(0, 1)
    shown = shown[top : top + 2 * picture.shape[0], left : left + 2 * picture.shape[1]]
    assert (shown == picture.repeat(2, 0).repeat(2, 1)).all()


def test_the_minimap_lies_beside_a_board_that_leaves_room():
    window = make_window("deep_rts", "FFA-6-31x31", ["mixed"] * 6, (1_280, 800))
    left, _, wide, _ = window.scene._minimap
    assert window.camera.corner()[0] + window.camera.size[0] * window.camera.scale <= left
    assert left + wide <= 1_280 - PANEL_WIDTH


@pytest.mark.parametrize("text", ["150 gold, 80 lumber, 30 stone", ""])
@pytest.mark.parametrize("room", [-9, 0, 1, 8, 30, 60, 200])
def test_text_fits_its_room(room, text):
    shown = fit(text, room)
    assert shown.get_width() <= max(1, room)
    if room >= write(text).get_width():
        assert shown.get_width() == write(text).get_width()


if __name__ == "__main__":
    APPROVED.mkdir(exist_ok=True)
    for make_screen in SCREENS:
        image = Image.fromarray(take(make_screen)).quantize(128, dither=Image.Dither.NONE)
        image.save(APPROVED / f"{make_screen.__name__}.png", optimize=True)
