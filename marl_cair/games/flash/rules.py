"""Steps of Flash games: keys to the browsers, their pictures and numbers back into the arrays."""

from __future__ import annotations

import atexit
import logging
import os
from collections.abc import Iterable
from contextlib import suppress
from itertools import combinations
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from marl_cair.games.flash import state as s
from marl_cair.games.flash.browser.server import (
    Event,
    FlashError,
    FlashServer,
    KeyEvent,
    MouseEvent,
)
from marl_cair.games.flash.description import (
    MIRRORED,
    Description,
    Number,
    Region,
    check_digest,
    find_description,
    find_value,
)
from marl_cair.games.flash.ending import EndReader
from marl_cair.games.flash.scenarios import NUMBERS, Scenario
from marl_cair.games.game import NO_WINNER

SMALL = s.SIDE, s.SIDE
Transport = Literal["bridge", "vnc"]
ALIVE = 0.1  # of a step, in the reward `alive`
MOST_SPARE = 8  # browsers of a SWF that wait for another engine
MOST_FAILURES = 2  # browsers of one game that are replaced when they fail
_LUMA = np.array((299, 587, 114), np.uint32)

logger = logging.getLogger(__name__)


class Action(NamedTuple):
    """Keys to hold, or a place to click."""

    name: str
    keys: tuple[int, ...] = ()  # of the player's
    place: tuple[int, int] | None = None


