"""Batches of the newest collected steps with Q(lambda) targets, for learning without replay."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from marl_cair.games.torchrl_env import GROUP
from marl_cair.policies.actor import PolicyActor, best_values
from marl_cair.training.collecting.rollout import by_time
from marl_cair.training.losses import find_lambda_returns, find_targets
from marl_cair.training.settings.learner import WATKINS, LearnerSettings


def make_rows(data: TensorDictBase, actor: PolicyActor, settings: LearnerSettings) -> TensorDict:
    """The learned steps of a collected batch [B, T], with their targets, as TensorDict [N].

    For a network with memory it is [S, T]: the streams (seats of worlds) with learned steps, which
    "learned" marks, with "state", the memory's before the step, and "starts" of episodes.

    actor: the network that has collected them, with "best_value" float32 [B, T, P] of each learned
    step, its largest legal Q, and "explored" bool [B, T, P], other actions than that of this value.
    """
    group, following = data[GROUP], data["next", GROUP]
    learned, best = by_time(group["learned"]), by_time(group["best_value"])
    terminated = by_time(following["terminated"]).squeeze(-1)
    is_end = terminated | by_time(following["truncated"]).squeeze(-1)
    none = torch.zeros_like(learned[:1])
    is_cut = is_end | ~torch.cat([learned[1:], none])
    best_ahead = torch.cat([best[1:], best[:1]])
    place = (is_cut & learned & ~terminated).nonzero(as_tuple=True)
    best_ahead[place] = _value_next(data, place, actor)
    if settings.traces == WATKINS:
        is_cut |= torch.cat([by_time(group["explored"])[1:], none])
    reward = by_time(following["reward"]).squeeze(-1) * settings.reward_scale
    returns = find_lambda_returns(
        reward, best_ahead, terminated, is_cut, settings.gamma, settings.q_lambda
    )
    rows = {
        "observation": by_time(group["observation"]),
        "action": by_time(group["action"]),
        "target": returns,
        "is_generated": torch.zeros_like(learned),
    }
    if group["action"].ndim > group["learned"].ndim:
        rows["action_mask"] = by_time(group["action_mask"])
    if not actor.state_size:
        count = int(learned.sum())
        return TensorDict({name: value[learned] for name, value in rows.items()}, [count])
    rows |= {
        "state": by_time(group["state"]),
        "starts": torch.cat([none, is_end[:-1]]),
        "learned": learned,
    }
    streams = learned.any(0).nonzero().squeeze(1)
    sequences = {name: value[:, streams].transpose(0, 1) for name, value in rows.items()}
    return TensorDict(sequences, [len(streams), len(learned)])


def _value_next(data: TensorDictBase, place: tuple[Tensor, ...], actor: PolicyActor) -> Tensor:
    """Largest legal Q float32 [K] after K steps; place: their time and stream, int64 [K] each."""
    group, following = data[GROUP], data["next", GROUP]
    num_players = group["learned"].shape[-1]
    where = (place[1] // num_players, place[0], place[1] % num_players)
    state = torch.zeros(len(place[0]), 0)
    if actor.state_size:
        _, state = actor.step(group["observation"][where], group["state"][where])
    values, _ = actor.step(following["observation"][where], state)
    mask = following["action_mask"][where].to(values.device)
    return best_values(values, mask).cpu()


def iterate_batches(
    rows: TensorDict,
    settings: LearnerSettings,
    actor: PolicyActor,
    sample_generated: Callable[[int], TensorDict | None],
    generator: torch.Generator,
) -> Iterator[TensorDict]:
    """Shuffled parts of `rows`, `learner.minibatches` in each of `learner.epochs`, with generated
    transitions added.

    sample_generated: number of real rows -> the generated transitions that join them, or None.
    generator: of the order.
    """
    for _ in range(settings.epochs):
        order = torch.randperm(len(rows), generator=generator)
        for part in order.chunk(settings.minibatches):
            batch = rows[part]
            generated = sample_generated(len(part))
            if generated is not None:
                batch = torch.cat([batch, _add_targets(generated, actor, settings)])
            yield batch


def _add_targets(
    generated: TensorDict, actor: PolicyActor, settings: LearnerSettings
) -> TensorDict:
    """Generated transitions [N] as rows, with one-step targets."""
    following = generated["next"]
    values = actor.compute_values(following["observation"]).to(following["reward"].device)
    best = best_values(values, following["action_mask"])
    return TensorDict(
        {
            "observation": generated["observation"],
            "action": generated["action"],
            "target": find_targets(generated, best, settings.gamma),
            "is_generated": generated["is_generated"].squeeze(-1),
        },
        [len(generated)],
    )
