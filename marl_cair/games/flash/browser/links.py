"""Requests to the page and its replies, over the page's socket or in-band over VNC."""

from __future__ import annotations

import json
import struct
import time
import zlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.flash.browser.bridge import Bridge
from marl_cair.games.flash.browser.keys import find_key
from marl_cair.games.flash.browser.rfb import RFBClient

# Keys that the page takes for itself (player.js), and that games hardly use.
RUN_KEY, TYPE_KEY = "pause", "scroll_lock"
MAX_ANSWER = 1 << 16  # bytes of values that the SWF returns, in-band
_HEAD = struct.Struct("<IIII")  # "FLSH", number of the reply, its Adler-32, its length
_MAGIC = 0x48534C46
_LOOK_S = 0.25  # seconds between two looks at whether the programs still run
_NIBBLES = "abcdefghijklmnop"


class KeyEvent(NamedTuple):
    """A key goes down or up; names are those of `keys.py`."""

    name: str
    is_down: bool


class MouseEvent(NamedTuple):
    """The mouse moves to (x, y), in the SWF's pixels, then its left button is held or not."""

    x: int
    y: int
    is_down: bool = False


Event = KeyEvent | MouseEvent


# Each takes requests (see `run` in player.js), whose events come first, and returns their replies
# in order: the length of a JSON text in 4 bytes, this text, the picture.


class SocketLink:
    """Over the page's socket: one message each way."""

    def __init__(self, bridge: Bridge) -> None:
        self._bridge = bridge

    def send(self, request: Mapping[str, Any], events: Sequence[Event]) -> None:
        self._bridge.send(json.dumps({**request, "events": [_pack(event) for event in events]}))

    def receive(self, timeout_s: float) -> bytearray:
        return self._bridge.receive(timeout_s)

    def close(self) -> None:
        """The bridge belongs to the caller."""


def _pack(event: Event) -> list[Any]:
    if isinstance(event, MouseEvent):
        return list(event)
    key = find_key(event.name)
    return [key.code, key.key, key.key_code, event.is_down]


class ScreenLink:
    """In-band over VNC: requests are keys, replies are pixels below the game.

    A request is typed only if it differs from the last; one key runs it. A pixel of a reply holds
    three bytes.

    address: of the VNC server.
    top: the row where replies begin.
    check_running: raises an error when the page, the browser or the display has ended.
    """

    def __init__(self, address: Path, top: int, check_running: Callable[[], None]) -> None:
        self._client = RFBClient(address, with_cursor=False)
        self._top = top
        self._check_running = check_running
        self._typed = ""
        self._number = 0  # of the last reply
        self._held: set[str] = set()
        self._is_button_down = False
        self._release_all()

    def send(self, request: Mapping[str, Any], events: Sequence[Event]) -> None:
        for event in events:
            self._send_event(event)
        if "seed" in request:
            self._release_all()
        text = json.dumps(request, separators=(",", ":"))
        if text != self._typed:
            self._type(text)
        self._client.tap(RUN_KEY)

    def _type(self, text: str) -> None:
        """Type a request. Keys that the game holds are released meanwhile, unseen by the game: they
        may be needed.
        """
        held = sorted(self._held)
        self._client.tap(TYPE_KEY)
        for name in held:
            self._client.release(name)
        for byte in text.encode():
            self._client.tap(_NIBBLES[byte >> 4])
            self._client.tap(_NIBBLES[byte & 15])
        self._client.tap(TYPE_KEY)
        for name in held:
            self._client.press(name)
        self._client.tap(TYPE_KEY)
        self._typed = text

    def _send_event(self, event: Event) -> None:
        if isinstance(event, KeyEvent):
            self._client.send_key(event.name, event.is_down)
            (self._held.add if event.is_down else self._held.discard)(event.name)
            return
        self._client.move(event.x, event.y)
        if event.is_down == self._is_button_down:
            return
        self._is_button_down = event.is_down
        if event.is_down:
            self._client.mouse_down()
        else:
            self._client.mouse_up()

    def _release_all(self) -> None:
        """Put keys and mouse where every game finds them: the display sends changes only."""
        for name in sorted(self._held):
            self._client.release(name)
        self._held.clear()
        if self._is_button_down:
            self._client.mouse_up()
        self._is_button_down = False
        self._client.move(0, self._top)  # below the game

    def receive(self, timeout_s: float) -> bytearray:
        deadline = time.monotonic() + timeout_s
        frame = self._client.frame()
        while (reply := read_reply(frame[self._top :], self._number + 1)) is None:
            remaining = deadline - time.monotonic()
            if remaining <= 0:
                raise TimeoutError(f"no reply appeared below the game within {timeout_s:g} s")
            try:
                frame = self._client.wait_for_update(min(remaining, _LOOK_S))
            except TimeoutError:
                self._check_running()
        self._number += 1
        return reply

    def close(self) -> None:
        self._client.close()


Link = SocketLink | ScreenLink


def read_reply(pixels: NDArray[np.uint8], number: int) -> bytearray | None:
    """The reply of this number that is drawn in `pixels` ([rows, columns, 3]), None if it is not
    there, or not all of it.
    """
    flat = pixels.reshape(-1)
    magic, drawn_number, checksum, size = _HEAD.unpack(flat[: _HEAD.size].tobytes())
    if (magic, drawn_number) != (_MAGIC, number) or size > len(flat) - _HEAD.size:
        return None
    reply = bytearray(flat[_HEAD.size : _HEAD.size + size].tobytes())
    return reply if zlib.adler32(reply) == checksum else None


def count_reply_rows(width: int, height: int) -> int:
    """Rows below a game of this size in which every reply fits."""
    num_bytes = _HEAD.size + 4 + MAX_ANSWER + 3 * width * height
    return -(-num_bytes // (3 * width))
