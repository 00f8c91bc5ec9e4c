"""Runs a Flash game in Chromium: in real time on a virtual display, or in lockstep."""

from __future__ import annotations

import json
import struct
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal, NoReturn, Self, get_args
from urllib.parse import urlencode

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.flash.browser.bridge import Bridge
from marl_cair.games.flash.browser.installing import find_ruffle
from marl_cair.games.flash.browser.keys import find_key
from marl_cair.games.flash.browser.launching import (
    VNC_SOCKET,
    Renderer,
    Window,
    check_programs,
    start_browser,
    start_display,
)
from marl_cair.games.flash.browser.links import (
    RUN_KEY,
    TYPE_KEY,
    Event,
    KeyEvent,
    Link,
    MouseEvent,
    ScreenLink,
    SocketLink,
    count_reply_rows,
)
from marl_cair.games.flash.browser.processes import FlashError, PrivateFolder
from marl_cair.games.flash.browser.rfb import RFBClient, RFBError
from marl_cair.games.flash.browser.swf_header import check_signature

__all__ = ["Event", "FlashError", "FlashServer", "KeyEvent", "MouseEvent"]

START_LIMIT_S = 60.0
REPLY_LIMIT_S = 30.0
_FRAME_LIMIT_S = 0.1  # what each frame of a step adds to the limit
_MAX_SIZE = 4096
_PAGE = Path(__file__).parent / "page"


