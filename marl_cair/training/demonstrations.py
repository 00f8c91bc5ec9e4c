"""Bots that play the learner's seats in a share of the games, for the learner to learn from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from marl_cair.games.game import Agent, Game
from marl_cair.training.config import DemonstrationSettings
from marl_cair.training.opponents import export_rng, import_rng

NOBODY = -1


class Demonstrators:
    """Who plays the learner's team in each world, drawn anew when its game begins.

    With `turn_decisions` also within games: a bot then shows what to do where the learner has come
    to, and the learner goes on from where a bot has led. With `advise` a bot tells what it would do
    wherever none plays (as in DAgger, Ross et al. 2011).

    Args:
        settings: bots, and their share of the games.
        game, scenario: for the bots.
        num_worlds: B.
        seed: of the draws and the bots.
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
        self.bots: list[Agent] = [game.bot(name, scenario) for name in settings.bots]
        for number, bot in enumerate(self.bots, start=1):
            bot.seed(seed + number)
        self._rng = np.random.default_rng(seed)
        self.playing = np.full(num_worlds, NOBODY, np.int8)  # [B], index into `bots`
        self.telling = self.playing.copy()  # [B], the same: who plays, or may advise
        self._decisions_left = np.zeros(num_worlds, np.int64)  # of the turn under way

    @property
    def representations(self) -> set[str]:
        """What the bots look at."""
        return {bot.representation for bot in self.bots}

    def draw(self, starting: NDArray[np.bool_], frames: int) -> None:
        """Choose for the worlds [B] whose game begins now, or whose turn is over.

        To be called before each decision.
        """
        if not self.bots:
            return
        starting = self._begin_turns(starting)
        count, until = int(starting.sum()), self.settings.until_frames
        if count == 0:
            return
        shown = self._rng.random(count) < self.settings.share
        chosen = self._rng.integers(0, len(self.bots), count)
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
        """Draws, games under way and the bots' generators, as plain data."""
        return {
            "rng": export_rng(self._rng),
            "playing": self.playing.tolist(),
            "telling": self.telling.tolist(),
            "decisions_left": self._decisions_left.tolist(),
            "bots": [bot.state_dict() for bot in self.bots],
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from `state_dict`."""
        import_rng(self._rng, state["rng"])
        self.playing = np.array(state["playing"], np.int8)
        self.telling = np.array(state["telling"], np.int8)
        self._decisions_left = np.array(state["decisions_left"], np.int64)
        for bot, saved in zip(self.bots, state["bots"], strict=True):
            bot.load_state_dict(saved)
