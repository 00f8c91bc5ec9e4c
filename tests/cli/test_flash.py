"""`marl-cair flash`: descriptions of SWF files, what is refused, and games played by hand."""

import lzma
import signal
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest

from marl_cair.cli import EXIT_DONE, EXIT_REFUSED, main
from marl_cair.cli.flash.add import read_header
from marl_cair.games.flash.browser.rfb import RFBClient
from marl_cair.games.flash.description import FOLDER, Region, find_description
from tests.games.flash.browser.flash_files import need_flash
from tests.games.flash.browser.vnc_servers import list_socket_options, run_tigervnc, wait_until

MULTITASK = (FOLDER / "multitask.swf").read_bytes()
PLAIN = b"FWS" + MULTITASK[3:8] + zlib.decompress(MULTITASK[8:])


def pack_lzma(plain):
    packed = lzma.compress(plain[8:], lzma.FORMAT_ALONE)  # 5 bytes of properties, 8 of the size
    return b"ZWS" + plain[3:8] + struct.pack("<I", len(packed) - 13) + packed[:5] + packed[13:]


@pytest.mark.parametrize(
    "data", [MULTITASK, PLAIN, pack_lzma(PLAIN)], ids=["zlib", "plain", "LZMA"]
)
def test_size_and_rate_are_in_the_file(data):
    assert read_header("game.swf", data) == ((480, 360), 30.0)


@pytest.mark.parametrize("data", [b"", b"FWS", b"CWS12345junk", b"ZWS12345junk", b"GIF89a" * 9])
def test_other_files_are_refused_by_name(data):
    with pytest.raises(ValueError, match=r"game\.swf"):
        read_header("game.swf", data)


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


def test_a_game_that_reports_nothing_is_read_from_its_picture(tmp_path, capsys):
    (tmp_path / "over.png").write_bytes(b"")
    done = f"10,10,50,50,{tmp_path / 'over.png'}"
    words = ["--mouse-grid", "8x6", "--reward", "0,0,100,8", "--done", done, "--name", "mouse"]
    assert add(tmp_path, capsys, *words)[0] == EXIT_DONE
    found = find_description(str(tmp_path / "out/mouse.toml"))
    assert (found.keys, found.mouse_grid) == (((),), (8, 6))
    assert found.score == Region(0, 0, 100, 8)
    assert found.done.region == Region(10, 10, 50, 50)


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
    assert not (tmp_path / "out/game.toml").exists()


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
    assert player.wait(20) == 130


def test_a_window_shows_the_game_and_takes_mouse_and_keys(tmp_path):
    need_flash()
    pytest.importorskip("pygame", reason="the window needs the extra `dev`")
    display = tmp_path / "rfb"
    with run_tigervnc(*list_socket_options(display)) as environment:
        window = {**environment, "SDL_VIDEODRIVER": "x11"}
        with subprocess.Popen(PLAY, env=window) as player, RFBClient(display) as screen:
            play_by_hand(screen)
            end(player)


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


@pytest.mark.parametrize("driver", ["offscreen", "dummy", "nonsense"])
def test_a_window_without_a_display_is_refused(driver, monkeypatch, capsys):
    pygame = pytest.importorskip("pygame", reason="the window needs the extra `dev`")
    monkeypatch.setenv("SDL_VIDEODRIVER", driver)
    assert main(["flash", "play", "multitask"]) == EXIT_REFUSED
    assert "there is no display for a window: set DISPLAY" in capsys.readouterr().err
    pygame.display.quit()


def test_a_window_without_pygame_is_refused(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "pygame", None)
    assert main(["flash", "play", "multitask"]) == EXIT_REFUSED
    assert "pip install pygame-ce" in capsys.readouterr().err