def list_actions(described: Description, kind: str) -> tuple[Action, ...]:
    """No key, each key and all pairs; or no click and a click in each place of the grid."""
    nothing = Action("noop")
    if kind == "keys":
        names = described.keys[0]
        chosen = [pair for size in (1, 2) for pair in combinations(range(len(names)), size)]
        return nothing, *(Action("+".join(names[k] for k in keys), keys) for keys in chosen)
    columns, rows = described.mouse_grid
    width, height = described.size
    return nothing, *(
        Action(
            f"click {column} {row}",
            place=((2 * column + 1) * width // (2 * columns), (2 * row + 1) * height // (2 * rows)),
        )
        for row in range(rows)
        for column in range(columns)
    )


# Browsers of engines that were closed, for the next ones: to start one takes seconds.
_spare: dict[tuple[Description, str], list[FlashServer]] = {}


def close_spare_browsers() -> None:
    """Close the browsers that wait for another engine."""
    while _spare:
        for server in _spare.popitem()[1]:
            server.close()


atexit.register(close_spare_browsers)
if hasattr(os, "register_at_fork"):  # they stay with the process that has started them
    os.register_at_fork(after_in_child=_spare.clear)


class Browsers:
    """The browsers of an engine, one for each world, each taken when its first game begins."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario, self.described = scenario, find_description(scenario.description)
        self.actions = list_actions(self.described, scenario.actions)
        self.ending = EndReader(self.described)
        self.picture: tuple[int, int] | None = SMALL
        if self.described.reads_pixels:
            self.picture = self.described.size
        self.transport: Transport = "vnc" if scenario.transport == "vnc" else "bridge"
        if scenario.transport == NUMBERS:
            self.picture = None
        self._kind = self.described, self.transport
        self._servers: dict[int, FlashServer] = {}
        self._process = os.getpid()

    def has(self, slot: int) -> bool:
        """Whether a world has a browser."""
        return slot in self._servers

    def server(self, slot: int) -> FlashServer:
        if slot not in self._servers:
            spare = _spare.get(self._kind, [])
            self._servers[slot] = spare.pop() if spare else self._open()
        return self._servers[slot]

    def _open(self) -> FlashServer:
        described = self.described
        check_digest(described)
        server = FlashServer(
            described.swf,
            described.size,
            described.fps,
            mode="lockstep",
            transport=self.transport,
            renderer=described.renderer,
        )
        if described.callback:
            server.watch(described.callback)
        return server

    def drop(self, slot: int) -> None:
        """Close a browser that has failed: the next game starts another one."""
        if slot in self._servers:
            self._servers.pop(slot).close()

    def close(self) -> None:
        """Keep up to MOST_SPARE browsers for the next engine of the same SWF, but none within a
        step; close the others.
        """
        if os.getpid() != self._process:  # a fork: they are its parent's
            self._servers.clear()
        spare = _spare.setdefault(self._kind, [])
        for server in self._servers.values():
            if server.is_idle and len(spare) < MOST_SPARE:
                spare.append(server)
            else:
                server.close()
        self._servers.clear()


# --- kernels, as `games.game.Game` describes them ------------------------------------------------


def reset(
    worlds: s.World, browsers: Browsers, seeds: Any, mask: Any, first: int, last: int
) -> None:
    """Load the SWF again in the browsers of the masked worlds, and start its game."""
    for row in range(first, last):
        if mask[row]:
            picture = _start(browsers, int(worlds.slot[row]), int(seeds[row]))
            for field in (worlds.tick, worlds.phase, worlds.score, worlds.held, worlds.illegal):
                field[row] = 0
            _read(worlds, browsers, row, picture)
            worlds.film[row] = worlds.film[row, -1]


def _start(browsers: Browsers, slot: int, seed: int) -> NDArray[np.uint8] | None:
    """The first picture of a game; a browser that fails is replaced by another one."""
    for _ in range(MOST_FAILURES):
        try:
            return _begin(browsers, browsers.server(slot), seed)
        except FlashError as error:
            browsers.drop(slot)
            close_spare_browsers()  # they may have ended too
            logger.warning("flash: %s; another browser is started", error)
    return _begin(browsers, browsers.server(slot), seed)


def _begin(browsers: Browsers, server: FlashServer, seed: int) -> NDArray[np.uint8] | None:
    if not server.is_idle:
        raise FlashError("a browser's last step was interrupted")
    server.reset(seed)
    for item in browsers.described.start:
        if isinstance(item, int):
            server.step(item, picture=None)
            continue
        for is_down in (True, False):
            event = KeyEvent(item, is_down) if isinstance(item, str) else MouseEvent(*item, is_down)
            server.step(1, [event], picture=None)
    return server.step(1, picture=browsers.picture)


def _shown(picture: NDArray[np.uint8] | None) -> NDArray[np.uint8]:
    if picture is None:
        raise FlashError("the page sent no picture")
    return picture


def step(
    worlds: s.World, browsers: Browsers, actions: Any, outcome: Any, first: int, last: int
) -> None:
    """Advance the running worlds, all browsers at the same time; one that fails ends its game as
    truncated.
    """
    running = (first + np.flatnonzero(worlds.phase[first:last] == s.RUNNING)).tolist()
    outcome.rewards[first:last] = 0.0
    ticks, begun = browsers.scenario.ticks_per_step, []
    for row in running:
        events = _press(worlds, browsers, row, actions[row])
        try:
            browsers.server(int(worlds.slot[row])).begin_step(ticks, events, browsers.picture)
            begun.append(row)
        except FlashError as error:
            _truncate(worlds, browsers, row, error)
    for row in begun:
        try:
            _advance(worlds, browsers, row, outcome)
        except FlashError as error:
            _truncate(worlds, browsers, row, error)
    outcome.terminated[first:last] = worlds.phase[first:last] == s.TERMINATED
    outcome.truncated[first:last] = worlds.phase[first:last] == s.TRUNCATED


def _truncate(worlds: s.World, browsers: Browsers, row: int, error: FlashError) -> None:
    logger.warning("flash: %s; this game ends as truncated", error)
    browsers.drop(int(worlds.slot[row]))
    worlds.phase[row] = s.TRUNCATED


def _press(worlds: s.World, browsers: Browsers, row: int, actions: Iterable[int]) -> list[Event]:
    """The changes of keys that a step begins with, and its clicks."""
    events: list[Event] = []
    for player, number in enumerate(actions):
        action = browsers.actions[number]
        for key, name in enumerate(browsers.described.keys[player]):
            is_down = key in action.keys
            if is_down != worlds.held[row, player, key]:
                events.append(KeyEvent(name, is_down))
                worlds.held[row, player, key] = is_down
        if action.place is not None:
            events += [MouseEvent(*action.place, is_down) for is_down in (True, False)]
    return events


def _advance(worlds: s.World, browsers: Browsers, row: int, outcome: Any) -> None:
    """Write the results of a step that was begun."""
    before = worlds.score[row].copy()
    picture = browsers.server(int(worlds.slot[row])).end_step()
    worlds.tick[row] += browsers.scenario.ticks_per_step
    is_done, winner = _read(worlds, browsers, row, picture)
    if is_done:
        worlds.phase[row] = s.TERMINATED
    elif worlds.tick[row] >= browsers.scenario.max_ticks:
        worlds.phase[row] = s.TRUNCATED
    outcome.rewards[row] = _pay(browsers, worlds.score[row] - before, is_done, winner)
    outcome.winner[row] = winner if is_done else NO_WINNER


def _read(
    worlds: s.World, browsers: Browsers, row: int, picture: NDArray[np.uint8] | None
) -> tuple[bool, int]:
    """Write what a browser shows and reports to a row: is the game over, and who has won?"""
    described = browsers.described
    server = browsers.server(int(worlds.slot[row]))
    reported = server.values.get(described.callback)
    if described.callback and reported is None:
        raise FlashError(f"the SWF has no callback {described.callback!r}, or it returned nothing")
    if isinstance(described.score, Region):
        worlds.score[row] = read_brightness(_shown(picture), described.score)
    elif described.scores:
        worlds.score[row] = find_value(reported, described.scores)
    elif described.score:
        worlds.score[row] = find_value(reported, described.score)
    else:
        worlds.score[row] = worlds.tick[row]
    numbers = described.numbers
    worlds.numbers[row] = [_read_number(reported, one, is_second=False) for one in numbers]
    if half := len(described.keys) // 2:
        second = [_read_number(reported, one, is_second=True) for one in numbers]
        worlds.numbers[row, -half:] = second
    if browsers.picture is not None:
        small = _shown(picture) if browsers.picture == SMALL else shrink(_shown(picture))
        worlds.picture[row] = small.transpose(2, 0, 1)
        worlds.film[row, :-1] = worlds.film[row, 1:]
        worlds.film[row, -1] = find_luma(small)
    if isinstance(described.done, str):
        is_done = bool(find_value(reported, described.done))
    else:
        is_done = browsers.ending.is_over(_shown(picture))
    winner = int(find_value(reported, described.winner)) if described.winner else NO_WINNER
    return is_done, winner


def _read_number(reported: Any, number: Number, is_second: bool) -> float:
    """A number as one half of the players sees it; 0 where the SWF reports none."""
    other = number.second if is_second else ""
    path = other if other not in ("", MIRRORED) else number.path
    value = find_value(reported, path, missing=lambda: None)
    if value is None:
        return 0.0
    value = min(number.high, max(number.low, float(value)))
    return number.low + number.high - value if other == MIRRORED else value


def read_brightness(picture: NDArray[np.uint8], region: Region) -> float:
    """The mean of a region of a picture [H, W, 3], 0..1."""
    x, y, width, height = region
    return float(picture[y : y + height, x : x + width].mean() / 255.0)


def shrink(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """A picture [H, W, 3] at 84 x 84: means of its pixels."""
    small = Image.fromarray(picture).resize(SMALL, Image.Resampling.BOX)
    return np.asarray(small, np.uint8)


def find_luma(picture: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The brightness uint8 [H, W] of a picture [H, W, 3]."""
    return (picture @ _LUMA // 1000).astype(np.uint8)


def _pay(
    browsers: Browsers, gained: NDArray[np.float64], is_done: bool, winner: int
) -> NDArray[np.float32]:
    """The reward of each player, float32 [P]."""
    most = browsers.described.most_points
    if len(gained) > 1:
        if browsers.scenario.reward == "lead":
            others = (gained.sum() - gained) / (len(gained) - 1)
            lead: NDArray[np.float32] = np.clip(gained - others, -most, most).astype(np.float32)
            return lead
        paid = np.zeros(len(gained), np.float32)
        if is_done and winner != NO_WINNER:
            paid[:] = -1.0
            paid[winner] = 1.0
        return paid
    if browsers.scenario.reward == "alive":
        return np.array([-1.0 if is_done else ALIVE], np.float32)
    return np.clip(gained, -most, most).astype(np.float32)


def legal_actions(worlds: s.World, browsers: Browsers, out: Any, first: int, last: int) -> None:
    """All actions are legal, out bool [B, P, A]."""
    out[first:last] = True


def observe_small(worlds: s.World, browsers: Browsers, out: Any, first: int, last: int) -> None:
    """The picture at 84 x 84, out uint8 [B, P, 3, 84, 84]."""
    _show(browsers, worlds.picture[first:last], out[first:last])


def observe_gray(worlds: s.World, browsers: Browsers, out: Any, first: int, last: int) -> None:
    """The luma of the last one or four steps, out uint8 [B, P, 1 or 4, 84, 84]."""
    _show(browsers, worlds.film[first:last, -out.shape[2] :], out[first:last])


def observe_image(worlds: s.World, browsers: Browsers, out: Any, first: int, last: int) -> None:
    """The picture at full size, which each browser sends again; out uint8 [B, P, 3, H, W]."""
    for row in range(first, last):
        picture = draw(worlds, browsers, row)
        _show(browsers, picture.transpose(2, 0, 1)[None], out[row : row + 1])


def observe_numbers(worlds: s.World, browsers: Browsers, out: Any, first: int, last: int) -> None:
    """The numbers that the SWF reports, after the player's own; out float32 [B, P, 1 + V]."""
    out[first:last, :, 0] = np.arange(out.shape[1])
    out[first:last, :, 1:] = worlds.numbers[first:last]


def _show(browsers: Browsers, pictures: NDArray[np.uint8], out: Any) -> None:
    """Pictures [N, C, H, W] of all players, the second half of them mirrored where it must be."""
    out[:] = pictures[:, None]
    if browsers.described.is_mirrored:
        half = out.shape[1] // 2
        out[:, half:] = pictures[:, None, :, :, ::-1]


def draw(
    worlds: s.World, browsers: Browsers, world: int, player: int | None = None
) -> NDArray[np.uint8]:
    """What a browser shows now, uint8 [H, W, 3]; of one that has failed the last small picture,
    enlarged.
    """
    slot, size = int(worlds.slot[world]), browsers.described.size
    picture = None
    if browsers.has(slot):
        with suppress(FlashError):  # the next step meets it too, and ends the game
            picture = _shown(browsers.server(slot).step(0, picture=size))
    if picture is None:
        last = Image.fromarray(worlds.picture[world].transpose(1, 2, 0))
        picture = np.asarray(last.resize(size), np.uint8)
    is_second = player is not None and 2 * player >= worlds.score.shape[1]
    return picture[:, ::-1] if is_second and browsers.described.is_mirrored else picture
