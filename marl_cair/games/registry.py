"""The table of games (ours and those of installed packages), and scenarios that users add."""

from __future__ import annotations

import dataclasses
import re
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from contextlib import suppress
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeVar

from marl_cair.games.checks.scenario import change_scenario
from marl_cair.lookup import find_by_name

if TYPE_CHECKING:
    from marl_cair.games.game import Game

ENTRY_POINTS = "marl_cair.games"  # the group in which a package lists its games
_OWN = ("deep_line_wars", "deep_rts", "deep_maze", "flappy_bird", "flash")
_NAME = re.compile(r"[A-Za-z0-9][\w.-]*")  # a part of a Gymnasium id
_NAME_RULE = "it must start with a letter or digit and contain only letters, digits, _, - and ."

T = TypeVar("T")


class GameLoadError(ValueError):
    """A game of an installed package that cannot be loaded; names the package and the cause."""


class BrokenGameWarning(UserWarning):
    """A game of an installed package is left out because it cannot be loaded."""


class Games(Mapping[str, "Game"]):
    """The games by name; a lookup loads the game's rules.

    An installed package adds a game by an entry point of the group `marl_cair.games`: its name is
    the game's, its value a module with GAME, SCENARIOS and GYMNASIUM_PREFIX. A game that fails is
    left out with a warning; looking it up by name raises its error.
    """

    def __init__(self) -> None:
        self._modules: dict[str, ModuleType] = {}
        self._points: dict[str, EntryPoint] = {}  # of the games of installed packages
        self._broken: dict[str, GameLoadError] = {}
        self._on_add: Callable[[str, ModuleType], None] | None = None
        self._checked: set[str] = set()
        self._waiting: list[EntryPoint] | None = None  # to be loaded; None: not read yet

    @property
    def modules(self) -> Mapping[str, ModuleType]:
        """The games' packages by name, which list scenarios without loading rules."""
        if self._waiting is None:
            self._waiting = []  # a package may look games up while it is imported
            for name in _OWN:
                self._add(name, import_module(f"marl_cair.games.{name}"))
            self._waiting = sorted(entry_points(group=ENTRY_POINTS))
        for point in tuple(self._waiting):
            if point in self._waiting and not _is_being_imported(point):
                self._waiting.remove(point)
                self._add_foreign(point)
        return self._modules

    def on_add(self, register: Callable[[str, ModuleType], None]) -> None:
        """Call `register` with the name and the package of each game."""
        known, self._on_add = tuple(self._modules.items()), register
        for name, module in known:
            register(name, module)
        _ = self.modules

    def _add(self, name: str, module: ModuleType) -> None:
        self._modules[name] = module
        if self._on_add is not None:
            self._on_add(name, module)

    def _add_foreign(self, point: EntryPoint) -> None:
        if point.name in self._modules:
            _warn(str(_describe(point, f"there is a game {point.name!r} already: rename it")))
            return
        self._points[point.name] = point
        try:
            module = point.load()
            _check_module(module, self._modules)
            self._add(point.name, module)
        except Exception as error:  # noqa: BLE001  # whatever its code raises
            self._leave_out(point.name, error)

    def _leave_out(self, name: str, cause: Exception) -> GameLoadError:
        error = self._broken[name] = _describe(self._points[name], repr(cause))
        error.__cause__ = cause
        self._modules.pop(name, None)
        _warn(str(error))
        return error

    def __getitem__(self, name: str) -> Game:
        if name not in self.modules and name in self._broken:
            raise self._broken[name]
        module = find_by_name("game", name, self.modules)
        if name not in self._points or name in self._checked:
            known: Game = module.GAME
            return known
        self._checked.add(name)  # first: its code may look it up
        try:
            game: Game = module.GAME
            if game.name != name:
                raise ValueError(f"GAME.name is {game.name!r}, the entry point's {name!r}")
            game.make_spec(game.scenario())
        except Exception as error:  # whatever its code raises
            raise self._leave_out(name, error) from error
        return game

    def __contains__(self, name: object) -> bool:
        return name in self.modules

    def __iter__(self) -> Iterator[str]:
        return iter(tuple(self.modules))

    def __len__(self) -> int:
        return len(self.modules)

    def load_own(self) -> list[Game]:
        """The games of this package."""
        return [self[name] for name in _OWN]

    def apply(self, name: str, function: Callable[[Game], T]) -> T:
        """`function` of a game.

        Raises:
            UnknownNameError: no such game; names the nearest.
            GameLoadError: a game of an installed package fails; it is left out from then on.
        """
        game = self[name]
        try:
            return function(game)
        except Exception as error:
            if name not in self._points:
                raise
            raise self._leave_out(name, error) from error

    def apply_to_all(self, function: Callable[[Game], T]) -> dict[str, T]:
        """`function` of each game by name, without the games that fail."""
        results = {}
        for name in self:
            with suppress(GameLoadError):
                results[name] = self.apply(name, function)
        return results


