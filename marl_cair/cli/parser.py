"""`Parser`: an argument parser that refuses abbreviated, repeated and misspelt options."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NoReturn

from marl_cair.lookup import find_by_name

_REPEATABLE = "--set"
_UNKNOWN = "unrecognized arguments: "


class Parser(argparse.ArgumentParser):
    """As argparse's, but abbreviated and repeated options are errors, and the error of an unknown
    option names the nearest.
    """

    def __init__(self, prog: str | None = None, **options: Any) -> None:
        super().__init__(prog, allow_abbrev=False, **options)

    def parse_known_args(  # type: ignore[override]  # argparse's overloads
        self, args: Sequence[str] | None = None, namespace: argparse.Namespace | None = None
    ) -> tuple[argparse.Namespace, list[str]]:
        """As argparse's. Exits with code 2 where an option is given twice."""
        words = list(sys.argv[1:] if args is None else args)
        words = words[: words.index("--")] if "--" in words else words
        places: dict[str, int] = {}
        for place, word in enumerate(words):
            flag = word.partition("=")[0]
            if flag in places and flag in self._option_string_actions and flag != _REPEATABLE:
                first, second = (_quote(words, at) for at in (places[flag], place))
                self.error(f"{flag} is given twice, as {first!r} and as {second!r}: give it once")
            places[flag] = place
        return super().parse_known_args(args, namespace)

    def error(self, message: str) -> NoReturn:
        """Exit with code 2; of an unknown option the message names the nearest."""
        unknown = re.match(rf"{_UNKNOWN}(--[^\s=]+)", message)
        if unknown:
            known = {name: None for name in self._option_string_actions if name.startswith("--")}
            try:
                find_by_name("option", unknown[1], known)
            except ValueError as error:
                message = str(error)
        super().error(message)


def refuse_repeats(words: Sequence[str], names: Sequence[str] | None = None) -> None:
    """Raise ValueError where two of `words`, name=value each, set the same option. names: of the
    options that they set, where these are not the texts before `=`.
    """
    first: dict[str, str] = {}
    for word, name in zip(words, names or [w.partition("=")[0] for w in words], strict=True):
        if name in first:
            raise ValueError(f"{first[name]!r} and {word!r} set the same option: give it once")
        first[name] = word


def run_subcommand(
    command: str, table: Mapping[str, Callable[[Sequence[str]], int]], arguments: Sequence[str]
) -> int:
    """Call the function of the first word with the other words; without words, and for --help, that
    of the first sub-command with --help. Raises UnknownNameError for another word.
    """
    if not arguments or arguments[0] in ("-h", "--help"):
        return next(iter(table.values()))(["--help"])
    return find_by_name(f"{command} command", arguments[0], table)(arguments[1:])


def require_counts(options: argparse.Namespace, *names: str) -> None:
    """Raise ValueError for an option of `names` that is given and below 1."""
    for name in names:
        if (value := getattr(options, name)) is not None and value < 1:
            raise ValueError(f"--{name} is {value}, it must be 1 or more")


def _quote(words: Sequence[str], place: int) -> str:
    """An option as it was typed, with its value."""
    word, rest = words[place], words[place + 1 : place + 2]
    takes_next = "=" not in word and bool(rest) and not rest[0].startswith("--")
    return f"{word} {rest[0]}" if takes_next else word
