"""Heads: features to action values, plain or dueling."""

import math

import torch
from torch import Tensor, nn


class PlainHead(nn.Module):
    """One dense layer: features [N, F] -> action values [N, A]; it has no action embedding."""

    def __init__(self, num_features: int, num_actions: int, embedding_size: int = 0) -> None:
        super().__init__()
        self.values = _make_linear(num_features, num_actions)

    def forward(self, features: Tensor) -> Tensor:
        values: Tensor = self.values(features)
        return values


class DuelingHead(nn.Module):
    """Q = V + advantage - mean advantage, over all A actions (Wang et al. 2016, equation 9).

    With `embedding_size` r > 0 the advantage of action a is e_a . (M f) + b_a, with e_a in R^r:
    r + 1 weights for each action instead of F + 1, but advantages of rank r.
    """

    def __init__(self, num_features: int, num_actions: int, embedding_size: int = 0) -> None:
        super().__init__()
        self.state_value = _make_linear(num_features, 1)
        self.advantage: nn.Module
        if embedding_size > 0:
            self.advantage = nn.Sequential(
                _make_linear(num_features, embedding_size),
                _make_linear(embedding_size, num_actions),
            )
        else:
            self.advantage = _make_linear(num_features, num_actions)

    def forward(self, features: Tensor) -> Tensor:
        advantage = self.advantage(features)
        values: Tensor = self.state_value(features) + advantage - advantage.mean(-1, keepdim=True)
        return values


def _make_linear(num_inputs: int, num_outputs: int) -> nn.Linear:
    """Return a dense layer; the variance of its outputs does not depend on its sizes."""
    layer = nn.Linear(num_inputs, num_outputs)
    with torch.no_grad():
        layer.weight.normal_(0.0, 1.0 / math.sqrt(num_inputs))
        layer.bias.zero_()
    return layer
