"""The `conv` body: three convolutions by board size, then one dense layer."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar, NamedTuple

import torch
from torch import Tensor, nn

from marl_cair.policies.body import Body, is_image, make_dense, require_planes

if TYPE_CHECKING:
    from marl_cair.policies.config import QNetworkConfig

SMALL_BOARD_MAX_SIDE = 20  # tiles
MAX_MAP_CELLS = 100  # before the dense layer: about 1.6 M weights


class ConvLayer(NamedTuple):
    """One square convolution; sizes in cells."""

    channels: int
    kernel: int
    stride: int
    padding: int

    def shrink(self, side: int) -> int:
        """Return the side of the output map for an input of `side` cells."""
        return (side + 2 * self.padding - self.kernel) // self.stride + 1


SMALL_BOARD = (ConvLayer(32, 3, 1, 1), ConvLayer(64, 3, 2, 1), ConvLayer(64, 3, 1, 1))
LARGE_BOARD = (ConvLayer(32, 3, 2, 1), ConvLayer(64, 3, 2, 1), ConvLayer(64, 3, 1, 1))
IMAGE = (ConvLayer(32, 8, 4, 0), ConvLayer(64, 4, 2, 0), ConvLayer(64, 3, 1, 0))  # as for Atari
EXTRA = ConvLayer(64, 3, 2, 1)


class ConvBody(Body):
    """Planes float32 [N, C, H, W] -> features float32 [N, F].

    The first layer keeps a board's resolution: one cell may decide a game. Images have the layers
    of Mnih et al. 2015 (Nature 518, Methods). Further layers of stride 2 bound the dense layer for
    any input size. `policy.conv_channels` and `policy.conv_strides` replace the layers.
    """

    READS_CHANNELS_LAST: ClassVar[bool] = True

    def __init__(self, observation_shape: Sequence[int], config: "QNetworkConfig") -> None:
        super().__init__(observation_shape, config)
        num_planes, num_rows, num_columns = require_planes("conv", observation_shape)
        shape = (num_planes, num_rows, num_columns)
        layers, num_cells = choose_layers(shape, config.conv_channels, config.conv_strides)
        self.convolutions = stack_convolutions(num_planes, layers, config.norm)
        num_inputs = layers[-1].channels * num_cells
        self.dense = make_dense(num_inputs, self.num_features, config.norm)

    def forward(self, observation: Tensor) -> Tensor:
        # Channels last is 10 to 25 % faster on CPU, and suits tensor cores.
        planes = observation.contiguous(memory_format=torch.channels_last)
        features: Tensor = self.dense(self.convolutions(planes).flatten(1))
        return features


def choose_layers(
    shape: Sequence[int], channels: Sequence[int] = (), strides: Sequence[int] = ()
) -> tuple[tuple[ConvLayer, ...], int]:
    """Return the layers for a board or image [C, H, W], and the cells of their last map.

    channels: of each layer; empty: by the size of the input. strides: of 3 x 3 kernels, one for
    each of `channels`; empty: kernels and strides by the size of the input.
    """
    layers: tuple[ConvLayer, ...]
    _, num_rows, num_columns = shape
    if is_image(shape):
        layers = IMAGE
    elif max(num_rows, num_columns) > SMALL_BOARD_MAX_SIDE:
        layers = LARGE_BOARD
    else:
        layers = SMALL_BOARD
    layers = replace_layers(layers, channels, strides)
    for layer in layers:
        num_rows, num_columns = layer.shrink(num_rows), layer.shrink(num_columns)
    while num_rows * num_columns > MAX_MAP_CELLS:
        layers = (*layers, EXTRA)
        num_rows, num_columns = EXTRA.shrink(num_rows), EXTRA.shrink(num_columns)
    return layers, num_rows * num_columns


def replace_layers(
    layers: Sequence[ConvLayer], channels: Sequence[int], strides: Sequence[int]
) -> tuple[ConvLayer, ...]:
    """Return `layers` with other channels; with `strides`, 3 x 3 kernels of these in their place.
    Without `channels` they stay.
    """
    if strides:
        sizes = zip(channels, strides, strict=True)
        return tuple(ConvLayer(count, 3, stride, 1) for count, stride in sizes)
    if channels:
        by_size = zip(layers, channels, strict=True)
        return tuple(layer._replace(channels=count) for layer, count in by_size)
    return tuple(layers)


def stack_convolutions(
    num_planes: int, layers: Sequence[ConvLayer], norm: str = "none"
) -> nn.Sequential:
    """Return the convolutions, each followed by a normalisation over the whole map (`norm` "layer")
    and a ReLU; the first reads `num_planes` planes.
    """
    stack: list[nn.Module] = []
    for layer in layers:
        stack.append(
            nn.Conv2d(num_planes, layer.channels, layer.kernel, layer.stride, layer.padding)
        )
        if norm == "layer":
            stack.append(nn.GroupNorm(1, layer.channels))
        stack.append(nn.ReLU())
        num_planes = layer.channels
    return nn.Sequential(*stack)
