"""The constants of a scenario, handed to the compiled rules and pictures."""

from __future__ import annotations

from typing import NamedTuple

from marl_cair.games.flappy_bird.art import Art, make_art
from marl_cair.games.flappy_bird.scenarios import Scenario
from marl_cair.games.flappy_bird.tables import gap_tops
from marl_cair.games.game_package import fill_record

# What each reward pays for: a pipe, a crash, a tick of flight, being the last one flying.
_PAY = {
    "classic": (1.0, -5.0, 0.0, 0.0),
    "unit": (1.0, -1.0, 0.0, 0.0),
    "thesis": (0.1, 0.0, 0.0, 0.0),
    "alive": (1.0, -1.0, 0.1, 0.0),
    "sparse": (0.0, -1.0, 0.0, 1.0),
}


class Rules(NamedTuple):
    """The constants of a scenario. Lengths in hundredths of a pixel where not said otherwise."""

    num_players: int
    speed: int  # of the pipes, per tick
    pipe_gap: int  # pixels
    first_gap_top: int  # pixels, the highest
    num_gap_tops: int  # 1 pixel apart
    wind: int  # of the strongest gust, per tick
    pipe_pay: float
    crash_pay: float
    tick_pay: float
    win_pay: float
    ticks_per_step: int
    max_ticks: int
    art: Art  # what the pictures are painted with


def make_rules(scenario: Scenario) -> Rules:
    """The numbers of `scenario`."""
    highest, lowest = gap_tops(scenario.pipe_gap)
    pays = zip(("pipe_pay", "crash_pay", "tick_pay", "win_pay"), _PAY[scenario.reward], strict=True)
    return fill_record(
        Rules,
        scenario,
        speed=scenario.speed_hundredths,
        first_gap_top=highest,
        num_gap_tops=lowest - highest + 1,
        wind=scenario.wind_hundredths,
        art=make_art(),
        **dict(pays),
    )


def reward_bound(scenario: Scenario) -> float:
    """More than one step can pay or cost: its ticks, the pipes it can pass, and the end."""
    pipe_pay, crash_pay, tick_pay, win_pay = _PAY[scenario.reward]
    ticks = scenario.ticks_per_step
    # Two pipes are more than 100 pixels apart.
    num_pipes = 1 + int(ticks * scenario.pipe_speed / 100)
    return abs(crash_pay) + num_pipes * pipe_pay + ticks * tick_pay + win_pay
