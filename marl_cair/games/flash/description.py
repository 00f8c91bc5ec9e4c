"""Descriptions of SWF files (TOML): size, keys, how to start, the score and the end."""

from __future__ import annotations

import hashlib
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple, get_args

from marl_cair.games.flash.browser.keys import find_key
from marl_cair.games.flash.browser.launching import Renderer
from marl_cair.games.flash.browser.swf_header import read_header
from marl_cair.lookup import UnknownNameError, find_by_name

FOLDER = Path(__file__).parent / "swf"  # of the games that ship
OWN = ("multitask", "duel")
MIRRORED = "mirrored"  # of a number: the second half of the players sees low + high - value
MAX_SIDE, MAX_FPS, MAX_PLAYERS, MAX_KEYS, MAX_GRID = 4096, 120, 8, 16, 64
_CLICK = re.compile(r"(\d+) *, *(\d+)")


class DescriptionError(ValueError):
    """A description of a SWF that cannot be used; names the file, the value and what is allowed."""


class Region(NamedTuple):
    """A part of the picture, in pixels of the SWF."""

    x: int
    y: int
    width: int
    height: int


class Number(NamedTuple):
    """An entry of what the SWF reports, by its path ("balls.0.x"), and its range."""

    path: str
    low: float
    high: float
    second: str = ""  # what the second half of the players sees here: a path, or MIRRORED


@dataclass(frozen=True)
class Ending:
    """A game is over when a region looks like a picture, or when a scene is recognised."""

    region: Region | None = None
    picture: Path | None = None  # of the region, or of the whole SWF
    within: float = 0.05  # mean difference from the picture, 0..1
    scenes: Path | None = None  # a classifier that `scenes.SceneClassifier` has saved
    names: tuple[str, ...] = ()  # of the scenes at the end


@dataclass(frozen=True)
class Description:
    """What the engine needs to know of a SWF.

    Attributes:
        path: the TOML file.
        swf: the file, whose digest is `sha256`.
        size: width and height of the stage in pixels.
        fps: frames per second of the SWF.
        renderer: how Ruffle draws: "canvas", or "webgl", which is slower but knows all blend modes.
        start: what begins a game after the SWF is loaded: a key, "x, y" for a click, or a number of
            frames to wait.
        keys: of each player.
        mouse_grid: columns and rows of the places to click; (0, 0): there is no mouse.
        is_mirrored: the second half of the players sees the picture mirrored.
        callback: of ExternalInterface, which returns an object; "": the SWF reports nothing.
        score: the path of the score in that object, or the region whose mean brightness (0..1) it
            is, or "" for a score of 1 per frame.
        scores: the path of a list with the score of each player; "": all have `score`.
        done: the path of a truth value, or how the end looks.
        winner: the path of the winning player's number, -1 for none.
        numbers: the representation `vector`.
        most_points: the largest change of the score in one step.
    """

    path: Path
    title: str
    swf: Path
    sha256: str
    size: tuple[int, int]
    fps: int
    renderer: Renderer
    start: tuple[str | int | tuple[int, int], ...]
    keys: tuple[tuple[str, ...], ...]
    mouse_grid: tuple[int, int]
    is_mirrored: bool
    callback: str
    score: str | Region
    scores: str
    done: str | Ending
    winner: str
    numbers: tuple[Number, ...]
    most_points: float

    @property
    def reads_pixels(self) -> bool:
        """Whether score or end are read from the picture, at full size."""
        return isinstance(self.score, Region) or isinstance(self.done, Ending)


def find_description(name: str) -> Description:
    """The description of a game that ships, or of a TOML file.

    Raises:
        DescriptionError: no such file, or one that cannot be used.
    """
    if name in OWN:
        return read_description(FOLDER / f"{name}.toml")
    if not name.endswith(".toml"):
        try:
            find_by_name("flash description", name, dict.fromkeys(OWN))
        except UnknownNameError as error:
            raise DescriptionError(
                f"{error}; or give the path of a .toml file, which `marl-cair flash add` writes"
            ) from None
    return read_description(Path(name))


def read_description(path: Path) -> Description:
    """Read a TOML file. Raises DescriptionError."""
    try:
        stamp = path.stat().st_mtime_ns
    except OSError as error:
        raise DescriptionError(f"the description {path} cannot be read: {error.strerror}") from None
    return _read(path, stamp)


