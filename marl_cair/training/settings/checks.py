"""What a setting must be, in one line that names it."""

from __future__ import annotations

from collections.abc import Sequence


def require(holds: bool, name: str, value: object, allowed: str) -> None:
    """Raise ValueError that names the setting, its value and what is allowed."""
    if not holds:
        raise ValueError(f"{name} is {value!r}, it must be {allowed}")


def require_once(name: str, values: Sequence[object]) -> None:
    """Raise ValueError where one of `values` is there twice."""
    for place, value in enumerate(values):
        if value in values[:place]:
            raise ValueError(f"{name} has {value!r} twice: name each once")
