"""How the learner plays its own seats: its Q-network, or with NFSP mostly its average policy."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from marl_cair.policies.actor import PolicyActor
from marl_cair.training.settings.config import ExplorationSettings


class OwnPolicies(NamedTuple):
    """The learner's policies, and which of them plays a game.

    Attributes:
        answer: the Q-network, greedy but for `exploration`.
        exploration: the epsilon of each frame.
        average: the average policy of NFSP; None: the Q-network plays always.
        eta: share of games, drawn for each team, in which the Q-network plays.
    """

    answer: PolicyActor
    exploration: ExplorationSettings
    average: PolicyActor | None = None
    eta: float = 1.0

    def draw_answering(
        self, rng: np.random.Generator, num_games: int, num_teams: int
    ) -> NDArray[np.bool_]:
        """Whether the Q-network plays, bool [num_games, num_teams]; no draw without an average."""
        if self.average is None:
            return np.ones((num_games, num_teams), np.bool_)
        return rng.random((num_games, num_teams)) < self.eta

    def state_dict(self) -> dict[str, Any]:
        """The random generators of both."""
        average = None if self.average is None else self.average.state_dict()
        return {"answer": self.answer.state_dict(), "average": average}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from `state_dict`."""
        self.answer.load_state_dict(state["answer"])
        if self.average is not None:
            self.average.load_state_dict(state["average"])
