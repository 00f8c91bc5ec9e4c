"""`RandomPlayer`: plays uniformly random legal actions; the bot `random` of games without one."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from marl_cair.games.game import GameSpec

RANDOM = "random"  # the name under which every game has a bot: what defaults can count on


class RandomPlayer:
    """At each place of the action shape all legal actions are equally likely.

    Args:
        scenario: not used.
        spec: of the scenario; the player observes the first of its representations.
    """

    name = RANDOM

    def __init__(self, scenario: Any, spec: GameSpec) -> None:
        self.representation = next(iter(spec.representations))
        self._rng = np.random.default_rng(0)

    def seed(self, seed: int) -> None:
        from marl_cair.games.checks.engine import check_seed  # imports `game`

        self._rng = np.random.default_rng(check_seed(self.name, seed))

    def act(self, observation: NDArray[Any], action_mask: NDArray[np.bool_]) -> NDArray[np.int64]:
        return draw_legal(action_mask, self._rng)

    def state_dict(self) -> dict[str, Any]:
        return {"rng": self._rng.bit_generator.state}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self._rng.bit_generator.state = state["rng"]


def draw_legal(mask: NDArray[Any], rng: np.random.Generator) -> NDArray[np.int64]:
    """A random legal index [...] along the last axis of a mask [..., A], uniform; 0 without any."""
    counts = np.cumsum(mask.astype(np.int64), axis=-1)
    nth = (rng.random(mask.shape[:-1]) * counts[..., -1]).astype(np.int64)
    chosen: NDArray[np.int64] = np.argmax(counts > nth[..., None], axis=-1)
    return chosen