@lru_cache(maxsize=32)
def _read(path: Path, stamp: int) -> Description:
    try:
        found = tomllib.loads(path.read_text("utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise DescriptionError(f"{path} is no TOML file: {error}") from None
    reader = _Reader(path, found)
    description = Description(
        path=path,
        title=reader.take("title", str, path.stem),
        swf=reader.find_file("swf", reader.take("swf", str)),
        sha256=reader.take("sha256", str),
        size=reader.take_numbers("size", 2, 1, MAX_SIDE),
        fps=reader.take_number("fps", 1, MAX_FPS),
        renderer=reader.take_renderer(),
        start=tuple(map(reader.read_input, reader.take("start", list, []))),
        keys=reader.take_keys(),
        mouse_grid=reader.take_numbers("mouse_grid", 2, 0, MAX_GRID, (0, 0)),
        is_mirrored=reader.take("mirrored", bool, False),
        callback=reader.take("callback", str, ""),
        score=reader.take_score(),
        scores=reader.take("scores", str, ""),
        done=reader.take_ending(),
        winner=reader.take("winner", str, ""),
        numbers=tuple(map(reader.read_entry, reader.take("numbers", list, []))),
        most_points=float(reader.take("most_points", (int, float), 100)),
    )
    reader.finish(description)
    return description


class _Reader:
    """Takes entries out of a parsed file; what is left at the end is unknown."""

    def __init__(self, path: Path, found: dict[str, Any]) -> None:
        self.path, self.found, self.known = path, found, list[str]()

    def fail(self, name: str, value: object, allowed: str) -> DescriptionError:
        return DescriptionError(f"{self.path}: {name} is {value!r:.200}, it must be {allowed}")

    def take(self, name: str, kind: Any, default: Any = None) -> Any:
        self.known.append(name)
        value = self.found.pop(name, default)
        if value is None:
            raise DescriptionError(f"{self.path} has no {name}: add a line `{name} = ...`")
        is_number = kind is not bool and isinstance(value, bool)
        if is_number or not isinstance(value, kind):
            kinds = kind if isinstance(kind, tuple) else (kind,)
            raise self.fail(name, value, "a " + " or ".join(one.__name__ for one in kinds))
        return value

    def take_number(self, name: str, low: int, high: int) -> int:
        value = int(self.take(name, int))
        if not low <= value <= high:
            raise self.fail(name, value, f"in {low}..{high}")
        return value

    def take_numbers(
        self, name: str, count: int, low: int, high: int, default: tuple[int, ...] | None = None
    ) -> Any:
        values = self.take(name, list, None if default is None else list(default))
        return self.check_numbers(name, values, count, low, high)

    def check_numbers(self, name: str, values: Any, count: int, low: int, high: int) -> Any:
        are_whole = isinstance(values, list) and all(type(value) is int for value in values)
        if not are_whole or len(values) != count or not all(low <= v <= high for v in values):
            raise self.fail(name, values, f"{count} whole numbers in {low}..{high}")
        return tuple(values)

    def take_renderer(self) -> Renderer:
        value, known = self.take("renderer", str, "canvas"), get_args(Renderer)
        if value not in known:
            raise self.fail("renderer", value, " or ".join(known))
        renderer: Renderer = value
        return renderer

    def find_file(self, name: str, value: str) -> Path:
        path = self.path.parent / value
        if not path.is_file():
            raise self.fail(name, value, f"a file; there is no {path}")
        return path

    def read_input(self, value: Any) -> Any:
        if type(value) is int and 0 < value < 10_000:
            return value
        if isinstance(value, str) and (place := _CLICK.fullmatch(value)):
            return int(place[1]), int(place[2])
        return self.check_key("start", value)

    def check_key(self, name: str, value: Any) -> str:
        if not isinstance(value, str):
            raise self.fail(name, value, 'a key, as in "left"')
        try:
            find_key(value)
        except UnknownNameError as error:
            raise DescriptionError(f"{self.path}: {name}: {error}") from None
        return value

    def take_keys(self) -> tuple[tuple[str, ...], ...]:
        players = self.take("keys", list, [])
        if not 0 < len(players) <= MAX_PLAYERS or not all(isinstance(p, list) for p in players):
            raise self.fail("keys", players, f"a list of keys for each of 1..{MAX_PLAYERS} players")
        if len({len(keys) for keys in players}) > 1 or len(players[0]) > MAX_KEYS:
            raise self.fail("keys", players, f"as many keys for each player, at most {MAX_KEYS}")
        return tuple(tuple(self.check_key("keys", key) for key in keys) for keys in players)

    def take_score(self) -> str | Region:
        score = self.take("score", (str, dict), "")
        return score if isinstance(score, str) else self.read_region("score", score)

    def read_region(self, name: str, table: Mapping[str, Any]) -> Region:
        values = table.get("region")
        return Region(*self.check_numbers(f"{name}.region", values, 4, 0, MAX_SIDE))

    def take_ending(self) -> str | Ending:
        done = self.take("done", (str, dict))
        if isinstance(done, str):
            return done
        if "scenes" in done:
            names = tuple(map(str, done.get("names", ())))
            return Ending(scenes=self.find_file("done.scenes", str(done["scenes"])), names=names)
        within = done.get("within", Ending.within)
        if not isinstance(within, int | float) or not 0 <= within <= 1:
            raise self.fail("done.within", within, "in 0..1")
        picture = self.find_file("done.picture", str(done.get("picture", "")))
        return Ending(self.read_region("done", done), picture, float(within))

    def read_entry(self, value: Any) -> Number:
        try:
            path, low, high, *second = value
            entry = Number(str(path), float(low), float(high), *map(str, second))
        except (TypeError, ValueError):
            allowed = f'["path", low, high], or with a second path or "{MIRRORED}" at the end'
            raise self.fail("numbers", value, allowed) from None
        if not entry.low < entry.high:
            raise self.fail("numbers", value, '["path", low, high] with low below high')
        return entry

    def finish(self, found: Description) -> None:
        """Check what depends on several entries."""
        for name in self.found:
            try:
                find_by_name("entry", name, dict.fromkeys(self.known))
            except UnknownNameError as error:
                raise DescriptionError(f"{self.path}: {error}") from None
        if not found.keys[0] and found.mouse_grid == (0, 0):
            raise self.fail("keys", [], "given, or mouse_grid")
        if (0 in found.mouse_grid) != (found.mouse_grid == (0, 0)):
            raise self.fail("mouse_grid", list(found.mouse_grid), "two numbers above 0")
        if not found.callback and isinstance(found.done, str):
            raise self.fail("callback", "", "given where `done` is an entry of what it returns")
        for name, part in (("score", found.score), ("done", found.done)):
            region = part if isinstance(part, Region) else getattr(part, "region", None)
            if region and not _fits(region, found.size):
                raise self.fail(f"{name}.region", list(region), f"within {list(found.size)} pixels")


def _fits(region: Region, size: tuple[int, int]) -> bool:
    right, bottom = region.x + region.width, region.y + region.height
    return bool(region.width and region.height) and right <= size[0] and bottom <= size[1]


class Stage(NamedTuple):
    """What a SWF needs to run: pixels, frames per second, how it is drawn."""

    title: str
    swf: Path
    size: tuple[int, int]
    fps: int
    renderer: Renderer = "canvas"


def find_stage(name: str) -> Stage:
    """The stage of a SWF, or of what `find_description` finds.

    Raises:
        DescriptionError: as `find_description` and `check_digest`.
        ValueError: the SWF is no Flash file.
        OSError: the SWF cannot be read.
    """
    if name.endswith(".swf"):
        swf = Path(name)
        header = read_header(swf)
        return Stage(swf.stem, swf, header.size, max(1, round(header.fps)))
    found = find_description(name)
    check_digest(found)
    return Stage(found.title, found.swf, found.size, found.fps, found.renderer)


def check_digest(description: Description) -> None:
    """Raise DescriptionError if the SWF is not the one that was described: agents and results of
    another one would be mixed up with its.
    """
    digest = hashlib.sha256(description.swf.read_bytes()).hexdigest()
    if digest != description.sha256:
        raise DescriptionError(
            f"{description.swf} has the SHA-256 {digest}, {description.path} describes "
            f"{description.sha256}: give back the file, or describe the new one with "
            "`marl-cair flash add`"
        )


def find_value(state: Any, path: str, missing: Callable[[], Any] | None = None) -> Any:
    """The value at a path ("balls.0.x") of nested dicts and lists; of none: `missing()`.

    Raises DescriptionError where there is none and no `missing` is given.
    """
    value = state
    for part in path.split("."):
        try:
            value = value[int(part)] if isinstance(value, list) else value[part]
        except (KeyError, IndexError, TypeError, ValueError):
            if missing is not None:
                return missing()
            raise DescriptionError(
                f"the SWF reports {state!r:.200}, which has no {path!r}"
            ) from None
    return value
