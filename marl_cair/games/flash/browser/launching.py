"""Starts the virtual display and the browser of a Flash game in its private folder."""

from __future__ import annotations

import contextlib
import os
import secrets
import select
import struct
from pathlib import Path
from typing import Literal, NamedTuple

from marl_cair.files import write_atomically
from marl_cair.games.flash.browser.installing import diagnose, find_browser
from marl_cair.games.flash.browser.processes import FlashError, PrivateFolder

Renderer = Literal["canvas", "webgl"]
VNC_SOCKET = "rfb.sock"  # in the private folder
_DISPLAY_LIMIT_S = 20.0

_CHROMIUM = (
    *("--disable-gpu", "--force-device-scale-factor=1", "--force-color-profile=srgb"),
    *("--no-first-run", "--no-default-browser-check", "--disable-component-update"),
    *("--disable-background-networking", "--disable-sync", "--disable-extensions"),
    *("--disable-quic", "--force-webrtc-ip-handling-policy=disable_non_proxied_udp"),
    *("--disable-backgrounding-occluded-windows", "--disable-renderer-backgrounding"),
    *("--disable-background-timer-throttling", "--autoplay-policy=no-user-gesture-required"),
    *("--mute-audio", "--disable-dev-shm-usage", "--disable-breakpad", "--lang=en-US"),
    *("--password-store=basic", "--disk-cache-size=1", "--window-position=0,0"),
)
# It keeps its abstract socket (no `-nolisten local`): by that other X servers see that this number
# is taken. Without it they would take over its other socket.
_DISPLAY = (
    *("-depth", "24", "-noreset", "-s", "0", "-nolisten", "tcp"),
    *("-rfbport", "-1", "-rfbunixmode", "384", "-SecurityTypes", "None", "-AlwaysShared"),
    *("-FrameRate", "1000", "-SendCutText=0", "-AcceptCutText=0", "-AcceptSetDesktopSize=0"),
)


def check_programs(needs_display: bool) -> None:
    """Raise FlashError that lists what is missing."""
    missing = diagnose(needs_display)
    if missing:
        lines = [f"{part.name} ({part.purpose}): {part.command}" for part in missing]
        raise FlashError("missing for Flash games:\n" + "\n".join(lines))


class Window(NamedTuple):
    """What the browser's window shows. Units: pixels."""

    width: int
    height: int
    renderer: Renderer
    is_in_band: bool  # lockstep over VNC: frames come when they are ready, held keys do not repeat


def start_display(folder: PrivateFolder, window: Window) -> dict[str, str]:
    """Start Xtigervnc, with a VNC server on a UNIX socket and no TCP port. Returns the environment
    variables of its clients.
    """
    authority = folder.path / "xauth"
    write_atomically(authority, _pack_cookie())  # first: without it the display is open to all
    authority.chmod(0o600)
    read_end, write_end = os.pipe()
    command = ["Xtigervnc", "-displayfd", str(write_end)]
    command += ["-geometry", f"{window.width}x{window.height}"]
    command += [*_DISPLAY, "-rfbunixpath", str(folder.path / VNC_SOCKET), "-auth", str(authority)]
    if window.is_in_band:
        command.append("-r")
    try:
        # TERM, so that it removes its lock and its socket.
        folder.start(
            "Xtigervnc",
            command,
            end_by="TERM",
            environment=folder.environment(),
            pass_fds=[write_end],
        )
    finally:
        os.close(write_end)
    with os.fdopen(read_end, "rb") as numbers:
        if not select.select([numbers], [], [], _DISPLAY_LIMIT_S)[0]:
            raise FlashError(f"Xtigervnc was not ready within {_DISPLAY_LIMIT_S:g} s")
        display = numbers.readline().decode().strip()
    if not display:
        folder.wait_for_end("Xtigervnc")
    x_socket = Path(f"/tmp/.X11-unix/X{display}")  # noqa: S108 (X servers put it there)
    # A display of the same number that ends at this moment takes it away; clients connect without.
    with contextlib.suppress(FileNotFoundError):
        status = x_socket.stat()
        folder.inform_watcher(f"FILE {status.st_ino}.{int(status.st_mtime)} {x_socket}")
    return {"DISPLAY": f":{display}", "XAUTHORITY": str(authority)}


def _pack_cookie() -> bytes:
    """An Xauthority entry with a random key, for every display of every host (FamilyWild)."""
    fields = [b"", b"", b"MIT-MAGIC-COOKIE-1", secrets.token_bytes(16)]  # address, display, ...
    packed = b"".join(struct.pack(">H", len(field)) + field for field in fields)
    return struct.pack(">H", 0xFFFF) + packed


def start_browser(
    folder: PrivateFolder, address: str, window: Window, display: dict[str, str] | None
) -> None:
    """Start Chromium with one page, and no network but the page's own server.

    display: variables of the display; None: it runs without one.
    """
    # The address holds a token, and all users can read command lines: a file forwards to it.
    start = folder.path / "start.html"
    refresh = address.replace("&", "&amp;")
    write_atomically(start, f'<meta http-equiv="refresh" content="0;url={refresh}">')
    server = address.split("/")[2]
    command = [str(find_browser()), *_CHROMIUM, f"--user-data-dir={folder.path}/profile"]
    command.append(f"--host-resolver-rules=MAP 127.0.0.1 {server},MAP * ~NOTFOUND")
    if os.geteuid() == 0:
        command.append("--no-sandbox")  # Chromium has none for root
    if window.renderer == "webgl":
        command.append("--enable-unsafe-swiftshader")
    if window.is_in_band:
        command += ["--disable-frame-rate-limit", "--disable-gpu-vsync"]
    # Without a window manager the page is one pixel smaller than the window.
    command.append(f"--window-size={window.width + 1},{window.height + 1}")
    if display is None:
        command += ["--headless", start.as_uri()]
    else:
        command += ["--kiosk", f"--app={start.as_uri()}"]
    environment = {**folder.environment(), **(display or {})}
    folder.start("chromium", command, end_by="KILL", environment=environment)
