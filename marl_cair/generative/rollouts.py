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
    """About `num_rows` transitions [N], generated ones; fewer where too many are turned away.

    A learner whose real rows are returns of several decisions learns more slowly by a fifth of rows
    of one, be they generated or real. So a generated row goes on from where real steps have led,
    with what the learner would do there now (model-based value expansion, Feinberg et al. 2018).
    Where the game ended on the way there is nowhere to go on from: of such a row the first step is
    generated, and no other, so that ends are no rarer than they are.

    generator: whose gate is open. choose: observations [N, ...] and masks bool [N, A] -> actions
    int64 [N]. The rows have EXPERIENCE_KEYS and "steps_to_next_obs"; rewards are discounted sums.
    """
    made: list[TensorDict] = []
    missing = num_rows
    for _ in range(_MAX_ROUNDS):
        if missing <= 0:
            break
        made.append(_make(generator, real, missing, rollouts, choose))
        missing -= len(made[-1])
    return cast(TensorDict, torch.cat(made))


def _make(
    generator: Generator,
    real: EpisodeReplayBuffer,
    num_rows: int,
    rollouts: Rollouts,
    choose: Choose,
) -> TensorDict:
    num_real, num_generated, gamma = rollouts
    if num_real == 0:
        first = generator.generate(real.sample_steps(num_rows), num_rows).select(*_KEYS)
        return extend_rollouts(generator, first, num_generated - 1, gamma, choose)
    heads = real.sample_steps(num_rows, num_real)
    ended = heads[NEXT_DONE].squeeze(1)
    grown = extend_rollouts(generator, heads[~ended].select(*_KEYS), num_generated, gamma, choose)
    parts = [grown[(grown[STEPS_TO_NEXT_OBS] > heads[~ended][STEPS_TO_NEXT_OBS]).squeeze(1)]]
    if ended.any():
        starts = real.read_steps(heads["index"][ended])
        parts.append(generator.generate(starts, len(starts)).select(*_KEYS))
    return cast(TensorDict, torch.cat(parts))


@torch.no_grad()
def extend_rollouts(
    generator: Generator, rows: TensorDict, num_steps: int, gamma: float, choose: Choose
) -> TensorDict:
    """Lengthen transitions [N] by up to `num_steps` generated decisions, in place.

    A row ends where its game does, and where the next prediction is not accepted: it is then as
    long as it is. Arguments as those of `generate_rows`.
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
