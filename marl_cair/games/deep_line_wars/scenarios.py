"""Named configurations of Deep Line Wars: board, numbers, actions, time and reward."""

from __future__ import annotations

from dataclasses import dataclass

from marl_cair.games.checks.scenario import check_shaping_discount, check_time, check_whole_number
from marl_cair.games.deep_line_wars.tables import PRESETS, PROGRESS_PER_TILE
from marl_cair.lookup import find_by_name

GYMNASIUM_PREFIX = "DeepLineWars"  # of the ids marl_cair/DeepLineWars-<scenario>-v0

ACTION_SPACES = {"spatial": "buy, or build at a cell", "classic": "the thesis's 13, by cursor"}
REWARDS = {"sparse": "+1 win, -1 loss, 0 draw", "shaped": "sparse plus a potential difference"}

MIN_SIDE, MAX_SIDE = 6, 120


@dataclass(frozen=True)
class Scenario:
    """Settings of one kind of game.

    Raises:
        ValueError: a value is outside what is allowed; the message names field, value and range.
    """

    rows: int = 10
    columns: int = 15  # column 0 is the own spawn column, the last one the enemy's
    preset: str = "balanced"  # numbers of units and towers: see tables.PRESETS
    actions: str = "spatial"  # or "classic"
    reward: str = "sparse"  # or "shaped"
    shaping_discount: float = 0.99  # gamma of the potential difference, per step
    ticks_per_step: int = 10  # game ticks that one step lasts
    max_ticks: int = 2_500  # time limit

    def __post_init__(self) -> None:
        for field in ("rows", "columns"):
            check_whole_number("deep_line_wars", self, field, MIN_SIDE, MAX_SIDE)
        check_time("deep_line_wars", self)
        find_by_name("deep_line_wars preset", self.preset, PRESETS)
        find_by_name("deep_line_wars action space", self.actions, ACTION_SPACES)
        find_by_name("deep_line_wars reward", self.reward, REWARDS)
        check_shaping_discount("deep_line_wars", self)

    @property
    def build_columns(self) -> int:
        """Columns of the own half that take towers: 1..build_columns in the own view."""
        neutral = 1 if self.columns % 2 else 2
        return (self.columns - neutral) // 2 - 1

    @property
    def unit_capacity(self) -> int:
        """Unit slots per player that can never run out, a power of two.

        A player buys at most one unit a step and each walks off the board after a known time,
        so only the purchases of one walk can be alive together.
        """
        slowest = min(PRESETS[self.preset].unit_speed)
        walk_ticks = -(-(self.columns - 1) * PROGRESS_PER_TILE // slowest)
        purchases = -(-walk_ticks // self.ticks_per_step) + 2
        return 1 << (purchases - 1).bit_length()


SCENARIOS = {
    "10x15": Scenario(rows=10, columns=15),
    "11x11": Scenario(rows=11, columns=11),
    "13x13": Scenario(rows=13, columns=13),
    "15x15": Scenario(rows=15, columns=15),
    "17x17": Scenario(rows=17, columns=17),
    "30x11": Scenario(rows=11, columns=30, max_ticks=4_000),
}
