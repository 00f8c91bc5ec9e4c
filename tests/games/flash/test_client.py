"""Frames and keys in real time, as FlashRL had them: pushed to a callback, and on demand."""

import threading

import numpy as np
import pytest

from marl_cair.games.flash.client import Game
from marl_cair.games.flash.scenes import SceneClassifier
from tests.games.flash.browser.flash_files import PROBE, need_flash
from tests.games.flash.browser.vnc_servers import wait_until


@pytest.fixture(scope="module", autouse=True)
def _needs_browsers():
    need_flash()


def test_frames_are_pushed_with_their_scenes_and_taken_on_demand():
    pushed, has_frames = [], threading.Event()

    def keep(frame, number, scene, game):
        pushed.append((frame, number, scene))
        if number == 2:
            has_frames.set()

    with Game("multitask", fps=20) as game:
        menu = game.screen()
        game.click(240, 190)  # PLAY
        wait_until(lambda: np.abs(game.screen().astype(int) - menu).mean() > 20)
        assert game.render().shape == (84, 84, 3)
        stage = game.screen()
        game.send_key("left", 0.1)
    scenes = SceneClassifier.train({"menu": [menu], "stage": [stage]})
    options = {"grayscale": True, "normalized": True, "scenes": scenes}
    with Game("multitask", fps=20, frame_callback=keep, **options) as game:
        assert has_frames.wait(30)
        assert game.find_scene() == "menu"
    frames, numbers, names = zip(*pushed, strict=True)
    assert list(numbers) == list(range(len(numbers)))
    assert set(names) == {"menu"}
    assert (frames[0].shape, frames[0].dtype) == ((84, 84, 1), np.float32)
    assert 0.0 <= frames[0].min() < frames[0].max() <= 1.0


def test_what_the_callback_raises_is_raised_by_close():
    is_called = threading.Event()

    def fail(frame, number, scene, game):
        is_called.set()
        raise ZeroDivisionError

    game = Game("duel", fps=20, frame_callback=fail)
    assert is_called.wait(30)
    with pytest.raises(ZeroDivisionError):
        game.close()


def test_mouse_and_held_keys_reach_the_game():
    with Game(str(PROBE)) as game:  # which logs its input and the frame of each
        game.move(10, 20)
        wait_until(lambda: "mouseMove 10 20" in find_log(game))
        game.mouse_down(30, 40)
        game.mouse_up(50, 60)
        game.hold("a", 30)
        wait_until(lambda: "up 65" in find_log(game))
        log = find_log(game)
    words, frames = zip(*(entry.split("@") for entry in log.split(", ")), strict=True)
    order = ["mouseMove 10 20", "mouseDown 30 40", "mouseUp 50 60", "down 65"]
    assert [word for word in words if word in order] == order
    assert int(frames[words.index("up 65")]) > int(frames[words.index("down 65")])


def find_log(game):
    """What the probe has seen, as "down 65@12, up 65@42"."""
    return game._server.call("getState")["log"]


def test_a_rate_below_one_is_refused():
    with pytest.raises(ValueError, match="fps is 0"):
        Game("duel", fps=0)
