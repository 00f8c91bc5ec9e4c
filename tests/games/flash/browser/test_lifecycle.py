"""Every way in which a Flash game can fail or end: a clear error in time, and nothing is left."""

import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

from marl_cair.files import NotEnoughSpaceError
from marl_cair.games.flash.browser import launching
from marl_cair.games.flash.browser import server as server_module
from marl_cair.games.flash.browser.processes import FlashError, PrivateFolder
from marl_cair.games.flash.browser.server import FlashServer
from tests.games.flash.browser.flash_files import PROBE, SIZE, change_page, need_flash
from tests.games.flash.browser.vnc_servers import wait_until
from tests.processes import ROOT

CHILD = """
import sys, time
from pathlib import Path
from marl_cair.games.flash.browser.server import FlashServer
server = FlashServer(Path(sys.argv[1]), (480, 360), 30, mode="lockstep", transport="vnc")
server.step()
print(server.address.parent, flush=True)
time.sleep(60)
"""


@pytest.fixture
def make_server():
    need_flash()
    servers = []

    def make(swf=PROBE, **options):
        servers.append(FlashServer(swf, SIZE, 30, mode="lockstep", **options))
        return servers[-1]

    yield make
    for server in servers:
        server.close()
        wait_until(lambda folder=server._folder.path: not list_traces(folder))


def test_a_display_whose_file_is_taken_away_is_used(make_server, monkeypatch):
    """As by a display of the same number that ends at this moment."""

    class TakenAway(type(Path())):
        def stat(self, **options):
            self.unlink()
            return super().stat(**options)

    monkeypatch.setattr(launching, "Path", TakenAway)
    server = make_server(transport="vnc")
    assert not (X_SOCKETS / f"X{server._display['DISPLAY'][1:]}").exists()
    assert server.step() is not None


def list_traces(folder):
    """What is left of a server: its folder, its processes, its display's socket."""
    processes = find_processes(folder).values()
    sockets = [path for path in X_SOCKETS.glob("X*") if is_dead(path) and path not in DEAD_BEFORE]
    return [*([folder] if folder.exists() else []), *processes, *sockets]


def is_dead(path):
    """Whether no X server listens at this socket."""
    with socket.socket(socket.AF_UNIX) as client:
        try:
            client.connect(str(path))
        except ConnectionRefusedError:
            return True
        except FileNotFoundError:
            return False
    return False


def find_processes(folder):
    """Process id -> command line of the programs of a folder."""
    found = {}
    for path in Path("/proc").glob("[0-9]*"):
        try:
            command = (path / "cmdline").read_text("utf-8", errors="replace")
        except OSError:
            continue
        if str(folder) in command:
            found[int(path.name)] = command.replace("\0", " ")
    return found


X_SOCKETS = Path("/tmp/.X11-unix")  # noqa: S108
DEAD_BEFORE = {path for path in X_SOCKETS.glob("X*") if is_dead(path)}


def find_process(folder, mark):
    """Id of a program whose command line contains `mark`."""
    marked = [number for number, command in find_processes(folder).items() if mark in command]
    assert marked, mark
    return min(marked)


def test_close_leaves_nothing_and_may_be_repeated(make_server):
    server = make_server(transport="vnc")
    folder = server._folder.path
    assert find_process(folder, "Xtigervnc")
    assert find_process(folder, "--kiosk")
    server.close()
    server.close()
    wait_until(lambda: not list_traces(folder))
    with pytest.raises(FlashError, match="is closed; make another one"):
        server.step()


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGKILL])
def test_nothing_is_left_when_python_is_killed(number):
    need_flash()
    with subprocess.Popen(
        [sys.executable, "-c", CHILD, str(PROBE)],
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    ) as python:
        folder = Path(python.stdout.readline().strip())
        assert find_process(folder, "Xtigervnc")
        os.kill(python.pid, number)
        python.wait(10)
        wait_until(lambda: not list_traces(folder))


def step_often(server):
    for _ in range(1000):
        server.step()


