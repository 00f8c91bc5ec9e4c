"""One update of a Q-network: loss, gradient step, target network, averaged weights."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy
from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor, nn

from marl_cair.policies.heads import set_noise
from marl_cair.policies.q_network import QNetwork
from marl_cair.policies.saved_weights import require_finite, restore_optimizer, restore_weights
from marl_cair.ranges import COUNT, WEIGHT, read_number
from marl_cair.replay.transition import NO_ACTION
from marl_cair.training.losses import Loss, find_learned, measure_errors
from marl_cair.training.settings.demonstration import DemonstrationSettings
from marl_cair.training.settings.learner import AVERAGED, LOSSES, LearnerSettings

_OPTIMIZERS: dict[str, Callable[..., torch.optim.Optimizer]] = {
    "adam": torch.optim.Adam,
    "radam": torch.optim.RAdam,
    "rmsprop": torch.optim.RMSprop,
    "sgd": torch.optim.SGD,
}


class DivergedError(ValueError):
    """Loss or gradient are not finite; the weights are those before the update."""


def _share_weights(network: QNetwork) -> QNetwork:
    """A network that acts with these weights, in evaluation mode, while they are trained."""
    weights = [*network.parameters(), *network.buffers()]
    return deepcopy(network, {id(weight): weight for weight in weights}).eval()


class Learner:
    """Network, target network, optimiser, and the averaged weights that are rated and kept.

    The loss is an entry of `LOSSES`. Neighbouring actions differ little in value, so a few updates
    can change the greedy policy; `average` is the exponential moving average of the weights (Polyak
    and Juditsky 1992), whose policy is steady. `newest` acts with the weights of `network`;
    `behaviour` collects: `newest`, or a network with the weights of `average`. All are on the
    device of `network`.

    Noisy layers have noise in all of them but `average`, from a generator with `seed`.
    """

    def __init__(
        self,
        network: QNetwork,
        settings: LearnerSettings,
        demonstration: DemonstrationSettings | None = None,
        seed: int = 0,
    ) -> None:
        self.network, self.settings = network, settings
        self.demonstration = demonstration or DemonstrationSettings()
        self.loss: Loss = LOSSES.make(settings.algorithm, settings)
        self.average = deepcopy(network).eval().requires_grad_(False)
        self.target = network
        if self.loss.HAS_TARGET_NETWORK:
            self.target = deepcopy(network).requires_grad_(False)
        self.newest = _share_weights(network)
        is_averaged = settings.behaviour == AVERAGED
        self.behaviour = _share_weights(self.average) if is_averaged else self.newest
        self.noise = torch.Generator().manual_seed(seed)
        for noisy in (self.network, self.target, self.newest, self.behaviour):
            set_noise(noisy, self.noise)
        self._parameters: list[Tensor] = list(network.parameters())
        self._targets: list[Tensor] = list(self.target.parameters())
        self._averaged: list[Tensor] = list(self.average.parameters())
        own, saved = self.average.state_dict(), network.state_dict(keep_vars=True)
        # As means of batch normalisation: beside the weights, what a saved network has.
        buffers = {k: v for k, v in saved.items() if isinstance(v, Tensor)}  # not extra state
        self._running = [(own[k], v) for k, v in buffers.items() if not isinstance(v, nn.Parameter)]
        make_optimizer = _OPTIMIZERS[settings.optimizer]
        epsilon = {} if settings.optimizer == "sgd" else {"eps": settings.optimizer_epsilon}
        self.optimizer = make_optimizer(self._parameters, lr=settings.learning_rate, **epsilon)
        self.updates = 0
        self.generated = 0.0  # sum over updates of the generated share of their rows

    def update(self, batch: TensorDict, done: float = 0.0) -> dict[str, Tensor | float]:
        """One gradient step on rows as the loss reads them; returns scalars for the log.

        batch: TensorDict [N], or [N, T] of sequences; gets "td_error" float32 of the same shape.
        done: share of the run that is over, 0..1, for the learning rate.
        Raises DivergedError where loss or gradient are not finite.
        """
        device = self._parameters[0].device
        rows = batch if device.type == "cpu" else batch.to(device, non_blocking=True)
        with torch.autocast(device.type, torch.bfloat16, enabled=self.settings.autocast):
            result = self.loss(self.network, self.target, rows)
        rows["td_error"] = result.td_error
        loss: Tensor = result.loss
        values: dict[str, Tensor | float] = {"loss/all": loss.detach()}
        if self.demonstration.is_given:
            margin_loss = self._find_margin_loss(rows, result.values)
            loss = loss + self.demonstration.margin_weight * margin_loss
            values["loss/margin"] = margin_loss.detach()
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        norm = torch.nn.utils.clip_grad_norm_(self._parameters, self.settings.max_grad_norm)
        if not torch.isfinite(norm):
            raise DivergedError(
                f"update {self.updates}: loss {loss.item()}, gradient {norm.item()}"
            )
        for group in self.optimizer.param_groups:
            group["lr"] = self.settings.learning_rate_at(done)
        self.optimizer.step()
        self.updates += 1
        self._follow()
        batch["td_error"] = result.td_error.cpu()
        return {**values, "grad_norm": norm, **self._split(rows)}

    @torch.no_grad()
    def _follow(self) -> None:
        """Move target network and averaged weights towards the newest weights."""
        settings = self.settings
        if self.loss.HAS_TARGET_NETWORK:
            if settings.target == "soft":
                torch._foreach_lerp_(self._targets, self._parameters, settings.target_tau)
            elif self.updates % settings.target_every_updates == 0:
                torch._foreach_copy_(self._targets, self._parameters)
        torch._foreach_lerp_(self._averaged, self._parameters, 1.0 - settings.average_decay)
        for averaged, newest in self._running:
            averaged.copy_(newest)

    def _find_margin_loss(self, batch: TensorDict, values: Tensor) -> Tensor:
        """Mean over the learned steps of max over legal a of (Q(s, a) + margin where a is not the
        expert's action) - Q(s, the expert's action), 0 for steps without an expert's action.
        """
        learned = find_learned(batch, values.device)
        shown = learned & (batch["expert_action"] != NO_ACTION)
        if not shown.any():
            return torch.zeros(())
        action, values = batch["expert_action"][shown, None], values[shown]
        wanted = values.gather(1, action)
        rivals = (values + self.demonstration.margin).scatter(1, action, wanted)
        legal = batch["action_mask"][shown]
        best = rivals.masked_fill(~legal, -torch.inf).amax(1, keepdim=True)
        loss: Tensor = (best - wanted).sum() / learned.sum()
        return loss

    def _split(self, batch: TensorDict) -> dict[str, Tensor | float]:
        """Mean loss and TD error of real and of generated rows, apart."""
        learned = find_learned(batch, batch["td_error"].device)
        error = batch["td_error"].abs()[learned]
        loss = measure_errors(error, torch.zeros_like(error), self.settings.loss)
        generated = batch["is_generated"].view(batch.shape)[learned]
        values: dict[str, Tensor | float] = {}
        num_generated = int(generated.sum())
        for name, rows, count in (
            ("real", ~generated, len(error) - num_generated),
            ("generated", generated, num_generated),
        ):
            if count:
                values[f"td_error/{name}"] = error[rows].mean()
                values[f"loss/{name}"] = loss[rows].mean()
        values["batch/generated_share"] = share = num_generated / len(error)
        self.generated += share
        return values

    def state_dict(self) -> dict[str, Any]:
        """Network, target, optimiser and counts as tensors and plain data."""
        return {
            **{name: dict(network.state_dict()) for name, network in self._networks().items()},
            "optimizer": self.optimizer.state_dict(),
            "updates": self.updates,
            "generated": self.generated,
            "noise": self.noise.get_state(),
        }

    def require_finite(self) -> None:
        """Raise ValueError for weights or moments that are not finite: no run could resume them."""
        for name, network in self._networks().items():
            require_finite(network.state_dict(), f"learner.{name}.")
        for moments in self.optimizer.state.values():
            require_finite(moments, "learner.optimizer.")

    def _networks(self) -> dict[str, QNetwork]:
        networks = {"network": self.network, "average": self.average}
        return networks | ({"target": self.target} if self.loss.HAS_TARGET_NETWORK else {})

    def load_state_dict(self, state: Mapping[str, Any]) -> None:
        """Continue from `state_dict`. Raises ValueError for numbers that are not finite."""
        for name, network in self._networks().items():
            restore_weights(network, state[name], f"learner.{name}")
        restore_optimizer(self.optimizer, state["optimizer"], "learner.optimizer")
        self.updates = read_number(state, "updates", COUNT)
        if "generated" in state:  # not in states from before it was counted
            self.generated = read_number(state, "generated", WEIGHT)
        self.noise.set_state(state["noise"])