class FlashServer:
    """One Flash game in one browser. It is ready, with seed 0, when this returns.

    swf: the Flash file.
    size: width and height of the game, in pixels.
    fps: frames per second of the game; it replaces the SWF's own number.
    mode: "realtime": the game runs by the clock, and is seen and played over VNC (`connect`).
        "lockstep": it stands still between calls of `step`, and is exactly reproducible.
    transport: how lockstep reaches the game. "bridge": a socket of the page, in a browser without
        a display. "vnc": keys, mouse and pixels over VNC. Both give the same states and pictures.
    renderer: "canvas", or "webgl", which is much slower without a GPU but knows all blend modes.

    Raises ValueError (arguments, no Flash file), OSError (files, full disk) and FlashError, also in
    every later call: programs that are missing, have ended or do not answer. No call waits forever.
    """

    def __init__(
        self,
        swf: Path,
        size: tuple[int, int],
        fps: int,
        *,
        mode: Literal["realtime", "lockstep"] = "realtime",
        transport: Literal["bridge", "vnc"] = "bridge",
        renderer: Renderer = "canvas",
    ) -> None:
        _check_choice("mode", mode, ("realtime", "lockstep"))
        _check_choice("transport", transport, ("bridge", "vnc"))
        _check_choice("renderer", renderer, get_args(Renderer))
        self.size = _check_size("size", size)
        if not 1 <= fps <= 1000:
            raise ValueError(f"fps is {fps}, it must be from 1 to 1000")
        self.fps = fps
        self.mode = mode
        self.values: dict[str, Any] = {}  # what the callbacks of `watch` returned last
        self._watched: tuple[str, ...] = ()
        self._held: set[str] = set()  # keys
        self._is_in_band = mode == "lockstep" and transport == "vnc"
        self._has_display = mode == "realtime" or self._is_in_band
        self._pending: tuple[int, tuple[int, int] | None] | None = None  # frames, picture
        check_signature(swf)
        check_programs(needs_display=self._has_display)
        self._link: Link | None = None
        self._bridge: Bridge | None = None
        self._display: dict[str, str] | None = None  # environment variables of its clients
        self._folder = PrivateFolder()
        try:
            self._start(swf, renderer)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the browser and the display, and remove their files."""
        if self._link is not None:
            self._link.close()
            self._link = None
        if self._bridge is not None:
            self._bridge.close()
            self._bridge = None
        self._folder.close()

    @property
    def address(self) -> Path:
        """The UNIX socket of the VNC server, which only this user can open."""
        if not self._has_display:
            raise ValueError('mode="lockstep" with transport="bridge" has no display to connect to')
        return self._folder.path / VNC_SOCKET

    def connect(self, **options: Any) -> RFBClient:
        """A new VNC client of the game; `options` are those of RFBClient."""
        return RFBClient(self.address, **options)

    # --- the game --------------------------------------------------------------------------------

    def watch(self, *names: str) -> None:
        """Call these callbacks of the SWF, without arguments, after each `reset` and `step`:
        `values` holds what they returned. Faster than `call` after each step.
        """
        self._watched = names

    def reset(self, seed: int) -> None:
        """Load the SWF again. In lockstep its clock is 0 and its first frame has run.

        seed: of Math.random, from 0 to 2^64 - 1.
        """
        if not 0 <= seed < 1 << 64:
            raise ValueError(f"seed is {seed}, it must be from 0 to 2^64 - 1")
        self._held.clear()
        self._send({"seed": [seed & 0xFFFFFFFF, seed >> 32], **self._watch_request()})
        self._keep_values(self._receive(0)[0])

    def step(
        self,
        num_frames: int = 1,
        events: Sequence[Event] = (),
        picture: tuple[int, int] | None = (84, 84),
    ) -> NDArray[np.uint8] | None:
        """Dispatch events, then run frames; return the picture of the last, RGB [height, width, 3].

        picture: its width and height, to which the page scales the game; None: no picture.
        """
        self.begin_step(num_frames, events, picture)
        return self.end_step()

    def begin_step(
        self,
        num_frames: int = 1,
        events: Sequence[Event] = (),
        picture: tuple[int, int] | None = (84, 84),
    ) -> None:
        """Begin a `step`, which `end_step` waits for: several servers can so run at one time."""
        if self.mode != "lockstep":
            raise ValueError('step is for mode="lockstep"; in real time the game runs by the clock')
        if num_frames < 0:
            raise ValueError(f"num_frames is {num_frames}, it must be 0 or more")
        changes = [event for event in events if self._is_change(event)]
        request: dict[str, Any] = {"frames": num_frames, **self._watch_request()}
        if picture is not None:
            request["picture"] = _check_size("picture", picture)
        self._send(request, changes)
        self._pending = (num_frames, picture)

    def end_step(self) -> NDArray[np.uint8] | None:
        """Wait for the step that was begun, and return its picture."""
        if self._pending is None:
            raise ValueError("no step was begun; call begin_step first")
        num_frames, picture = self._pending
        self._pending = None
        values, pixels = self._receive(num_frames)
        self._keep_values(values)
        columns, rows = picture or (0, 0)
        if len(pixels) != 3 * columns * rows:
            self._refuse(f"a picture of {len(pixels)} bytes, {3 * columns * rows} were asked for")
        return pixels.reshape(rows, columns, 3) if picture else None

    @property
    def is_idle(self) -> bool:
        """Whether it runs, and no step was begun without its end."""
        return self._link is not None and self._pending is None

    def call(self, name: str, *arguments: Any) -> Any:
        """Call a callback of the SWF (ExternalInterface) with JSON values; None if it has none of
        this name, as before its first frame has run.
        """
        self._send({"calls": [[name, *arguments]]})
        values = self._receive(0)[0]
        if len(values) != 1:
            self._refuse(f"{len(values)} values for one call")
        return values[0]

    def _watch_request(self) -> dict[str, Any]:
        return {"calls": [[name] for name in self._watched]} if self._watched else {}

    def _keep_values(self, values: list[Any]) -> None:
        self.values = dict(zip(self._watched, values, strict=False))

    def _is_change(self, event: Event) -> bool:
        """False for a key that is already down or up. Raises ValueError for what cannot be sent."""
        if isinstance(event, MouseEvent):
            for axis, value, size in zip("xy", event[:2], self.size, strict=True):
                if not 0 <= value < size:
                    raise ValueError(f"{axis} of {event} must be from 0 to {size - 1}")
            return True
        find_key(event.name)
        if self._is_in_band and event.name in (RUN_KEY, TYPE_KEY):
            raise ValueError(f'transport="vnc" takes the key {event.name!r} itself; use "bridge"')
        if event.is_down == (event.name in self._held):
            return False
        (self._held.add if event.is_down else self._held.remove)(event.name)
        return True

    # --- messages --------------------------------------------------------------------------------

    def _send(self, request: dict[str, Any], events: Sequence[Event] = ()) -> None:
        if self._link is None:
            raise FlashError("this FlashServer is closed; make another one")
        if self._pending is not None:
            raise ValueError("a step was begun; call end_step first")
        try:
            self._link.send(request, events)
        except (ConnectionError, RFBError, TimeoutError) as error:
            self._fail(error)

    def _receive(self, num_frames: int) -> tuple[list[Any], NDArray[np.uint8]]:
        """What the callbacks returned, and the picture's bytes."""
        if self._link is None:
            raise FlashError("this FlashServer is closed; make another one")
        try:
            reply = self._link.receive(REPLY_LIMIT_S + _FRAME_LIMIT_S * num_frames)
        except (ConnectionError, RFBError, TimeoutError) as error:
            self._fail(error)
        except BaseException:
            self.close()  # the reply to come would be taken for that of the next request
            raise
        try:
            (size,) = struct.unpack_from("<I", reply)
            answer = json.loads(reply[4 : 4 + size])
            if "error" in answer:
                raise FlashError(f"the game failed: {answer['error']}")
            return list(answer["values"]), np.frombuffer(reply, np.uint8, offset=4 + size)
        except (struct.error, ValueError, KeyError, TypeError) as error:
            self._refuse(f"a reply that cannot be read ({error!r})")

    def _refuse(self, received: str) -> NoReturn:
        self.close()
        raise FlashError(f"the page sent {received}")

    def _check_running(self) -> None:
        self._folder.check_running()
        if self._bridge is not None:
            self._bridge.check_open()

    def _fail(self, error: Exception) -> NoReturn:
        """Close, and raise FlashError with the cause: which program has ended, if any."""
        deadline = time.monotonic() + 0.5  # a browser closes its sockets before it has ended
        try:
            while not isinstance(error, TimeoutError) and time.monotonic() < deadline:
                self._folder.check_running()
                time.sleep(0.02)
            self._folder.check_running()
            cause = "the page crashed, or the game left it"
            if isinstance(error, TimeoutError):
                cause = "the game runs forever, or the machine is too busy"
            raise FlashError(f"{error}: {cause}.{self._folder.describe_log('chromium')}") from error
        finally:
            self.close()

    # --- starting --------------------------------------------------------------------------------

    def _start(self, swf: Path, renderer: Renderer) -> None:
        width, height = self.size
        rows = count_reply_rows(width, height) if self._is_in_band else 0
        settings = {"width": width, "height": height, "rows": rows, "fps": self.fps}
        query = urlencode({**settings, "mode": self.mode, "renderer": renderer})
        window = Window(width, height + rows, renderer, self._is_in_band)
        ruffle = find_ruffle()
        files = [*_PAGE.iterdir(), *ruffle.glob("*.js"), *ruffle.glob("*.wasm")]
        self._bridge = bridge = Bridge({**{path.name: path for path in files}, "game.swf": swf})
        if self._has_display:
            self._display = start_display(self._folder, window)
        start_browser(self._folder, f"{bridge.address}index.html?{query}", window, self._display)
        deadline = time.monotonic() + START_LIMIT_S
        while not bridge.wait_for_page(0.1):
            self._folder.check_running()
            if time.monotonic() > deadline:
                log = self._folder.describe_log("chromium")
                raise FlashError(f"the page was not ready within {START_LIMIT_S:g} s.{log}")
        self._link = SocketLink(bridge)
        self._receive(0)
        if self._is_in_band:
            self._link = ScreenLink(self.address, height, self._check_running)


def _check_choice(name: str, value: str, choices: tuple[str, ...]) -> None:
    if value not in choices:
        raise ValueError(f"{name} is {value!r}, it must be one of {', '.join(map(repr, choices))}")


def _check_size(name: str, size: tuple[int, int]) -> tuple[int, int]:
    width, height = size
    if not (1 <= width <= _MAX_SIZE and 1 <= height <= _MAX_SIZE):
        raise ValueError(f"{name} is {size}, width and height must be from 1 to {_MAX_SIZE}")
    return width, height
