"""Real X and VNC servers for tests, skipped when they are not installed."""

import contextlib
import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

IS_NEEDED = os.environ.get("MARL_CAIR_NEEDS_FLASH") == "1"


def need_program(name: str, package: str, *, is_optional: bool = False) -> None:
    if shutil.which(name) is None:
        reason = f"{name} is not installed: apt-get install {package}"
        if IS_NEEDED and not is_optional:
            pytest.fail(reason)
        pytest.skip(reason)


def find_free_port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


@contextlib.contextmanager
def run_program(command: list[str], **options: object) -> Iterator[subprocess.Popen]:
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, **options
    ) as process:
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()


@contextlib.contextmanager
def run_x_server(command: list[str]) -> Iterator[dict[str, str]]:
    """Yields the environment of programs that draw on the server, and its SERVER_PID."""
    reader, writer = os.pipe()
    with run_program([*command, "-displayfd", str(writer)], pass_fds=[writer]) as server:
        os.close(writer)
        with os.fdopen(reader) as numbers:
            number = numbers.readline().strip()
        assert number, f"{command[0]} did not start"
        yield {**os.environ, "DISPLAY": f":{number}", "SERVER_PID": str(server.pid)}
    Path(f"/tmp/.X11-unix/X{number}").unlink(missing_ok=True)  # noqa: S108 (left if it was killed)


@contextlib.contextmanager
def run_tigervnc(*options: str, size: str = "480x360") -> Iterator[dict[str, str]]:
    need_program("Xtigervnc", "tigervnc-standalone-server")
    command = ["Xtigervnc", "-geometry", size, "-depth", "24", "-nolisten", "tcp"]
    settings = ["-AlwaysShared", "-SendCutText=0", "-FrameRate", "1000", "-noreset"]
    with run_x_server([*command, *settings, *options]) as environment:
        yield environment


def list_socket_options(path: Path) -> list[str]:
    """Options of Xtigervnc: a UNIX socket, no TCP port, no password."""
    return ["-rfbport", "-1", "-rfbunixpath", str(path), "-SecurityTypes", "None"]


def wait_until(is_true, limit_s: float = 10.0) -> None:
    deadline = time.monotonic() + limit_s
    while not is_true():
        assert time.monotonic() < deadline, f"not true after {limit_s} s"
        time.sleep(0.02)
