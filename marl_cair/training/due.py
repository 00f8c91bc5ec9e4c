"""Whether something is due that happens every so many steps."""

from __future__ import annotations


def count_due(before: int, after: int, every: int) -> int:
    """How many multiples of `every` lie in (before, after]."""
    return after // every - before // every


def is_due(before: int, after: int, every: int) -> bool:
    """Whether a multiple of `every` lies in (before, after]."""
    return count_due(before, after, every) > 0
