"""Checks a body or head from outside the package on observations of zeros."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import torch
from torch import Tensor, nn

from marl_cair import policies
from marl_cair.outside import OutsideCodeError, outside_call

if TYPE_CHECKING:
    from marl_cair.policies.q_network import QNetwork

_NUM_ROWS = 2


@torch.no_grad()
def check_outside(network: QNetwork) -> None:
    """Run a network with a body or head from outside twice, on two observations of zeros.

    Raises OutsideCodeError with the class's name if it fails, its output is not float32 of shape
    [N, num_features] (body) or [N, num_actions] (head), or not finite, or a second call gives other
    values: it would remember or draw. Other networks are not run.
    """
    names = network.config.body, network.config.head
    parts: list[tuple[str, nn.Module, int]] = []
    if policies.NETWORKS.is_outside(names[0]):
        parts.append((names[0], network.body, network.body.num_features))
    if policies.HEADS.is_outside(names[1]):
        parts.append((names[1], network.head, network.num_actions))
    if not parts:
        return
    hooks = [part.register_forward_hook(_make_check(name, size)) for name, part, size in parts]
    was_training = network.training
    network.eval()  # running means, as of batch normalisation, do not change
    seen = torch.zeros(_NUM_ROWS, *network.observation_shape)
    named = " and ".join(name for name, _, _ in parts)
    what = f"{named} failed on observations of zeros of shape {list(seen.shape)}"
    try:
        with outside_call(what), torch.random.fork_rng(devices=[]):
            state = torch.zeros(_NUM_ROWS, network.state_size) if network.memory else None
            for _ in range(2):
                network(seen, state)
    finally:
        for hook in hooks:
            hook.remove()
        network.train(was_training)


def _make_check(name: str, size: int) -> Callable[[nn.Module, Any, Any], None]:
    wanted, before = [_NUM_ROWS, size], list[Tensor]()

    def check(part: nn.Module, inputs: Any, output: Any) -> None:
        if not isinstance(output, Tensor):
            given = f"a {type(output).__name__}"
        elif list(output.shape) != wanted or output.dtype != torch.float32:
            given = f"{output.dtype} of shape {list(output.shape)}"
        elif not bool(torch.isfinite(output).all()):
            given = "numbers that are not finite (NaN or infinite)"
        elif before and not torch.equal(output, before[0]):
            given = "other values in a second call (it may draw while `self.training` only)"
        else:
            before.append(output.clone())  # it may be a buffer that the next call fills
            return
        raise OutsideCodeError(
            f"{name} gave {given} for {_NUM_ROWS} observations of zeros; its forward must return "
            f"finite torch.float32 of shape {wanted}"
        )

    return check
