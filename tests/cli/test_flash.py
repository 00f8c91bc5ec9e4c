"""`marl-cair flash`: descriptions of SWF files, what is refused, and games played by hand."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from marl_cair.cli import EXIT_DONE, EXIT_REFUSED, main
from marl_cair.games.flash.browser.rfb import RFBClient
from marl_cair.games.flash.description import FOLDER, Region, find_description
from marl_cair.games.flash.ending import EndReader, read_picture
from tests.games.flash.browser.flash_files import need_flash
from tests.games.flash.browser.vnc_servers import list_socket_options, run_tigervnc, wait_until

MULTITASK = (FOLDER / "multitask.swf").read_bytes()


def add(folder, capsys, *words):
    swf = folder / "game.swf"
    swf.write_bytes(MULTITASK)
    code = main(["flash", "add", str(swf), "--out", str(folder / "out"), *words])
    return code, capsys.readouterr()


def test_a_game_that_reports_its_state_is_described(tmp_path, capsys):
    words = ["--keys", "left,right", "--start", "30;240,190;enter", "--callback", "getState"]
    code, shown = add(tmp_path, capsys, *words, "--reward", "score", "--done", "done")
    assert code == EXIT_DONE
    assert "480 x 360" in shown.out
    found = find_description(str(tmp_path / "out/game.toml"))
    assert (found.size, found.fps, found.keys) == ((480, 360), 30, (("left", "right"),))
    assert found.start == (30, (240, 190), "enter")
    assert (found.callback, found.score, found.done) == ("getState", "score", "done")
    code, shown = add(tmp_path, capsys, *words, "--done", "done")
    assert code == EXIT_REFUSED
    assert "exists" in shown.err


def save_picture(path, size):
    Image.new("RGB", size).save(path)


@pytest.mark.parametrize("size", [(480, 360), (50, 60)])
def test_the_picture_of_the_end_shows_the_game_or_the_region(tmp_path, capsys, size):
    save_picture(tmp_path / "over.png", size)
    done = f"10,10,50,60,{tmp_path / 'over.png'}"
    assert add(tmp_path, capsys, "--keys", "a", "--done", done)[0] == EXIT_DONE
    ending = EndReader(find_description(str(tmp_path / "out/game.toml")))
    shown = np.full((360, 480, 3), 255, np.uint8)
    assert not ending.is_over(shown)
    shown[10:70, 10:60] = 0
    assert ending.is_over(shown)


def test_a_picture_of_another_size_is_refused(tmp_path, capsys):
    save_picture(tmp_path / "over.png", (60, 50))
    done = f"10,10,50,60,{tmp_path / 'over.png'}"
    code, shown = add(tmp_path, capsys, "--keys", "a", "--done", done)
    assert code == EXIT_REFUSED
    assert "over.png has (60, 50) pixels: give a picture of the whole game, (480, 360)" in shown.err
    assert not (tmp_path / "out/game.toml").exists()


def test_a_game_that_reports_nothing_is_read_from_its_picture(tmp_path, capsys):
    save_picture(tmp_path / "over.png", (480, 360))
    done = f"10,10,50,60,{tmp_path / 'over.png'}"
    words = ["--mouse-grid", "8x6", "--reward", "0,0,100,8", "--done", done, "--name", "mouse"]
    words += ["--renderer", "webgl"]
    assert add(tmp_path, capsys, *words)[0] == EXIT_DONE
    found = find_description(str(tmp_path / "out/mouse.toml"))
    assert (found.keys, found.mouse_grid, found.renderer) == (((),), (8, 6), "webgl")
    assert found.score == Region(0, 0, 100, 8)
    assert found.done.region == Region(10, 10, 50, 60)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["--keys", "lefft", "--callback", "f", "--done", "done"], "'lefft'"),
        (["--done", "done", "--callback", "f"], "mouse_grid"),
        (["--keys", "a", "--done", "done"], "callback"),
        (["--keys", "a", "--done", "1,2,3,x.png"], "--done"),
        (["--mouse-grid", "8", "--callback", "f", "--done", "done"], "--mouse-grid"),
    ],
)
def test_what_cannot_be_used_leaves_no_description(tmp_path, capsys, words, named):
    code, shown = add(tmp_path, capsys, *words)
    assert code == EXIT_REFUSED
    assert named in shown.err
    assert not any((tmp_path / "out").glob("*"))  # of the SWF neither


# --- by hand ------------------------------------------------------------------------------------

PLAY = [sys.executable, "-m", "marl_cair", "flash", "play", "multitask"]
BUTTON, PANEL = (170, 190), (20, 60)  # x, y: of the menu, of the first task
YELLOW, BLUE = (255, 209, 64), (30, 78, 128)


def shows(screen, place, colour):
    x, y = place
    return np.abs(screen.refresh()[y, x].astype(int) - colour).max() < 12


def play_by_hand(screen):
    """Clicks PLAY, lets the ball roll off, and presses Enter: back to the menu."""
    wait_until(lambda: shows(screen, BUTTON, YELLOW), 60)
    screen.click(240, 190)
    wait_until(lambda: shows(screen, PANEL, BLUE))
    screen.press("left")
    wait_until(lambda: not shows(screen, PANEL, BLUE))
    screen.release("left")
    screen.tap("enter")
    wait_until(lambda: shows(screen, BUTTON, YELLOW))


def end(player):
    player.send_signal(signal.SIGINT)
    try:
        assert player.wait(20) == 130
    finally:
        player.kill()  # where a shell has SIGINT ignored, the signal is lost


def test_a_window_takes_mouse_and_keys_and_saves_pictures(tmp_path):
    need_flash()
    pytest.importorskip("pygame", reason="the window needs the extra `dev`")
    swf, display = tmp_path / "game.swf", tmp_path / "rfb"
    swf.write_bytes(MULTITASK)
    with run_tigervnc(*list_socket_options(display)) as environment:
        window = {**environment, "SDL_VIDEODRIVER": "x11", "PYTHONPATH": os.pathsep.join(sys.path)}
        command = [*PLAY[:-1], str(swf)]
        with (
            subprocess.Popen(
                command, env=window, cwd=tmp_path, stdout=subprocess.PIPE, text=True
            ) as player,
            RFBClient(display) as screen,
        ):
            play_by_hand(screen)
            screen.tap("f12")
            assert "saved game-1.png\n" in player.stdout
            end(player)
    assert read_picture(tmp_path / "game-1.png").shape == (360, 480, 3)


def test_a_vnc_viewer_plays_at_the_address_that_is_printed():
    need_flash()
    with subprocess.Popen([*PLAY, "--vnc"], stdout=subprocess.PIPE, text=True) as player:
        address = Path(player.stdout.readline().removeprefix("VNC server: ").strip())
        assert f"xtigervncviewer {address} " in player.stdout.readline()
        assert f"UNIX-CONNECT:{address}\n" in player.stdout.readline()
        with RFBClient(address) as screen:
            play_by_hand(screen)
        end(player)
    assert not address.parent.exists()


def test_a_window_without_a_display_is_refused(monkeypatch, capsys):
    pygame = pytest.importorskip("pygame", reason="the window needs the extra `dev`")
    pygame.display.quit()
    monkeypatch.setenv("SDL_VIDEODRIVER", "nonsense")
    assert main(["flash", "play", "multitask"]) == EXIT_REFUSED
    message = capsys.readouterr().err
    assert "no window can be opened" in message
    assert "or give --vnc and use a VNC viewer" in message


def test_a_window_without_pygame_is_refused(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "pygame", None)
    assert main(["flash", "play", "multitask"]) == EXIT_REFUSED
    assert 'pip install "marl_cair[play]"' in capsys.readouterr().err
