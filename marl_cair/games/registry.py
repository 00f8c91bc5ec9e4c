"""Which games there are: ours and those of installed packages; and scenarios that users add."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator, Mapping, MutableMapping
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from types import ModuleType
from typing import TYPE_CHECKING, Any

from marl_cair.games.scenario_checks import change_scenario
from marl_cair.lookup import find_by_name

if TYPE_CHECKING:
    from marl_cair.games.game import Game

ENTRY_POINTS = "marl_cair.games"  # the group in which a package names its games
_OWN = {
    "deep_line_wars": "marl_cair.games.deep_line_wars",
    "deep_rts": "marl_cair.games.deep_rts",
    "deep_maze": "marl_cair.games.deep_maze",
    "flappy_bird": "marl_cair.games.flappy_bird",
}
_NAMES_OF_MODULE = ("SCENARIOS", "GYMNASIUM_PREFIX")  # beside GAME, which loads the rules
_NAME = re.compile(r"[A-Za-z0-9][\w.-]*")  # a part of a Gymnasium id
_NAME_RULE = "begin with a letter or digit and go on with letters, digits, _, - and ."


class GameLoadError(ValueError):
    """A game of an installed package that cannot be loaded; names the package and the cause."""


class BrokenGameWarning(UserWarning):
    """An installed package has a game that is left out, as it cannot be loaded."""


class Games(Mapping[str, "Game"]):
    """The games by name, each loaded when it is asked for.

    An installed package adds a game by an entry point of the group `marl_cair.games`: its name is
    the game's, its value a module with GAME, SCENARIOS and GYMNASIUM_PREFIX, as ours have it. One
    that fails is left out with a warning, and says why when it is asked for by name.
    """

    def __init__(self) -> None:
        self._modules: dict[str, ModuleType] | None = None
        self._foreign: dict[str, EntryPoint] = {}
        self._broken: dict[str, GameLoadError] = {}

    @property
    def modules(self) -> Mapping[str, ModuleType]:
        """The games' packages, which know their scenarios without loading their rules."""
        if self._modules is None:
            modules = {name: import_module(path) for name, path in _OWN.items()}
            for point in sorted(entry_points(group=ENTRY_POINTS), key=lambda point: point.name):
                self._add_foreign(point, modules)
            self._modules = modules
        return self._modules

    def _add_foreign(self, point: EntryPoint, modules: dict[str, ModuleType]) -> None:
        if point.name in modules:
            clash = f"{modules[point.name].__name__} has that name already"
            self._leave_out(point.name, point, f"{clash}: rename the entry point and its game")
            return
        try:
            module = point.load()
            fault = _find_fault(point.value, module, modules)
        except (Exception, SystemExit) as error:  # noqa: BLE001  # our games must go on
            self._leave_out(point.name, point, repr(error), error)
            return
        if fault:
            self._leave_out(point.name, point, fault)
            return
        self._foreign[point.name] = point
        modules[point.name] = module

    def leave_out(self, name: str, cause: BaseException) -> None:
        """Go on without a game of an installed package that fails with `cause`, and warn of it.

        Raises:
            BaseException: `cause`, where the game is one of ours.
        """
        if name not in self._foreign:
            raise cause
        self._leave_out(name, self._foreign[name], repr(cause), cause)

    def _leave_out(
        self, name: str, point: EntryPoint, why: str, cause: BaseException | None = None
    ) -> None:
        package = point.dist.name if point.dist is not None else "an installed package"
        error = GameLoadError(
            f"the game {name!r} of {package} ({point.value}) cannot be loaded: {why}. Repair or "
            "uninstall that package; all other games are there"
        )
        error.__cause__ = cause
        self._broken.setdefault(name, error)
        if self._modules is not None and name in self._foreign:
            self._modules.pop(name, None)
        warnings.warn(str(error), BrokenGameWarning, stacklevel=2)

    def __getitem__(self, name: str) -> Game:
        if name not in self.modules and name in self._broken:
            raise self._broken[name]
        module = find_by_name("game", name, self.modules)
        if name not in self._foreign:
            own: Game = module.GAME
            return own
        try:
            game: Game = module.GAME
            if game.name != name:
                raise ValueError(f"its GAME.name is {game.name!r}, the entry point's {name!r}")
        except (Exception, SystemExit) as error:
            self.leave_out(name, error)
            raise self._broken[name] from error
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

    def load_all(self) -> dict[str, Game]:
        """All games that can be loaded; the others have warned."""
        loaded = {}
        for name in self:
            try:
                loaded[name] = self[name]
            except GameLoadError:
                continue
        return loaded


def _find_fault(path: str, module: Any, others: Mapping[str, ModuleType]) -> str:
    """What keeps the module at `path` from being a game beside the others; "" for nothing."""
    if missing := [name for name in _NAMES_OF_MODULE if not hasattr(module, name)]:
        return f"{path} has no {' and no '.join(missing)}"
    prefix, scenarios = module.GYMNASIUM_PREFIX, module.SCENARIOS
    if not _is_name(prefix):
        return f"its GYMNASIUM_PREFIX is {prefix!r}, it must {_NAME_RULE}"
    for name, other in others.items():
        # Of two prefixes, one of which goes on where the other ends, ids may be the same too.
        taken = f"{other.GYMNASIUM_PREFIX}-"
        if taken.startswith(f"{prefix}-") or f"{prefix}-".startswith(taken):
            return (
                f"its GYMNASIUM_PREFIX {prefix!r} would give it the Gymnasium ids of {name} "
                f"({other.__name__}, {other.GYMNASIUM_PREFIX!r}); it must take another"
            )
    if not isinstance(scenarios, Mapping) or not scenarios:
        return f"its SCENARIOS is {scenarios!r}, it must be a dict of scenarios by their names"
    for name in scenarios:
        if not _is_name(name):
            return f"its SCENARIOS has the name {name!r}, a name must {_NAME_RULE}"
    return ""


def _is_name(name: object) -> bool:
    return isinstance(name, str) and _NAME.fullmatch(name) is not None


GAMES = Games()


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
    if not _is_name(name):
        raise ValueError(f"{game}: {name!r} is no name of a scenario: {_NAME_RULE}")
    if name in scenarios:
        raise ValueError(f"{game} has a scenario {name!r} already: choose another name")
    chosen = find_by_name(f"{game} scenario", base or next(iter(scenarios)), scenarios)
    scenarios[name] = change_scenario(game, chosen, options)
    return gymnasium_id(module.GYMNASIUM_PREFIX, name)


def gymnasium_id(prefix: str, scenario: str) -> str:
    """For example marl_cair/DeepRTS-1v1-15x15-v0."""
    return f"marl_cair/{prefix}-{scenario}-v0"
