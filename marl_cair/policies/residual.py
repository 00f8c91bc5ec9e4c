"""The `residual` body: stages of residual blocks, then one dense layer."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

import torch
from torch import Tensor, nn

from marl_cair.policies.body import Body, make_dense, require_planes
from marl_cair.policies.conv import SMALL_BOARD_MAX_SIDE, ConvLayer

if TYPE_CHECKING:
    from marl_cair.policies.config import QNetworkConfig

STAGES = (16, 32, 32)  # planes
NUM_BLOCKS = 2  # of a stage
MAX_MAP_CELLS = 121  # before the dense layer: 11 x 11, of images 84 x 84
POOLING = ConvLayer(0, 3, 2, 1)


class ResidualBody(Body):
    """Planes float32 [N, C, H, W] -> features float32 [N, F].

    The large network of IMPALA (Espeholt et al. 2018, figure 3): three stages of 16, 32 and 32
    planes, each a convolution 3x3, max-pooling 3x3 of stride 2, and two blocks x + conv(relu(conv(
    relu(x)))). The first stage of boards up to 20 x 20 does not pool: one cell may decide a game.
    Further stages bound the dense layer for any input size.
    """

    READS_CHANNELS_LAST: ClassVar[bool] = True

    def __init__(self, observation_shape: Sequence[int], config: "QNetworkConfig") -> None:
        super().__init__(observation_shape, config)
        num_planes, num_rows, num_columns = require_planes("residual", observation_shape)
        is_small = max(num_rows, num_columns) <= SMALL_BOARD_MAX_SIDE
        layers: list[nn.Module] = []
        num_stages = 0
        while num_stages < len(STAGES) or num_rows * num_columns > MAX_MAP_CELLS:
            channels = STAGES[min(num_stages, len(STAGES) - 1)]
            layers.append(nn.Conv2d(num_planes, channels, 3, padding=1))
            if num_stages > 0 or not is_small:
                layers.append(nn.MaxPool2d(3, 2, 1))
                num_rows, num_columns = POOLING.shrink(num_rows), POOLING.shrink(num_columns)
            layers.extend(ResidualBlock(channels, config.norm) for _ in range(NUM_BLOCKS))
            num_planes, num_stages = channels, num_stages + 1
        self.stages = nn.Sequential(*layers, nn.ReLU())
        self.dense = make_dense(num_planes * num_rows * num_columns, self.num_features, config.norm)

    def forward(self, observation: Tensor) -> Tensor:
        planes = observation.contiguous(memory_format=torch.channels_last)
        features: Tensor = self.dense(self.stages(planes).flatten(1))
        return features


class ResidualBlock(nn.Module):
    """Planes [N, C, H, W] -> planes of the same shape: x + conv(relu(conv(relu(x)))), kernels 3x3.

    With `norm` "layer" each ReLU reads normalised planes (He et al. 2016b, pre-activation).
    """

    def __init__(self, channels: int, norm: str) -> None:
        super().__init__()
        layers: list[nn.Module] = []
        for _ in range(2):
            if norm == "layer":
                layers.append(nn.GroupNorm(1, channels))
            layers += [nn.ReLU(), nn.Conv2d(channels, channels, 3, padding=1)]
        self.layers = nn.Sequential(*layers)

    def forward(self, planes: Tensor) -> Tensor:
        changes: Tensor = self.layers(planes)
        return planes + changes
