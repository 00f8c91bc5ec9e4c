"""`ActionReader`: embeddings of the kinds of all players' actions."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from marl_cair.generative.settings import GeneratorSpec, NetworkSize


class ActionReader(nn.Module):
    """Actions int64 [N] and those of the other seats [N, O], -1 where unknown -> [N, D]."""

    kinds: Tensor

    def __init__(self, spec: GeneratorSpec, size: NetworkSize) -> None:
        super().__init__()
        # The last one, -1, is of unknown actions.
        self.register_buffer("kinds", torch.tensor((*spec.kinds, spec.num_kinds)), persistent=False)
        self.own = nn.Embedding(spec.num_kinds, size.action_embedding)
        self.others = nn.Embedding(spec.num_kinds + 1, size.action_embedding)
        self.num_features = 2 * size.action_embedding

    def forward(self, action: Tensor, others: Tensor) -> Tensor:
        own, theirs = self.own(self.kinds[action]), self.others(self.kinds[others]).sum(1)
        return torch.cat([own, theirs], 1)
