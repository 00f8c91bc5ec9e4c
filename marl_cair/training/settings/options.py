"""Every option of a training run, read off the configuration dataclasses."""

from __future__ import annotations

import dataclasses
import functools
import inspect
import io
import tokenize
import types
import typing
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from marl_cair.training.settings.config import TrainConfig


@dataclass(frozen=True)
class Option:
    """One setting: its dotted path, its default, and the comment that stands beside the field."""

    path: str
    default: Any
    comment: str
    kind: Any


def list_options(owner: type = TrainConfig, prefix: str = "") -> Iterator[Option]:
    """All settings below a configuration dataclass, groups unfolded, in the order of the source."""
    comments = read_comments(owner)
    kinds = typing.get_type_hints(owner)
    for field in dataclasses.fields(owner):
        path = f"{prefix}{field.name}"
        kind = kinds[field.name]
        if dataclasses.is_dataclass(kind) and isinstance(kind, type):
            yield from list_options(kind, f"{path}.")
            continue
        if field.default is not dataclasses.MISSING:
            default: Any = field.default
        elif field.default_factory is not dataclasses.MISSING:
            default = field.default_factory()
        else:
            default = dataclasses.MISSING
        yield Option(path, default, comments.get(field.name, ""), kind)


@functools.cache  # Python's own reader of a class's source takes 30 ms
def read_comments(owner: type) -> Mapping[str, str]:
    """The trailing comment of each field's first line; comment lines right below continue it."""
    comments: dict[str, str] = {}
    field = ""
    source = inspect.getsource(owner)
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type == tokenize.NAME and token.line[:5].strip() == token.string[:1]:
            if token.line.startswith(f"    {token.string}:"):
                field = token.string
        elif token.type == tokenize.COMMENT and field and token.line.strip() != token.string:
            comments.setdefault(field, token.string.lstrip("# "))
    return types.MappingProxyType(comments)
