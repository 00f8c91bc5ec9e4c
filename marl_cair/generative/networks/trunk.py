"""What both networks share: embeddings of actions, and convolutions that these steer."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

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


class Trunk(nn.Module):
    """Residual convolutions over [N, F, H, W], scaled and shifted by what `means` [N, D] say (FiLM,
    Perez et al. 2018) at the first and the last.
    """

    def __init__(self, size: NetworkSize) -> None:
        super().__init__()
        channels = size.channels
        self.film = nn.Linear(size.hidden, 4 * channels)
        self.convs = nn.ModuleList(
            nn.Conv2d(channels, channels, 3, padding=1) for _ in range(size.depth)
        )

    def forward(self, board: Tensor, means: Tensor) -> Tensor:
        film = self.film(means)[..., None, None].chunk(4, 1)
        board = functional.relu(board) * (1.0 + film[0]) + film[1]
        for conv in self.convs[:-1]:
            board = functional.relu(board + conv(board))
        board = board * (1.0 + film[2]) + film[3]
        return functional.relu(board + self.convs[-1](board))
