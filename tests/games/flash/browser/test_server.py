"""A Flash game in Chromium: lockstep is exact on both transports; real time is seen over VNC."""

import hashlib
import json
import random
import socket
import time
import zlib
from pathlib import Path

import numpy as np
import pytest

from marl_cair.games.flash.browser.links import read_reply
from marl_cair.games.flash.browser.server import FlashError, FlashServer, KeyEvent, MouseEvent
from marl_cair.lookup import UnknownNameError
from tests.games.flash.browser.flash_files import PROBE, SIZE, need_flash, pack_timeline

FRAME_MS = 1000 / 30


def make_server(**options):
    need_flash()
    server = FlashServer(PROBE, SIZE, 30, **options)
    server.watch("getState")
    return server


@pytest.fixture(scope="module")
def over_bridge():
    with make_server(mode="lockstep") as server:
        yield server


@pytest.fixture(scope="module")
def over_vnc():
    with make_server(mode="lockstep", transport="vnc") as server:
        yield server


@pytest.fixture(scope="module")
def in_real_time():
    with make_server() as server:
        yield server


@pytest.fixture(params=["over_bridge", "over_vnc"])
def server(request):
    return request.getfixturevalue(request.param)


def state(server):
    return server.values["getState"]


EVENTS = [
    [],
    [KeyEvent("left", True)],
    [KeyEvent("left", True), KeyEvent("a", True), KeyEvent("a", False)],
    [MouseEvent(5, 6), MouseEvent(100, 50), MouseEvent(100, 51, True), MouseEvent(0, 0, True)],
    [MouseEvent(479, 359), KeyEvent("left", False), KeyEvent("b", False)],
    [KeyEvent("space", True), MouseEvent(30, 30, True), KeyEvent("space", False)],
    [MouseEvent(30, 30, False), KeyEvent("enter", True), MouseEvent(30, 30)],
    [KeyEvent("enter", False), KeyEvent("f5", True), KeyEvent("f5", False)],
]


def play(server, seed, max_pause_s=0.0):
    """States and pictures of an episode, as one text each."""
    server.reset(seed)
    trace = [json.dumps(server.values)]
    for number in range(len(EVENTS) + 2):
        time.sleep(random.uniform(0, max_pause_s))
        size = SIZE if number % 8 == 5 else (84, 84)
        picture = server.step(1 + number % 3, EVENTS[number % len(EVENTS)], picture=size)
        trace.append(hashlib.sha256(picture.tobytes()).hexdigest() + json.dumps(server.values))
    return trace


def test_one_step_is_one_frame_from_the_first_on(server):
    for _ in range(2):
        server.reset(7)
        assert state(server)["frames"] == 0
        for frame in range(1, 40):
            server.step()
            assert state(server)["frames"] == frame
        server.step(25)
        assert state(server)["frames"] == 64


def test_frames_of_an_old_file_without_scripts_are_counted_too(tmp_path):
    need_flash()
    swf = tmp_path / "timeline.swf"
    swf.write_bytes(pack_timeline(6))
    with FlashServer(swf, SIZE, 60, mode="lockstep") as server:
        for seed in (0, 1):
            server.reset(seed)
            for frame in range(9):
                picture = server.step(min(frame, 1), picture=SIZE)
                assert find_ball(picture) == 40 * (frame % 6) + 19.5


def test_the_clock_stands_still_between_steps(server):
    server.reset(1)
    server.step(9)
    before = state(server)
    time.sleep(0.1)
    server.step(0)
    assert state(server) == before
    assert before["timer"] == int(10 * FRAME_MS)
    server.step(3)
    assert state(server)["timer"] == int(13 * FRAME_MS)
    assert state(server)["date"] - before["date"] == int(13 * FRAME_MS) - int(10 * FRAME_MS)


def test_an_episode_repeats_exactly(server):
    first = play(server, 5)
    assert play(server, 5, max_pause_s=0.03) == first
    assert play(server, 6) != first
    assert play(server, 5) == first


