"""Stopping rules of a league: width of its intervals (--ci) and time (--time)."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence

from marl_cair.league.ratings.rate import Rating


class Clock:
    """Runs from `start`, for `seconds` (0: for ever); `has_ended` once it was asked too late."""

    def __init__(self, seconds: float) -> None:
        self.has_ended = False
        self._seconds = seconds or math.inf
        self._end = math.inf

    def start(self) -> None:
        """Start counting."""
        self._end = time.monotonic() + self._seconds

    def is_time_up(self) -> bool:
        """Whether the seconds have passed."""
        self.has_ended = self.has_ended or time.monotonic() > self._end
        return self.has_ended


def describe_ending(half_width_elo: float, ratings: Sequence[Rating], is_time_up: bool) -> str:
    """Whether intervals are as narrow as was asked (0: no limit), and whether time is up."""
    why = "the time of --time is up; the same command resumes it" if is_time_up else ""
    if half_width_elo <= 0.0:
        return f"Ended as {why}." if why else ""
    asked = f"within {half_width_elo:g} Elo either way (--ci)"
    limited = [r for r in ratings if not r.is_bound and r.low < r.high]
    bare = len(ratings) - len(limited)
    wide = sum((r.high - r.low) / 2.0 > half_width_elo for r in limited)
    if limited and not wide:
        but = f", but for {bare} of {len(ratings)} agents that have none" if bare else ""
        return f"All intervals are {asked}{but}."
    why = why or "all games are played that --games allows and that do not only repeat others"
    found = f"{wide} of {len(limited)} are wider" if limited else "there are none"
    return f"Not reached: intervals {asked}, {found}: {why}."
