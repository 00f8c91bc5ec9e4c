"""The VNC client with Xtigervnc and x11vnc: its frames equal those of X and of other clients."""

import asyncio
import contextlib
import ctypes
import ctypes.util
import os
import signal
import subprocess
import sys
import threading
import time

import asyncvnc
import numpy as np
import pytest
from PIL import Image

from marl_cair.games.flash.browser.rfb import RFBClient, RFBError
from tests.games.flash.browser.vnc_servers import (
    find_free_port,
    list_socket_options,
    need_program,
    run_program,
    run_tigervnc,
    run_x_server,
    wait_until,
)

WIDTH, HEIGHT = 480, 360
PASSWORD = "right one"  # noqa: S105


def run(environment, *command, **options):
    return subprocess.run(command, env=environment, check=True, capture_output=True, **options)


def draw_noise(environment, folder, seed=0, colour="#3070c0"):
    """Fill the screen with random pixels of two colours, and give it a cursor."""
    need_program("xsetroot", "x11-xserver-utils", is_optional=True)
    bits = np.random.default_rng(seed).integers(0, 256, WIDTH * HEIGHT // 8)
    rows = ",".join(map(hex, bits))
    sizes = f"#define n_width {WIDTH}\n#define n_height {HEIGHT}\n"
    (folder / "noise").write_text(f"{sizes}static unsigned char n_bits[] = {{\n{rows}}};\n")
    run(environment, "xsetroot", "-cursor_name", "left_ptr")
    run(environment, "xsetroot", "-bitmap", folder / "noise", "-fg", colour, "-bg", "#e0a010")


def read_screen(environment):
    """The picture [H, W, 3] of the X server, without a cursor."""
    need_program("xwd", "x11-apps", is_optional=True)
    dump = run(environment, "xwd", "-root", "-silent").stdout
    header = np.frombuffer(dump[:100], ">u4")
    width, height, num_colours = header[4], header[5], header[19]
    assert header[11] == 32
    pixels = np.frombuffer(dump[header[0] + 12 * num_colours :], np.uint8)
    return pixels.reshape(height, width, 4)[..., 2::-1]


@pytest.fixture
def tigervnc(tmp_path):
    """The environment of X programs, and the address."""
    address = tmp_path / "rfb"
    with run_tigervnc(*list_socket_options(address)) as environment:
        draw_noise(environment, tmp_path)
        yield environment, address


def test_frames_equal_those_of_the_x_server(tigervnc, tmp_path):
    environment, address = tigervnc
    with RFBClient(address, with_cursor=False) as client:
        client.move(3, 4)
        screen = read_screen(environment)
        assert len(np.unique(screen.reshape(-1, 3), axis=0)) == 2
        np.testing.assert_array_equal(client.refresh(), screen)
        for seed in range(5):
            draw_noise(environment, tmp_path, seed, colour=f"#{seed}0{seed}0ff")
            wait_for_frame(client, read_screen(environment))


def test_cursor_is_in_the_frame_or_not(tigervnc):
    environment, address = tigervnc
    screen = read_screen(environment)
    with RFBClient(address, with_cursor=False) as bare, RFBClient(address) as client:
        bare.move(200, 100)
        time.sleep(1.2)  # after a second TigerVNC paints the cursor of a pointer that others moved
        np.testing.assert_array_equal(bare.refresh(), screen)
        differs = (client.refresh() != screen).any(-1)
        assert 50 < differs.sum() < 600
        assert not np.delete(differs, slice(90, 130), 0).any()


def test_areas_that_x_copies(tigervnc):
    environment, address = tigervnc
    x11 = ctypes.CDLL(ctypes.util.find_library("X11"))
    for function in (x11.XOpenDisplay, x11.XDefaultRootWindow, x11.XDefaultGC):
        function.restype = ctypes.c_void_p
    display = ctypes.c_void_p(x11.XOpenDisplay(environment["DISPLAY"].encode()))
    root = ctypes.c_void_p(x11.XDefaultRootWindow(display))
    context = ctypes.c_void_p(x11.XDefaultGC(display, 0))
    with RFBClient(address, with_cursor=False) as client:
        client.move(479, 359)
        client.refresh()
        for x, y in ((10, 7), (0, 30), (200, 100)):
            x11.XCopyArea(display, root, root, context, 5, 5, 250, 200, x, y)
            x11.XSync(display, 0)
            wait_for_frame(client, read_screen(environment))
    x11.XCloseDisplay(display)


def test_the_screen_changes_its_size(tigervnc):
    need_program("xrandr", "x11-xserver-utils", is_optional=True)
    environment, address = tigervnc
    with RFBClient(address, with_cursor=False) as client:
        client.move(1, 1)
        run(environment, "xrandr", "-s", "640x480")
        wait_until(lambda: client.wait_for_update().shape == (480, 640, 3))
        np.testing.assert_array_equal(client.refresh(), read_screen(environment))


def test_frames_equal_those_of_asyncvnc(tigervnc):
    async def capture():
        reader, writer = await asyncio.open_unix_connection(str(tigervnc[1]))
        client = await asyncvnc.Client.create(reader, writer)
        pixels = await client.screenshot()
        writer.close()
        return pixels[..., :3]

    with RFBClient(tigervnc[1]) as client:
        np.testing.assert_array_equal(client.refresh(), asyncio.run(capture()))


def test_frames_equal_those_of_vncdotool(tigervnc, tmp_path):
    command = [
        sys.executable,
        "-m",
        "vncdotool.command",
        "--server",
        tigervnc[1],
        "capture",
        "a.png",
    ]
    subprocess.run(command, cwd=tmp_path, check=True, timeout=30)
    with RFBClient(tigervnc[1]) as client, Image.open(tmp_path / "a.png") as picture:
        np.testing.assert_array_equal(client.refresh(), np.asarray(picture.convert("RGB")))


def test_frames_of_x11vnc(tmp_path):
    for name, package in (("Xvfb", "xvfb"), ("x11vnc", "x11vnc")):
        need_program(name, package, is_optional=True)
    screen = f"{WIDTH}x{HEIGHT}x24"
    port = find_free_port()
    options = ["-localhost", "-rfbport", str(port), "-forever", "-shared", "-nopw", "-quiet"]
    with run_x_server(["Xvfb", "-screen", "0", screen]) as environment:
        draw_noise(environment, tmp_path)
        with (
            run_program(["x11vnc", *options], env=environment),
            connect_when_ready(port) as client,
        ):
            client.move(0, 0)
            wait_for_frame(client, read_screen(environment))
            draw_noise(environment, tmp_path, seed=1)
            wait_for_frame(client, read_screen(environment))


def wait_for_frame(client, expected):
    wait_until(
        lambda: (
            np.array_equal(client.frame(), expected)
            or np.array_equal(client.wait_for_update(), expected)
        )
    )


def connect_when_ready(port, **options):
    clients = []

    def connect():
        with contextlib.suppress(RFBError):
            clients.append(RFBClient(("127.0.0.1", port), with_cursor=False, **options))
        return clients

    wait_until(connect, 30)
    return clients[0]


def test_passwords(tmp_path):
    need_program("vncpasswd", "tigervnc-tools")
    (tmp_path / "key").write_bytes(
        subprocess.run(["vncpasswd", "-f"], input=PASSWORD.encode(), stdout=-1, check=True).stdout
    )
    port = find_free_port()
    options = ["-localhost", "-rfbport", str(port), "-SecurityTypes", "VncAuth"]
    with run_tigervnc(*options, "-PasswordFile", str(tmp_path / "key")) as environment:
        draw_noise(environment, tmp_path)
        with connect_when_ready(port, password=PASSWORD) as client:
            client.move(1, 1)
            np.testing.assert_array_equal(client.refresh(), read_screen(environment))
        with pytest.raises(RFBError, match="refused the log-in: '.*(fail|incorrect)"):
            RFBClient(("127.0.0.1", port), password=PASSWORD[::-1])
        with pytest.raises(RFBError, match=r"offers the security types \[2\]: without a password"):
            RFBClient(("127.0.0.1", port))


def test_threads_share_a_client(tigervnc, tmp_path):
    environment, address = tigervnc
    errors, is_done = [], threading.Event()

    def work(call):
        while not is_done.is_set():
            try:
                call()
            except TimeoutError:
                pass
            except Exception as error:  # noqa: BLE001 (whatever a race raises)
                errors.append(error)
                return

    with RFBClient(address, with_cursor=False) as client:
        calls = [client.refresh, lambda: client.wait_for_update(0.05), client.frame]
        calls += [lambda: client.tap("a"), lambda: client.click(5, 6)]
        threads = [threading.Thread(target=work, args=[call]) for call in calls]
        for thread in threads:
            thread.start()
        for seed in range(5):
            draw_noise(environment, tmp_path, seed)
        is_done.set()
        for thread in threads:
            thread.join(10)
        assert errors == []
        np.testing.assert_array_equal(client.refresh(), read_screen(environment))


def test_a_server_that_is_killed(tmp_path):
    address = tmp_path / "rfb"
    with (
        run_tigervnc(*list_socket_options(address)) as environment,
        RFBClient(address) as client,
    ):
        os.kill(int(environment["SERVER_PID"]), signal.SIGKILL)
        with pytest.raises(RFBError, match="rfb (closed the connection|ended)"):
            client.refresh()
        with pytest.raises(RFBError):
            RFBClient(address)
