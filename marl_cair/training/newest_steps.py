"""Batches of the newest collected steps with Q(lambda) targets, for learning without replay."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor

from marl_cair.games.torchrl_env import GROUP
from marl_cair.policies.actor import PolicyActor, find_values, masked_argmax
from marl_cair.training.collecting.rollout import by_time
from marl_cair.training.losses import find_lambda_returns, find_targets
from marl_cair.training.settings.learner import WATKINS, LearnerSettings


class DoubleValues(NamedTuple):
    """Values of states for targets, by two networks (double Q-learning, van Hasselt et al. 2016).

    The largest of hundreds of values that err is too large. Actions by the averaged weights, and
    their values by the newest, err apart; and the newest weights carry values back quickly.
    """

    chooser: PolicyActor  # the network that has collected; its action counts
    judge: PolicyActor  # the newest network; its value of this action counts

    def rate(self, observation: Tensor, state: Tensor, action_mask: Tensor) -> Tensor:
        """Values float32 [K] of observations [K, *shape] with state float32 [K, state_size], under
        action_mask bool [K, A].
        """
        action = self.choose(observation, state, action_mask)
        return self.judge_actions(observation, state, action_mask, action)[0]

    def choose(self, observation: Tensor, state: Tensor, action_mask: Tensor) -> Tensor:
        """The chooser's best legal actions int64 [K]; arguments as in `rate`."""
        return masked_argmax(self.chooser.step(observation, state)[0], action_mask)

    def judge_actions(
        self, observation: Tensor, state: Tensor, action_mask: Tensor, *actions: Tensor
    ) -> list[Tensor]:
        """The judge's values float32 [K] of each of `actions` int64 [K]; the rest as in `rate`."""
        values = self.judge.step(observation, state)[0]
        return [find_values(values, one, action_mask if one.ndim > 1 else None) for one in actions]


def make_rows(data: TensorDictBase, double: DoubleValues, settings: LearnerSettings) -> TensorDict:
    """The learned steps of a collected batch [B, T], with their targets, as TensorDict [N].

    For a network with memory it is [S, T]: the streams (seats of worlds) with learned steps, which
    "learned" marks, with "state", the memory's before the step, and "starts" of episodes.

    data: with "best_action" int64 [B, T, P], that of the chooser.
    """
    group, following = data[GROUP], data["next", GROUP]
    learned, action = by_time(group["learned"]), by_time(group["action"])
    best_action, mask = by_time(group["best_action"]), by_time(group["action_mask"])
    terminated = by_time(following["terminated"]).squeeze(-1)
    is_end = terminated | by_time(following["truncated"]).squeeze(-1)
    none = torch.zeros_like(learned[:1])
    seen, state = by_time(group["observation"]), torch.zeros(*learned.shape, 0)
    if double.chooser.state_size:
        state = by_time(group["state"])
    best, taken = torch.zeros(2, *learned.shape)
    best[learned], taken[learned] = double.judge_actions(
        *(part[learned] for part in (seen, state, mask, best_action, action))
    )
    best_ahead = torch.cat([best[1:], best[:1]])
    is_cut = is_end | ~torch.cat([learned[1:], none])
    place = (is_cut & learned & ~terminated).nonzero(as_tuple=True)
    best_ahead[place] = _value_next(data, place, double)
    if settings.traces == WATKINS:
        explored = (action != best_action).view(*learned.shape, -1).any(-1)
        is_cut |= torch.cat([explored[1:], none])
    reward = by_time(following["reward"]).squeeze(-1) * settings.reward_scale
    returns = find_lambda_returns(
        reward, best_ahead, terminated, is_cut, settings.gamma, settings.q_lambda
    )
    rows = {
        "observation": seen,
        "action": action,
        "target": returns - settings.action_gap * (best - taken).relu(),
        "is_generated": torch.zeros_like(learned),
    }
    if action.ndim > learned.ndim:
        rows["action_mask"] = mask
    if not double.chooser.state_size:
        count = int(learned.sum())
        return TensorDict({name: value[learned] for name, value in rows.items()}, [count])
    rows |= {
        "state": state,
        "starts": torch.cat([none, is_end[:-1]]),
        "learned": learned,
    }
    streams = learned.any(0).nonzero().squeeze(1)
    sequences = {name: value[:, streams].transpose(0, 1) for name, value in rows.items()}
    return TensorDict(sequences, [len(streams), len(learned)])


def _value_next(data: TensorDictBase, place: tuple[Tensor, ...], double: DoubleValues) -> Tensor:
    """Values float32 [K] after K steps; place: their time and stream, int64 [K] each."""
    group, following = data[GROUP], data["next", GROUP]
    num_players = group["learned"].shape[-1]
    where = (place[1] // num_players, place[0], place[1] % num_players)
    state = torch.zeros(len(place[0]), 0)
    if double.chooser.state_size:
        _, state = double.chooser.step(group["observation"][where], group["state"][where])
    return double.rate(following["observation"][where], state, following["action_mask"][where])


def iterate_batches(
    rows: TensorDict,
    settings: LearnerSettings,
    double: DoubleValues,
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
                batch = torch.cat([batch, _add_targets(generated, double, settings)])
            yield batch


def _add_targets(
    generated: TensorDict, double: DoubleValues, settings: LearnerSettings
) -> TensorDict:
    """Generated transitions [N] of n steps as rows, with targets."""
    following, none = generated["next"], torch.zeros(len(generated), 0)
    allowed = following["action_mask"] | following["terminated"]  # after an end it may be empty
    ahead = double.rate(following["observation"], none, allowed)
    target = find_targets(generated, ahead, settings.gamma)
    seen, mask, action = (generated[name] for name in ("observation", "action_mask", "action"))
    if settings.action_gap:
        chosen = double.choose(seen, none, mask)
        best, taken = double.judge_actions(seen, none, mask, chosen, action)
        target = target - settings.action_gap * (best - taken).relu()
    return TensorDict(
        {
            "observation": seen,
            "action": action,
            "target": target,
            "is_generated": generated["is_generated"].squeeze(-1),
        },
        [len(generated)],
    )
