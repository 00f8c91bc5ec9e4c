"""A loss: deep Q-learning with mellowmax in place of max and target network (Kim et al. 2019).

No change of marl_cair is needed. With this file in the current folder:

    marl-cair train learner.algorithm=loss:Mellowmax
"""

import torch

from marl_cair.training.losses import Loss, compare, find_targets, mask_values

OMEGA = 10.0


class Mellowmax(Loss):
    """Target: R + gamma^k log(mean of exp(omega Q(s', a')) over the legal a') / omega."""

    LEARNS_FROM_REPLAY = True
    HAS_TARGET_NETWORK = False

    def __call__(self, network, target, batch):
        """Return the loss, TD errors [N] and values [N, A] of a batch [N] of transitions."""
        following = batch["next"]
        with torch.no_grad():
            mask = following["action_mask"]
            values = mask_values(network(following["observation"]), mask)
            count = mask.sum(-1).clamp_min(1)  # none may be legal after the end
            ahead = ((OMEGA * values).logsumexp(-1) - count.log()) / OMEGA
            wanted = find_targets(batch, ahead, self.settings.gamma)
        return compare(network(batch["observation"]), batch, wanted, self.settings.loss)
