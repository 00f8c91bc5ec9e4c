"""Checks a loss from outside the package on a batch of zeros."""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.outside import OutsideCodeError, outside_call
from marl_cair.policies.q_network import QNetwork
from marl_cair.replay.transition import NO_ACTION, TransitionSpec, make_tensordict
from marl_cair.training.losses import Loss, LossResult
from marl_cair.training.settings.learner import LOSSES, LearnerSettings

_NUM_ROWS, _NUM_STEPS = 2, 3  # of a batch, and of its sequences


def check_loss(settings: LearnerSettings, network: QNetwork, spec: TransitionSpec) -> None:
    """Call a loss from outside once, with copies of `network`, on two rows or sequences of zeros,
    but for one reward or target: a loss may divide by how rows differ.

    Raises OutsideCodeError with the class's name if it fails, or does not return a `LossResult` as
    `Loss` describes it, or one that is not finite. Other losses are not called.
    """
    name = settings.algorithm
    if not LOSSES.is_outside(name):
        return
    loss: Loss = LOSSES.make(name, settings)
    online = deepcopy(network).cpu()
    target = deepcopy(online).requires_grad_(False) if loss.HAS_TARGET_NETWORK else online
    batch = _make_zeros(loss, network, spec)
    shapes = (), tuple(batch.shape), (*batch.shape, *network.values_shape)
    what = f"learner.algorithm={name} failed on a batch of zeros of shape {list(batch.shape)}"
    with outside_call(what), torch.random.fork_rng(devices=[]):
        result: Any = loss(online, target, batch)
    if not isinstance(result, LossResult):
        raise OutsideCodeError(
            f"learner.algorithm={name} returned {result!r:.80}, it must be a LossResult"
        )
    for field, value, shape in zip(LossResult._fields, result, shapes, strict=True):
        if fault := _find_fault(value, shape):
            raise OutsideCodeError(
                f"learner.algorithm={name} returned {field} {fault} for a batch of zeros of shape "
                f"{list(batch.shape)}; it must be finite torch.float32 of shape {list(shape)}"
            )
    if not result.loss.requires_grad:
        raise OutsideCodeError(
            f"learner.algorithm={name} returned a loss without gradient: compute it from values of "
            "`network` outside of torch.no_grad"
        )


def _find_fault(value: Any, shape: tuple[int, ...]) -> str:
    if not isinstance(value, Tensor):
        return f"of type {type(value).__name__}"
    if value.dtype != torch.float32 or tuple(value.shape) != shape:
        return f"of {value.dtype} and shape {list(value.shape)}"
    return "" if bool(torch.isfinite(value).all()) else "that is not finite"


def _make_zeros(loss: Loss, network: QNetwork, spec: TransitionSpec) -> TensorDict:
    """Zeros with the keys of a batch that `loss` gets for `network`, without priorities; every
    action is legal.
    """
    fields: dict[Any, tuple[torch.dtype, tuple[int, ...]]] = spec.fields()
    shape: tuple[int, ...] = (_NUM_ROWS,)
    if loss.LEARNS_FROM_REPLAY and not network.state_size:
        rows = {key: torch.zeros(*shape, *size, dtype=kind) for key, (kind, size) in fields.items()}
        for key in ("action_mask", ("next", "action_mask"), "steps_to_next_obs"):
            rows[key].fill_(1)
        rows["expert_action"].fill_(NO_ACTION)
        rows["next", "reward"][-1] = 1.0
        return make_tensordict(rows)
    number, is_true = (torch.float32, ()), (torch.bool, ())
    places = network.values_shape[:-1]
    kept = {
        "observation": fields["observation"],
        "action": (torch.int64, places),
        "is_generated": is_true,
    }
    if loss.LEARNS_FROM_REPLAY:
        names = "action_mask", "expert_action", "opponent", "index"
        kept |= {name: fields[name] for name in names}
        kept |= {"reward": number, "terminated": is_true}
    else:
        kept["target"] = number
        if places:
            kept["action_mask"] = torch.bool, network.values_shape
    if network.state_size:
        shape = _NUM_ROWS, _NUM_STEPS
        kept["state"] = torch.float32, (network.state_size,)
        kept |= {"starts": is_true, "learned": is_true}
    batch = {key: torch.zeros(*shape, *size, dtype=kind) for key, (kind, size) in kept.items()}
    for key in {"action_mask", "learned"} & set(batch):
        batch[key].fill_(1)
    batch["reward" if loss.LEARNS_FROM_REPLAY else "target"][-1] = 1.0
    if loss.LEARNS_FROM_REPLAY:
        batch["learned"][:, -1] = False  # the last entry only gives the next value
        batch["expert_action"].fill_(NO_ACTION)
    return TensorDict(batch, shape)
