"""Who plays the learner's seats in a share of the games, for the learner to learn from."""

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
from marl_cair.training.settings.config import DemonstrationSettings

NOBODY = -1


class Demonstrators:
    """Who plays the learner's team in each world, drawn anew when its game begins.

    With `turn_decisions` also within games: one then shows what to do where the learner has come
    to, and the learner goes on from where that one has led. With `advise` one tells what it would
    do wherever none plays (as in DAgger, Ross et al. 2011).

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
            agent = load_agent(source, game.name, scenario)
            allowed = "an agent that is no mixture: give one of its members"
            require(
                not isinstance(agent, MixedAgent), f"demonstration.agents.{name}", source, allowed
            )
            agent.name = name
            self.agents.append(agent)
        for number, agent in enumerate(self.agents, start=1):
            agent.seed(seed + number)
        self._rng = np.random.default_rng(seed)
        self.playing = np.full(num_worlds, NOBODY, np.int8)  # [B], index into `agents`
        self.telling = self.playing.copy()  # [B], the same: who plays, or may advise
        self._decisions_left = np.zeros(num_worlds, np.int64)  # of the turn under way

    @property
    def representations(self) -> set[str]:
        """What they look at."""
        return {agent.representation for agent in self.agents}

    def draw(self, starting: NDArray[np.bool_], frames: int) -> None:
        """Choose for the worlds [B] whose game begins now, or whose turn is over.

        To be called before each decision.
        """
        if not self.agents:
            return
        starting = self._begin_turns(starting)
        count, until = int(starting.sum()), self.settings.until_frames
        if count == 0:
            return
        shown = self._rng.random(count) < self.settings.share
        chosen = self._rng.integers(0, len(self.agents), count)
        if until is not None and frames >= until:
            shown[:] = False
            chosen[:] = NOBODY
        self.telling[starting] = chosen
        self.playing[starting] = np.where(shown, chosen, NOBODY)

    def _begin_turns(self, starting: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """The worlds [B] in which a turn begins. A game's first turn is of any length up to the
        whole one: else all worlds would change hands at once.
        """
        turn = self.settings.turn_decisions
        if turn is None:
            return starting
        beginning: NDArray[np.bool_] = starting | (self._decisions_left == 0)
        self._decisions_left[beginning] = turn
        self._decisions_left[starting] = self._rng.integers(1, turn + 1, int(starting.sum()))
        self._decisions_left -= 1
        return beginning

    def state_dict(self) -> dict[str, Any]:
        """Draws, games under way and the demonstrators' generators, as plain data."""
        return {
            "rng": export_rng(self._rng),
            "playing": self.playing.tolist(),
            "telling": self.telling.tolist(),
            "decisions_left": self._decisions_left.tolist(),
            "bots": [agent.state_dict() for agent in self.agents],
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from `state_dict`. Raises ValueError for what no games can be."""
        import_rng(self._rng, state["rng"])
        agents = Range(NOBODY, len(self.agents) - 1)
        for name, own, allowed in (
            ("playing", self.playing, agents),
            ("telling", self.telling, agents),
            ("decisions_left", self._decisions_left, COUNT),
        ):
            numbers = read_numbers(state[name], name, allowed)
            own[:] = read_array({name: np.array(numbers, own.dtype)}, name, (own.dtype, own.shape))
        for agent, saved in zip(self.agents, state["bots"], strict=True):
            agent.load_state_dict(saved)