def _is_being_imported(point: EntryPoint) -> bool:
    """True while a user imports the package, which imports this one: its game is added later."""
    package = point.value.partition(":")[0].partition(".")[0].strip()
    return any(
        getattr(getattr(module, "__spec__", None), "_initializing", False)
        for name, module in tuple(sys.modules.items())
        if name.partition(".")[0] == package
    )


def _check_module(module: Any, others: Mapping[str, Any]) -> None:
    """Raise ValueError or AttributeError unless a package's module can be a game."""
    prefix, scenarios = module.GYMNASIUM_PREFIX, module.SCENARIOS
    if prefix in {other.GYMNASIUM_PREFIX for other in others.values()}:
        raise ValueError(f"another game has the GYMNASIUM_PREFIX {prefix!r}")
    for name in (prefix, *scenarios):
        if not _is_name(name):
            raise ValueError(f"{name!r} is not a valid name: {_NAME_RULE}")
    for name, scenario in scenarios.items():
        if not dataclasses.is_dataclass(scenario):
            raise ValueError(f"the scenario {name!r} is {scenario!r}, it must be a dataclass")


def _is_name(name: object) -> bool:
    return isinstance(name, str) and _NAME.fullmatch(name) is not None


def _describe(point: EntryPoint, cause: str) -> GameLoadError:
    package = point.dist.name if point.dist else "an installed package"
    return GameLoadError(
        f"the game {point.name!r} of {package} ({point.value}) cannot be loaded: {cause}. Fix or "
        "uninstall that package; the other games are available"
    )


def _warn(message: str) -> None:
    """Warn; print where warnings are errors, so that the other games stay available."""
    try:
        warnings.warn(message, BrokenGameWarning, stacklevel=2)
    except BrokenGameWarning:
        warnings.showwarning(message, BrokenGameWarning, __file__, 0)


GAMES = Games()
_bases: dict[tuple[str, str], str] = {}  # (game, scenario that was added) -> one that was not


def find_game(name: str) -> Game:
    """`GAMES[name]`, by which games are pickled."""
    return GAMES[name]


def add_scenario(game: str, name: str, base: str | None = None, **options: Any) -> str:
    """Add a scenario to a game; arguments, result and errors as of `marl_cair.register_scenario`,
    which also registers it with Gymnasium.
    """
    module = find_by_name("game", game, GAMES.modules)
    scenarios: Any = module.SCENARIOS
    if not isinstance(scenarios, MutableMapping):
        raise ValueError(
            f"{game} takes no new scenarios, its SCENARIOS is a {type(scenarios).__name__} that "
            "cannot be changed: pass the options with the scenario, as to make_engine"
        )
    if not _is_name(name):
        raise ValueError(f"{game}: {name!r} is not a valid scenario name: {_NAME_RULE}")
    if name in scenarios:
        raise ValueError(f"{game} has a scenario {name!r} already: choose another name")
    base = base or next(iter(scenarios))
    chosen = find_by_name(f"{game} scenario", base, scenarios)
    scenarios[name] = change_scenario(game, chosen, options)
    _bases[game, name] = _bases.get((game, base), base)
    return gymnasium_id(module.GYMNASIUM_PREFIX, name)


def gymnasium_id(prefix: str, scenario: str) -> str:
    """For example marl_cair/DeepRTS-1v1-15x15-v0."""
    return f"marl_cair/{prefix}-{scenario}-v0"


def describe_scenario(game: str, name: str) -> dict[str, Any]:
    """The keyword arguments of `make_engine` that make a scenario in any process: of an added one,
    the game's own scenario that it is based on, and all options that differ.
    """
    if (game, name) not in _bases:
        return {"game": game, "scenario": name}
    scenarios, base = GAMES.modules[game].SCENARIOS, _bases[game, name]
    options = _list_differences(scenarios[name], scenarios[base])
    # Fields that follow others may equal the base's and still differ from what they would become.
    made = change_scenario(game, scenarios[base], options)
    return {"game": game, "scenario": base, **options, **_list_differences(scenarios[name], made)}


def _list_differences(scenario: Any, other: Any) -> dict[str, Any]:
    """The fields of `scenario` that have another value in `other`."""
    names = [field.name for field in dataclasses.fields(scenario) if field.init]
    values = {name: getattr(scenario, name) for name in names}
    return {name: value for name, value in values.items() if value != getattr(other, name)}
