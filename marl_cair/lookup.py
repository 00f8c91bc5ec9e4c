"""Tables by name: errors with the nearest names, and entries that are imported when used."""

import difflib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import cached_property
from importlib import import_module
from importlib.metadata import EntryPoint
from itertools import chain
from typing import Any, TypeVar

from marl_cair import outside

T = TypeVar("T")

MAX_NEAREST = 3
MAX_LISTED = 24  # of more names only the nearest are listed
MIN_SIMILARITY = 0.5  # difflib's ratio, 0..1: "linewars" still finds "deep_line_wars"


class UnknownNameError(ValueError):
    """A name that is not in a table; the message lists the nearest and all known names."""


class UnknownOptionError(UnknownNameError, TypeError):
    """A keyword argument that is no option: a TypeError too, as Python raises in such a call."""


class LazyTable(Mapping[str, T]):
    """A table whose entries are imported when they are looked up.

    With a `group` it is open: installed packages add names by entry points of that group, and
    "module:attribute" is a name too, of any module that Python finds. The names of `places` come
    first. A broken entry point raises only when it is looked up.

    places: name -> "module:attribute", or the entry itself.
    group: of entry points, for example "marl_cair.networks"; "": the table is closed.
    base: "module:class", of which an entry from outside must be a subclass; "": any callable.
    flags: attributes that the class of an entry from outside must have, each True or False.
    """

    def __init__(
        self,
        places: Mapping[str, str | T],
        group: str = "",
        base: str = "",
        flags: Collection[str] = (),
    ) -> None:
        self._places = dict(places)
        self._group, self._base, self._flags = group, base, flags

    @cached_property
    def _points(self) -> dict[str, EntryPoint]:
        return outside.find_points(self._group, self._places) if self._group else {}

    def __getitem__(self, name: str) -> T:
        if name in self._places:
            place = self._places[name]
            entry: T = import_place(place) if isinstance(place, str) else place
            return entry
        if name in self._points:
            found = outside.load_point(self._points[name])
        elif name in self:
            found = outside.import_outside(name)
        else:
            raise KeyError(name)
        return self._check_kind(name, found)

    def _check_kind(self, name: str, found: Any) -> T:
        if self._base:
            base = import_place(self._base)
            holds = isinstance(found, type) and issubclass(found, base)
            needed = f"a subclass of {self._base.replace(':', '.')}"
        else:
            holds, needed = callable(found), "a function or a class"
        if not holds:
            raise outside.OutsideCodeError(f"{name} is {found!r:.80}, it must be {needed}")
        for flag in self._flags:
            if not isinstance(getattr(found, flag, None), bool):
                raise outside.OutsideCodeError(
                    f"{name} has {flag} {getattr(found, flag, 'not set')!r:.80}: set it to True or "
                    "False in the class"
                )
        entry: T = found
        return entry

    def is_outside(self, name: str) -> bool:
        """Whether the entry is of an installed package or a "module:attribute"."""
        return name in self and name not in self._places

    def make(self, name: str, *arguments: Any) -> Any:
        """Call the entry. Raises OutsideCodeError for any error of one from outside."""
        entry: Any = self[name]
        if not self.is_outside(name):
            return entry(*arguments)
        with outside.outside_call(f"{name} failed when it was made"):
            return entry(*arguments)

    def __contains__(self, name: object) -> bool:
        is_known = name in self._places or name in self._points
        return is_known or (bool(self._group) and outside.is_place(name))

    def __iter__(self) -> Iterator[str]:
        return iter([*self._places, *self._points])

    def __len__(self) -> int:
        return len(self._places) + len(self._points)


def import_place(place: str) -> Any:
    """The object at "module:attribute"."""
    module, _, attribute = place.partition(":")
    return getattr(import_module(module), attribute)


def import_when_used(module: str, places: Mapping[str, str]) -> Callable[[str], Any]:
    """The `__getattr__` of a module: names of `places` ("module:attribute") are imported when they
    are used, because that takes seconds.
    """

    def find(name: str) -> Any:
        if name in places:
            return import_place(places[name])
        raise AttributeError(f"module {module!r} has no attribute {name!r}")

    return find


def check_name(kind: str, name: str, *known: Collection[str]) -> None:
    """Raise UnknownNameError, as `find_by_name`, for a name that is in none of `known`."""
    if not (isinstance(name, str) and any(name in names for names in known)):
        raise UnknownNameError(_describe_unknown(kind, name, chain(*known)))


def find_by_name(kind: str, name: str, table: Mapping[str, T]) -> T:
    """Return `table[name]`. Raises UnknownNameError with the nearest names, if any, and all names;
    `kind` ("game", "network", ...) is the table's name in the error.
    """
    if isinstance(name, str) and name in table:
        return table[name]
    raise UnknownNameError(_describe_unknown(kind, name, table))


def _describe_unknown(kind: str, name: object, known: Iterable[str]) -> str:
    names = list(dict.fromkeys(known))
    nearest = _nearest_names(name, names) if isinstance(name, str) else []
    hint = f"nearest are {', '.join(map(repr, nearest))}; " if nearest else ""
    if nearest and len(names) > MAX_LISTED:
        return f"unknown {kind} {name!r}: {hint.rstrip('; ')}"
    return f"unknown {kind} {name!r}: {hint}known are {', '.join(map(repr, names)) or 'none'}"


def _nearest_names(name: str, names: list[str]) -> list[str]:
    """Up to MAX_NEAREST of `names`, best first; letter case and the kind of dash do not count.

    Those that begin with `name` come first. Of "learner.gamma" as many parts as `name` has count.
    """
    typed = _plain_spelling(name)
    num_parts = typed.count(".") + 1
    by_end: dict[str, list[str]] = {}
    for candidate in names:
        end = ".".join(_plain_spelling(candidate).split(".")[-num_parts:])
        by_end.setdefault(end, []).append(candidate)
    close = difflib.get_close_matches(typed, by_end, MAX_NEAREST, MIN_SIMILARITY)
    longer = [end for end in by_end if typed and end.startswith(typed)]
    begins = typed.replace(".", "_")
    whole = [n for n in names if typed and _plain_spelling(n).replace(".", "_").startswith(begins)]
    ends = dict.fromkeys([*sorted(longer, key=lambda end: end != typed), *close])
    ranked = [*(n for n in whole if "." in n), *(n for end in ends for n in by_end[end])]
    return list(dict.fromkeys(ranked))[:MAX_NEAREST]


def _plain_spelling(name: str) -> str:
    return name.casefold().replace("-", "_").replace(" ", "_")
