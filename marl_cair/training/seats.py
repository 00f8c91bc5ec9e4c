"""`SeatRouter`, the one policy of the collector: learner and opponents share the seats."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDictBase
from tensordict.nn import TensorDictModuleBase
from torch import Tensor

from marl_cair.games.game import Agent
from marl_cair.games.torchrl_env import GROUP, BatchedGameEnv
from marl_cair.policies.actor import PolicyActor
from marl_cair.training.config import ExplorationSettings
from marl_cair.training.demonstrations import NOBODY, Demonstrators
from marl_cair.training.metrics import Decisions, EpisodeStatistics
from marl_cair.training.opponents import LATEST_ID, OpponentBook, export_rng, import_rng


class SeatRouter(TensorDictModuleBase):
    """Chooses the actions of all seats [B, P].

    When a game begins its opponent is drawn from the book and the learner's team evenly; both hold
    until the game ends. The learner plays all seats of its team (one, where everybody plays for
    itself), the opponent all others; against `latest`, and where there is but one team, the learner
    plays and learns from every seat. A seat that is out is nobody's: its action is the no-op.

    Args:
        env: the worlds; its episode counts tell when a game begins.
        actor: the learner; greedy but for the exploration here.
        book: the opponents.
        demonstrators: bots that play the learner's team in a share of the games.
        exploration: the epsilon of each frame.
        statistics: hears the learner's first value of each game.
        seed: of the teams.
    """

    def __init__(
        self,
        env: BatchedGameEnv,
        actor: PolicyActor,
        book: OpponentBook,
        demonstrators: Demonstrators,
        exploration: ExplorationSettings,
        statistics: EpisodeStatistics,
        seed: int,
    ) -> None:
        super().__init__()
        self.in_keys = [(GROUP, "observation"), (GROUP, "action_mask"), (GROUP, "done")]
        self.out_keys = [
            (GROUP, "action"),
            (GROUP, "learned"),
            (GROUP, "demonstrated"),
            (GROUP, "opponent"),
        ]
        worlds, self._players = env.engine.num_worlds, env.engine.num_players
        self._teams, self._noop = env.engine.spec.team_of_seat, env.engine.spec.noop_action
        self._env, self._book, self._exploration = env, book, exploration
        self._demonstrators = demonstrators
        self._statistics = statistics
        # Out of the module's parameters: the collector must not copy or count them.
        self.__dict__["actor"] = actor
        self._rng = np.random.default_rng(seed)
        self.frames = 0
        self.opponent = np.full(worlds, LATEST_ID, np.int16)
        self._team = np.zeros(worlds, np.int64)
        self._episode = np.full(worlds, -1, np.int64)
        self._owned = np.zeros((worlds, self._players), np.bool_)
        self._out = np.zeros((worlds, self._players), np.bool_)
        self._shown = np.zeros((worlds, self._players), np.bool_)
        self._actions = np.zeros((worlds, self._players), np.int64)

    @property
    def epsilon(self) -> float:
        """The chance of exploration at the current frame."""
        return self._exploration.epsilon_at(self.frames)

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write ("player", "action") int64, "learned" bool and "opponent" int16, each [B, P]."""
        group = tensordict.get(GROUP)
        if self.frames:
            taken = Decisions(self._actions, self._owned, self._shown, self._out, self.opponent)
            self._statistics.note_step(taken, self._env.last)
        starting = self._start_new_games()
        self._owned = self._find_owned()
        self._out = group.get("done").squeeze(-1).numpy().copy()
        self._shown = self._find_shown()
        learned = self._owned & ~self._out
        chosen = learned & ~self._shown
        actions = torch.full(learned.shape, self._noop, dtype=torch.int64)
        rows = torch.from_numpy(chosen)
        observation, mask = group.get("observation"), group.get("action_mask")
        actor: PolicyActor = self.__dict__["actor"]
        values = actor.compute_values(observation[rows])
        actions[rows] = actor.exploration(values, mask[rows], self.epsilon)
        if starting.any():
            best = values.masked_fill(~mask[rows], -torch.inf).amax(-1).numpy()
            self._statistics.note_first_values(starting, chosen, best)
        self._play_opponents(group, mask, actions)
        self._demonstrate(group, mask, actions)
        self._actions = actions.numpy().copy()
        group.set("action", actions)
        group.set("learned", torch.from_numpy(learned))
        group.set("demonstrated", torch.from_numpy(learned & self._shown))
        met = torch.from_numpy(self.opponent).unsqueeze(1).expand(-1, self._players)
        group.set("opponent", met.contiguous())
        self.frames += len(self.opponent)
        return tensordict

    def _start_new_games(self) -> NDArray[np.bool_]:
        """Draw opponent and team of the worlds [B] whose game has just begun; returns which."""
        starting: NDArray[np.bool_] = self._env.seeds.episodes != self._episode
        count = int(starting.sum())
        if count:
            self.opponent[starting] = self._book.draw(count, self.frames)
            self._team[starting] = self._rng.integers(0, int(self._teams.max()) + 1, count)
            self._episode = self._env.seeds.episodes.copy()
            self._book.forget_unused(self.opponent)
            self._demonstrators.draw(starting, self.frames)
        return starting

    def _find_owned(self) -> NDArray[np.bool_]:
        """The learner's seats [B, P], whether they are still in or not."""
        owned: NDArray[np.bool_] = self._team[:, None] == self._teams
        owned |= self.opponent[:, None] == LATEST_ID
        return owned

    def _find_shown(self) -> NDArray[np.bool_]:
        """The seats [B, P] that a demonstrator plays: against `latest`, those of one team."""
        shown = self._demonstrators.playing != NOBODY
        found: NDArray[np.bool_] = shown[:, None] & (self._team[:, None] == self._teams)
        return found

    def _demonstrate(self, group: TensorDictBase, mask: Tensor, actions: Tensor) -> None:
        shown = self._shown & ~self._out
        for number, bot in enumerate(self._demonstrators.bots):
            played = shown & (self._demonstrators.playing == number)[:, None]
            if played.any():
                self._act(bot, torch.from_numpy(played), group, mask, actions)

    def _act(
        self, agent: Agent, rows: Tensor, group: TensorDictBase, mask: Tensor, actions: Tensor
    ) -> None:
        """Let `agent` choose the actions of `rows` bool [B, P]."""
        seen = group.get(self._env.key_of(agent.representation))
        chosen = agent.act(seen[rows].numpy(), mask[rows].numpy())
        actions[rows] = torch.from_numpy(np.asarray(chosen, np.int64))

    def _play_opponents(self, group: TensorDictBase, mask: Tensor, actions: Tensor) -> None:
        theirs = ~self._owned & ~self._out
        for number in np.unique(self.opponent[theirs.any(1)]).tolist():
            agent = self._book.agent(number)
            rows = torch.from_numpy(theirs & (self.opponent[:, None] == number))
            self._act(agent, rows, group, mask, actions)

    def export_state(self) -> dict[str, Any]:
        """Teams, opponents and random states as tensors and plain data."""
        actor: PolicyActor = self.__dict__["actor"]
        return {
            "frames": self.frames,
            "opponent": torch.from_numpy(self.opponent.copy()),
            "team": torch.from_numpy(self._team.copy()),
            "episode": torch.from_numpy(self._episode.copy()),
            "owned": torch.from_numpy(self._owned.copy()),
            "out": torch.from_numpy(self._out.copy()),
            "shown": torch.from_numpy(self._shown.copy()),
            "demonstrators": self._demonstrators.state_dict(),
            "actions": torch.from_numpy(self._actions.copy()),
            "rng": export_rng(self._rng),
            "exploration": actor.state_dict(),
        }

    def import_state(self, state: Mapping[str, Any]) -> None:
        """Continue from `export_state`."""
        self.frames = state["frames"]
        self.opponent = state["opponent"].numpy().copy()
        self._team = state["team"].numpy().copy()
        self._episode = state["episode"].numpy().copy()
        self._owned = state["owned"].numpy().copy()
        self._out = state["out"].numpy().copy()
        self._shown = state["shown"].numpy().copy()
        self._demonstrators.load_state_dict(state["demonstrators"])
        self._actions = state["actions"].numpy().copy()
        import_rng(self._rng, state["rng"])
        actor: PolicyActor = self.__dict__["actor"]
        actor.load_state_dict(state["exploration"])
