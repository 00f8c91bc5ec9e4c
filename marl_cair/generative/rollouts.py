"""Generated transitions of several decisions, as long as the generator can answer for them."""

from __future__ import annotations

from collections.abc import Callable

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.generative.generator import Generator
from marl_cair.replay.transition import (
    ACTION,
    ACTION_MASK,
    NEXT_ACTION_MASK,
    NEXT_DONE,
    NEXT_OBSERVATION,
    NEXT_REWARD,
    NEXT_TERMINATED,
    OBSERVATION,
    STEPS_TO_NEXT_OBS,
)

_FOLLOWING = (NEXT_OBSERVATION, NEXT_ACTION_MASK, NEXT_TERMINATED, NEXT_DONE)


@torch.no_grad()
def extend_rollouts(
    generator: Generator,
    rows: TensorDict,
    num_steps: int,
    gamma: float,
    choose: Callable[[Tensor, Tensor], Tensor],
) -> TensorDict:
    """Lengthen one-step transitions to as many as `num_steps` decisions, in place.

    A learner whose real rows are returns of several decisions learns more slowly by a fifth of rows
    of one, be they generated or real. So what follows is predicted too, of the actions that the
    learner itself would choose (model-based value expansion, Feinberg et al. 2018). A row ends
    where its game does, and where the next prediction is not accepted: it is then as long as it is.

    Args:
        generator: whose gate is open.
        rows: what it generated, [N]; rewards become discounted sums, "steps_to_next_obs" counts.
        num_steps: decisions of a row, 1 or more.
        gamma: discount per decision.
        choose: observations [N, ...] and masks bool [N, A] -> actions int64 [N].
    """
    places = (~rows[NEXT_TERMINATED].squeeze(1)).nonzero().squeeze(1)
    for step in range(1, num_steps):
        if not len(places):
            break
        observation, mask = rows[NEXT_OBSERVATION][places], rows[NEXT_ACTION_MASK][places]
        starts = TensorDict(
            {OBSERVATION: observation, ACTION_MASK: mask, ACTION: choose(observation, mask)},
            [len(places)],
        )
        predicted, accepted = generator.predict(starts)
        places, predicted = places[accepted], predicted[accepted]
        rows[NEXT_REWARD][places] += gamma**step * predicted[NEXT_REWARD]
        for key in _FOLLOWING:
            rows[key][places] = predicted[key]
        rows[STEPS_TO_NEXT_OBS][places] += 1
        places = places[~predicted[NEXT_TERMINATED].squeeze(1)]
    return rows
