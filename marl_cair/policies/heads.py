"""Heads: features to action values (plain, dueling, naf) or quantiles of returns; noisy layers."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from marl_cair.policies.config import NO_CELL

FIRST_NOISE = 0.5  # sigma_0 of Fortunato et al. 2018
FIRST_STEEPNESS = 0.1  # of NafHead: the farthest points are 0.06 below the best one initially


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
        self.advantage = _make_advantage(num_features, num_actions, embedding_size)

    def forward(self, features: Tensor) -> Tensor:
        advantage = self.advantage(features)
        values: Tensor = self.state_value(features) + advantage - advantage.mean(-1, keepdim=True)
        return values


class QuantileHead(nn.Module):
    """Features [N, F] -> K quantiles of the return of each action, float32 [N, A, K].

    Quantile i estimates the return at probability (2 i - 1) / (2 K) (Dabney et al. 2018, lemma 2);
    the mean over all K is the action value. Each quantile is dueling, as the atoms of Rainbow are
    (Hessel et al. 2018): theta_ai = V_i + A_ai - mean_a A_ai; `embedding_size` as `DuelingHead`.
    """

    def __init__(
        self, num_features: int, num_actions: int, embedding_size: int, num_quantiles: int
    ) -> None:
        super().__init__()
        self.num_quantiles = num_quantiles
        self.state_value = _make_linear(num_features, num_quantiles)
        num_outputs = num_actions * num_quantiles
        self.advantage = _make_advantage(num_features, num_outputs, embedding_size)

    def forward(self, features: Tensor) -> Tensor:
        advantage = self.advantage(features).unflatten(-1, (-1, self.num_quantiles))
        value = self.state_value(features).unsqueeze(-2)
        quantiles: Tensor = value + advantage - advantage.mean(-2, keepdim=True)
        return quantiles


class NafHead(nn.Module):
    """Normalised advantage functions (Gu et al. 2016) of actions that are points u in [-1, 1]^3.

    Q(s, u) = V(s) - 1/2 |L(s)^T (u - mu(s))|^2, with L lower triangular and its diagonal positive.
    The best point is mu; values are those of the game's actions, whose points `find_points` gives:
    the best legal one is the nearest to mu by L. Each row of a batch teaches the values of all.
    """

    points: Tensor
    places: Tensor

    def __init__(
        self, num_features: int, num_actions: int, embedding_size: int, points: Tensor
    ) -> None:
        super().__init__()
        self.register_buffer("points", points, persistent=False)
        self.num_axes = size = points.shape[1]
        self.state_value = _make_linear(num_features, 1)
        self.best = _make_linear(num_features, size)
        self.factor = _make_linear(num_features, size * (size + 1) // 2)  # the diagonal first
        places = np.full((size, size), size * (size + 1) // 2)  # above the diagonal: 0
        places[np.diag_indices(size)] = np.arange(size)
        places[np.tril_indices(size, -1)] = np.arange(size, size * (size + 1) // 2)
        self.register_buffer("places", torch.from_numpy(places.ravel()), persistent=False)

    def forward(self, features: Tensor) -> Tensor:
        size, entries = self.num_axes, self.factor(features)
        diagonal, below = FIRST_STEEPNESS * entries[:, :size].exp(), entries[:, size:]
        entries = functional.pad(torch.cat([diagonal, below], 1), (0, 1))
        factor = entries.index_select(1, self.places).view(-1, size, size)
        away = self.points - self.best(features).tanh().unsqueeze(1)
        advantage = -0.5 * (away @ factor).square().sum(-1)
        values: Tensor = self.state_value(features) + advantage
        return values


def find_points(kinds: Sequence[int], cells: Sequence[int], board: tuple[int, int]) -> Tensor:
    """Actions as points float32 [A, 3]: kind, row and column of the cell, the centres of even parts
    of -1..1 (as `games.action_forms.ContinuousActions`); row and column are 0 without a cell.

    kinds: of each action, 0..G-1. cells: row * columns + column, or NO_CELL. board: rows, columns.
    """
    cell = np.array(cells)
    places = np.stack([np.array(kinds), cell // board[1], cell % board[1]], 1)
    points = (2.0 * places + 1.0) / np.array([max(kinds) + 1, *board]) - 1.0
    points[cell == NO_CELL, 1:] = 0.0
    return torch.from_numpy(points.astype(np.float32))


class NoisyLinear(nn.Linear):
    """A dense layer with learned, factorised noise (Fortunato et al. 2018, equations 8 to 11).

    y = (W + S * f(e') f(e)^T) x + b + s * f(e'), f(x) = sign(x) sqrt(|x|), with e [inputs] and e'
    [outputs] from a standard normal distribution. Each row of a batch has its own e, so that worlds
    side by side explore apart, and all have one e': a draw of [rows, outputs] would cost as much as
    the layer. S and s begin at 0.5 / sqrt(inputs).

    Attributes:
        generator: on the CPU, of the noise; None: y = W x + b. See `set_noise`.
    """

    generator: torch.Generator | None = None

    def __init__(self, layer: nn.Linear) -> None:
        """Take over the weights of `layer`, which has a bias."""
        super().__init__(layer.in_features, layer.out_features, device="meta")
        self.weight, self.bias = layer.weight, layer.bias
        first = FIRST_NOISE / math.sqrt(layer.in_features)
        self.weight_noise = nn.Parameter(torch.full_like(layer.weight, first))
        self.bias_noise = nn.Parameter(torch.full_like(layer.bias, first))

    def forward(self, input: Tensor) -> Tensor:
        plain = functional.linear(input, self.weight, self.bias)
        if self.generator is None:
            return plain
        of_input, of_output = (
            _scale_noise(torch.randn(shape, generator=self.generator)).to(input.device)
            for shape in (input.shape, plain.shape[-1:])
        )
        noise = functional.linear(input * of_input, self.weight_noise, self.bias_noise)
        return plain + noise * of_output


def _scale_noise(drawn: Tensor) -> Tensor:
    return drawn.sign() * drawn.abs().sqrt()


def make_noisy(head: nn.Module) -> None:
    """Replace the dense layers in `head` by noisy ones with the same weights.

    Raises ValueError if it has none.
    """
    found = [
        (owner, name, layer)
        for owner in head.modules()
        for name, layer in owner.named_children()
        if type(layer) is nn.Linear and layer.bias is not None
    ]
    if not found:
        raise ValueError(
            f"noisy is True, but {type(head).__name__} holds no torch.nn.Linear with a bias: set "
            "policy.noisy=false, or use head='dueling'"
        )
    for owner, name, layer in found:
        setattr(owner, name, NoisyLinear(layer))


def set_noise(network: nn.Module, generator: torch.Generator | None) -> None:
    """Draw the noise of all noisy layers from `generator` (on the CPU); None: without noise."""
    for layer in network.modules():
        if isinstance(layer, NoisyLinear):
            layer.generator = generator


def _make_advantage(num_features: int, num_outputs: int, embedding_size: int) -> nn.Module:
    sizes = [num_features, *[embedding_size] * (embedding_size > 0), num_outputs]
    layers = [_make_linear(*pair) for pair in pairwise(sizes)]
    return nn.Sequential(*layers) if embedding_size > 0 else layers[0]


def _make_linear(num_inputs: int, num_outputs: int) -> nn.Linear:
    """Return a dense layer; the variance of its outputs does not depend on its sizes."""
    layer = nn.Linear(num_inputs, num_outputs)
    with torch.no_grad():
        layer.weight.normal_(0.0, 1.0 / math.sqrt(num_inputs))
        layer.bias.zero_()
    return layer
