"""Heads: features to action values (plain, dueling) or quantiles of returns, and noisy layers."""

import math
from itertools import pairwise

import torch
from torch import Tensor, nn
from torch.nn import functional

FIRST_NOISE = 0.5  # sigma_0 of Fortunato et al. 2018


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
