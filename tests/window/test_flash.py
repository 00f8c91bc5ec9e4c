"""Flash games by hand: keys are held, and the window is that of all games."""

import json

import pygame
import pytest

from marl_cair.cli import main
from marl_cair.games.flash.description import FOLDER
from marl_cair.games.replays import read_replay
from marl_cair.window.session import View
from tests.games.flash.browser.flash_files import need_flash
from tests.window.persons import Person, make_window


@pytest.fixture(name="duel")
def make_duel():
    need_flash()
    window = make_window("flash", "duel", (None, "random"))
    yield window
    window.shut_down()


def list_actions(window, seat=0):
    """Names of the actions of a seat so far, all of them legal."""
    names = window.session.spec.action_names
    return [names[actions[seat]] for actions in window.session.history.actions]


def test_a_key_is_down_while_it_is_held(duel):
    person = Person(duel)
    person.wait(3)
    assert duel.moment.step == 0  # the game begins with the person's first key
    person.hold(pygame.K_w)
    person.wait(2)
    person.hold(pygame.K_d)
    person.wait()
    person.release(pygame.K_w)
    person.wait()
    person.release(pygame.K_d)
    person.wait()
    assert list_actions(duel) == ["w", "w", "w+d", "d", "noop"]


def test_a_key_that_is_tapped_within_a_step_counts_for_that_step(duel):
    Person(duel).press(pygame.K_d)
    Person(duel).wait(2)
    assert list_actions(duel) == ["d", "noop"]


def test_of_many_keys_the_two_newest_count(duel):
    person = Person(duel)
    person.hold(pygame.K_a, pygame.K_w, pygame.K_d, pygame.K_a)  # the last one repeats itself
    person.wait()
    person.release(pygame.K_d)
    person.wait()
    assert list_actions(duel) == ["w+d", "w+a"]


def test_two_persons_play_with_the_keys_of_their_seats():
    need_flash()
    window = make_window("flash", "duel", (None, None))
    assert window.view == View(None)
    Person(window).hold(pygame.K_w, pygame.K_LEFT)
    Person(window).wait()
    assert (list_actions(window, 0), list_actions(window, 1)) == (["w"], ["d"])  # left fires, as D
    window.shut_down()


def test_the_second_seat_sees_and_plays_the_mirrored_game():
    need_flash()
    window = make_window("flash", "duel", ("random", None))
    Person(window).hold(pygame.K_d)
    Person(window).wait()
    assert list_actions(window, 1) == ["d"]
    own = window.moment.picture
    assert (own == window.session.look(View(0)).picture[:, ::-1]).all()
    window.shut_down()


def test_keys_of_a_game_go_before_hotkeys(tmp_path):
    need_flash()
    text = (FOLDER / "duel.toml").read_text("utf-8")
    keys = '["w", "s", "d", "a"]'
    assert keys in text
    (tmp_path / "own.toml").write_text(text.replace(keys, '["w", "s", "d", "p"]'), "utf-8")
    (tmp_path / "duel.swf").write_bytes((FOLDER / "duel.swf").read_bytes())
    described = str(tmp_path / "own.toml")
    window = make_window("flash", "duel", (None, "random"), description=described)
    person = Person(window)
    person.press(pygame.K_p)
    person.wait()
    assert list_actions(window) == ["p"]
    assert not window.shown["pause"]
    person.press(pygame.K_p, mod=pygame.KMOD_CTRL)
    assert window.shown["pause"]
    window.shut_down()


def test_a_game_of_clicks_is_played_by_mouse(tmp_path):
    need_flash()
    text = (FOLDER / "multitask.toml").read_text("utf-8")
    text = text.replace('start = ["enter"]', "start = [30]\nmouse_grid = [8, 5]")
    (tmp_path / "own.toml").write_text(text, "utf-8")
    (tmp_path / "multitask.swf").write_bytes((FOLDER / "multitask.swf").read_bytes())
    described = str(tmp_path / "own.toml")
    window = make_window("flash", "multitask", description=described, actions="mouse")
    person, menu = Person(window), window.moment.picture
    person.wait(3)
    assert window.moment.step == 0
    person.click((window.camera.corner()[0] + 240, window.camera.corner()[1] + 190))  # PLAY
    person.wait(2)
    assert list_actions(window) == ["click 4 2", "noop"]
    assert window.moment.numbers.scoreboard["score"][0] > 0  # the game has begun
    assert (window.moment.picture != menu).mean() > 0.2
    window.shut_down()


def test_duel_is_played_against_the_agent_with_recording_and_statistics(tmp_path, monkeypatch):
    need_flash()
    pygame.display.init()
    fire = {"key": pygame.K_d, "mod": 0}
    events = [
        [pygame.event.Event(pygame.KEYDOWN, **fire)],
        *[[]] * 90,
        [pygame.event.Event(pygame.KEYUP, **fire)],
        *[[]] * 240,
        [pygame.event.Event(pygame.KEYDOWN, key=pygame.K_F12, mod=0)],
        [pygame.event.Event(pygame.QUIT)],
    ]
    monkeypatch.setattr(pygame.event, "get", lambda: events.pop(0))
    record = tmp_path / "duel.replay"
    words = ["flash", "--scenario", "duel", "--opponent", "agents/flash_duel", "--speed", "4"]
    assert main(["play", *words, "--record", str(record), "--folder", str(tmp_path)]) == 0
    replay = read_replay(record)
    assert replay.players == ("person", "flash_duel")
    fired = [replay.spec.action_names[action] == "d" for action in replay.actions[:, 0]]
    assert fired == sorted(fired, reverse=True)  # down, then up
    assert 0 < sum(fired) < len(fired)
    about = json.loads((tmp_path / "duel.json").read_text("utf-8"))
    assert about["players"][0]["actions"]["d"] == sum(fired)
    assert len(about["players"]) == 2
    assert (tmp_path / "duel.csv").is_file()
    assert (tmp_path / "screenshot.png").is_file()
