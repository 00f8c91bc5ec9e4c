"""Real transitions of the small worlds that the generator tests learn from."""

from __future__ import annotations

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.replay.transition import NO_ACTION, NO_OPPONENT


def pack_rows(
    now: Tensor,
    action: Tensor,
    later: Tensor,
    reward: Tensor,
    ended: Tensor,
    masks: tuple[Tensor, Tensor] | None = None,
) -> TensorDict:
    """One-step transitions, numbered from 0.

    now, later: observations [N, ...]; action: int64 [N]; reward: float32 [N]; ended: bool [N];
    masks: of legal actions now and later, bool [N, A] both; None: there are two, always legal.
    """
    num = len(action)
    every, no = torch.ones(num, 2, dtype=torch.bool), torch.zeros(num, 1, dtype=torch.bool)
    mask, next_mask = masks or (every, every)
    following = {
        "observation": later,
        "action_mask": next_mask,
        "reward": reward[:, None],
        "terminated": ended[:, None],
        "done": ended[:, None].clone(),
    }
    return TensorDict(
        {
            "observation": now,
            "action_mask": mask,
            "action": action,
            "next": TensorDict(following, [num]),
            "steps_to_next_obs": torch.ones(num, 1, dtype=torch.int64),
            "is_generated": no,
            "expert_action": torch.full((num,), NO_ACTION, dtype=torch.int64),
            "opponent": torch.full((num,), NO_OPPONENT, dtype=torch.int16),
            "index": torch.arange(num),
        },
        [num],
    )
