"""Settings of neural fictitious self-play."""

from __future__ import annotations

from dataclasses import dataclass

from marl_cair.lookup import find_by_name
from marl_cair.training.settings.checks import require

AVERAGE, GREEDY = "average", "greedy"
PLAYED = (AVERAGE, GREEDY)


@dataclass(frozen=True)
class NfspSettings:
    """Neural fictitious self-play (Heinrich and Silver 2016): beside the Q-network, which answers
    whom it meets, a second network learns what the answers were on the mean of all time.

    In games of hidden or simultaneous moves a greedy Q-network, however well trained, plays a pure
    strategy that somebody beats; the average policy comes near an equilibrium. Use it with
    `opponent.mixture={latest: 1}`, as in the paper, or with any other.
    """

    enabled: bool = False  # whether there is an average policy
    eta: float = 0.1  # share of games, for each team, in which the Q-network plays, not the average
    played: str = AVERAGE  # what is rated, kept and frozen for the pool: average, or greedy (Q)
    capacity_rows: int = 100_000  # of the reservoir: an even sample of all decisions of Q
    min_rows: int = 1_000  # rows; the average policy begins to learn with these
    batch_size: int = 128  # rows of its own update
    frames_per_update: int = 64  # frames collected for each of its updates
    learning_rate: float = 1e-3  # of its Adam

    def __post_init__(self) -> None:
        require(0 < self.eta <= 1, "nfsp.eta", self.eta, "above 0, at most 1")
        find_by_name("nfsp.played", self.played, dict.fromkeys(PLAYED))
        for name in ("capacity_rows", "min_rows", "batch_size", "frames_per_update"):
            require(getattr(self, name) >= 1, f"nfsp.{name}", getattr(self, name), "1 or more")
        require(
            self.capacity_rows >= self.min_rows,
            "nfsp.capacity_rows",
            self.capacity_rows,
            f"{self.min_rows} (nfsp.min_rows) or more",
        )
        require(self.learning_rate > 0, "nfsp.learning_rate", self.learning_rate, "above 0")

    @property
    def plays_average(self) -> bool:
        """Whether the agent that is rated, kept and frozen is the average policy."""
        return self.enabled and self.played == AVERAGE
