"""RFB (VNC) messages of a server: log-in, frame updates, checks of sizes; no sockets."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Generator
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAX_PIXELS = 2**24  # of a frame, which with all that is kept beside it takes 200 MB
MAX_TEXT_BYTES = 2**20  # of a name, a reason or a clipboard
MAX_CURSOR_SIDE = 1024

NO_SECURITY, VNC_AUTH = 1, 2
RAW, COPY_RECT, DESKTOP_SIZE, CURSOR = 0, 1, -223, -239
# 32 bits, true colour: on the wire a pixel is the bytes red, green, blue, unused.
PIXEL_FORMAT = struct.pack(">BBBBHHHBBB3x", 32, 24, 0, 1, 255, 255, 255, 0, 8, 16)

# Yields buffers to fill with what the server sends next. A message that a time-out interrupts
# thus continues in the next call.
Listening = Generator[memoryview, None, None]


class RFBError(ConnectionError):
    """The server refused, closed the connection or broke the protocol; the client is of no use."""


class Conversation:
    """What a server sends, and the client's answers to it.

    address: for errors.
    send: takes the client's messages.
    password: None, or what `encode_password` returns.
    with_cursor: False asks the server to keep the mouse cursor out of the frame.
    """

    def __init__(
        self,
        address: object,
        send: Callable[[bytes], None],
        password: bytes | None,
        *,
        with_cursor: bool,
    ) -> None:
        self.address, self._send = address, send
        self._password, self._with_cursor = password, with_cursor
        self.awaited = "greeting"  # for errors of time
        # The last complete one. It is replaced, never written to: any thread may copy it.
        self.frame: NDArray[np.uint8] = np.zeros((0, 0, 3), np.uint8)
        self.num_updates = 0  # frames since the log-in
        self.is_requested = False  # an update that has not come yet

    def request(self, *, is_full: bool = False) -> None:
        """Request the changes; or everything, also while something is not known."""
        self.is_requested = True
        if is_full:
            self._unknown[:], self._is_whole = True, False
        height, width = self._unknown.shape
        self._send(struct.pack(">BBHHHH", 3, self._is_whole, 0, 0, width, height))

    def listen(self) -> Listening:
        """Read all that the server sends, from its first byte. Raises RFBError."""
        yield from self._log_in()
        self.awaited = "update"
        self.request()
        while True:
            (kind,) = yield from _read(">B")
            if kind == 0:
                yield from self._read_update()
            elif kind == 1:  # colours of a palette
                (num_colours,) = yield from _read(">3xH")
                yield memoryview(bytearray(6 * num_colours))
            elif kind == 3:  # clipboard
                yield from _read(">3x")
                yield from _read_text("clipboard")
            elif kind != 2:  # bell
                raise RFBError(f"unknown message {kind} from {self.address}, known are 0 to 3")

    def _log_in(self) -> Listening:
        minor = yield from self._agree_on_version()
        self.awaited = "answer to the log-in"
        if minor == 3:
            (kind,) = yield from _read(">I")
            offered = [kind] if kind else []
        else:
            (num_kinds,) = yield from _read(">B")
            offered = list((yield from _read(f">{num_kinds}B")))
        if not offered:
            reason = yield from _read_text("reason")
            raise RFBError(f"{self.address} refused the connection: {reason!r}")
        chosen = VNC_AUTH if self._password is not None and VNC_AUTH in offered else NO_SECURITY
        if chosen not in offered:
            raise RFBError(
                f"{self.address} offers the security types {offered}: without a password it "
                f"must offer {NO_SECURITY} (none), with one also {VNC_AUTH} (VncAuth) will do"
            )
        if minor > 3:
            self._send(bytes([chosen]))
        if self._password is not None and chosen == VNC_AUTH:
            (challenge,) = yield from _read(">16s")
            self._send(_encrypt(challenge, self._password))
        if chosen == VNC_AUTH or minor == 8:
            (failure,) = yield from _read(">I")
            if failure:
                reason = (yield from _read_text("reason")) if minor == 8 else "no reason given"
                raise RFBError(f"{self.address} refused the log-in: {reason!r}")
        self._send(b"\1")  # other clients stay
        self._resize(*(yield from _read(">HH16x")))
        yield from _read_text("name")
        cursor = () if self._with_cursor else (CURSOR,)
        encodings = (COPY_RECT, RAW, DESKTOP_SIZE, *cursor)
        self._send(b"\0\0\0\0" + PIXEL_FORMAT)
        self._send(struct.pack(f">BxH{len(encodings)}i", 2, len(encodings), *encodings))

    def _agree_on_version(self) -> Generator[memoryview, None, int]:
        (greeting,) = yield from _read(">12s")
        match = re.fullmatch(rb"RFB (\d{3})\.(\d{3})\n", greeting)
        version = (int(match[1]), int(match[2])) if match else (0, 0)
        if version < (3, 3):
            raise RFBError(f"{self.address} is no VNC server, it begins with {greeting!r}")
        minor = 8 if version >= (3, 8) else 7 if version == (3, 7) else 3
        self._send(b"RFB 003.%03d\n" % minor)
        return minor

    def _resize(self, width: int, height: int) -> None:
        if not 0 < width * height <= MAX_PIXELS:
            raise RFBError(
                f"{self.address} has a frame of {width}x{height} pixels, "
                f"it must be of 1 to {MAX_PIXELS}"
            )
        self._pixels = np.zeros((height, width, 3), np.uint8)  # what is being received
        # Pixels that a full update has yet to bring; whole: none, which is known without a search.
        self._unknown, self._is_whole = np.ones((height, width), np.bool_), False
        self._wire = bytearray(4 * width * height)

    def _read_update(self) -> Listening:
        (num_rectangles,) = yield from _read(">xH")
        for _ in range(num_rectangles):
            yield from self._read_rectangle()
        self.is_requested = False
        self._is_whole = self._is_whole or not self._unknown.any()
        if not self._is_whole:  # the size changed, or this was sent before the last request came
            self.request()
        else:
            self.frame = self._pixels.copy()
            self.num_updates += 1

    def _read_rectangle(self) -> Listening:
        x, y, width, height, encoding = yield from _read(">HHHHi")
        size = f"{width}x{height}"
        if encoding == DESKTOP_SIZE:
            self._resize(width, height)
        elif encoding == CURSOR:
            if max(width, height) > MAX_CURSOR_SIDE:
                raise RFBError(f"a cursor of {size} pixels, at most {MAX_CURSOR_SIDE} a side")
            yield memoryview(bytearray((4 * width + (width + 7) // 8) * height))
        elif encoding in (RAW, COPY_RECT):
            self._check_inside(x, y, width, height)
            place = (slice(y, y + height), slice(x, x + width))
            if encoding == RAW:
                wire = memoryview(self._wire)[: 4 * width * height]
                yield wire
                pixels = np.frombuffer(wire, np.uint8).reshape(height, width, 4)
                for channel in range(3):  # 7 times as fast as all three at once
                    self._pixels[(*place, channel)] = pixels[..., channel]
                if not self._is_whole:
                    self._unknown[place] = False
            else:
                x, y = yield from _read(">HH")
                self._check_inside(x, y, width, height)
                source = (slice(y, y + height), slice(x, x + width))
                self._pixels[place] = self._pixels[source]
                self._unknown[place] = self._unknown[source]
        else:
            raise RFBError(f"encoding {encoding} from {self.address} was not asked for")

    def _check_inside(self, x: int, y: int, width: int, height: int) -> None:
        frame_height, frame_width = self._unknown.shape
        if x + width > frame_width or y + height > frame_height:
            raise RFBError(
                f"a rectangle of {width}x{height} pixels at ({x}, {y}) from {self.address} is "
                f"outside the frame of {frame_width}x{frame_height}"
            )


def _read(layout: str) -> Generator[memoryview, None, tuple[Any, ...]]:
    data = bytearray(struct.calcsize(layout))
    yield memoryview(data)
    return struct.unpack(layout, data)


def _read_text(what: str) -> Generator[memoryview, None, str]:
    (num_bytes,) = yield from _read(">I")
    if num_bytes > MAX_TEXT_BYTES:
        raise RFBError(f"a {what} of {num_bytes} bytes, at most {MAX_TEXT_BYTES} are allowed")
    data = bytearray(num_bytes)
    yield memoryview(data)
    return data.decode("utf-8", "replace")


def encode_password(password: str) -> bytes:
    """The DES key: 8 bytes, the bits of each reversed."""
    try:
        key = password.encode("latin-1")[:8].ljust(8, b"\0")
    except UnicodeEncodeError:
        raise ValueError("a VNC password has only characters of Latin-1") from None
    return bytes(int(f"{byte:08b}"[::-1], 2) for byte in key)


def _encrypt(challenge: bytes, key: bytes) -> bytes:
    """Encrypt with DES, as TripleDES of one key thrice."""
    try:
        from cryptography.hazmat.decrepit.ciphers.algorithms import TripleDES
        from cryptography.hazmat.primitives.ciphers import Cipher, modes
    except ImportError as error:
        raise RFBError("a VNC password needs: pip install 'marl_cair[vnc]'") from error
    encryptor = Cipher(TripleDES(3 * key), modes.ECB()).encryptor()  # noqa: S305 (VNC's choice)
    answer: bytes = encryptor.update(challenge)
    return answer