def test_both_transports_give_the_same_states_and_pictures(over_bridge, over_vnc):
    assert play(over_bridge, 2**64 - 1) == play(over_vnc, 2**64 - 1)


@pytest.mark.parametrize("asks", ["late", "with the step", "for each frame"])
def test_a_picture_shows_frames_that_were_not_drawn(server, asks):
    """Frames without a picture are not drawn; a later request shows the last of them."""
    seen = trace_pictures(server, asks)
    assert seen == trace_pictures(server, "for each frame")
    assert len(set(seen)) == len(seen)


def trace_pictures(server, asks):
    """What is seen and reported after each step of an episode."""
    server.reset(5)
    trace = []
    for number, events in enumerate(EVENTS * 2):
        count = 1 + number % 3
        if asks == "late":
            server.step(count, events, picture=None)
            picture = server.step(0, picture=SIZE)
        elif asks == "with the step":
            picture = server.step(count, events, picture=SIZE)
        else:
            for frame in range(count):
                picture = server.step(1, () if frame else events, picture=SIZE)
        trace.append(hashlib.sha256(picture.tobytes()).hexdigest() + json.dumps(server.values))
    return trace


def test_input_reaches_the_game_before_the_frame_in_its_order(server):
    server.reset(0)
    server.step(1)
    server.step(1, [KeyEvent("right", True), MouseEvent(7, 9), MouseEvent(10, 20, True)])
    server.step(1, [MouseEvent(10, 20), KeyEvent("right", False), MouseEvent(1, 2)])
    assert state(server)["log"].split(", ") == [
        "down 39@1",
        *("mouseMove 10 20@1", "mouseDown 10 20@1"),
        *("mouseUp 10 20@2", "click 10 20@2", "up 39@2", "mouseMove 1 2@2"),
    ]


def test_a_held_key_does_not_repeat_and_is_free_after_reset(server):
    server.reset(0)
    for _ in range(3):
        server.step(1, [KeyEvent("x", True)])
    time.sleep(0.7)  # a display repeats keys after 0.66 s
    server.step(1, [MouseEvent(3, 3, True)])
    log = "down 88@0, mouseMove 3 3@3, mouseDown 3 3@3"
    assert state(server)["log"] == log
    server.reset(0)
    assert state(server)["log"] == ""
    server.step(3, [KeyEvent("x", True)])
    server.step(1, [MouseEvent(3, 3, True)])
    assert state(server)["log"] == log


def test_pictures_show_the_game(server):
    server.reset(3)
    picture = server.step(1, [KeyEvent("a", True)], picture=SIZE)
    assert (picture.shape, picture.dtype) == ((360, 480, 3), np.uint8)
    assert picture[5, 5].tolist() == [0, 0xAA, 0]
    assert picture[300, 400].tolist() == [255, 255, 255]
    reds = np.argwhere((picture == [0xCC, 0x22, 0]).all(-1))
    assert 180 <= reds[:, 0].mean() <= 240
    assert reds[:, 1].mean() == pytest.approx(32, abs=0.6)
    assert len(reds) == pytest.approx(np.pi * 25**2, rel=0.1)
    small = server.step(0)
    assert small.shape == (84, 84, 3)
    blocks = picture[:, :480].reshape(6, 60, 6, 80, 3).mean((1, 3))
    assert np.abs(small.reshape(6, 14, 6, 14, 3).mean((1, 3)) - blocks).max() < 6
    assert server.step(0, picture=(100, 30)).shape == (30, 100, 3)
    assert server.step(0, picture=None) is None


def test_the_display_shows_the_picture(over_vnc):
    over_vnc.reset(4)
    with over_vnc.connect(with_cursor=False) as client:
        client.move(0, SIZE[1])  # below the game; now the server leaves out the cursor
        for _ in range(5):
            picture = over_vnc.step(1, picture=SIZE)
            deadline = time.monotonic() + 5
            while (client.refresh()[: SIZE[1]] != picture).any():
                assert time.monotonic() < deadline


