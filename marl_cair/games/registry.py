"""Which games there are: ours and those of installed packages; and scenarios that users add."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable, Iterator, Mapping, MutableMapping
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import EntryPoint
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeVar

from marl_cair.games.checks.scenario import change_scenario
from marl_cair.games.game_packages import (
    NAME_RULE,
    PackageFault,
    is_being_imported,
    is_name,
    load_game,
    load_module,
    name_module,
    name_package,
    read_entry_points,
)
from marl_cair.lookup import find_by_name

if TYPE_CHECKING:
    from marl_cair.games.game import Game

_OWN = {
    "deep_line_wars": "marl_cair.games.deep_line_wars",
    "deep_rts": "marl_cair.games.deep_rts",
    "deep_maze": "marl_cair.games.deep_maze",
    "flappy_bird": "marl_cair.games.flappy_bird",
}
_MEND = "Repair or uninstall that package; all other games are there"

Answer = TypeVar("Answer")


class GameLoadError(ValueError):
    """A game of an installed package that cannot be loaded; names the package and the cause."""


class BrokenGameWarning(UserWarning):
    """An installed package has a game that is left out, as it cannot be loaded."""


class Games(Mapping[str, "Game"]):
    """The games by name, each loaded when it is asked for.

    An installed package adds a game by an entry point of the group `marl_cair.games`: its name is
    the game's, its value a module with GAME, SCENARIOS and GYMNASIUM_PREFIX, as ours have it. One
    that fails is left out with a warning, and says why when it is asked for by name. One that is
    half imported, as it imports this package itself, is added by the first look-up after that.
    """

    def __init__(self) -> None:
        self._modules: dict[str, ModuleType] = {}
        self._waiting: list[EntryPoint] | None = None  # to be loaded; None: they are not read yet
        self._is_adding = False
        self._tell: Callable[[str, ModuleType], None] | None = None
        self._foreign: dict[str, EntryPoint] = {}
        self._checked: set[str] = set()
        self._broken: dict[str, GameLoadError] = {}

    @property
    def modules(self) -> Mapping[str, ModuleType]:
        """The games' packages, which know their scenarios without loading their rules."""
        self._add_missing()
        return self._modules

    def announce(self, tell: Callable[[str, ModuleType], None]) -> None:
        """Call `tell` with the name and the package of each game, and of each added later."""
        known, self._tell = tuple(self._modules.items()), tell
        for name, module in known:
            with self._guard(name):
                tell(name, module)
        self._add_missing()

    def _add_missing(self) -> None:
        # A package that looks games up while it is imported for us finds those that are there.
        if self._waiting == [] or self._is_adding:
            return
        self._is_adding = True
        try:
            self._add_all()
        finally:
            self._is_adding = False

    def _add_all(self) -> None:
        """Ours first: other packages may use them while they are imported."""
        if self._waiting is None:
            for name, path in _OWN.items():
                self._add(name, import_module(path))
            self._waiting, faults = read_entry_points()
            for package, fault in faults.items():
                _warn(f"the entry points of {package} cannot be read: {fault!r}. {_MEND}")
        kept: list[EntryPoint] = []
        for point in tuple(self._waiting):
            if is_being_imported(point) or point.name in {other.name for other in kept}:
                kept.append(point)
                continue
            self._add_foreign(point)
            self._waiting.remove(point)

    def _add(self, name: str, module: ModuleType) -> None:
        self._modules[name] = module
        if self._tell is not None:
            self._tell(name, module)

    def _add_foreign(self, point: EntryPoint) -> None:
        if point.name in self._modules:
            clash = f"{name_module(self._modules[point.name])} has that name already"
            _warn(str(_describe(point, f"{clash}: rename the entry point and its game")))
            return
        self._foreign[point.name] = point
        with self._guard(point.name):
            self._add(point.name, load_module(point, self._modules))

    @contextmanager
    def _guard(self, name: str) -> Iterator[None]:
        """Leave out a game of an installed package whose code fails in here; ours raise."""
        try:
            yield
        except (KeyboardInterrupt, GeneratorExit):
            raise
        except BaseException as error:
            if name not in self._foreign:
                raise
            self._leave_out(name, error)

    def _leave_out(self, name: str, cause: BaseException) -> None:
        why = str(cause) if isinstance(cause, PackageFault) else repr(cause)
        error = self._broken[name] = _describe(self._foreign[name], why)
        error.__cause__ = cause
        self._modules.pop(name, None)
        _warn(str(error))

    def __getitem__(self, name: str) -> Game:
        if name not in self.modules and name in self._broken:
            raise self._broken[name]
        module = find_by_name("game", name, self.modules)
        if name not in self._foreign or name in self._checked:
            game: Game = module.GAME
            return game
        self._checked.add(name)  # before: its code may ask for it
        with self._guard(name):
            return load_game(name, module)
        raise self._broken[name]

    def __contains__(self, name: object) -> bool:
        return name in self.modules

    def __iter__(self) -> Iterator[str]:
        return iter(tuple(self.modules))

    def __len__(self) -> int:
        return len(self.modules)

    def load_own(self) -> list[Game]:
        """The games of this package."""
        return [self[name] for name in _OWN]

    def load_all(self) -> dict[str, Game]:
        """All games that can be loaded; the others have warned."""
        return self.ask_each(lambda game: game)

    def ask(self, name: str, question: Callable[[Game], Answer]) -> Answer:
        """What `question` returns for a game.

        Raises:
            UnknownNameError: no such game; names the nearest.
            GameLoadError: it is of an installed package, and fails; it is left out from then on.
        """
        game = self[name]
        with self._guard(name):
            return question(game)
        raise self._broken[name]

    def ask_each(self, question: Callable[[Game], Answer]) -> dict[str, Answer]:
        """What `question` returns for each game by name; those that fail warn and are left out."""
        told = {}
        for name in self:
            try:
                told[name] = self.ask(name, question)
            except GameLoadError:
                continue
        return told


