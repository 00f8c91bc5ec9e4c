"""Code from outside the package: names `module:attribute`, entry points and permission to run."""

from __future__ import annotations

import os
import re
import sys
import traceback
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from marl_cair.text import clean_text

# Environment variable: names `module:attribute`, divided by commas, that files may make run.
# Worker processes inherit it.
ALLOWED = "MARL_CAIR_ALLOW_CODE"
_IMPORTED = "MARL_CAIR_IMPORTED_CODE"  # the same for `agent.json` alone

# Packages whose lines are not the user's, beside those that come with Python.
_NOT_THEIRS = "marl_cair", "torch", "tensordict", "torchrl", "numpy"


class CodeNotAllowedError(ValueError):
    """A file names code that the user has neither named nor allowed."""


class OutsideCodeError(ValueError):
    """Code of a user or of an installed package that is missing, of a wrong kind, or fails."""


@contextmanager
def outside_call(what: str) -> Iterator[None]:
    """Turn whatever the user's code raises into an OutsideCodeError that begins with `what` and
    ends with the file and line in the user's code.
    """
    try:
        yield
    except OutsideCodeError:
        raise
    except Exception as error:
        place = find_line(error)
        raise OutsideCodeError(f"{what}: {type(error).__name__}: {error}{place}") from error


def find_line(error: Exception) -> str:
    """Where the user's code raised it: " (FILE, line N)"; "" if it did not."""
    modules = [sys.modules[name] for name in _NOT_THEIRS if name in sys.modules]
    known = tuple(f"{Path(str(module.__file__)).parent}{os.sep}" for module in modules)
    frames = traceback.extract_tb(error.__traceback__)
    theirs = [one for one in frames if not one.filename.startswith((*known, "<"))]
    python = f"{Path(os.__file__).parent}{os.sep}"  # installed packages may lie below it
    theirs = [
        one for one in theirs if not re.match(rf"{re.escape(python)}(?!\w+-packages)", one.filename)
    ]
    lines = [one for one in theirs if one.filename == theirs[0].filename]
    return f" ({lines[-1].filename}, line {lines[-1].lineno})" if lines else ""


def is_place(name: object) -> bool:
    """Whether `name` is written as `package.module:attribute`."""
    module, colon, attribute = str(name).partition(":")
    parts = (*module.split("."), attribute)
    return isinstance(name, str) and bool(colon) and all(map(str.isidentifier, parts))


def import_outside(place: str) -> Any:
    """The object at `module:attribute`, of a module that Python finds or of the current folder.

    Raises OutsideCodeError with the cause, and how to make the module known.
    """
    module, _, attribute = place.partition(":")
    search_current_folder()
    try:
        found = import_module(module)
    except Exception as error:  # whatever the user's code raises
        raise OutsideCodeError(
            f"{place} cannot be imported ({type(error).__name__}: {error}): install the package of "
            f"module {module!r}, or put its folder on PYTHONPATH"
        ) from error
    if not hasattr(found, attribute):
        file = getattr(found, "__file__", module)
        raise OutsideCodeError(f"{place}: {file} has no {attribute!r}; correct the name")
    return getattr(found, attribute)


def search_current_folder() -> None:
    """Let Python find modules in the current folder, after all others."""
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.append(here)


def read_code(place: str) -> bytes:
    """The source of the module of an imported `module:attribute`; empty if it has no file."""
    file = getattr(sys.modules.get(place.partition(":")[0]), "__file__", None)
    return Path(file).read_bytes() if file else b""


def find_points(group: str, own: Iterable[str]) -> dict[str, EntryPoint]:
    """Entry points of `group` by name, in alphabetical order; nothing is imported.

    Warns about those with a name that this package (`own`) or another entry point has already.
    """
    points: dict[str, EntryPoint] = {}
    taken = set(own)
    for point in sorted(entry_points(group=group)):
        if point.name in taken:
            text = f"{describe_point(point)} is not used: {point.name!r} exists already, rename it"
            warnings.warn(text, UserWarning, stacklevel=2)
            continue
        taken.add(point.name)
        points[point.name] = point
    return points


def load_point(point: EntryPoint) -> Any:
    """The object of an entry point. Raises OutsideCodeError that names its package."""
    try:
        return point.load()
    except Exception as error:  # whatever the package's code raises
        raise OutsideCodeError(
            f"{describe_point(point)} cannot be loaded ({type(error).__name__}: {error}): fix or "
            "uninstall that package"
        ) from error


def describe_point(point: EntryPoint) -> str:
    """An entry point in words: name, group, place and package."""
    package = point.dist.name if point.dist else "an installed package"
    return f"{point.name!r} of {point.group} in {package} ({point.value})"


def allow_code(*places: str) -> None:
    """Let files, such as `agent.json` of a checkpoint, name the classes `module:attribute`, in this
    process and in those that it starts. Only for code that you trust.
    """
    _add(ALLOWED, places)


def require_known(places: Iterable[str], file: str | os.PathLike[str]) -> None:
    """Raise CodeNotAllowedError if one of `places`, which `file` names, is neither allowed nor of a
    module that this process has imported already.
    """
    known = *list_allowed(), *_read(_IMPORTED)
    missing = []
    for place in places:
        if place.partition(":")[0] in sys.modules:
            _add(_IMPORTED, [place])  # for the workers of this process
        elif place not in known:
            missing.append(place)
    if missing:
        listed = ",".join(map(clean_text, missing))
        raise CodeNotAllowedError(
            f"{file} names code, which runs only if you allow it: {listed}. If you trust it, set "
            f"the environment variable {ALLOWED}={listed}, or import its module first"
        )


def list_allowed() -> list[str]:
    """The names that `allow_code` has allowed."""
    return _read(ALLOWED)


def _read(variable: str) -> list[str]:
    return [place for place in os.environ.get(variable, "").split(",") if place]


def _add(variable: str, places: Iterable[str]) -> None:
    os.environ[variable] = ",".join(dict.fromkeys([*_read(variable), *places]))