@pytest.mark.parametrize(
    "value", [None, True, -1.5, 'text with ü, 語 and "quotes"', [1, [2, {"a": None}]], {}]
)
def test_values_pass_both_ways(server, value):
    assert server.call("echo", value) == value


def test_a_callback_that_is_missing_is_none(server):
    assert server.call("noSuchCallback", 1) is None


def test_steps_of_several_servers_run_at_one_time(over_bridge, over_vnc):
    for each in (over_bridge, over_vnc):
        each.reset(0)
        each.begin_step(30)
        with pytest.raises(ValueError, match="call end_step first"):
            each.step()
    pictures = [each.end_step() for each in (over_bridge, over_vnc)]
    assert (pictures[0] == pictures[1]).all()
    assert state(over_bridge) == state(over_vnc)
    with pytest.raises(ValueError, match="call begin_step first"):
        over_bridge.end_step()


def test_the_game_reaches_no_network_and_no_page(over_bridge):
    over_bridge.reset(0)
    with socket.create_server(("127.0.0.1", 0)) as outside:
        outside.settimeout(0.2)
        address = f"http://127.0.0.1:{outside.getsockname()[1]}/"
        over_bridge.call("fetch", address)
        for name in ("fetch", "open", "location.assign", "eval"):
            assert over_bridge.call("callPage", name, address) is None
        deadline = time.monotonic() + 5
        while "ioError" not in state(over_bridge)["log"]:
            assert time.monotonic() < deadline
            over_bridge.step()
        with pytest.raises(TimeoutError):
            outside.accept()


def test_real_time_runs_by_the_clock(in_real_time):
    first, start = in_real_time.call("getState")["frames"], time.monotonic()
    with in_real_time.connect() as client:
        assert client.frame().shape == (360, 480, 3)
        columns = {find_ball(client.wait_for_update()) for _ in range(30)}
    frames = in_real_time.call("getState")["frames"] - first
    assert len(columns) > 15
    assert frames == pytest.approx(30 * (time.monotonic() - start), rel=0.4)


def find_ball(frame):
    return np.argwhere((frame == [0xCC, 0x22, 0]).all(-1))[:, 1].mean()


def test_real_time_takes_keys_from_any_client(in_real_time):
    in_real_time.reset(0)
    with in_real_time.connect(with_cursor=False) as client, in_real_time.connect() as other:
        other.press("left")
        deadline = time.monotonic() + 5
        while client.wait_for_update()[5, 5].tolist() != [0, 0xAA, 0]:
            assert time.monotonic() < deadline
        other.release("left")
    assert "down 37" in in_real_time.call("getState")["log"]


def test_the_vnc_server_is_private(in_real_time):
    assert in_real_time.address.stat().st_mode & 0o777 == 0o600
    folder = in_real_time.address.parent
    assert folder.stat().st_mode & 0o777 == 0o700
    assert (folder / "xauth").stat().st_mode & 0o777 == 0o600


def test_the_display_lets_nobody_in_without_the_cookie(in_real_time, over_vnc):
    numbers = {each._display["DISPLAY"][1:] for each in (in_real_time, over_vnc)}
    assert len(numbers) == 2
    for number in numbers:
        name = f"/tmp/.X11-unix/X{number}"  # noqa: S108
        # A display of the same number that ends at this moment takes the file away.
        for place in (f"\0{name}", *([name] if Path(name).exists() else [])):
            with socket.socket(socket.AF_UNIX) as client:
                client.connect(place)
                client.sendall(b"l\0\x0b\0" + bytes(8))  # X11, little endian, no authorization
                assert client.recv(1) == b"\0"  # refused


