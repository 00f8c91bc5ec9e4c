"""Every option of a training run, read off the configuration dataclasses."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import re
import types
import typing
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from marl_cair.training.settings.config import TrainConfig

# A field, and the first comment that stands behind code of it.
_FIELD = re.compile(
    r"^    (\w+): (?:(?!^    \w+:).)*?[^\s#][^\n#]*# ([^\n]*)$", re.MULTILINE | re.DOTALL
)


class Option(NamedTuple):
    """One setting: its dotted path, its default, and the comment that stands beside the field."""

    path: str
    default: Any
    comment: str
    kind: Any


def list_options(owner: type = TrainConfig, prefix: str = "") -> Iterator[Option]:
    """All settings below a configuration dataclass, groups unfolded, in the order of the source."""
    comments, kinds = read_comments(owner), typing.get_type_hints(owner)
    for field in dataclasses.fields(owner):
        path, kind, make = f"{prefix}{field.name}", kinds[field.name], field.default_factory
        if dataclasses.is_dataclass(kind) and isinstance(kind, type):
            yield from list_options(kind, f"{path}.")
            continue
        default = field.default if make is dataclasses.MISSING else make()
        yield Option(path, default, comments.get(field.name, ""), kind)


@functools.cache  # Python's own reader of a class's source takes 30 ms
def read_comments(owner: type) -> Mapping[str, str]:
    """The first trailing comment of each field."""
    return types.MappingProxyType(dict(_FIELD.findall(inspect.getsource(owner))))
