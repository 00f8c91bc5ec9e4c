"""Weak bots, "rusher@0.3": a bot that makes a share of its decisions and else does nothing."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.players.random_player import RANDOM

if TYPE_CHECKING:
    from marl_cair.games.game import Agent, GameSpec

SEPARATOR = "@"
STRENGTHS = 0.02, 0.05, 0.1, 0.2, 0.4, 0.7  # of the sampler `curriculum`, beside 1

MakeBot = Callable[[Any, "GameSpec"], "Agent"]


class WeakBot:
    """Plays what `bot` plays in a share of its decisions, drawn at random, else the no-op.

    The bot sees every observation, so that what it remembers stays true.

    Args:
        bot: any agent, also a recurrent one.
        strength: the share, above 0 and below 1.
        noop: the action that does nothing.
    """

    def __init__(self, bot: Agent, strength: float, noop: int) -> None:
        self._bot, self._strength, self._noop = bot, strength, noop
        self.name = f"{bot.name}{SEPARATOR}{strength:g}"
        self.representation = bot.representation
        self.state_size: int = getattr(bot, "state_size", 0)
        self._rng = np.random.default_rng(0)

    def seed(self, seed: int) -> None:
        self._bot.seed(seed)
        self._rng = np.random.default_rng([seed, round(1e9 * self._strength)])

    def act(
        self, observation: NDArray[Any], action_mask: NDArray[np.bool_], *state: NDArray[np.float32]
    ) -> Any:
        answer = self._bot.act(observation, action_mask, *state)
        chosen = np.array(answer[0] if state else answer)
        chosen[self._rng.random(len(chosen)) >= self._strength] = self._noop
        return (chosen, answer[1]) if state else chosen

    def state_dict(self) -> dict[str, Any]:
        return {"bot": self._bot.state_dict(), "rng": self._rng.bit_generator.state}

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        self._bot.load_state_dict(state["bot"])
        self._rng.bit_generator.state = state["rng"]


class BotTable(dict[str, MakeBot]):
    """The bots of a game by name. NAME@STRENGTH is a name too, with a strength above 0 and below 1;
    such names are not listed.
    """

    def __missing__(self, name: str) -> MakeBot:
        plain, strength = self._split(name)
        return partial(_make_weak, self[plain], name, strength)

    def __contains__(self, name: object) -> bool:
        if super().__contains__(name):
            return True
        try:
            self._split(name)
        except KeyError:
            return False
        return True

    def _split(self, name: object) -> tuple[str, float]:
        """A plain name and a strength. Raises KeyError."""
        plain, _, written = str(name).partition(SEPARATOR)
        try:
            strength = float(written)
        except ValueError:
            raise KeyError(name) from None
        if not super().__contains__(plain) or not 0 < strength < 1:
            raise KeyError(name)
        return plain, strength


def _make_weak(make: MakeBot, name: str, strength: float, scenario: Any, spec: GameSpec) -> WeakBot:
    weak = WeakBot(make(scenario, spec), strength, spec.noop_action)
    weak.name = name  # as it was asked for: 0.30 and 0.3 are the same strength
    return weak


def read_strength(name: str) -> float:
    """The strength in a bot's name, 1 where there is none."""
    return float(name.partition(SEPARATOR)[2] or 1)


def list_strengths(bot: str) -> list[str]:
    """The names of a bot at all strengths, weakest first; of `random` none but its own."""
    weak = [] if bot == RANDOM else [f"{bot}{SEPARATOR}{strength:g}" for strength in STRENGTHS]
    return [*weak, bot]
