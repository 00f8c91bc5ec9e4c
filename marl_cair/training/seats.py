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

from marl_cair.games.torchrl_env import GROUP, BatchedGameEnv
from marl_cair.policies.actor import PolicyActor
from marl_cair.training.config import ExplorationSettings
from marl_cair.training.metrics import EpisodeStatistics
from marl_cair.training.opponents import LATEST_ID, OpponentBook, export_rng, import_rng


class SeatRouter(TensorDictModuleBase):
    """Chooses the actions of all seats [B, P].

    When a game begins its opponent is drawn from the book and the learner's seat evenly; both hold
    until the game ends. Against `latest` the learner plays, and learns from, every seat.

    Args:
        env: the worlds; its episode counts tell when a game begins.
        actor: the learner; greedy but for the exploration here.
        book: the opponents.
        exploration: the epsilon of each frame.
        statistics: hears the learner's first value of each game.
        seed: of the seats.
    """

    def __init__(
        self,
        env: BatchedGameEnv,
        actor: PolicyActor,
        book: OpponentBook,
        exploration: ExplorationSettings,
        statistics: EpisodeStatistics,
        seed: int,
    ) -> None:
        super().__init__()
        self.in_keys = [(GROUP, "observation"), (GROUP, "action_mask")]
        self.out_keys = [(GROUP, "action"), (GROUP, "learned"), (GROUP, "opponent")]
        worlds, self._players = env.engine.num_worlds, env.engine.num_players
        self._env, self._book, self._exploration = env, book, exploration
        self._statistics = statistics
        # Out of the module's parameters: the collector must not copy or count them.
        self.__dict__["actor"] = actor
        self._rng = np.random.default_rng(seed)
        self.frames = 0
        self.opponent = np.full(worlds, LATEST_ID, np.int16)
        self._seat = np.zeros(worlds, np.int64)
        self._episode = np.full(worlds, -1, np.int64)
        self._learned = np.zeros((worlds, self._players), np.bool_)
        self._actions = np.zeros((worlds, self._players), np.int64)

    @property
    def epsilon(self) -> float:
        """The chance of exploration at the current frame."""
        return self._exploration.epsilon_at(self.frames)

    def forward(self, tensordict: TensorDictBase) -> TensorDictBase:
        """Write ("player", "action") int64, "learned" bool and "opponent" int16, each [B, P]."""
        group = tensordict.get(GROUP)
        if self.frames:
            self._statistics.note_step(self._actions, self._learned, self._env.last, self.opponent)
        starting = self._seat_new_games()
        learned = self._find_learned()
        actions = torch.zeros(learned.shape, dtype=torch.int64)
        rows = torch.from_numpy(learned)
        observation, mask = group.get("observation"), group.get("action_mask")
        actor: PolicyActor = self.__dict__["actor"]
        values = actor.compute_values(observation[rows])
        actions[rows] = actor.exploration(values, mask[rows], self.epsilon)
        if starting.any():
            best = values.masked_fill(~mask[rows], -torch.inf).amax(-1).numpy()
            self._statistics.note_first_values(starting, learned, best)
        self._play_opponents(group, mask, learned, actions)
        self._learned, self._actions = learned, actions.numpy().copy()
        group.set("action", actions)
        group.set("learned", rows)
        met = torch.from_numpy(self.opponent).unsqueeze(1).expand(-1, self._players)
        group.set("opponent", met.contiguous())
        self.frames += len(self.opponent)
        return tensordict

    def _seat_new_games(self) -> NDArray[np.bool_]:
        """Draw opponent and seat of the worlds [B] whose game has just begun; returns which."""
        starting: NDArray[np.bool_] = self._env.seeds.episodes != self._episode
        count = int(starting.sum())
        if count:
            self.opponent[starting] = self._book.draw(count, self.frames)
            self._seat[starting] = self._rng.integers(0, self._players, count)
            self._episode = self._env.seeds.episodes.copy()
            self._book.forget_unused(self.opponent)
        return starting

    def _find_learned(self) -> NDArray[np.bool_]:
        seats = np.arange(self._players)
        learned: NDArray[np.bool_] = self._seat[:, None] == seats
        learned |= self.opponent[:, None] == LATEST_ID
        return learned

    def _play_opponents(
        self, group: TensorDictBase, mask: Tensor, learned: NDArray[np.bool_], actions: Tensor
    ) -> None:
        for number in np.unique(self.opponent).tolist():
            if number == LATEST_ID:
                continue
            agent = self._book.agent(number)
            rows = torch.from_numpy(~learned & (self.opponent[:, None] == number))
            seen = group.get(self._env.key_of(agent.representation))
            chosen = agent.act(seen[rows].numpy(), mask[rows].numpy())
            actions[rows] = torch.from_numpy(np.asarray(chosen, np.int64))

    def export_state(self) -> dict[str, Any]:
        """Seats, opponents and random states as tensors and plain data."""
        actor: PolicyActor = self.__dict__["actor"]
        return {
            "frames": self.frames,
            "opponent": torch.from_numpy(self.opponent.copy()),
            "seat": torch.from_numpy(self._seat.copy()),
            "episode": torch.from_numpy(self._episode.copy()),
            "learned": torch.from_numpy(self._learned.copy()),
            "actions": torch.from_numpy(self._actions.copy()),
            "rng": export_rng(self._rng),
            "exploration": actor.state_dict(),
        }

    def import_state(self, state: Mapping[str, Any]) -> None:
        """Continue from `export_state`."""
        self.frames = state["frames"]
        self.opponent = state["opponent"].numpy().copy()
        self._seat = state["seat"].numpy().copy()
        self._episode = state["episode"].numpy().copy()
        self._learned = state["learned"].numpy().copy()
        self._actions = state["actions"].numpy().copy()
        import_rng(self._rng, state["rng"])
        actor: PolicyActor = self.__dict__["actor"]
        actor.load_state_dict(state["exploration"])
