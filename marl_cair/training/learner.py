"""The Q-learning update: TorchRL's DQNLoss on masked batches of real and generated transitions."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor
from torchrl.data import Categorical
from torchrl.modules import QValueActor
from torchrl.objectives import DQNLoss, HardUpdate, SoftUpdate

from marl_cair.policies.q_network import QNetwork
from marl_cair.policies.saved_weights import restore_optimizer, restore_weights
from marl_cair.ranges import COUNT, read_number
from marl_cair.replay.transition import NO_ACTION
from marl_cair.training.settings.config import DemonstrationSettings
from marl_cair.training.settings.learner import LearnerSettings

# Warm-up of the averaged weights: after n updates they average over at most about n / 10.
_AVERAGE_WARMUP = 10


class Learner:
    """Network, target network, optimiser, and the averaged weights that are rated and kept.

    Target of a row: R + gamma^k * (not terminated) * Q_target(s', argmax over legal a of Q(s', a)),
    R the discounted sum of k rewards (double Q-learning, van Hasselt et al. 2016).

    Neighbouring actions differ little in value, so a few updates can change the greedy policy;
    `average` is the exponential moving average of the weights (Polyak and Juditsky 1992), whose
    policy is steady. The newest weights collect.
    """

    def __init__(
        self,
        network: QNetwork,
        settings: LearnerSettings,
        demonstration: DemonstrationSettings | None = None,
    ) -> None:
        self.network, self.settings = network, settings
        self.demonstration = demonstration or DemonstrationSettings()
        actor = QValueActor(
            network,
            in_keys=["observation"],
            spec=Categorical(network.num_actions, dtype=torch.int64),
            action_mask_key="action_mask",
        )
        self._loss = DQNLoss(
            actor,
            loss_function=settings.loss,
            delay_value=True,
            double_dqn=settings.double,
            action_space="categorical",
            reduction="mean",
        )
        self._loss.make_value_estimator(gamma=settings.gamma)
        self._values = torch.empty(0)
        if self.demonstration.is_given:
            inner = next(m for m in self._loss.value_network.modules() if isinstance(m, QNetwork))
            inner.register_forward_hook(self._note_values)
        if settings.target == "soft":
            self._target = SoftUpdate(self._loss, tau=settings.target_tau)
        else:
            every = settings.target_every_updates
            self._target = HardUpdate(self._loss, value_network_update_interval=every)
        self._parameters: list[Tensor] = list(network.parameters())
        self.average = deepcopy(network).eval().requires_grad_(False)
        self._averaged: list[Tensor] = list(self.average.parameters())
        self.optimizer = torch.optim.Adam(self._parameters, lr=settings.learning_rate)
        self.updates = 0

    def update(self, batch: TensorDict, done: float = 0.0) -> dict[str, Tensor | float]:
        """One gradient step on rows with the transition keys; returns scalars for the log.

        batch: gets "td_error" [N, 1], squared.
        done: share of the run that is over, 0..1, for the learning rate.
        """
        kind = self._parameters[0].device.type
        with torch.autocast(kind, torch.bfloat16, enabled=self.settings.autocast):
            td_loss = self._loss(batch)["loss"]
        margin_loss = self._find_margin_loss(batch)
        loss = td_loss + self.demonstration.margin_weight * margin_loss
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()
        norm = torch.nn.utils.clip_grad_norm_(self._parameters, self.settings.max_grad_norm)
        for group in self.optimizer.param_groups:
            group["lr"] = self.settings.learning_rate_at(done)
        self.optimizer.step()
        self._target.step()
        self.updates += 1
        self._take_into_average()
        values = {"loss/all": td_loss.detach(), "grad_norm": norm, **self._split(batch)}
        if self.demonstration.is_given:
            values["loss/margin"] = margin_loss.detach()
        return values

    def _note_values(self, module: QNetwork, inputs: tuple[Tensor, ...], values: Tensor) -> None:
        """Keep Q(s, .) of the loss, its only values with gradients: another pass for the margin
        would cost a third of an update.
        """
        if values.requires_grad:
            self._values = values

    def _find_margin_loss(self, batch: TensorDict) -> Tensor:
        """Mean over the batch of max over legal a of (Q(s, a) + margin where a is not the expert's
        action) - Q(s, the expert's action), 0 for rows without an expert's action.
        """
        if (
            not self.demonstration.is_given
            or not (shown := batch["expert_action"] != NO_ACTION).any()
        ):
            return torch.zeros(())
        action = batch["expert_action"][shown, None]
        values = self._values[shown]
        wanted = values.gather(1, action)
        rivals = (values + self.demonstration.margin).scatter(1, action, wanted)
        legal = batch["action_mask"][shown]
        best = rivals.masked_fill(~legal, -torch.inf).amax(1, keepdim=True)
        loss: Tensor = (best - wanted).sum() / len(shown)
        return loss

    @torch.no_grad()
    def _take_into_average(self) -> None:
        warm = (1 + self.updates) / (_AVERAGE_WARMUP + self.updates)
        share = 1.0 - min(self.settings.average_decay, warm)
        torch._foreach_lerp_(self._averaged, self._parameters, share)

    def _split(self, batch: TensorDict) -> dict[str, Tensor | float]:
        """Mean loss and TD error of real and of generated rows, apart."""
        # TorchRL writes the square of the TD error.
        error = batch["td_error"].detach().flatten().sqrt()
        loss = error.clamp(max=1.0) * (error - 0.5 * error.clamp(max=1.0))
        if self.settings.loss == "l2":
            loss = error.square()
        generated = batch["is_generated"].flatten()
        values: dict[str, Tensor | float] = {}
        num_generated = int(generated.sum())
        for name, rows, count in (
            ("real", ~generated, len(error) - num_generated),
            ("generated", generated, num_generated),
        ):
            if count:
                values[f"td_error/{name}"] = error[rows].mean()
                values[f"loss/{name}"] = loss[rows].mean()
        values["batch/generated_share"] = num_generated / len(error)
        return values

    def state_dict(self) -> dict[str, Any]:
        """Network, target, optimiser and counts as tensors and plain data."""
        return {
            "loss": dict(self._loss.state_dict()),
            "average": dict(self.average.state_dict()),
            "optimizer": self.optimizer.state_dict(),
            "target_counter": getattr(self._target, "counter", 0),
            "updates": self.updates,
        }

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from `state_dict`. Raises ValueError for numbers that are not finite."""
        restore_weights(self._loss, state["loss"], "learner.loss")
        restore_weights(self.average, state["average"], "learner.average")
        restore_optimizer(self.optimizer, state["optimizer"], "learner.optimizer")
        if hasattr(self._target, "counter"):
            self._target.counter = read_number(state, "target_counter", COUNT)
        self.updates = read_number(state, "updates", COUNT)