@pytest.mark.parametrize(
    ("transport", "mark", "message"),
    [
        ("bridge", "--headless", r"chromium ended \(SIGKILL\)"),
        ("vnc", "Xtigervnc", r"Xtigervnc ended \(SIGKILL\)|chromium ended"),
        ("vnc", "--type=renderer", "the page crashed"),
    ],
)
def test_a_program_that_is_killed_is_named_at_once(make_server, transport, mark, message):
    server = make_server(transport=transport)
    server.step()
    os.kill(find_process(server._folder.path, mark), signal.SIGKILL)
    start = time.monotonic()
    with pytest.raises(FlashError, match=message):
        step_often(server)
    assert time.monotonic() - start < 10
    with pytest.raises(FlashError, match="is closed"):
        server.reset(0)


def test_a_game_that_runs_forever_is_ended(make_server, monkeypatch):
    monkeypatch.setattr(server_module, "REPLY_LIMIT_S", 1.0)
    server = make_server()
    with pytest.raises(FlashError, match=r"no reply within 1 s: the game runs forever"):
        server.call("runForever")


@pytest.mark.parametrize("transport", ["bridge", "vnc"])
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("return rgb;", "return rgb.subarray(3);", "of 21165 bytes, 21168 were asked for"),
        ("setUint32(0, text.length", "setUint32(0, 1e9", "cannot be read"),
        ("return reply;", "return new Uint8Array(3);", "cannot be read"),
        ("answer.values =", "answer.other =", r"cannot be read \(KeyError\('values'\)"),
    ],
)
def test_a_reply_that_is_none_ends_the_server(
    make_server, tmp_path, monkeypatch, transport, old, new, message
):
    change_page(tmp_path, monkeypatch, old, new)
    with pytest.raises(FlashError, match=message):
        make_server(transport=transport).step()


def test_a_step_that_is_interrupted_ends_the_server(make_server):
    server = make_server()

    def interrupt(*_):
        raise KeyboardInterrupt

    previous = signal.signal(signal.SIGALRM, interrupt)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.3)
        with pytest.raises(KeyboardInterrupt):
            server.step(100_000)
    finally:
        signal.signal(signal.SIGALRM, previous)
    with pytest.raises(FlashError, match="is closed"):  # else it would return that step's picture
        server.step()


@pytest.mark.parametrize("transport", ["bridge", "vnc"])
def test_a_broken_flash_file_is_refused_with_ruffles_words(make_server, tmp_path, transport):
    swf = tmp_path / "broken.swf"
    swf.write_bytes(PROBE.read_bytes()[:40])
    start = time.monotonic()
    with pytest.raises(FlashError, match=r"the game failed: .*"):
        make_server(swf, transport=transport)
    assert time.monotonic() - start < 30


def test_what_is_no_flash_file_is_refused(tmp_path):
    need_flash()
    swf = tmp_path / "page.swf"
    swf.write_text("<html>", "utf-8")
    with pytest.raises(ValueError, match="begins with b'<ht', not FWS, CWS or ZWS"):
        FlashServer(swf, SIZE, 30)
    with pytest.raises(FileNotFoundError, match=r"missing.swf"):
        FlashServer(tmp_path / "missing.swf", SIZE, 30)


def put_in_place(program, script, monkeypatch):
    """A shell script that is found in place of the installed program of its name."""
    program.write_text(f"#!/bin/sh\n{script}\n", "utf-8")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", f"{program.parent}:{os.environ['PATH']}")


def test_a_browser_that_does_not_start_is_named_with_its_words(tmp_path, monkeypatch):
    need_flash()
    put_in_place(tmp_path / "chromium", "echo No usable sandbox >&2; exit 3", monkeypatch)
    with pytest.raises(FlashError, match=r"chromium ended \(exit status 3\).\n.*\nNo usable sand"):
        FlashServer(PROBE, SIZE, 30, mode="lockstep")


def test_a_browser_that_shows_no_page_is_a_timeout(tmp_path, monkeypatch):
    need_flash()
    put_in_place(tmp_path / "chromium", "exec sleep 60", monkeypatch)
    monkeypatch.setattr(server_module, "START_LIMIT_S", 0.3)
    with pytest.raises(FlashError, match=r"the page was not ready within 0.3 s"):
        FlashServer(PROBE, SIZE, 30, mode="lockstep")


