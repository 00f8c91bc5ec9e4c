"""Check and load saved weights and optimiser states."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor, nn

from marl_cair.ranges import WEIGHT, read_number


def require_finite(weights: Mapping[str, Any], where: str) -> None:
    """Raise ValueError for a tensor with NaN or infinite numbers.

    weights: tensors by name; where: prefix of the name in the message.
    """
    for name, value in weights.items():
        is_number = isinstance(value, Tensor) and value.is_floating_point()
        if is_number and not bool(torch.isfinite(value).all()):
            raise ValueError(
                f"{where}{name} holds numbers that are not finite (NaN or infinite): the training "
                "has diverged or the file is damaged; take an earlier checkpoint"
            )


def restore_weights(network: nn.Module, saved: Mapping[str, Any], where: str) -> None:
    """Load weights from `state_dict`. where: their owner, for the message.

    Raises ValueError if they belong to another network or are not finite.
    """
    require_finite(saved, f"{where}.")
    try:
        network.load_state_dict(saved)
    except (RuntimeError, AttributeError) as error:
        raise ValueError(f"{where} does not fit: {error}") from error


def restore_optimizer(optimizer: torch.optim.Optimizer, saved: Any, where: str) -> None:
    """Load an optimiser's `state_dict`, less its learning rate. where: its owner, for the message.

    Raises ValueError if it belongs to other weights, or would break the next step.
    """
    parameters = [one for group in optimizer.param_groups for one in group["params"]]
    own = optimizer.state_dict()["param_groups"]
    if len(saved["param_groups"]) != len(own):
        raise ValueError(f"{where} has {len(saved['param_groups'])} groups, expected {len(own)}")
    for group, held in zip(saved["param_groups"], own, strict=True):
        for name, value in held.items():
            if name == "lr":
                read_number(group, name, WEIGHT)
            elif group.get(name) != value:
                raise ValueError(
                    f"{where}.{name} is {group.get(name)!r:.80}, expected {value!r:.80}"
                )
    for number, kept in saved["state"].items():
        if type(number) is not int or not 0 <= number < len(parameters):
            raise ValueError(f"{where} holds a weight {number!r:.80}, there are {len(parameters)}")
        for name, value in kept.items():
            _check_moment(f"{where}.{number}.{name}", value, parameters[number])
    optimizer.load_state_dict({**saved, "param_groups": own})


def _check_moment(name: str, value: Any, parameter: Tensor) -> None:
    """A moment has the weight's shape, a step count is a single number; squares are 0 or more."""
    is_step = name.endswith(".step")
    shape = () if is_step else tuple(parameter.shape)
    if not isinstance(value, Tensor) or tuple(value.shape) != shape or value.is_complex():
        raise ValueError(f"{name} must be a tensor of shape {list(shape)}")
    require_finite({name: value}, "")
    if (is_step or name.endswith("_sq")) and bool((value < 0).any()):
        raise ValueError(f"{name} holds numbers below 0")
