"""Neural fictitious self-play: the average policy, and which policy plays a game."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from marl_cair.games.torchrl_env import GROUP
from marl_cair.policies.actor import PolicyActor
from marl_cair.policies.q_network import QNetwork
from marl_cair.policies.saved_weights import restore_optimizer, restore_weights
from marl_cair.ranges import COUNT, read_number
from marl_cair.replay.reservoir import Reservoir
from marl_cair.training.collecting.exploration import Exploration
from marl_cair.training.settings.learner import NfspSettings


class AveragePolicy:
    """The supervised half of neural fictitious self-play (Heinrich and Silver 2016, algorithm 1).

    Its rows are the learner's own decisions in games that its Q-network plays: no generated ones,
    and none of a demonstrator. Decisions with one legal action are left out.

    Args:
        network: its outputs are the logits of the actions, softmax over the legal ones.
        settings: of its update.
        reservoir: the sample of rows that it learns from.
    """

    def __init__(self, network: QNetwork, settings: NfspSettings, reservoir: Reservoir) -> None:
        self.network, self.settings, self.reservoir = network, settings, reservoir
        self._optimizer = torch.optim.Adam(network.parameters(), lr=settings.learning_rate)
        self.updates = 0

    def remember(self, data: TensorDictBase) -> None:
        """Add rows from a collected TensorDict [B, T] with "answered" bool [B, T, P]."""
        group = data[GROUP]
        mask = group["action_mask"]
        rows = group["answered"] & (mask.sum(-1) > 1)
        self.reservoir.extend(group["observation"][rows], mask[rows], group["action"][rows])

    def learn(self, num_updates: int) -> list[dict[str, Tensor | float]]:
        """Take gradient steps, none while the reservoir is too empty; returns scalars of each."""
        if len(self.reservoir) < self.settings.min_rows:
            return []
        batch_size = self.settings.batch_size
        return [self.update(self.reservoir.sample(batch_size)) for _ in range(num_updates)]

    def update(self, batch: TensorDict) -> dict[str, Tensor | float]:
        """One gradient step on the cross-entropy of the actions; returns scalars for the log."""
        device = next(self.network.parameters()).device
        batch = batch if device.type == "cpu" else batch.to(device, non_blocking=True)
        logits = self.network(batch["observation"])
        legal = logits.masked_fill(~batch["action_mask"], -torch.inf)
        loss = torch.nn.functional.cross_entropy(legal, batch["action"])
        self._optimizer.zero_grad(set_to_none=True)
        torch.autograd.backward(loss)
        self._optimizer.step()
        self.updates += 1
        return {"average/loss": loss.detach(), "average/rows": float(len(self.reservoir))}

    def state_dict(self) -> dict[str, Any]:
        """Network, optimiser and count as tensors and plain data; not the reservoir."""
        return {
            "network": dict(self.network.state_dict()),
            "optimizer": self._optimizer.state_dict(),
            "updates": self.updates,
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from `state_dict`. Raises ValueError for numbers that are not finite."""
        restore_weights(self.network, state["network"], "average_policy.network")
        restore_optimizer(self._optimizer, state["optimizer"], "average_policy.optimizer")
        self.updates = read_number(state, "updates", COUNT)


class OwnPolicies(NamedTuple):
    """The learner's policies in its own seats."""

    answer: PolicyActor  # the Q-network
    exploration: Exploration  # its actions
    average: PolicyActor | None = None  # of NFSP; None: the Q-network always plays
    eta: float = 1.0  # share of games, drawn for each team, in which the Q-network plays

    def explore(self, values: Tensor, action_mask: Tensor, frames: int) -> Tensor:
        """The Q-network's actions int64 [N] after `frames` steps; values and mask [N, A]."""
        generator = self.answer.exploration.generator
        return self.exploration(values, action_mask, generator, frames)

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
