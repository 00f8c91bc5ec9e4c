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

_SEPARATOR = "@"
STRENGTHS = 0.02, 0.05, 0.1, 0.2, 0.4, 0.7  # of the sampler `curriculum`, beside 1

MakeBot = Callable[[Any, "GameSpec"], "Agent"]


class WeakBot:
    """Plays what `bot` plays in a share of its decisions, drawn at random, else the no-op.

    The bot sees every observation, so that what it remembers stays true.

    Args:
        bot: any agent, also a recurrent one.
        name: as it was asked for.
        strength: the share, above 0 and below 1.
        noop: the action that does nothing.
    """

    def __init__(self, bot: Agent, name: str, strength: float, noop: int) -> None:
        self._bot, self.name, self._strength, self._noop = bot, name, strength, noop
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
        plain, strength = split_name(name)
        if strength == 1:
            raise KeyError(name)
        return partial(_make_weak, self[plain], name, strength)

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and super().__contains__(split_name(name)[0])


def _make_weak(make: MakeBot, name: str, strength: float, scenario: Any, spec: GameSpec) -> WeakBot:
    return WeakBot(make(scenario, spec), name, strength, spec.noop_action)


def split_name(name: str) -> tuple[str, float]:
    """A bot's plain name and its strength, 1 where the name has none."""
    plain, _, written = name.partition(_SEPARATOR)
    try:
        strength = float(written)
    except ValueError:
        return name, 1.0
    return (plain, strength) if 0 < strength < 1 else (name, 1.0)


def list_strengths(bot: str) -> list[str]:
    """The names of a bot at all strengths, weakest first; of `random` none but its own."""
    weak = [] if bot == RANDOM else [f"{bot}{_SEPARATOR}{strength:g}" for strength in STRENGTHS]
    return [*weak, bot]
