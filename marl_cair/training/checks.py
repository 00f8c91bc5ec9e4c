"""`require`: what a setting must be, in one line that names it."""

from __future__ import annotations


def require(holds: bool, name: str, value: object, allowed: str) -> None:
    """Raise ValueError that names the setting, its value and what is allowed."""
    if not holds:
        raise ValueError(f"{name} is {value!r}, it must be {allowed}")
