"""Settings of demonstrations."""

from __future__ import annotations

from dataclasses import dataclass, field

from marl_cair.training.settings.checks import (
    Count,
    Natural,
    NonNegative,
    Share,
    check_fields,
    require,
)


@dataclass(frozen=True)
class DemonstrationSettings:
    """Games in which a bot, or another agent, plays the learner's seats, and the learner learns
    from its actions: deep Q-learning from demonstrations (Hester et al. 2018). With `advise` they
    also label the states in which the learner plays (DAgger, Ross et al. 2011). `replays` are
    demonstrations too: they fill the replay buffer before the first step, until newer steps
    overwrite them.
    """

    bots: tuple[str, ...] = ()  # bots that demonstrate, one for each such game; (): none
    agents: dict[str, str] = field(default_factory=dict)  # by name: folder or module:function
    replays: str | None = None  # file, or folder of files, of recorded games; None: none
    players: tuple[str, ...] = ()  # names of those who demonstrate in them; (): who has won
    share: Share = 0.25  # of games
    until_frames: Natural | None = None  # frames after which they stop; None: never
    advise: bool = False  # they also give their own action wherever the learner plays
    turn_decisions: Count | None = None  # steps after which turns are drawn again; None: never
    margin: NonNegative = 0.1  # by which the demonstrated action's value is to exceed all others
    margin_weight: NonNegative = 1.0  # of that loss, beside the TD error's

    def __post_init__(self) -> None:
        check_fields(self, "demonstration.")
        allowed = "false where demonstration.bots and demonstration.agents are empty"
        given = not self.advise or bool(self.bots or self.agents)
        require(given, "demonstration.advise", self.advise, allowed)
        needs = not self.players or self.replays is not None
        require(needs, "demonstration.players", self.players, "() without demonstration.replays")

    @property
    def is_given(self) -> bool:
        """Whether there are demonstrations."""
        return bool(self.bots or self.agents or self.replays)
