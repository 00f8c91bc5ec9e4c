"""Values and n-step returns of sequences of replayed steps, for networks with memory."""

from __future__ import annotations

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.policies.q_network import QNetwork


def count_burn_in(batch: TensorDict) -> int:
    """Number of first steps of the sequences [N, T] that are learned in none of them."""
    return int(batch["learned"].any(0).long().argmax())


def unroll_after(burn_in: int, network: QNetwork, batch: TensorDict) -> Tensor:
    """Values float32 [N, T - burn_in, A] of sequences [N, T] after the burn-in steps, which only
    move the stored state on, without gradient.

    batch: with "observation", "starts" and "state", of which the first step's is used.
    """
    seen, starts = batch["observation"].transpose(0, 1), batch["starts"].T
    state = batch["state"][:, 0]
    if burn_in:
        with torch.no_grad():
            _, states = network.unroll(seen[:burn_in], state, starts[:burn_in])
        state = states[-1]
    values, _ = network.unroll(seen[burn_in:], state, starts[burn_in:])
    return values.transpose(0, 1)


def find_step_returns(batch: TensorDict, value: Tensor, gamma: float, n_steps: int) -> Tensor:
    """n-step returns float32 [N, T] of sequences.

    The rewards of n_steps steps and the value of the entry after them; of fewer steps if the
    episode or the sequence ends before, and no value after a terminated step.

    batch: with "reward", "terminated" and "learned". value: float32 [N, T], of each entry.
    """
    reward, terminated, learned = batch["reward"], batch["terminated"], batch["learned"]
    ahead = _shift(value).masked_fill(terminated, 0.0)
    goes_on = _shift(learned)
    goes_on[:, -1] = False
    found: Tensor = reward + gamma * ahead
    for _ in range(min(n_steps, found.shape[1]) - 1):
        found = reward + gamma * torch.where(goes_on, _shift(found), ahead)
    return found


def _shift(rows: Tensor) -> Tensor:
    """Rows [N, T] of the next entry; those of the last are its own."""
    return torch.cat([rows[:, 1:], rows[:, -1:]], 1)
