"""VNC (RFB) client: frames as NumPy arrays, keys and mouse, over TCP or a UNIX socket."""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
import time
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.flash.browser.keys import find_key
from marl_cair.games.flash.browser.rfb_messages import Conversation, RFBError, encode_password
from marl_cair.lookup import find_by_name

__all__ = ["BUTTONS", "RFBClient", "RFBError"]

MAX_TIMEOUT_S = 3600
BUTTONS = {"left": 1, "middle": 2, "right": 4}


class RFBClient:
    """A client of one VNC server, shared by any number of threads.

    It connects, logs in and receives a first frame when it is made. It has no thread of its own:
    frames are received in the calls that wait for them. Input is sent at once, in the order of
    the calls, while other threads wait for frames.

    address: the path of a UNIX socket, or host and port.
    password: used if the server asks for one, which needs the package `cryptography`. VNC ignores
        all after 8 characters.
    timeout_s: the limit of making the client, and of each later call that has none of its own.
    with_cursor: False asks the server to keep the mouse cursor out of the frame. TigerVNC does so
        while the mouse is where this client moved it: move it once, to any place.

    Raises RFBError (refused, closed, protocol; then the client is of no use), and TimeoutError.
    """

    def __init__(
        self,
        address: Path | tuple[str, int],
        password: str | None = None,
        *,
        timeout_s: float = 5.0,
        with_cursor: bool = True,
    ) -> None:
        self.address = address
        self._timeout_s = _check_timeout(timeout_s)
        key = None if password is None else encode_password(password)
        self._server = Conversation(address, self._send, key, with_cursor=with_cursor)
        self._messages, self._wanted = self._server.listen(), memoryview(b"")
        # Taken in this order. Reentrant: a signal handler may close a client that is waiting.
        self._receiving, self._sending = threading.RLock(), threading.RLock()
        self._ended_by = ""  # why the connection is no longer usable
        self._pointer, self._buttons = (0, 0), 0
        deadline = time.monotonic() + timeout_s
        self._socket = _connect(address, timeout_s)
        self._sender = self._socket.dup()  # has a time-out of its own
        try:
            while not self._server.num_updates:
                self._receive(deadline, timeout_s)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the connection. Calls that wait in other threads raise RFBError."""
        self._end("the client is closed")
        with self._receiving, self._sending:  # all waits have ended
            self._socket.close()
            self._sender.close()

    @property
    def width(self) -> int:
        """Columns of the newest frame."""
        return len(self._server.frame[0])

    @property
    def height(self) -> int:
        """Rows of the newest frame."""
        return len(self._server.frame)

    def frame(self) -> NDArray[np.uint8]:
        """A copy of the newest frame that was received, RGB [H, W, 3]. Never waits."""
        return self._server.frame.copy()

    def wait_for_update(self, timeout_s: float | None = None) -> NDArray[np.uint8]:
        """The frame [H, W, 3] after the next update: after the next change of a pixel or the size.

        Raises TimeoutError if nothing changes; a change after that is for the next call.
        """
        return self._update(timeout_s, is_full=False)

    def refresh(self, timeout_s: float | None = None) -> NDArray[np.uint8]:
        """The frame [H, W, 3] as it is now, changed or not: the server sends all of it again."""
        return self._update(timeout_s, is_full=True)

    def send_key(self, name: str, is_down: bool) -> None:
        """Press or release a key of `keys.py`. Raises UnknownNameError with the nearest names."""
        self._send(_pack_key(name, is_down))

    def press(self, name: str) -> None:
        """Press a key and hold it."""
        self._send(_pack_key(name, True))

    def release(self, name: str) -> None:
        """Release a key."""
        self._send(_pack_key(name, False))

    def tap(self, name: str) -> None:
        """Press and release a key, without a pause."""
        self._send(_pack_key(name, True) + _pack_key(name, False))

    def move(self, x: int, y: int) -> None:
        """Move the mouse; before, it is at (0, 0). Raises ValueError outside the frame."""
        self._send_mouse((x, y), [(0, 0)])

    def mouse_down(self, button: str = "left") -> None:
        """Press "left", "middle" or "right" where the mouse is, and hold it."""
        self._send_mouse(None, [(find_by_name("mouse button", button, BUTTONS), 0)])

    def mouse_up(self, button: str = "left") -> None:
        """Release a button where the mouse is."""
        self._send_mouse(None, [(0, find_by_name("mouse button", button, BUTTONS))])

    def click(self, x: int, y: int, button: str = "left") -> None:
        """Move the mouse, press and release, without a pause."""
        bit = find_by_name("mouse button", button, BUTTONS)
        self._send_mouse((x, y), [(0, 0), (bit, 0), (0, bit)])

    def _send_mouse(self, place: tuple[int, int] | None, changes: list[tuple[int, int]]) -> None:
        """Send a pointer event for each (buttons pressed, buttons released)."""
        for axis, value, size in zip("xy", place or (), (self.width, self.height), strict=False):
            if not 0 <= value < size:
                raise ValueError(f"{axis} is {value}, it must be from 0 to {size - 1}")
        with self._sending:
            self._pointer = self._pointer if place is None else (int(place[0]), int(place[1]))
            events = b""
            for pressed, released in changes:
                self._buttons = (self._buttons | pressed) & ~released
                events += struct.pack(">BBHH", 5, self._buttons, *self._pointer)
            self._send(events)

    def _send(self, data: bytes) -> None:
        with self._sending:
            self._check_open()
            try:
                self._sender.settimeout(self._timeout_s)
                self._sender.sendall(data)
            except BaseException as error:
                self._end_by(error)
                raise

    def _update(self, timeout_s: float | None, is_full: bool) -> NDArray[np.uint8]:
        limit = self._timeout_s if timeout_s is None else _check_timeout(timeout_s)
        deadline, seen = time.monotonic() + limit, self._server.num_updates
        if not self._receiving.acquire(timeout=limit):
            raise TimeoutError(f"other threads waited for frames all the {limit:g} s")
        try:
            self._check_open()
            if is_full:
                seen = self._server.num_updates
                self._server.request(is_full=True)
            elif not self._server.is_requested:
                self._server.request()
            while self._server.num_updates == seen:
                self._receive(deadline, limit)
            return self.frame()
        finally:
            self._receiving.release()

    def _receive(self, deadline: float, limit: float) -> None:
        """Receive what is wanted next, then read it. After TimeoutError a later call continues."""
        self._check_open()
        while self._wanted:
            remaining = deadline - time.monotonic()
            if remaining <= 0:
                raise TimeoutError(f"no {self._server.awaited} from {self.address} in {limit:g} s")
            try:
                self._socket.settimeout(remaining)
                num_bytes = self._socket.recv_into(self._wanted)
                self._wanted = self._wanted[num_bytes:]
            except TimeoutError:
                continue
            except BaseException as error:
                self._end_by(error)
                raise
            if num_bytes == 0:
                self._end(f"{self.address} closed the connection: no {self._server.awaited}")
                self._check_open()
        try:
            self._wanted = next(self._messages)
        except BaseException as error:
            self._end_by(error)
            raise

    def _check_open(self) -> None:
        if self._ended_by:
            raise RFBError(self._ended_by)

    def _end(self, reason: str) -> None:
        self._ended_by = self._ended_by or reason
        with contextlib.suppress(OSError):  # not connected any more
            self._socket.shutdown(socket.SHUT_RDWR)

    def _end_by(self, error: BaseException) -> None:
        """End the connection, because a message is half sent or half read.

        Raises the error with its cause for errors of the socket.
        """
        reason = str(error) or f"the client was interrupted by {type(error).__name__}"
        if isinstance(error, TimeoutError):
            reason = f"{self.address} took no message in {self._timeout_s:g} s: the client gave up"
        self._end(reason)
        if isinstance(error, TimeoutError):
            raise TimeoutError(reason) from error
        if isinstance(error, OSError) and not isinstance(error, RFBError):
            raise RFBError(f"the connection to {self.address} ended: {self._ended_by}") from error


def _pack_key(name: str, is_down: bool) -> bytes:
    return struct.pack(">BBxxI", 4, is_down, find_key(name).keysym)


def _check_timeout(timeout_s: float) -> float:
    if not 0 < timeout_s <= MAX_TIMEOUT_S:
        raise ValueError(f"timeout_s is {timeout_s}, it must be above 0, at most {MAX_TIMEOUT_S}")
    return timeout_s


def _connect(address: Path | tuple[str, int], timeout_s: float) -> socket.socket:
    try:
        if isinstance(address, tuple):
            connection = socket.create_connection(address, timeout_s)
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return connection
        with contextlib.ExitStack() as closed_on_error:
            connection = closed_on_error.enter_context(socket.socket(socket.AF_UNIX))
            connection.settimeout(timeout_s)
            connection.connect(str(address))
            closed_on_error.pop_all()
            return connection
    except TimeoutError:
        raise TimeoutError(f"no connection to {address} in {timeout_s:g} s") from None
    except (OSError, OverflowError) as error:
        raise RFBError(f"no connection to {address}: {error}") from error