def _describe(point: EntryPoint, why: str) -> GameLoadError:
    return GameLoadError(
        f"the game {point.name!r} of {name_package(point.dist)} ({point.value}) cannot be loaded: "
        f"{why}. {_MEND}"
    )


def _warn(message: str) -> None:
    """Warn, and raise nothing where warnings are errors: then print it, and go on with ours."""
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
    """Name a configuration of a game, for this process; returns the id that Gymnasium is to use.

    Args:
        game: a name in GAMES.
        name: letters, digits, `_`, `-` and `.`.
        base: the scenario that `options` change (default: the game's first).
        options: fields of the scenario.

    Raises:
        UnknownNameError: no such game, base or option; names the nearest.
        ValueError: the name is taken or no name, an option's value is not allowed, or the game
            takes no scenarios.
    """
    module = find_by_name("game", game, GAMES.modules)
    scenarios: Any = module.SCENARIOS
    if not isinstance(scenarios, MutableMapping):
        raise ValueError(
            f"{game} takes no scenarios of its users, its SCENARIOS is a "
            f"{type(scenarios).__name__} that cannot be changed: give the options where you name "
            "the scenario, as in make_engine"
        )
    if not is_name(name):
        raise ValueError(f"{game}: {name!r} is no name of a scenario: {NAME_RULE}")
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
    """What makes a scenario in any process: its game, and its name there.

    Of one that was added the name of the game's own that it goes back to, and all options that make
    it of that.
    """
    if (game, name) not in _bases:
        return {"game": game, "scenario": name}
    scenarios, base = GAMES.modules[game].SCENARIOS, _bases[game, name]
    options = _list_differences(scenarios[name], scenarios[base])
    # Fields that follow others may be what they are in the base, and only there.
    made = change_scenario(game, scenarios[base], options)
    return {"game": game, "scenario": base, **options, **_list_differences(scenarios[name], made)}


def _list_differences(scenario: Any, other: Any) -> dict[str, Any]:
    """The fields of `scenario` that have another value in `other`."""
    names = [field.name for field in dataclasses.fields(scenario) if field.init]
    values = {name: getattr(scenario, name) for name in names}
    return {name: value for name, value in values.items() if value != getattr(other, name)}