def test_no_tcp_port_is_open(in_real_time, over_bridge):
    ports = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        for line in Path(table).read_text("utf-8").splitlines()[1:]:
            fields = line.split()
            if fields[3] == "0A":  # listens
                ports.add(fields[9])
    for each in (in_real_time, over_bridge):
        for program in each._folder._programs.values():
            assert not ports & set(list_sockets(program.pid))


def list_sockets(process_id):
    """Inodes of the sockets of a process."""
    for path in Path(f"/proc/{process_id}/fd").iterdir():
        name = str(path.readlink())
        if name.startswith("socket:["):
            yield name[8:-1]


def test_no_command_line_holds_the_token(in_real_time):
    token = in_real_time._bridge.address.split("/")[3]
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        try:
            assert token.encode() not in path.read_bytes()
        except OSError:
            continue


def test_real_time_has_no_steps(in_real_time):
    with pytest.raises(ValueError, match='step is for mode="lockstep"'):
        in_real_time.step()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"num_frames": -1}, "num_frames is -1, it must be 0 or more"),
        ({"events": [MouseEvent(480, 0)]}, r"x of MouseEvent\(x=480.* must be from 0 to 479"),
        ({"events": [MouseEvent(0, -1)]}, "y of MouseEvent.* must be from 0 to 359"),
        ({"events": [KeyEvent("lefft", True)]}, "unknown key 'lefft': nearest are 'left'"),
        ({"picture": (0, 84)}, r"picture is \(0, 84\), width and height must be from 1 to 4096"),
    ],
)
def test_wrong_arguments_are_named_and_change_nothing(over_bridge, arguments, message):
    over_bridge.reset(0)
    with pytest.raises((ValueError, UnknownNameError), match=message):
        over_bridge.step(**arguments)
    over_bridge.step()
    assert state(over_bridge)["frames"] == 1


def test_keys_of_the_transport_are_not_the_games(over_vnc):
    for name in ("pause", "scroll_lock"):
        with pytest.raises(ValueError, match=f"takes the key '{name}' itself; use \"bridge\""):
            over_vnc.step(1, [KeyEvent(name, True)])


def test_a_seed_has_64_bits(over_bridge):
    for seed in (-1, 2**64):
        with pytest.raises(ValueError, match=r"it must be from 0 to 2\^64 - 1"):
            over_bridge.reset(seed)


def test_lockstep_over_the_bridge_has_no_display(over_bridge):
    with pytest.raises(ValueError, match="has no display"):
        over_bridge.connect()


def test_a_reply_that_is_not_whole_is_not_read():
    reply = b"a reply"
    head = (
        b"FLSH"
        + (3).to_bytes(4, "little")
        + zlib.adler32(reply).to_bytes(4, "little")
        + bytes([len(reply), 0, 0, 0])
    )
    pixels = np.frombuffer((head + reply).ljust(60, b"\0"), np.uint8).reshape(2, 10, 3).copy()
    assert read_reply(pixels, 3) == reply
    assert read_reply(pixels, 4) is None
    pixels[0, 7, 0] += 1
    assert read_reply(pixels, 3) is None


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"mode": "fast"}, "mode is 'fast', it must be one of 'realtime', 'lockstep'"),
        ({"transport": "tcp"}, "transport is 'tcp', it must be one of 'bridge', 'vnc'"),
        ({"renderer": "gpu"}, "renderer is 'gpu', it must be one of 'canvas', 'webgl'"),
        ({"fps": 0}, "fps is 0, it must be from 1 to 1000"),
        ({"size": (480, 5000)}, "size is .*5000.* must be from 1 to 4096"),
    ],
)
def test_wrong_options_are_named(options, message):
    arguments = {"swf": PROBE, "size": SIZE, "fps": 30, **options}
    with pytest.raises(ValueError, match=message):
        FlashServer(**arguments)


def test_missing_programs_are_listed(monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(FlashError, match=r"missing for Flash games:\nchromium .*apt-get install"):
        FlashServer(PROBE, SIZE, 30)
