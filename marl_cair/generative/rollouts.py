"""Generated transitions as long as real ones: several decisions, of which the last are made up."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, cast

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.generative.generator import Generator
from marl_cair.replay.buffer import EpisodeReplayBuffer
from marl_cair.replay.transition import (
    ACTION,
    ACTION_MASK,
    EXPERIENCE_KEYS,
    NEXT_ACTION_MASK,
    NEXT_DONE,
    NEXT_OBSERVATION,
    NEXT_REWARD,
    NEXT_TERMINATED,
    OBSERVATION,
    STEPS_TO_NEXT_OBS,
)

Choose = Callable[[Tensor, Tensor], Tensor]

_KEYS = (*EXPERIENCE_KEYS, STEPS_TO_NEXT_OBS)
_FOLLOWING = (NEXT_OBSERVATION, NEXT_ACTION_MASK, NEXT_TERMINATED, NEXT_DONE)
_MAX_ROUNDS = 4  # of proposals, if many are turned away


class Rollouts(NamedTuple):
    """What generated rows are made of: steps as they were, then steps that are generated."""

    num_real: int  # 0: the first step is generated too, of any legal action in a share of the rows
    num_generated: int  # 1 or more
    gamma: float  # discount per decision


@torch.no_grad()
def generate_rows(
    generator: Generator,
    real: EpisodeReplayBuffer,
    num_rows: int,
    rollouts: Rollouts,
    choose: Choose,
) -> TensorDict:
    """Up to `num_rows` generated transitions [N]; fewer where too many are turned away.

    Rows of one decision, be they generated or real, hold back a learner whose other rows are
    returns of several. So a generated row goes on from where real steps have led, with what the
    learner would do there now (model-based value expansion, Feinberg et al. 2018). Where the game
    ended within those steps it is the last of them that is generated anew.

    generator: whose gate is open. choose: observations [N, ...] and masks bool [N, A] -> actions
    int64 [N]. The rows have EXPERIENCE_KEYS and "steps_to_next_obs"; rewards are discounted sums.
    """
    num_real, num_generated, gamma = rollouts
    if num_real == 0:
        first = generator.generate(real.sample_steps(num_rows), num_rows).select(*_KEYS)
        return extend_rollouts(generator, first, num_generated - 1, gamma, choose)
    made: list[TensorDict] = []
    missing = num_rows
    for _ in range(_MAX_ROUNDS):
        if missing <= 0:
            break
        made.append(_go_on(generator, real, missing, rollouts, choose))
        missing -= len(made[-1])
    return cast(TensorDict, torch.cat(made))


def _go_on(
    generator: Generator,
    real: EpisodeReplayBuffer,
    num_rows: int,
    rollouts: Rollouts,
    choose: Choose,
) -> TensorDict:
    """Those of `num_rows` real beginnings whose first generated step is accepted."""
    heads = real.sample_steps(num_rows, rollouts.num_real)
    ended = heads[NEXT_DONE].squeeze(1)
    lengths = heads[STEPS_TO_NEXT_OBS].squeeze(1)
    begun = [heads[~ended].select(*_KEYS)]
    for length in range(2, rollouts.num_real + 1):
        index = heads["index"][ended & (lengths == length)]
        if len(index):
            begun.append(real.read_steps(index, length - 1).select(*_KEYS))
    rows = cast(TensorDict, torch.cat(begun))
    before = rows[STEPS_TO_NEXT_OBS].clone()
    rows = extend_rollouts(generator, rows, rollouts.num_generated, rollouts.gamma, choose)
    made = [rows[(rows[STEPS_TO_NEXT_OBS] > before).squeeze(1)]]
    last = heads[ended & (lengths == 1)]
    if len(last):
        predicted, accepted = generator.predict(last)
        made.append(predicted[accepted].select(*_KEYS))
    return cast(TensorDict, torch.cat(made))


@torch.no_grad()
def extend_rollouts(
    generator: Generator, rows: TensorDict, num_steps: int, gamma: float, choose: Choose
) -> TensorDict:
    """Lengthen transitions [N] by up to `num_steps` generated decisions, in place.

    A row ends where its game does, and where the next prediction is not accepted: it is then as
    long as it is. rows: EXPERIENCE_KEYS and "steps_to_next_obs"; the rest as `generate_rows`.
    """
    places = (~rows[NEXT_DONE].squeeze(1)).nonzero().squeeze(1)
    for _ in range(num_steps):
        if not len(places):
            break
        observation, mask = rows[NEXT_OBSERVATION][places], rows[NEXT_ACTION_MASK][places]
        starts = TensorDict(
            {OBSERVATION: observation, ACTION_MASK: mask, ACTION: choose(observation, mask)},
            [len(places)],
        )
        predicted, accepted = generator.predict(starts)
        places, predicted = places[accepted], predicted[accepted]
        discounts = gamma ** rows[STEPS_TO_NEXT_OBS][places].double()
        rows[NEXT_REWARD][places] += (discounts * predicted[NEXT_REWARD]).float()
        for key in _FOLLOWING:
            rows[key][places] = predicted[key]
        rows[STEPS_TO_NEXT_OBS][places] += 1
        places = places[~predicted[NEXT_TERMINATED].squeeze(1)]
    return rows
