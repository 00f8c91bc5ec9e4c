"""`marl-cair flash`: what it writes for a SWF, and what it refuses."""

import lzma
import struct
import zlib

import pytest

from marl_cair.cli import EXIT_DONE, EXIT_REFUSED, main
from marl_cair.cli.flash.add import read_header
from marl_cair.games.flash.description import FOLDER, Region, find_description

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
