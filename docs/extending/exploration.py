"""An exploration: Boltzmann, which samples from the softmax over the legal values.

No change of marl_cair is needed. With this file in the current folder:

    marl-cair train exploration.kind=exploration:Boltzmann exploration.anneal_frames=50000
"""

import torch

from marl_cair.training.collecting.exploration import Exploration


class Boltzmann(Exploration):
    """Temperature from `exploration.epsilon_start` to `epsilon_end`, in `anneal_frames` steps."""

    def __call__(self, values, action_mask, generator, frames):
        """Return actions int64 [N] for values float32 [N, A] and a mask bool [N, A]."""
        temperature = max(self.settings.epsilon_at(frames), 1e-6)
        logits = (values / temperature).masked_fill(~action_mask, -torch.inf)
        chances = logits.softmax(-1).cpu()  # the generator is on the CPU
        return torch.multinomial(chances, 1, generator=generator).squeeze(1).to(values.device)
