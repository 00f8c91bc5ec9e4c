"""`ValueHead`: by how much an edited value differs from the value that it takes over."""

from __future__ import annotations

import torch
from torch import Tensor, nn
from torch.nn import functional

NUM_VALUES = 256


class ValueHead(nn.Module):
    """Features [M, F] of M edited values -> logits [M, 256] of their differences, modulo 256.

    Clocks, purchases and damage change a value by an amount that depends on the value: each plane
    has a table of its values.
    """

    def __init__(self, num_planes: int, num_features: int) -> None:
        super().__init__()
        self.value = nn.Embedding(num_planes * NUM_VALUES, num_features)
        self.middle = nn.Linear(num_features, num_features)
        self.leave = nn.Linear(num_features, NUM_VALUES)
        self.bias = nn.Embedding(num_planes, NUM_VALUES)
        with torch.no_grad():
            self.value.weight.mul_(0.3)
            self.bias.weight.zero_()

    def forward(self, features: Tensor, plane: Tensor, base: Tensor) -> Tensor:
        """plane, base: int64 [M], the plane and the value that is edited."""
        hidden = functional.relu(features + self.value(plane * NUM_VALUES + base))
        hidden = functional.relu(hidden + self.middle(hidden))
        logits: Tensor = self.leave(hidden) + self.bias(plane)
        return logits
