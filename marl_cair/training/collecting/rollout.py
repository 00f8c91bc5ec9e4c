"""From the collector's TensorDict [B, T] to the replay's rollout [T, S]."""

from __future__ import annotations

from tensordict import TensorDictBase
from torch import Tensor

from marl_cair.games.torchrl_env import GROUP
from marl_cair.replay.rollout import Rollout


def make_rollout(data: TensorDictBase, reward_scale: float) -> Rollout:
    """Streams are seats of worlds, s = b * P + p; only ends carry a next observation.

    The step at which a seat goes out is terminated for that seat, and no later one is learned.
    """
    group, following = data[GROUP], data["next", GROUP]
    terminated = _by_time(following["terminated"]).squeeze(-1)
    truncated = _by_time(following["truncated"]).squeeze(-1) & ~terminated
    # What terminated steps lead to is of no value to Q-learning, but the generator learns ends.
    learned = _by_time(group["learned"])
    final_step = ((terminated | truncated) & learned).flatten().nonzero().squeeze(1)
    num_streams = learned.shape[1]
    time, stream = final_step // num_streams, final_step % num_streams
    players = group["action"].shape[-1]
    final = (stream // players, time, stream % players)
    return Rollout(
        observation=_by_time(group["observation"]),
        action_mask=_by_time(group["action_mask"]),
        action=_by_time(group["action"]),
        reward=_by_time(following["reward"]).squeeze(-1) * reward_scale,
        terminated=terminated,
        truncated=truncated,
        learned=learned,
        expert_action=_by_time(group["expert_action"]),
        opponent=_by_time(group["opponent"]),
        final_step=final_step,
        final_observation=following["observation"][final],
        final_action_mask=following["action_mask"][final],
    )


def _by_time(value: Tensor) -> Tensor:
    """[B, T, P, ...] -> [T, B * P, ...], contiguous."""
    return value.transpose(0, 1).flatten(1, 2).contiguous()
