"""`MixedAgent`: one of several agents, drawn before each game, as one agent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.checks.engine import check_seed
from marl_cair.games.game import Agent
from marl_cair.games.players.recurrent import call_agent, find_state_size


class MixedAgent:
    """A mixed strategy: one member, drawn before each game, plays all of it.

    The result of training a population, as in policy-space response oracles (Lanctot et al. 2017)
    and AlphaStar's league: where every single agent is beaten by another, a mixture is harder to
    beat than any of its members.

    Code that plays many games at once draws a member for each (`draw`) and then calls `act_as`. For
    other code it is an ordinary agent, which plays as one member until it is seeded again.

    Args:
        members: K agents with the same representation; a mixture is replaced by its members.
        weights: chances, in proportion: K numbers above 0.
        name: for tables.

    Raises:
        ValueError: no member, another number of weights, one that is not above 0, or members with
            different representations.
    """

    def __init__(
        self, members: Sequence[Agent], weights: Sequence[float], name: str = "mixture"
    ) -> None:
        if not members or len(members) != len(weights):
            raise ValueError(
                f"{name} has {len(members)} members and {len(weights)} weights: give one or more "
                "members, and a weight for each"
            )
        if not all(np.isfinite(weight) and weight > 0 for weight in weights):
            raise ValueError(f"{name} has the weights {list(weights)}: all must be above 0")
        self.members: tuple[Agent, ...] = ()
        shares: list[float] = []
        for member, weight in zip(members, weights, strict=True):
            if isinstance(member, MixedAgent):
                self.members += member.members
                shares += (weight * member.weights).tolist()
            else:
                self.members += (member,)
                shares.append(weight)
        seen = sorted({member.representation for member in self.members})
        if len(seen) > 1:
            raise ValueError(
                f"{name} has members that observe {' and '.join(seen)}: mix agents with the same "
                "representation"
            )
        self.name, self.representation = name, seen[0]
        self.weights: NDArray[np.float64] = np.array(shares) / sum(shares)
        self.state_size = find_state_size(*self.members)
        self.failure = ""  # of a member that has forfeited: see `league.agents.foreign`
        self._rng = np.random.default_rng(0)
        self._playing = 0

    def seed(self, seed: int) -> None:
        """Restart all random generators, and draw the member that `act` uses."""
        self._rng = np.random.default_rng(check_seed(self.name, seed))
        for member in self.members:
            member.seed(int(self._rng.integers(2**62)))
        self._playing = int(self.draw(1)[0])

    def draw(self, count: int) -> NDArray[np.int64]:
        """Members for `count` games, int64 [count]."""
        return np.asarray(self._rng.choice(len(self.members), count, p=self.weights), np.int64)

    def act(
        self,
        observation: NDArray[Any],
        action_mask: NDArray[np.bool_],
        state: NDArray[np.float32] | None = None,
    ) -> Any:
        """`Agent.act` of the member drawn by `seed`."""
        playing = np.full(len(action_mask), self._playing)
        return self.act_as(playing, observation, action_mask, state)

    def act_as(
        self,
        playing: NDArray[np.int64],
        observation: NDArray[Any],
        action_mask: NDArray[np.bool_],
        state: NDArray[np.float32] | None = None,
    ) -> Any:
        """`Agent.act` of N rows, each by its member of `playing` [N] (of `draw`)."""
        actions = np.zeros(action_mask.shape[:-1], np.int64)
        states = np.zeros((len(actions), 0), np.float32) if state is None else state.copy()
        self.failure = ""
        for number in np.unique(playing).tolist():
            rows, member = playing == number, self.members[number]
            seen = observation[rows], action_mask[rows]
            actions[rows] = call_agent(member, states, rows, *seen)
            self.failure = self.failure or str(getattr(member, "failure", ""))
        return (actions, states) if self.state_size else actions

    def state_dict(self) -> dict[str, Any]:
        """All random generators, and the drawn member, as plain data."""
        return {
            "rng": self._rng.bit_generator.state,
            "playing": self._playing,
            "members": [member.state_dict() for member in self.members],
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from `state_dict`."""
        self._rng.bit_generator.state = state["rng"]
        self._playing = state["playing"]
        for member, held in zip(self.members, state["members"], strict=True):
            member.load_state_dict(held)