def test_a_display_that_does_not_start_is_named_with_its_words(tmp_path, monkeypatch):
    need_flash()
    put_in_place(tmp_path / "Xtigervnc", "echo Server is already active; exit 1", monkeypatch)
    with pytest.raises(FlashError, match=r"Xtigervnc ended \(exit status 1\).\n.*\nServer is alr"):
        FlashServer(PROBE, SIZE, 30)


@pytest.fixture
def full_disk(monkeypatch):
    """A disk of 100 MB for the folders of servers, and a function that fills it."""
    with tempfile.TemporaryDirectory(prefix="disk-") as folder:
        command = ["mount", "-t", "tmpfs", "-o", "size=100m", "flash", folder]
        if subprocess.run(command, capture_output=True, check=False).returncode != 0:
            pytest.skip("mounting a small disk needs root")
        monkeypatch.setattr("tempfile.tempdir", folder)

        def fill():
            with Path(folder, "filling").open("wb") as file:
                os.posix_fallocate(file.fileno(), 0, shutil.disk_usage(folder).free)

        yield fill
        subprocess.run(["umount", folder], check=True)


def test_a_disk_that_is_full_stops_no_game_but_the_next_start(full_disk, make_server, monkeypatch):
    server = make_server(transport="vnc")
    full_disk()
    for seed in range(2):
        server.reset(seed)
        assert server.step(10, picture=SIZE).shape == (360, 480, 3)
    with pytest.raises(NotEnoughSpaceError, match=r"needs 64\S* MiB, but its disk has .* free"):
        make_server()
    monkeypatch.setattr("marl_cair.games.flash.browser.processes._MIN_FREE", 0)  # full a bit later
    for transport, name in (("bridge", "start.html"), ("vnc", "xauth")):
        with pytest.raises(
            NotEnoughSpaceError, match=f"{name} could not be written, the disk is f"
        ):
            make_server(transport=transport)
    server.step()
    assert len(list(server._folder.path.parent.glob("flash-*"))) == 1


def test_a_path_that_is_too_long_for_sockets_is_named(monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", "/tmp/" + "long/" * 20)  # noqa: S108
    with pytest.raises(OSError, match=r"has 104 characters, at most 60 .* Set TMPDIR to a shorter"):
        PrivateFolder()


def start_sleep(folder, name="sleeper"):
    # A program that ignores SIGTERM, and one of its own beside it.
    script = f"trap '' TERM; sleep 61 & echo {folder.path}; sleep 60"
    command = ["sh", "-c", script]
    return folder.start(name, command, end_by="TERM", environment=folder.environment())


def test_programs_that_do_not_end_are_killed():
    with PrivateFolder() as folder:
        program = start_sleep(folder)
        wait_until((folder.path / "sleeper.log").read_text)
    wait_until(lambda: not Path(f"/proc/{program}").exists())
    assert not folder.path.exists()


def test_a_watcher_that_is_killed_is_named_and_replaced_at_the_end():
    folder = PrivateFolder()
    program = start_sleep(folder)
    folder._watcher.kill()
    folder._watcher.wait()
    with pytest.raises(FlashError, match="the process that watches over .* was killed"):
        start_sleep(folder, "another")
    folder.close()
    assert not folder.path.exists()
    assert not Path(f"/proc/{program}").exists()


def test_files_that_a_program_leaves_go_too_but_not_anothers(tmp_path):
    for name in ("left", "anothers", "later"):
        (tmp_path / name).touch()
    status = (tmp_path / "left").stat()
    os.utime(tmp_path / "later", (0, 0))  # its inode was used again
    keys = {
        "left": f"{status.st_ino}.{int(status.st_mtime)}",
        "later": f"{(tmp_path / 'later').stat().st_ino}.{int(status.st_mtime)}",
    }
    with PrivateFolder() as folder:
        folder.inform_watcher(f"FILE {keys['left']} {tmp_path / 'left'}")
        folder.inform_watcher(f"FILE {keys['left']} {tmp_path / 'anothers'}")
        folder.inform_watcher(f"FILE {keys['left']} {tmp_path / 'missing'}")
        folder.inform_watcher(f"FILE {keys['later']} {tmp_path / 'later'}")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["anothers", "later"]
