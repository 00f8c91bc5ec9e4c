"""Multi-step generated transitions: real steps, continued by generated ones."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, cast

import torch
from tensordict import TensorDict
from torch import Tensor

from marl_cair.generative.generator import Generator
from marl_cair.generative.settings import MAX_ROUNDS
from marl_cair.policies.actor import masked_argmax
from marl_cair.replay import transition
from marl_cair.replay.buffer import EpisodeReplayBuffer
from marl_cair.replay.transition import NEXT_DONE, NEXT_REWARD, OTHER_ACTIONS, STEPS_TO_NEXT_OBS

_KEYS = (*transition.EXPERIENCE_KEYS, STEPS_TO_NEXT_OBS)
_STATE_KEYS = ("observation", "action_mask", OTHER_ACTIONS)
_FOLLOWING = (
    *(transition.NEXT_OBSERVATION, transition.NEXT_ACTION_MASK),
    *(transition.NEXT_TERMINATED, NEXT_DONE),
)


class Unroll(Protocol):
    """Values of sequences by a network with memory (`QNetwork.unroll`)."""

    def __call__(
        self, observations: Tensor, state: Tensor, starts: Tensor
    ) -> tuple[Tensor, Tensor]:
        """[T, N, ...], [N, S] before them, bool [T, N] -> values [T, N, A], states [T, N, S]."""


@dataclass(frozen=True)
class Rollouts:
    """Makes transitions of real steps followed by generated steps.

    One-step rows hurt a learner whose other rows are n-step returns. A generated row therefore
    continues real steps, with the learner's present actions (model-based value expansion, Feinberg
    et al. 2018). If the episode ended within the real steps, the last of them is generated instead.

    generator: its gate is open.
    choose: observations [N, ...] and masks bool [N, A] -> actions int64 [N] of the learner.
    num_real: real steps; 0: the first step is generated too, by `Generator.generate`.
    num_generated: generated steps, 1 or more.
    gamma: discount per step.
    """

    generator: Generator
    choose: Callable[[Tensor, Tensor], Tensor]
    num_real: int
    num_generated: int
    gamma: float

    @torch.no_grad()
    def generate(self, real: EpisodeReplayBuffer, num_rows: int) -> TensorDict:
        """Return up to `num_rows` transitions [N]; fewer if too many are rejected.

        They have EXPERIENCE_KEYS and "steps_to_next_obs"; rewards are discounted sums.
        """
        if self.num_real == 0:
            first = self.generator.generate(real.sample_steps(num_rows), num_rows).select(*_KEYS)
            return self.extend(first, self.num_generated - 1)
        made: list[TensorDict] = []
        missing = num_rows
        for _ in range(MAX_ROUNDS):
            if missing <= 0:
                break
            made.append(self._continue_real(real, missing))
            missing -= len(made[-1])
        return cast(TensorDict, torch.cat(made))

    @torch.no_grad()
    def branch(self, real: EpisodeReplayBuffer, num_rows: int, length: int) -> TensorDict:
        """Roll-outs of up to `length` one-step transitions from real states, with the learner's
        actions: up to `num_rows` transitions [N] in all.

        A roll-out stops at the end of its episode, and before a prediction that is rejected (MBPO,
        Janner et al. 2019).
        """
        starts = real.sample_steps(-(-num_rows // length))
        keys = [key for key in _STATE_KEYS if key in starts]
        starts, made = starts.select(*keys), []
        for _ in range(length):
            starts["action"] = self.choose(starts["observation"], starts["action_mask"])
            rows, accepted = self.generator.predict(starts)
            rows = rows[accepted]
            made.append(rows.select(*_KEYS))
            going_on = ~rows[transition.NEXT_TERMINATED].squeeze(1)
            starts = rows[going_on]["next"].select("observation", "action_mask")
            if not len(starts):
                break
        return cast(TensorDict, torch.cat(made)[:num_rows])

    def _continue_real(self, real: EpisodeReplayBuffer, num_rows: int) -> TensorDict:
        """Continue `num_rows` real starts; return those whose first generated step is accepted."""
        heads = real.sample_steps(num_rows, self.num_real)
        ended = heads[NEXT_DONE].squeeze(1)
        lengths = heads[STEPS_TO_NEXT_OBS].squeeze(1)
        begun = [heads[~ended]]
        for length in range(2, self.num_real + 1):
            index = heads["index"][ended & (lengths == length)]
            if len(index):
                begun.append(real.read_steps(index, length - 1))
        rows = cast(TensorDict, torch.cat(begun))
        before = rows[STEPS_TO_NEXT_OBS].clone()
        others = real.storage.find_others_after(rows["index"], before.squeeze(1))
        rows = self.extend(rows.select(*_KEYS), self.num_generated, others)
        made = [rows[(rows[STEPS_TO_NEXT_OBS] > before).squeeze(1)]]
        last = heads[ended & (lengths == 1)]
        if len(last):
            predicted, accepted = self.generator.predict(last)
            made.append(predicted[accepted].select(*_KEYS))
        return cast(TensorDict, torch.cat(made))

    @torch.no_grad()
    def extend(self, rows: TensorDict, num_steps: int, others: Tensor | None = None) -> TensorDict:
        """Extend transitions [N] by up to `num_steps` generated steps, in place.

        A row stops at the end of its episode, and if the next prediction is rejected.
        rows: EXPERIENCE_KEYS and "steps_to_next_obs". others: actions of the other seats in the
        first of these steps, int64 [N, O], if they are known.
        """
        places = (~rows[NEXT_DONE].squeeze(1)).nonzero().squeeze(1)
        for _ in range(num_steps):
            if not len(places):
                break
            starts = rows[places]["next"].select("observation", "action_mask")
            starts["action"] = self.choose(starts["observation"], starts["action_mask"])
            if others is not None:
                starts[OTHER_ACTIONS], others = others[places], None
            predicted, accepted = self.generator.predict(starts)
            places, predicted = places[accepted], predicted[accepted]
            discounts = self.gamma ** rows[STEPS_TO_NEXT_OBS][places].double()
            rows[NEXT_REWARD][places] += (discounts * predicted[NEXT_REWARD]).float()
            for key in _FOLLOWING:
                rows[key][places] = predicted[key]
            rows[STEPS_TO_NEXT_OBS][places] += 1
            places = places[~predicted[transition.NEXT_TERMINATED].squeeze(1)]
        return rows


@torch.no_grad()
def imagine_sequences(
    generator: Generator, unroll: Unroll, rows: TensorDict, num_steps: int
) -> TensorDict:
    """Real sequences [N, T] whose last `num_steps` steps are generated, for networks with memory.

    The real entries before them only give the state. The steps take the actions that `unroll`
    values most, and a sequence stops at its end, and before a prediction that is rejected: of the
    M returned, each has one generated step or more, and these alone are "learned".

    rows: as `EpisodeReplayBuffer.sample` gives them; where the first of these steps is not
    "learned", a sequence is left out. num_steps: 1..T - 1.
    """
    first = rows.shape[1] - 1 - num_steps
    made = rows[rows["learned"][:, first]].clone()
    if not len(made):
        return made
    made["learned"].fill_(False)
    made["starts"][:, first + 1 :] = False
    transition.mark_generated(made)
    for key in ("observation", "action_mask"):
        made[key][:, first + 1 :] = made[key][:, first : first + 1]
    seen, starts = made["observation"].transpose(0, 1), made["starts"].T  # views
    state, alive = made["state"][:, 0], torch.arange(len(made))
    if first:
        state = unroll(seen[:first], state, starts[:first])[1][-1]
    for entry in range(first, first + num_steps):
        values, states = unroll(seen[entry : entry + 1], state, starts[entry : entry + 1])
        state = states[-1]
        step = made[:, entry][alive].select("observation", "action_mask", "action")
        step["action"] = masked_argmax(values[0, alive], step["action_mask"])
        predicted, accepted = generator.predict(step)
        alive, predicted = alive[accepted], predicted[accepted]
        made["learned"][alive, entry] = True
        made["action"][alive, entry] = predicted["action"]
        made["reward"][alive, entry] = predicted[NEXT_REWARD][:, 0]
        made["terminated"][alive, entry] = ends = predicted[transition.NEXT_TERMINATED][:, 0]
        for key in ("observation", "action_mask"):  # what is not known repeats the last known entry
            made[key][alive, entry + 1 :] = predicted["next", key].unsqueeze(1)
        alive = alive[~ends]
        if not len(alive):
            break
    return made[made["learned"].any(1)]
