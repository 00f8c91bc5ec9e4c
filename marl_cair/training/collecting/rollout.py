"""Converts collected steps into a replay `Rollout`."""

from __future__ import annotations

import torch
from tensordict import TensorDictBase
from torch import Tensor

from marl_cair.games.torchrl_env import GROUP
from marl_cair.replay.rollout import Rollout


def make_rollout(data: TensorDictBase, reward_scale: float, num_others: int = 0) -> Rollout:
    """Streams are seats of worlds, s = b * P + p; only ends carry a next observation.

    num_others: P - 1, to note the other seats' actions too.

    The step at which a seat goes out is terminated for that seat, and no later one is learned.
    """
    group, following = data[GROUP], data["next", GROUP]
    names = ("observation", "action_mask", "action", "learned", "expert_action", "opponent")
    state = group.get("state", None)
    steps = {name: by_time(group[name]) for name in names}
    terminated = by_time(following["terminated"]).squeeze(-1)
    truncated = by_time(following["truncated"]).squeeze(-1) & ~terminated
    # Q-learning does not use the state after a terminated step, but the generator learns ends.
    final_step = ((terminated | truncated) & steps["learned"]).flatten().nonzero().squeeze(1)
    num_streams, players = steps["learned"].shape[1], group["action"].shape[-1]
    time, stream = final_step // num_streams, final_step % num_streams
    final = (stream // players, time, stream % players)
    return Rollout(
        **steps,
        reward=by_time(following["reward"]).squeeze(-1) * reward_scale,
        terminated=terminated,
        truncated=truncated,
        final_step=final_step,
        final_observation=following["observation"][final],
        final_action_mask=following["action_mask"][final],
        state=None if state is None else by_time(state),
        other_actions=by_time(_find_others(group["action"])) if num_others else None,
    )


def _find_others(action: Tensor) -> Tensor:
    """Actions [B, T, P] -> those of the seats after each one, [B, T, P, P - 1]."""
    players = action.shape[-1]
    return torch.stack([action.roll(-seat, -1)[..., 1:] for seat in range(players)], -2)


def by_time(value: Tensor) -> Tensor:
    """[B, T, P, ...] -> [T, B * P, ...], contiguous."""
    return value.transpose(0, 1).flatten(1, 2).contiguous()
