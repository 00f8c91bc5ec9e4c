"""Exploration: the learner's actions while it collects, from its action values."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from marl_cair.outside import OutsideCodeError, outside_call
from marl_cair.policies.actor import MaskedEpsilonGreedy, masked_argmax
from marl_cair.training.settings.exploration import EXPLORATIONS, ExplorationSettings


class Exploration(ABC):
    """Base class of explorations, the entries of `EXPLORATIONS`.

    Args:
        settings: `exploration.*`.
        action_groups: int [A], the kind of each action.
    """

    def __init__(self, settings: ExplorationSettings, action_groups: NDArray[np.int16]) -> None:
        self.settings, self.action_groups = settings, action_groups

    @abstractmethod
    def __call__(
        self, values: Tensor, action_mask: Tensor, generator: torch.Generator, frames: int
    ) -> Tensor:
        """Values float32 [N, A], mask bool [N, A] -> legal actions int64 [N], without gradients.
        Where seats act at several places: [N, *places, A] -> [N, *places].

        generator: on the CPU, the only source of randomness; its state is saved with the run.
        frames: steps of all environment copies so far.
        """

    def epsilon_at(self, frames: int) -> float:
        """Chance of a random action, for the log."""
        return 0.0


class EpsilonGreedy(Exploration):
    """The best legal action, or with probability epsilon a random one: uniform over the legal kinds
    of action, then over the actions of the kind. Epsilon falls linearly.

    With `exploration.epsilon_power` p row i of N explores with epsilon ** (1 + p * i / (N - 1)), as
    the actors of Ape-X (Horgan et al. 2018): most worlds follow the policy, a few leave it often.
    """

    def __init__(self, settings: ExplorationSettings, action_groups: NDArray[np.int16]) -> None:
        super().__init__(settings, action_groups)
        self._choose = MaskedEpsilonGreedy(0, action_groups)

    def __call__(
        self, values: Tensor, action_mask: Tensor, generator: torch.Generator, frames: int
    ) -> Tensor:
        self._choose.generator = generator
        rows = torch.linspace(0.0, 1.0, len(values), dtype=torch.float64)
        epsilon = self.epsilon_at(frames) ** (1.0 + self.settings.epsilon_power * rows)
        return self._choose(values, action_mask, epsilon)

    def epsilon_at(self, frames: int) -> float:
        return self.settings.epsilon_at(frames)


class NoisyLayers(Exploration):
    """The best legal action by values that have the noise of the network's noisy layers."""

    def __call__(
        self, values: Tensor, action_mask: Tensor, generator: torch.Generator, frames: int
    ) -> Tensor:
        return masked_argmax(values, action_mask)


class _Checked(Exploration):
    """An exploration from outside; raises OutsideCodeError for its errors and wrong actions."""

    def __init__(self, name: str, inner: Exploration) -> None:
        super().__init__(inner.settings, inner.action_groups)
        self._name, self._inner = name, inner

    def __call__(
        self, values: Tensor, action_mask: Tensor, generator: torch.Generator, frames: int
    ) -> Tensor:
        with outside_call(f"exploration.kind={self._name} failed"):
            actions = self._inner(values, action_mask, generator, frames)
            fault = f"{actions.dtype} of shape {list(actions.shape)}"
            if actions.dtype == torch.int64 and actions.shape == values.shape[:-1]:
                is_known = (actions >= 0) & (actions < values.shape[-1])
                known = actions.where(is_known, 0).unsqueeze(-1)
                illegal = actions[~(is_known & action_mask.gather(-1, known).squeeze(-1))]
                fault = f"the illegal action {int(illegal[0])}" if len(illegal) else ""
        if fault:
            raise OutsideCodeError(
                f"exploration.kind={self._name} gave {fault} for {len(values)} rows, it must give "
                f"a legal action of each, torch.int64 of shape {list(values.shape[:-1])}"
            )
        return actions

    def epsilon_at(self, frames: int) -> float:
        return float(self._inner.epsilon_at(frames))


def make_exploration(
    settings: ExplorationSettings, action_groups: NDArray[np.int16], shape: Sequence[int] = ()
) -> Exploration:
    """The exploration of a run; one from outside is called once with values of zeros.

    action_groups: int [A], the kind of each action. shape: of the places where a seat acts, () for
    one action. Raises OutsideCodeError.
    """
    made: Exploration = EXPLORATIONS.make(settings.kind, settings, action_groups)
    if not EXPLORATIONS.is_outside(settings.kind):
        return made
    checked = _Checked(settings.kind, made)
    values = torch.zeros(2, *shape, len(action_groups))
    checked(values, torch.ones_like(values, dtype=torch.bool), torch.Generator(), 0)
    return checked
