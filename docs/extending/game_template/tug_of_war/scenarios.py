"""Named configurations of Tug of war."""

from dataclasses import dataclass

GYMNASIUM_PREFIX = "TugOfWar"  # of the ids marl_cair/TugOfWar-<scenario>-v0
REWARDS = {"sparse": "+1 win, -1 loss"}


@dataclass(frozen=True)
class Scenario:
    """Settings of one kind of game. Raises ValueError if a value is not allowed."""

    rope_end: int = 2  # distance from the middle at which a player wins
    reward: str = "sparse"  # one of REWARDS
    shaping_discount: float = 0.99  # used by shaped rewards; this game has none
    ticks_per_step: int = 1
    max_ticks: int = 50  # time limit

    def __post_init__(self):
        if not 1 <= self.rope_end <= 20:
            raise ValueError(f"tug_of_war: rope_end is {self.rope_end}, it must be in 1..20")


SCENARIOS = {"short": Scenario(), "long": Scenario(rope_end=4)}
