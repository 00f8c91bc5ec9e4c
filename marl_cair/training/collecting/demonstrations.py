"""Demonstrators: bots and agents that play the learner's seats in a share of the games."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import Agent, Game
from marl_cair.games.players.mixed_agent import MixedAgent
from marl_cair.league.agents.load import load_agent
from marl_cair.ranges import COUNT, Range, read_array, read_numbers
from marl_cair.training.collecting.opponents import export_rng, import_rng
from marl_cair.training.settings.checks import require
from marl_cair.training.settings.demonstration import DemonstrationSettings

NO_DEMONSTRATOR = -1


class Demonstrators:
    """Draws the demonstrator of each world when its game begins.

    With `turn_decisions` it also draws within games: a demonstrator then continues from states that
    the learner has reached, and the learner from the demonstrator's. With `advise` a demonstrator
    gives its own action wherever none plays (as in DAgger, Ross et al. 2011).

    Args:
        settings: bots and other agents, and their share of the games.
        game, scenario: that are played.
        num_worlds: B.
        seed: of the draws and the demonstrators.

    Raises ValueError for a mixture, and as `load_agent` does.
    """

    def __init__(
        self,
        settings: DemonstrationSettings,
        game: Game,
        scenario: Any,
        num_worlds: int,
        seed: int,
    ) -> None:
        self.settings = settings
        self.agents: list[Agent] = [game.bot(name, scenario) for name in settings.bots]
        for name, source in settings.agents.items():
            agent, place = load_agent(source, game.name, scenario), f"demonstration.agents.{name}"
            allowed = "an agent that is no mixture: give one of its members"
            require(not isinstance(agent, MixedAgent), place, source, allowed)
            agent.name = name
            self.agents.append(agent)
        for number, agent in enumerate(self.agents, start=1):
            agent.seed(seed + number)
        self._rng = np.random.default_rng(seed)
        self.playing = np.full(num_worlds, NO_DEMONSTRATOR, np.int8)  # [B], index into `agents`
        self.telling = self.playing.copy()  # [B], the same: the one that plays or may advise
        self._decisions_left = np.zeros(num_worlds, np.int64)  # of the turn under way

    @property
    def representations(self) -> set[str]:
        """Their representations."""
        return {agent.representation for agent in self.agents}

    def draw(self, starting: NDArray[np.bool_], frames: int) -> None:
        """Draw for the worlds [B] whose game begins now, or whose turn is over.

        To be called before each step.
        """
        if not self.agents:
            return
        turn, left = self.settings.turn_decisions, self._decisions_left
        if turn is not None:
            beginning = starting | (left == 0)
            left[beginning] = turn
            # A game's first turn has any length: else all worlds would change at the same step.
            left[starting] = self._rng.integers(1, turn + 1, int(starting.sum()))
            left -= 1
            starting = beginning
        count, until = int(starting.sum()), self.settings.until_frames
        if count == 0:
            return
        shown = self._rng.random(count) < self.settings.share
        chosen = self._rng.integers(0, len(self.agents), count)
        if until is not None and frames >= until:
            shown[:] = False
            chosen[:] = NO_DEMONSTRATOR
        self.telling[starting] = chosen
        self.playing[starting] = np.where(shown, chosen, NO_DEMONSTRATOR)

    def state_dict(self) -> dict[str, Any]:
        """Draws, games in progress and the demonstrators' generators, as plain data."""
        return {
            "rng": export_rng(self._rng),
            "playing": self.playing.tolist(),
            "telling": self.telling.tolist(),
            "decisions_left": self._decisions_left.tolist(),
            "bots": [agent.state_dict() for agent in self.agents],
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from `state_dict`. Raises ValueError for a state that no games can have."""
        import_rng(self._rng, state["rng"])
        agents = Range(NO_DEMONSTRATOR, len(self.agents) - 1)
        for name, own, allowed in (
            ("playing", self.playing, agents),
            ("telling", self.telling, agents),
            ("decisions_left", self._decisions_left, COUNT),
        ):
            numbers = read_numbers(state[name], name, allowed)
            own[:] = read_array({name: np.array(numbers, own.dtype)}, name, (own.dtype, own.shape))
        for agent, saved in zip(self.agents, state["bots"], strict=True):
            agent.load_state_dict(saved)
