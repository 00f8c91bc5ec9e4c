"""Named configurations of Flappy Bird: pipes, wind, players, time and reward."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from marl_cair.games.checks.scenario import check_time, check_whole_number, read_number
from marl_cair.games.flappy_bird import tables as t
from marl_cair.games.flappy_bird.playable import is_playable
from marl_cair.lookup import find_by_name

GYMNASIUM_PREFIX = "FlappyBird"  # of the ids marl_cair/FlappyBird-<scenario>-v0

REWARDS = {
    "classic": "+1 a pipe, -5 at a crash",
    "unit": "+1 a pipe, -1 at a crash",
    "thesis": "0.1 a pipe",
    "alive": "+1 a pipe, -1 at a crash, 0.1 a tick",
    "sparse": "+1 to the last one flying, -1 at a crash",
}


@dataclass(frozen=True)
class Scenario:
    """Settings of one kind of game.

    Raises:
        ValueError: a value is outside what is allowed, or no sequence of flaps passes such pipes;
            the message names field, value and range.
    """

    num_players: int = 1  # birds on the same pipes
    pipe_gap: int = t.PIPE_GAP  # pixels between upper and lower pipe, more than the bird is high
    pipe_speed: float = t.PIPE_SPEED  # pixels per tick, to a tenth
    wind: float = 0.0  # pixels per tick that the strongest gust moves a bird, to a tenth
    reward: str = "classic"  # see REWARDS
    ticks_per_step: int = 1  # game ticks that one step lasts; it flaps in the first
    max_ticks: int = 6_000  # time limit: 200 seconds

    def __post_init__(self) -> None:
        check_whole_number("flappy_bird", self, "num_players", 1, t.MAX_PLAYERS)
        _check_tenths(self, "pipe_speed", t.MIN_SPEED, t.MAX_SPEED)
        _check_tenths(self, "wind", 0.0, t.MAX_WIND)
        check_whole_number("flappy_bird", self, "ticks_per_step", 1, t.MAX_TICKS_PER_STEP)
        check_time("flappy_bird", self)
        find_by_name("flappy_bird reward", self.reward, REWARDS)
        self._check_gap()

    def _check_gap(self) -> None:
        check_whole_number("flappy_bird", self, "pipe_gap", t.BIRD_HEIGHT + 1, t.MAX_GAP)
        numbers = self.pipe_gap, self.speed_hundredths, self.wind_hundredths
        if not is_playable(*numbers, self.ticks_per_step):
            rate, fixes = "", "slower pipes or less wind"
            if self.ticks_per_step > 1:
                rate = f" at ticks_per_step {self.ticks_per_step}"
                fixes = "slower pipes, less wind or fewer ticks"
            raise ValueError(
                f"flappy_bird: pipe_gap {self.pipe_gap}, pipe_speed {self.pipe_speed} and wind "
                f"{self.wind} cannot be played{rate}: no sequence of flaps passes the highest "
                f"gap after the lowest; take a larger gap, {fixes}"
            )

    @property
    def speed_hundredths(self) -> int:
        """`pipe_speed` in hundredths of a pixel per tick."""
        return round(self.pipe_speed * t.HUNDREDTHS)

    @property
    def wind_hundredths(self) -> int:
        """`wind` in hundredths of a pixel per tick."""
        return round(self.wind * t.HUNDREDTHS)


def _check_tenths(scenario: Any, field: str, low: float, high: float) -> None:
    """Raise ValueError unless the field is a number in low..high with at most one decimal."""
    value, speed = getattr(scenario, field), read_number(scenario, field)
    if speed is None or not low <= speed <= high or round(speed * 10) / 10 != speed:
        raise ValueError(
            f"flappy_bird: {field} is {value!r}, it must be in {low}..{high} pixels per tick, "
            "with at most one decimal"
        )


_CLASSIC = Scenario()
_EASY = Scenario(pipe_gap=140, pipe_speed=3.0)
_HARD = Scenario(pipe_gap=90, pipe_speed=5.0)
_WINDY = Scenario(pipe_gap=110, wind=1.5)

SCENARIOS = {
    "classic": _CLASSIC,
    "easy": _EASY,
    "hard": _HARD,
    "windy": _WINDY,
    "storm": Scenario(pipe_gap=120, pipe_speed=5.0, wind=2.5),
    "race-2": replace(_CLASSIC, num_players=2),
    "race-4": replace(_CLASSIC, num_players=4),
    "race-8": replace(_CLASSIC, num_players=8),
    "race-2-hard": replace(_HARD, num_players=2),
    "race-4-windy": replace(_WINDY, num_players=4),
}
