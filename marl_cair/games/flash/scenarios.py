"""Named configurations of Flash games: which SWF, actions, time, reward and access."""

from __future__ import annotations

from dataclasses import dataclass

from marl_cair.games.checks.scenario import check_time
from marl_cair.lookup import find_by_name

GYMNASIUM_PREFIX = "Flash"  # of the ids marl_cair/Flash-<scenario>-v0

REWARDS = {
    "points": "what the score gains; with several players +1 to the winner and -1 to the others",
    "lead": "what the score gains, less the mean of what the others' scores gain",
    "alive": "0.1 a step and -1 at the end; with several players as `points`",
}
ACTIONS = ("keys", "mouse")
NUMBERS = "numbers"
TRANSPORTS = {
    "bridge": "the page's socket",
    "vnc": "keys, mouse and pixels over VNC: the same game, slower",
    NUMBERS: "the page's socket without pictures: the same game, quicker",
}


@dataclass(frozen=True)
class Scenario:
    """Settings of one kind of game.

    Raises:
        ValueError: a value is outside what is allowed; the message names field, value and range.
    """

    description: str = "multitask"  # multitask, duel, or a TOML file of `marl-cair flash add`
    actions: str = "keys"  # none, each key and pairs of keys; or mouse: a click in a grid
    reward: str = "points"  # see REWARDS
    ticks_per_step: int = 2  # frames of the SWF in one step; keys are held during all of them
    max_ticks: int = 9_000  # time limit in frames
    transport: str = "bridge"  # see TRANSPORTS

    def __post_init__(self) -> None:
        find_by_name("flash actions", self.actions, dict.fromkeys(ACTIONS))
        find_by_name("flash reward", self.reward, REWARDS)
        find_by_name("flash transport", self.transport, TRANSPORTS)
        check_time("flash", self)


SCENARIOS = {"multitask": Scenario(), "duel": Scenario(description="duel", max_ticks=3_000)}
