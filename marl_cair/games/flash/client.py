"""`Game`: frames and keys of a Flash game in real time, as FlashRL had them.

The two ways of access of the thesis: frames are pushed to a callback at a fixed rate, or taken on
demand (`render`) by any thread.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.flash.browser.server import FlashServer
from marl_cair.games.flash.description import find_stage
from marl_cair.games.flash.rules import find_luma, shrink
from marl_cair.games.flash.scenes import SceneClassifier

Frame = NDArray[Any]
Callback = Callable[[Frame, int, str, "Game"], None]


class Game:
    """A Flash game that runs by the clock in a virtual display; a context manager.

    Args:
        name: `multitask`, `duel`, a SWF, or its TOML file.
        fps: frames pushed per second.
        frame_callback: called in a thread of its own with (frame, its number, its scene, this game)
            for each frame; None: frames are taken by `render` alone. An exception in it is raised
            by `close`.
        grayscale: frames are [84, 84, 1] instead of [84, 84, 3].
        normalized: frames are float32 in 0..1 instead of uint8.
        scenes: a classifier that names the scene of each frame; None: scenes are "".

    Raises:
        FlashError: the browser or its display cannot be started; the message says what to install.
    """

    def __init__(
        self,
        name: str,
        fps: int = 10,
        frame_callback: Callback | None = None,
        *,
        grayscale: bool = False,
        normalized: bool = False,
        scenes: SceneClassifier | None = None,
    ) -> None:
        if fps < 1:
            raise ValueError(f"fps is {fps}, it must be 1 or more")
        self.stage = find_stage(name)
        self._fps, self._scenes = fps, scenes
        self._is_gray, self._is_normalized = grayscale, normalized
        _, swf, size, game_fps, renderer = self.stage
        self._server = FlashServer(swf, size, game_fps, mode="realtime", renderer=renderer)
        try:
            self._client = self._server.connect()
        except BaseException:
            self._server.close()
            raise
        self._error: Exception | None = None
        self._is_over = threading.Event()
        self._thread: threading.Thread | None = None
        if frame_callback is not None:
            arguments = (frame_callback,)
            self._thread = threading.Thread(target=self._push, args=arguments, daemon=True)
            self._thread.start()

    @property
    def address(self) -> Path:
        """The UNIX socket of the VNC server, for any VNC viewer."""
        return self._server.address

    def render(self) -> Frame:
        """The newest frame, [84, 84, 3 or 1] uint8 0..255 or float32 0..1."""
        return self._prepare(self._client.refresh())

    def screen(self) -> NDArray[np.uint8]:
        """The newest picture at full size, uint8 [H, W, 3]."""
        return self._client.refresh()

    def find_scene(self) -> str:
        """The scene of the newest picture; "" without a classifier."""
        return self._scenes.find_scene(self._client.refresh()) if self._scenes else ""

    def send_key(self, name: str, seconds: float = 0.1) -> None:
        """Press a key, hold it so long, and release it."""
        self._client.press(name)
        time.sleep(seconds)
        self._client.release(name)

    def press(self, name: str) -> None:
        """Press a key and hold it until `release`."""
        self._client.press(name)

    def release(self, name: str) -> None:
        """Release a key."""
        self._client.release(name)

    def hold(self, name: str, num_frames: int) -> None:
        """Hold a key for so many frames of the game."""
        self.send_key(name, num_frames / self.stage.fps)

    def click(self, x: int, y: int, button: str = "left") -> None:
        """Press and release a mouse button at a pixel of the game."""
        self._client.click(x, y, button)

    def mouse_down(self, x: int, y: int, button: str = "left") -> None:
        """Press a mouse button at a pixel and hold it."""
        self._client.move(x, y)
        self._client.mouse_down(button)

    def mouse_up(self, x: int, y: int, button: str = "left") -> None:
        """Release a mouse button at a pixel."""
        self._client.move(x, y)
        self._client.mouse_up(button)

    def move(self, x: int, y: int) -> None:
        """Move the mouse to a pixel of the game."""
        self._client.move(x, y)

    def close(self) -> None:
        """End the game, its browser and its display. Raises what the callback raised."""
        self._is_over.set()
        thread = self._thread
        if thread is not None and thread is not threading.current_thread():
            thread.join()
        self._client.close()
        self._server.close()
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _prepare(self, picture: NDArray[np.uint8]) -> Frame:
        small: Frame = shrink(picture)
        if self._is_gray:
            small = find_luma(small)[..., None]
        return small.astype(np.float32) / 255.0 if self._is_normalized else small

    def _push(self, push: Callback) -> None:
        number, due = 0, time.monotonic()
        try:
            while not self._is_over.wait(max(0.0, due - time.monotonic())):
                picture = self._client.refresh()
                scene = self._scenes.find_scene(picture) if self._scenes else ""
                push(self._prepare(picture), number, scene, self)
                number += 1
                due = max(due + 1.0 / self._fps, time.monotonic())
        except Exception as error:  # noqa: BLE001  # whatever the user's code raises: see `close`
            self._error = error
