"""Games of other packages: their entry points, and what keeps one of them from being a game."""

from __future__ import annotations

import dataclasses
import re
import sys
from collections.abc import Mapping
from importlib.metadata import Distribution, EntryPoint, distributions, entry_points
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from marl_cair.games.game import Game

ENTRY_POINTS = "marl_cair.games"  # the group in which a package names its games
NAME_RULE = "begin with a letter or digit and go on with letters, digits, _, - and ."
_NAME = re.compile(r"[A-Za-z0-9][\w.-]*")  # a part of a Gymnasium id
_NAMES_OF_MODULE = ("SCENARIOS", "GYMNASIUM_PREFIX")  # beside GAME, which loads the rules
_VALUE = re.compile(r"[\w.]+(\s*:\s*[\w.]+)?(\s*\[.*\])?")  # module, module:attribute, extras


class PackageFault(ValueError):  # noqa: N818  # a finding, which a GameLoadError tells
    """What keeps a game of an installed package from being one, in words."""


def read_entry_points() -> tuple[list[EntryPoint], dict[str, Exception]]:
    """The entry points of games, sorted; and by package why its own cannot be read."""
    faults: dict[str, Exception] = {}
    try:
        found = list(entry_points(group=ENTRY_POINTS))
    except Exception:  # noqa: BLE001  # whatever is malformed: the others are read one by one
        found = _read_each(faults)
    return sorted(found, key=lambda point: (point.name, point.value)), faults


def _read_each(faults: dict[str, Exception]) -> list[EntryPoint]:
    """Those of each package that can be read; the others go into `faults`."""
    found: dict[str, list[EntryPoint]] = {}
    for distribution in distributions():
        package = name_package(distribution)
        if package in found or package in faults:  # installed twice: the first one is imported
            continue
        try:
            found[package] = list(distribution.entry_points.select(group=ENTRY_POINTS))
        except Exception as error:  # noqa: BLE001  # of its metadata, whatever it is
            faults[package] = error
    return [point for points in found.values() for point in points]


def name_package(distribution: Distribution | None) -> str:
    """The name under which a package is installed, as far as its metadata tell."""
    try:
        name = distribution.name if distribution is not None else None
    except Exception:  # noqa: BLE001  # of its metadata, whatever it is
        name = None
    return name or "an installed package"


def is_being_imported(point: EntryPoint) -> bool:
    """Whether some of the package that an entry point names is half imported at this moment."""
    package = point.value.partition(":")[0].partition(".")[0].strip()
    return any(
        # Python's own mark, which import_module reads too.
        getattr(getattr(module, "__spec__", None), "_initializing", False)
        for name, module in tuple(sys.modules.items())
        if name.partition(".")[0] == package
    )


def load_module(point: EntryPoint, others: Mapping[str, Any]) -> Any:
    """The module that an entry point names, which may be a game beside the others.

    Raises:
        PackageFault: it may not.
        BaseException: whatever the module raises when it is imported.
    """
    if not _VALUE.fullmatch(point.value):
        raise PackageFault(
            f"the value of its entry point is {point.value!r}, it must be a module (my_package"
            ".my_game) or module:attribute"
        )
    module = point.load()
    if fault := _find_fault(point.value, module, others):
        raise PackageFault(fault)
    return module


def _find_fault(path: str, module: Any, others: Mapping[str, Any]) -> str:
    """What keeps the module at `path` from being a game beside the others; "" for nothing."""
    if missing := [name for name in _NAMES_OF_MODULE if not hasattr(module, name)]:
        return f"{path} has no {' and no '.join(missing)}"
    prefix, scenarios = module.GYMNASIUM_PREFIX, module.SCENARIOS
    if not is_name(prefix):
        return f"its GYMNASIUM_PREFIX is {prefix!r}, it must {NAME_RULE}"
    for name, other in others.items():
        # Of two prefixes, one of which goes on where the other ends, ids may be the same too.
        taken = f"{other.GYMNASIUM_PREFIX}-"
        if taken.startswith(f"{prefix}-") or f"{prefix}-".startswith(taken):
            return (
                f"its GYMNASIUM_PREFIX {prefix!r} would give it the Gymnasium ids of {name} "
                f"({name_module(other)}, {other.GYMNASIUM_PREFIX!r}); it must take another"
            )
    if not isinstance(scenarios, Mapping) or not scenarios:
        return f"its SCENARIOS is {scenarios!r}, it must be a dict of scenarios by their names"
    for name, scenario in scenarios.items():
        if not is_name(name):
            return f"its SCENARIOS has the name {name!r}, a name must {NAME_RULE}"
        if not dataclasses.is_dataclass(scenario) or isinstance(scenario, type):
            return f"its scenario {name!r} is {scenario!r}, it must be an object of a dataclass"
    return ""


def is_name(name: object) -> bool:
    """Whether it may be a part of a Gymnasium id; NAME_RULE says what may."""
    return isinstance(name, str) and _NAME.fullmatch(name) is not None


def name_module(module: Any) -> str:
    """Its name; what an entry point names may be any object."""
    return getattr(module, "__name__", repr(module))


def load_game(name: str, module: Any) -> Game:
    """GAME of an installed package's module, which commands can list and describe.

    Raises:
        PackageFault: they cannot.
        BaseException: whatever its code raises.
    """
    from marl_cair.games.game import Game, GameSpec  # which imports `registry`

    game = module.GAME
    if not isinstance(game, Game):
        raise PackageFault(f"its GAME is {game!r}, it must be a marl_cair.games.game.Game")
    if game.name != name:
        raise PackageFault(f"its GAME.name is {game.name!r}, the entry point's {name!r}")
    if game.default_scenario not in game.scenarios:
        raise PackageFault(
            f"its GAME.default_scenario is {game.default_scenario!r}, it must be one of its "
            f"scenarios: {', '.join(game.scenarios)}"
        )
    spec: object = game.make_spec(game.scenario())
    if not isinstance(spec, GameSpec):
        raise PackageFault(f"its GAME.make_spec returns {spec!r}, it must return a GameSpec")
    return game
