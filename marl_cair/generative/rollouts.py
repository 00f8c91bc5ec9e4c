"""Generated transitions as long as real ones: several decisions, of which the last are made up."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

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

_KEYS = (*EXPERIENCE_KEYS, STEPS_TO_NEXT_OBS)
_FOLLOWING = (NEXT_OBSERVATION, NEXT_ACTION_MASK, NEXT_TERMINATED, NEXT_DONE)


@dataclass(frozen=True)
class Rollouts:
    """Makes transitions of steps as they were, then steps that are generated.

    Rows of one decision, be they generated or real, hold back a learner whose other rows are
    returns of several. So a generated row goes on from where real steps have led, with what the
    learner would do there now (model-based value expansion, Feinberg et al. 2018). Where the game
    ended within those steps it is the last of them that is generated anew.

    Args:
        generator: whose gate is open.
        choose: observations [N, ...] and masks bool [N, A] -> actions int64 [N] of the learner.
        num_real: steps as they were; 0: the first step is generated too, of any legal action in a
            share of the rows.
        num_generated: steps that follow on them, 1 or more.
        gamma: discount per decision.
        max_rounds: of proposals in one call, if many are turned away.
    """

    generator: Generator
    choose: Callable[[Tensor, Tensor], Tensor]
    num_real: int
    num_generated: int
    gamma: float
    max_rounds: int

    @torch.no_grad()
    def generate(self, real: EpisodeReplayBuffer, num_rows: int) -> TensorDict:
        """Up to `num_rows` transitions [N]; fewer where too many are turned away.

        They have EXPERIENCE_KEYS and "steps_to_next_obs"; rewards are discounted sums.
        """
        if self.num_real == 0:
            first = self.generator.generate(real.sample_steps(num_rows), num_rows).select(*_KEYS)
            return self.extend(first, self.num_generated - 1)
        made: list[TensorDict] = []
        missing = num_rows
        for _ in range(self.max_rounds):
            if missing <= 0:
                break
            made.append(self._go_on(real, missing))
            missing -= len(made[-1])
        return cast(TensorDict, torch.cat(made))

    def _go_on(self, real: EpisodeReplayBuffer, num_rows: int) -> TensorDict:
        """Those of `num_rows` real beginnings whose first generated step is accepted."""
        heads = real.sample_steps(num_rows, self.num_real)
        ended = heads[NEXT_DONE].squeeze(1)
        lengths = heads[STEPS_TO_NEXT_OBS].squeeze(1)
        begun = [heads[~ended].select(*_KEYS)]
        for length in range(2, self.num_real + 1):
            index = heads["index"][ended & (lengths == length)]
            if len(index):
                begun.append(real.read_steps(index, length - 1).select(*_KEYS))
        rows = cast(TensorDict, torch.cat(begun))
        before = rows[STEPS_TO_NEXT_OBS].clone()
        rows = self.extend(rows, self.num_generated)
        made = [rows[(rows[STEPS_TO_NEXT_OBS] > before).squeeze(1)]]
        last = heads[ended & (lengths == 1)]
        if len(last):
            predicted, accepted = self.generator.predict(last)
            made.append(predicted[accepted].select(*_KEYS))
        return cast(TensorDict, torch.cat(made))

    @torch.no_grad()
    def extend(self, rows: TensorDict, num_steps: int) -> TensorDict:
        """Lengthen transitions [N] by up to `num_steps` generated decisions, in place.

        A row ends where its game does, and where the next prediction is not accepted: it is then
        as long as it is. rows: EXPERIENCE_KEYS and "steps_to_next_obs".
        """
        places = (~rows[NEXT_DONE].squeeze(1)).nonzero().squeeze(1)
        for _ in range(num_steps):
            if not len(places):
                break
            observation, mask = rows[NEXT_OBSERVATION][places], rows[NEXT_ACTION_MASK][places]
            action = self.choose(observation, mask)
            starts = {OBSERVATION: observation, ACTION_MASK: mask, ACTION: action}
            predicted, accepted = self.generator.predict(TensorDict(starts, [len(places)]))
            places, predicted = places[accepted], predicted[accepted]
            discounts = self.gamma ** rows[STEPS_TO_NEXT_OBS][places].double()
            rows[NEXT_REWARD][places] += (discounts * predicted[NEXT_REWARD]).float()
            for key in _FOLLOWING:
                rows[key][places] = predicted[key]
            rows[STEPS_TO_NEXT_OBS][places] += 1
            places = places[~predicted[NEXT_TERMINATED].squeeze(1)]
        return rows
